"""Sampling places for signals of time, so that no narrow peak lies between them: boxes of time are halved until samples show what ranges allow.

Each operation that can be narrow (an exponential, a quotient, a high power …) is examined separately, so that a large slow signal does not
hide a small peak that is added to it. A box is finished when its range is a small part of the range of the whole segment, or when samples inside
it cover a good part of the range.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..door import Program, Ranges

BEGIN = 32  # number of boxes of a segment at the beginning
INSIDE = np.array([0.0983, 0.3029, 0.4871, 0.7082, 0.9213])  # positions of samples, as fractions of a box
SEEN = 0.25  # least fraction of a range that samples must cover
SMALL = 1e-3  # fraction of the range on the whole segment: smaller ranges are ignored
MOST = 100_000  # most boxes
NARROWEST = 64  # least width of a box, in units in the last place of a time


def resolved_places(program: Program, inputs: Any, constants: Any, mode: Any, start: float, stop: float) -> Any:
    """Return rising times within a segment that resolve all its narrow signals; an empty array where no signal is narrow."""
    functions = program.time_functions
    if functions is None or not functions.narrow or not stop > start:
        return np.empty(0)
    ranges = Ranges(functions, functions.narrow, constants, inputs)
    mode = np.asarray(mode)
    edges = np.linspace(start, stop, BEGIN + 1)
    low, high = edges[:-1], edges[1:]
    least = NARROWEST * float(np.spacing(max(abs(start), abs(stop))))
    small: Any = None
    found: list[Any] = []
    count = 0
    with np.errstate(all="ignore"):
        while len(low):
            times = low[:, None] + (high - low)[:, None] * INSIDE
            widths, shown = _widths(ranges, low, high, times, mode)
            if small is None:
                small = SMALL * np.where(np.isfinite(widths), widths, 0.0).max(axis=1, keepdims=True)
            open_ = ((widths > small) & (shown < SEEN * widths)).any(axis=0) & (high - low > least)
            count += len(low)
            found.append(times[~open_])
            if count > MOST:
                found.append(times)
                break
            middle = 0.5 * (low + high)
            low, high = np.concatenate([low[open_], middle[open_]]), np.concatenate([middle[open_], high[open_]])
    if count == BEGIN:
        return np.empty(0)  # no box was halved: regular sampling is enough
    return np.sort(np.concatenate([part.ravel() for part in found]))


def _widths(ranges: Ranges, low: Any, high: Any, times: Any, mode: Any) -> tuple[Any, Any]:
    """Return the widths of the ranges over boxes, and the widths that samples at `times` (boxes, places) show; each (operations, boxes)."""
    widths, shown = np.empty((2, len(ranges.roots), len(low)))
    values = ranges.values(times, mode)
    for number, ((a, b), value) in enumerate(zip(ranges.over(low, high, mode), values, strict=True)):
        widths[number] = b - a
        sampled = np.broadcast_to(value, times.shape)
        shown[number] = sampled.max(axis=1) - sampled.min(axis=1)
    widths[~np.isfinite(shown)] = 0.0  # the run reports values that are not finite
    return widths, shown
