"""Where a condition flips within a step: signs of the roots on places of the dense output, then ever finer places.

Between two places where a root has one sign it may still touch zero and come back: where its distance from zero is least, a
parabola through three places tells where to look once more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from .events import Events

PLACES = 12  # of a step
FINER, FEWER = (
    256,
    8,
)  # places by which an interval is cut again and again; the latter where each is a loop to be solved
WIDTH = 4  # units in the last place of a time: where cutting ends
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
    wrong = _wrong(events, roots(times, True), said)
    if not wrong.any():
        return None
    last = int(np.argmax(wrong.any(axis=1)))
    low, high = (float(times[last - 1]) if last else start), float(times[last])
    finer = FEWER if len(events.program.unknowns.names) else FINER
    while high - low > WIDTH * np.spacing(max(abs(low), abs(high))):
        inner = low + (high - low) * np.arange(1, finer) / finer
        inner = inner[(inner > low) & (inner < high)]
        if not len(inner):
            break
        wrong = _wrong(events, roots(inner, True), said).any(axis=1)
        if wrong.any():
            first = int(np.argmax(wrong))
            high = float(inner[first])
            low = float(inner[first - 1]) if first else low
        else:
            low = float(inner[-1])
    at = np.array([high])
    return Flip(high, state_at(at, True)[0], _wrong(events, roots(at, True), said)[0])


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
