"""Sampling places for signals of time, so that no narrow peak lies between them: boxes of time are halved until samples show what ranges allow.

Each operation that can be narrow (an exponential, a quotient, a high power …) is examined separately, so that a large slow signal does not
hide a small peak that is added to it. A box is finished when its range is a small part of the range of the whole segment, when samples inside
it cover a good part of its range, or when its range is about half of that of the box that it was cut from: a bound on a smooth function shrinks
with the box, however loose it is, and a peak keeps its height in the half that holds it. Segments are examined many at once.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import Any

import numpy as np

from compiler.api import Array, Program, Ranges, TimeFunctions

BEGIN = 32  # number of boxes of a segment at the beginning
TOGETHER = 256  # number of segments that are examined at once
INSIDE = np.array([0.0983, 0.3029, 0.4871, 0.7082, 0.9213])  # positions of samples, as fractions of a box
SEEN = 0.25  # least fraction of a range that samples must cover
HALVED = 0.6  # greatest fraction of the range of a box that a half of it may have to be finished
SMALL = 1e-3  # fraction of the range on the whole segment: smaller ranges are ignored
ROUNDING = 1e-12  # fraction of the largest value: smaller ranges are ignored, too
MOST = 400_000  # most boxes of a segment
NARROWEST = 64  # least width of a box, in units in the last place of a time


class Resolution:
    """Sampling places of all segments of a timeline, found when they are asked for. `edges` (segments + 1,), `modes` (segments, mode) or (0,)."""

    def __init__(self, edges: Array, modes: Array) -> None:
        self.edges, self.modes = np.asarray(edges), np.asarray(modes)
        self.ends: list[float] = self.edges[:-1].tolist()
        self.key: Any = None
        self.ranges: Ranges | None = None
        self.used: list[int] | None = None  # positions of the constants that decide
        self.found: dict[int, Any] = {}
        # signals with more peaks than are resolved, and their segments
        self.crowded: dict[tuple[str, float, float], None] = {}

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user on signals with more narrow peaks than are resolved."""
        return tuple(
            f"{name} has more narrow peaks between t = {start:.9g} s and {stop:.9g} s than {MOST} places resolve: peaks between them may have been "
            "missed; simulate a shorter time, or in several runs, or make the peaks wider"
            for name, start, stop in self.crowded
        )

    def places(self, program: Program, inputs: Array, constants: Array, mode: Array, start: float, stop: float) -> Any:
        """Return rising times within a part of one segment that resolve its narrow signals; an empty array where no signal is narrow."""
        functions = program.time_functions
        if functions is None or not functions.narrow or not stop > start:
            return np.empty(0)
        if self.used is None:
            self.used = functions.constants_of(functions.narrow)
        key = np.asarray(inputs).tobytes(), np.asarray(constants)[self.used].tobytes()
        if key != self.key or self.ranges is None:
            self.key, self.found, self.ranges = key, {}, Ranges(functions, functions.narrow, constants, inputs)
            self.crowded = {}
        ranges = self.ranges
        number = max(0, bisect_right(self.ends, 0.5 * (start + stop)) - 1)
        if ranges.moded and not np.array_equal(mode, self.modes[number] if self.modes.ndim == 2 else self.modes):
            times, crowded = _resolved(ranges, np.array([start, stop]), np.asarray(mode)[None, :])
            self._tell(functions, np.array([start, stop]), crowded)
            return times[0]
        if number not in self.found:
            first = number - number % TOGETHER
            part = slice(first, first + TOGETHER)
            modes = self.modes[part] if self.modes.ndim == 2 else self.modes
            edges = self.edges[first : first + TOGETHER + 1]
            resolved, crowded = _resolved(ranges, edges, modes)
            self.found |= dict(enumerate(resolved, first))
            self._tell(functions, edges, crowded)
        times = self.found[number]
        return times[slice(*np.searchsorted(times, (start, stop)))]

    def _tell(self, functions: TimeFunctions, edges: Array, crowded: set[tuple[int, int]]) -> None:
        """Record signals with more peaks than are resolved. `crowded`: operations and segments."""
        for operation, segment in sorted(crowded, key=lambda pair: (pair[1], pair[0])):
            key = functions.narrow_names[operation], float(edges[segment]), float(edges[segment + 1])
            self.crowded.setdefault(key)


