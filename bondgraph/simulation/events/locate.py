"""Where a condition flips within a step: signs of the roots on places of the dense output, then finer ones, then narrowed down to rounding.

Between two places where a root has one sign it may still touch zero and come back: where its distance from zero is least, a
parabola through three places tells where to look once more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .zeros import narrowed

if TYPE_CHECKING:
    from .events import Events

PLACES = 12  # of a step
FINER = 256  # places between two of these, where it costs no loop to be solved
WIDTH = 4  # units in the last place of a time: where narrowing ends
LEAST = 1e-300  # distance from a flip that counts: no flip has a sign of its own
PEAKS = 2  # times that a least distance is looked at again

StateAt = Callable[[Any, bool], Any]  # instants (k,), whether loops are solved exactly -> states (k, n)
RootsAt = Callable[[Any, Any], Any]  # instants (k,), a mode -> roots of the conditions (k, conditions)


@dataclass(frozen=True, slots=True)
class Flip:
    """The first instant in a step after which conditions are no longer what the mode says; which ones (a mask)."""

    time: float
    state: Any
    conditions: Any


def first_flip(
    events: Events, start: float, stop: float, mode: Any, state_at: StateAt, roots: Callable[[Any, bool], Any]
) -> Flip | None:
    """The first flip in (start, stop], or None. What holds at the start itself is what the mode says, whatever rounding leaves.

    `roots`: of the conditions, as `state_at`; shape (k, conditions).
    """
    if not len(events.places):
        return None
    said = np.asarray(mode)[events.places] == 1.0
    times = start + (stop - start) * np.arange(1, PLACES + 1) / PLACES
    times[-1] = stop
    seen = roots(times, False)
    for _ in range(PEAKS):
        more = _closest(times, seen)
        if not len(more):
            break
        found = roots(more, False)
        order = np.argsort(np.concatenate([times, more]), kind="stable")
        times, seen = np.concatenate([times, more])[order], np.concatenate([seen, found])[order]
    wrong = _wrong(events, seen, said)
    if not wrong.any():
        return None
    # Unknowns of loops have been taken from the dense output so far; from the first suspicion on they are solved for.
    first = int(np.argmax(wrong.any(axis=1)))
    start, times = (float(times[first - 1]) if first else start), times[first:]
    if not len(events.program.unknowns.names):
        stop = float(times[0])
        times = np.append(start + (stop - start) * np.arange(1, FINER) / FINER, stop)
    seen = roots(times, True)
    wrong = _wrong(events, seen, said)
    if not wrong.any():
        return None
    last = int(np.argmax(wrong.any(axis=1)))
    low, high = (float(times[last - 1]) if last else start), float(times[last])
    high = _narrowed(events, low, high, seen[last], said, roots)
    at = np.array([high])
    return Flip(high, state_at(at, True)[0], _wrong(events, roots(at, True), said)[0])


def _narrowed(
    events: Events, low: float, high: float, there: Any, said: Any, roots: Callable[[Any, bool], Any]
) -> float:
    """The first of the instants between two that rounding tells apart at which a condition has flipped; `there`: the roots at the second."""
    scale = np.where((there != 0) & np.isfinite(there), np.abs(there), 1.0)
    flipping = _wrong(events, there, said)

    def beyond(time: float) -> float:
        """How far a condition is behind its flip; negative before all flips."""
        nonlocal flipping
        seen = roots(np.array([time]), True)[0]
        distance = np.where(events.truth(seen) != said, np.abs(seen), -np.abs(seen)) - events.floor
        wrong = _wrong(events, seen, said)
        if wrong.any():
            flipping = wrong
        found = float((distance / scale)[flipping].max())
        return max(found, LEAST) if wrong.any() else min(found, -LEAST)

    width = 0.5 * WIDTH * float(np.spacing(max(abs(low), abs(high))))
    if high - low <= 2 * width:
        return high
    first, last = -abs(beyond(low)), beyond(high)
    (a, at_a), (b, _) = narrowed(beyond, (low, first), (high, last), width)
    return a if at_a > 0 else b


def _wrong(events: Events, roots: Any, said: Any) -> Any:
    """Which conditions are not what the mode says; shape as the roots."""
    return np.isfinite(roots) & (events.truth(roots) != said) & (np.abs(roots) >= events.floor)


def _closest(times: Any, roots: Any) -> Any:
    """Where parabolas through three places cross zero, or would, between places of one sign."""
    if len(times) < 3:
        return times[:0]
    distance = np.abs(roots)
    before, here, after = distance[:-2], distance[1:-1], distance[2:]
    same = (np.sign(roots[:-2]) == np.sign(roots[1:-1])) & (np.sign(roots[1:-1]) == np.sign(roots[2:]))
    rows, columns = np.nonzero(same & (here <= before) & (here <= after) & (here < 0.5 * np.maximum(before, after)))
    found = []
    for i, j in zip(rows, columns, strict=True):
        (a, b, c), (u, v, w) = times[i : i + 3], distance[i : i + 3, j]
        slope, other = (v - u) / (b - a), (w - v) / (c - b)
        bend = (other - slope) / (c - a)
        if bend > 0:
            low = 0.5 * (a + b) - slope / (2 * bend)
            if a < low < c and low not in times:
                found.append(low)
    return np.unique(np.array(found))
