"""Location of zero crossings within a step: all zeros of the indicators along the dense output, then the first one narrowed down to rounding.

An indicator is approximated by a polynomial on a part of the step. The part is halved until the polynomial has converged, or is farther from zero
than its error. Zeros and minima of the polynomial show where the indicator itself is to be evaluated; a minimum that the error could hide is
examined on smaller parts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from compiler.api import Array, BoolArray, IntArray

from ...errors import RunFailed
from ...numerics.indicators import EXACT, FINER, LEFT, ON_GRID, SHARES, Interpolants
from ...numerics.roots import narrowed
from .bounds import Overlooked
from .events import Events
from .indicators import HybridState

WIDTH = 4  # units in the last place of a time: end of the narrowing
LEAST = 1e-300  # least distance from a zero crossing, so that its sign is defined
NARROWEST = 2.0**-44  # smallest part, as a fraction of the interval searched, for conditions with narrow peaks
SMALLEST = 2.0**-26  # smallest part, as a fraction of the interval searched; a jump lies at one of its places
GOLDEN = 0.5 * (5**0.5 - 1)  # share of a bracket that a golden section keeps
CONSTANT = 1e-13  # of the largest range of an indicator in a run: a smaller one is rounding
MOST_HIDDEN = 1000  # most parts that are halved for a peak that their places do not show
FEWEST = 1 / 64  # smallest first part, as a fraction of the interval searched
MOST_PARTS = 1 << 15  # most parts of the interval searched

StateAt = Callable[[Any, bool], Any]  # instants (k,), True to solve loops exactly -> states (k, n)
RootsAt = Callable[[Any, Any], Any]  # instants (k,), a mode -> roots of the conditions (k, conditions)


@dataclass(frozen=True, slots=True)
class Flip:
    """First zero crossing in a step: the instant after which conditions differ from the mode, and a mask of these conditions."""

    time: float
    state: Any
    conditions: Any


def first_flip(
    events: Events, start: float, stop: float, mode: Array, state_at: StateAt, roots: Callable[[Any, bool], Any]
) -> Flip | None:
    """Return the first zero crossing in (start, stop], or None. At the start itself the mode holds, whatever rounding leaves.

    `roots`: of the conditions, as `state_at`; shape (k, conditions). Raises `RunFailed` where an indicator changes too often to be followed.
    """
    if not len(events.places):
        return None
    said, step = np.asarray(mode)[events.places] == 1.0, _SearchedStep(events, mode, state_at, roots)
    resolved = 64 * float(np.spacing(max(abs(start), abs(stop))))
    smallest, least = (max(share * (stop - start), resolved) for share in (SMALLEST, NARROWEST))
    waiting, count, halved = _first_parts(start, stop, events.spacing), 0, 0
    while waiting:
        low, high, widths = waiting.pop()
        times = low + (high - low) * SHARES
        times[[0, -1]] = low, high
        seen = Interpolants.through(roots(times, False))
        wrong = _wrong(events, seen.values, said)
        near = ~seen.far(events.floor) | wrong[1:].any(axis=0)
        if low == start and wrong[0].any():
            near &= ~_returns(events, seen.values, wrong[0])
        bounded, moves = step.bounds((low, high), times, widths)
        hidden = np.zeros_like(near)
        if bounded is not None:
            hidden, widths = moves & (bounded.unseen | ~seen.converged), bounded.widths
            if halved > MOST_HIDDEN:
                events.crowded |= hidden
                hidden[:] = False
        if not near.any() and not hidden.any():
            continue
        count += 1
        if count > MOST_PARTS:
            raise _unresolved(events, low, np.flatnonzero((near & ~seen.converged) | hidden))
        on_grid = ON_GRID @ seen.coefficients
        dips = seen.dips(on_grid, (low == start) & (np.abs(seen.values[0]) <= LEFT * events.floor))
        if bounded is not None and halved <= MOST_HIDDEN:
            hidden |= moves & dips.any(axis=0) & ~_wrong(events, on_grid, said).any(axis=0)
        unsure = near & (~seen.converged | (dips.any(axis=0) & (seen.error > EXACT * seen.variation)))
        if (unsure.any() and high - low > smallest) or hidden.any():
            rounding = step.rounding(high, seen)
            unsure &= seen.variation > rounding
            if bounded is not None:
                hidden &= bounded.reach > rounding
        if (unsure.any() and high - low > smallest) or (hidden.any() and high - low > least):
            halved += not (unsure.any() and high - low > smallest)
            middle = 0.5 * (low + high)
            waiting += [(middle, high, widths), (low, middle, widths)]
            continue
        times = _suspects(events, on_grid, wrong, _wrong(events, on_grid, said) & seen.converged, (low, high))
        minima = step.minima((low, high), seen, dips, near & ~wrong.any(axis=0), said)
        times = np.union1d(times, minima) if minima else times
        found = _in_part(events, (low, high), times, said, roots)
        if found is not None:
            events.spacing = high - low
            there = np.array([found])
            return Flip(found, state_at(there, True)[0], _wrong(events, roots(there, True), said)[0])
    events.spacing = np.inf
    return None


@dataclass(slots=True)
class _SearchedStep:
    """Step that is searched: conditions, and their states and roots along it."""

    events: Events
    mode: Any
    state_at: StateAt
    roots: Callable[[Any, bool], Any]
    noise: Any = None  # rounding of the indicators, found on use

    def rounding(self, time: float, seen: Interpolants) -> Any:
        """Return the rounding of the indicators, at the end of the first part that needs it: smaller changes are ignored."""
        if self.noise is None:
            at = HybridState(time, self.state_at(np.array([time]), False)[0], self.mode)
            self.noise = self.events.noise(at, seen.values[-1])
        return self.noise

    def bounds(self, part: tuple[float, float], times: Array, widths: Array | None) -> tuple[Overlooked | None, Any]:
        """Return bounds on narrow conditions over a part, and a mask of those that may have a zero there and are not constant but for rounding."""
        events = self.events
        if events.bounds is None:
            return None, None
        bounded = events.bounds.over(part, times, self.state_at(times, False), self.mode, events.floor, widths)
        events.reach = np.maximum(events.reach, np.where(np.isfinite(bounded.reach), bounded.reach, 0.0))
        return bounded, np.asarray(bounded.zero, dtype=bool) & ~(bounded.reach <= CONSTANT * events.reach)

    def minima(
        self, part: tuple[float, float], seen: Interpolants, dips: BoolArray, clear: BoolArray, said: BoolArray
    ) -> list[float]:
        """Return the instants of a part at which indicators are nearest to zero; `clear`: those that no place shows behind their zero crossing."""
        brackets = [
            (FINER[p], FINER[p + 2], j) for p, j in zip(*np.nonzero(dips[1:-1] & clear & seen.converged), strict=True)
        ]
        brackets += [(0.0, 1.0, j) for j in np.flatnonzero(clear & ~seen.converged)]
        if not brackets:
            return []
        (low, high), rounding = part, self.rounding(part[1], seen)
        return [
            _bottom(self.events, (low + (high - low) * a, low + (high - low) * b), j, said, self.roots)
            for a, b, j in brackets
            if seen.variation[j] > rounding[j]
        ]


def _first_parts(start: float, stop: float, spacing: float) -> list[tuple[float, float, Any]]:
    """Return the parts of an interval that are searched first, the last one first: from `spacing` on each twice as long as that before.
    The third item of a part is `widths` of the part that it is half of, or None.

    After many crossings in a step, the next one is probably as close: parts of that size need not be found by halving the whole step.
    """
    ends, spacing = [start], max(spacing, FEWEST * (stop - start))
    while spacing < 0.5 * (stop - ends[-1]):
        ends.append(ends[-1] + spacing)
        spacing *= 2
    return [(low, high, None) for low, high in pairwise([*ends, stop])][::-1]


def _suspects(events: Events, on_grid: Array, shown: BoolArray, wrong: BoolArray, part: tuple[float, float]) -> Any:
    """Return sorted instants of a part at which conditions may have changed. `shown`, `wrong`: masks of the conditions that differ from the mode at the
    places, and as the polynomials say on the grid.

    These are places that show it, sign changes and extrema of the polynomials behind the crossing, and places with least distance from zero.
    """
    low, high = part
    shares = [SHARES[shown.any(axis=1)]]
    wrong[0] = False  # at the start the mode holds: a change just behind it begins there
    begins = wrong & ~np.concatenate([np.zeros_like(wrong[:1]), wrong[:-1]])
    depth = np.where(wrong, np.abs(on_grid), 0.0)
    before, after = np.concatenate([depth[-1:], depth[:-1]]), np.concatenate([depth[1:], depth[:1]])
    deepest = wrong & (depth >= before) & (depth >= after)
    shares.append(FINER[(begins | deepest).any(axis=1)])
    times = low + (high - low) * np.unique(np.concatenate(shares))
    return times[times > low]


def _bottom(
    events: Events, bracket: tuple[float, float], j: int, said: BoolArray, roots: Callable[[Any, bool], Any]
) -> float:
    """Return the instant of a bracket at which an indicator is nearest to zero, or at which its condition differs, by golden sections.

    A parabola that is below zero for 1e-12 of a part is narrower than the error of its polynomial's extremum.
    """
    low, high = bracket
    width = WIDTH * float(np.spacing(max(abs(low), abs(high))))
    distance: dict[float, float] = {}
    while high - low > width:
        first, second = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        for time in {first, second} - distance.keys():
            indicators = roots(np.array([time]), True)
            distance[time] = abs(float(indicators[0, j]))
            if _wrong(events, indicators, said)[0, j]:
                return time
        low, high = (low, second) if distance[first] < distance[second] else (first, high)
    return low


def _in_part(
    events: Events, part: tuple[float, float], times: Array, said: BoolArray, roots: Callable[[Any, bool], Any]
) -> float | None:
    """Return the first zero crossing in a part of a step; `times`: the instants at which one is suspected."""
    if not len(times):
        return None
    # So far, unknowns of loops came from the dense output; here they are solved for.
    seen = roots(times, True)
    wrong = _wrong(events, seen, said)
    if not wrong.any():
        return None
    first = int(np.argmax(wrong.any(axis=1)))
    high = float(times[first])
    grid = part[0] + (part[1] - part[0]) * FINER
    before = float(grid[max(int(np.searchsorted(grid, high)) - 1, 0)])
    right = float(times[first - 1]) if first else part[0]
    return _narrowed(events, (right, max(before, right), high), seen[first], said, roots)


def _narrowed(
    events: Events, places: tuple[float, float, float], there: Array, said: BoolArray, roots: Callable[[Any, bool], Any]
) -> float:
    """Return the first instant, to rounding, at which a condition has changed; `there`: the roots at the last of three places.

    At the first place the mode holds. The crossing is between the others, unless rounding has hidden it from the search: then it is before both.
    """
    right, low, high = places
    scale = np.where((there != 0) & np.isfinite(there), np.abs(there), 1.0)
    flipping = _wrong(events, there, said)

    def beyond(time: float) -> float:
        """Return the largest distance of a condition behind its zero crossing; negative before all crossings."""
        nonlocal flipping
        seen = roots(np.array([time]), True)[0]
        size, changed = np.abs(seen), events.truth(seen) != said
        distance = np.where(changed, size, -size) - events.floor
        wrong = np.isfinite(seen) & changed & (size >= events.floor)
        if wrong.any():
            flipping = wrong
        found = float((distance / scale)[flipping].max())
        return max(found, LEAST) if wrong.any() else min(found, -LEAST)

    width = 0.5 * WIDTH * float(np.spacing(max(abs(low), abs(high))))
    if high - low <= 2 * width:
        return high
    first = beyond(low)
    if first > 0 and low > right:
        low, high, first, last = right, low, beyond(right), first
    else:
        last = beyond(high)
    if last < 0:  # a loop that is solved for once more has another rounding
        return high
    (a, at_a), (b, _) = narrowed(beyond, (low, -abs(first)), (high, last), width)
    return a if at_a > 0 else b


def _wrong(events: Events, roots: Array, said: BoolArray) -> Any:
    """Return a mask of the conditions that differ from the mode; shape as the roots."""
    return np.isfinite(roots) & (events.truth(roots) != said) & (np.abs(roots) >= events.floor)


def _returns(events: Events, roots: Array, wrong: BoolArray) -> Any:
    """Return a mask of the conditions that rounding left behind their zero crossing at the start, and that get no further in a part of a step.
    `wrong`: those that differ from the mode at the start."""
    left = wrong & (np.abs(roots[0]) <= 4 * events.floor)
    return left & (np.abs(roots) <= 1.1 * np.abs(roots[0])).all(axis=0)


def _unresolved(events: Events, time: float, conditions: IntArray) -> RunFailed:
    return RunFailed(
        "BR778", f"near t = {time:.9g} s {events.listed_conditions(conditions)} changes too often within a step to be followed;",
        "give the noise or the jumps in it a longer period, or let a signal that is smooth decide",
    )  # fmt: skip