def _resolved(ranges: Ranges, edges: Array, modes: Array) -> tuple[list[Any], set[tuple[int, int]]]:
    """Return for each segment the rising times that resolve its signals; empty where no box was halved, because regular sampling is enough.

    Also return the operations and segments with more peaks than are resolved.
    """
    count = len(edges) - 1
    shares = np.linspace(0.0, 1.0, BEGIN + 1)
    grid = edges[:-1, None] + np.diff(edges)[:, None] * shares
    low, high = grid[:, :-1].ravel(), grid[:, 1:].ravel()
    segment = np.repeat(np.arange(count), BEGIN)
    least = NARROWEST * float(np.spacing(np.abs(edges).max()))
    found: list[tuple[Any, Any]] = []
    small: Any = None
    before: Any = None
    boxes = np.zeros(count, dtype=int)
    crowded: set[tuple[int, int]] = set()
    with np.errstate(all="ignore"):
        while len(low):
            times = low[:, None] + (high - low)[:, None] * INSIDE
            lower, upper, shown = _bounds(ranges, low, high, times, modes[segment] if modes.ndim == 2 else modes)
            widths = upper - lower
            if small is None:
                small, before = _ignored(lower, upper, count), np.full_like(widths, np.nan)
            peaks = (widths > small[:, segment]) & (shown < SEEN * widths) & ~(widths <= HALVED * before)
            boxes += np.bincount(segment, minlength=count)
            open_ = peaks.any(axis=0) & (high - low > least)
            full = open_ & (boxes > MOST)[segment]
            if full.any():
                crowded |= {(i, int(s)) for i in range(len(peaks)) for s in set(segment[full & peaks[i]])}
            open_ &= ~full
            found.append((times[~open_], segment[~open_]))
            if not open_.any():
                break
            middle = 0.5 * (low + high)
            low, high = np.concatenate([low[open_], middle[open_]]), np.concatenate([middle[open_], high[open_]])
            segment, before = np.tile(segment[open_], 2), np.tile(widths[:, open_], (1, 2))
    times = np.concatenate([part.ravel() for part, _ in found])
    owners = np.concatenate([np.repeat(of, len(INSIDE)) for _, of in found])
    order = np.lexsort((times, owners))
    times, sizes = times[order], np.bincount(owners, minlength=count)
    parts = np.split(times, np.cumsum(sizes)[:-1])
    return [part if len(part) > BEGIN * len(INSIDE) else np.empty(0) for part in parts], crowded


def _ignored(lower: Array, upper: Array, count: int) -> Any:
    """Return the ranges that are too small to matter on each segment, shape (operations, segments)."""
    shape = (len(lower), count, BEGIN)
    lower, upper = (np.where(np.isfinite(x), x, np.nan).reshape(shape) for x in (lower, upper))
    greatest, smallest = np.fmax.reduce(upper, axis=2), np.fmin.reduce(lower, axis=2)
    values = np.fmax(np.abs(greatest), np.abs(smallest))
    return np.nan_to_num(np.fmax(SMALL * (greatest - smallest), ROUNDING * values))


def _bounds(ranges: Ranges, low: Array, high: Array, times: Array, mode: Array) -> tuple[Any, Any, Any]:
    """Return lower and upper bounds over boxes, and the widths that samples at `times` (boxes, places) show; each (operations, boxes)."""
    lower, upper, shown = np.empty((3, len(ranges.roots), len(low)))
    values = ranges.values(times, mode[:, None, :] if mode.ndim == 2 else mode)
    for number, ((a, b), value) in enumerate(zip(ranges.over(low, high, mode), values, strict=True)):
        lower[number], upper[number] = a, b
        sampled = np.broadcast_to(value, times.shape)
        shown[number] = sampled.max(axis=1) - sampled.min(axis=1)
    bad = ~np.isfinite(shown)
    lower[bad] = upper[bad] = 0.0  # the run reports values that are not finite
    return lower, upper, shown
