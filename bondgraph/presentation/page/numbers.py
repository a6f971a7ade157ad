"""Arrays of numbers as text: little-endian in base64, which a browser turns into a typed array without reading digits."""

from __future__ import annotations

from base64 import b64encode
from typing import Any

MOST = 301  # instants kept of the data shown along a run, except plots


def packed(values: Any, single: bool = True) -> dict[str, str]:
    """Return `{"f4": …}` or `{"f8": …}`: all numbers, rows one after the other. Values that are not finite are NaN."""
    import numpy as np

    kind = "<f4" if single else "<f8"
    with np.errstate(over="ignore"):
        array = np.ascontiguousarray(values, dtype=kind)
    array = np.where(np.isfinite(array), array, np.nan).astype(kind)
    return {kind[1:]: b64encode(array.tobytes()).decode("ascii")}


def thinned(count: int, most: int = MOST) -> Any:
    """Return the indices of at most `most` of `count` instants, with both ends."""
    import numpy as np

    return np.unique(np.linspace(0, max(count - 1, 0), min(count, most)).round().astype(int)) if count else []
