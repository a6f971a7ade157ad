"""Arrays of numbers as text: little-endian in base64, which a browser turns into a typed array without reading digits."""

from __future__ import annotations

from base64 import b64encode
from typing import Any

MOST = 301  # instants that are kept of what is shown along a run, beside the plots


def packed(values: Any, single: bool = True) -> dict[str, str]:
    """`{"f4": …}` or `{"f8": …}`: all numbers, rows one after the other. What is no finite number is NaN."""
    import numpy as np

    kind = "<f4" if single else "<f8"
    with np.errstate(over="ignore"):
        array = np.ascontiguousarray(values, dtype=kind)
    array = np.where(np.isfinite(array), array, np.nan).astype(kind)
    return {kind[1:]: b64encode(array.tobytes()).decode("ascii")}


def thinned(count: int, most: int = MOST) -> Any:
    """The places of at most so many of `count` instants, both ends among them."""
    import numpy as np

    return np.unique(np.linspace(0, max(count - 1, 0), min(count, most)).round().astype(int)) if count else []
