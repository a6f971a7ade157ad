"""The polynomial of order 7 within a step of the explicit pair, and where a law bends along it; see `pair.py`.

A step that is tried and one that is accepted are looked at alike: both go from a state and a time to others, with slopes at all stages.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .. import pair
from .bending import bends_at, first_between
from .shares import value_at
from .step import rates
from .stepper import Stepper

if TYPE_CHECKING:
    from ....door import Floats

C, STARTS, FROM, A, D = pair.C, pair.STARTS, pair.FROM, pair.A, pair.D
STAGES, ALL_STAGES = pair.STAGES, pair.ALL_STAGES
NEAREST = pair.NEAREST
PLACES = (0.0, 0.25, 0.5, 0.75, 1.0)  # of a step, at which it is seen whether a law has bent


def densify(s: Stepper) -> None:
    """The polynomial of the last step."""
    n = s.n
    before = s.ends - 2
    densify_between(
        s, s.end_time[before], s.end_time[before + 1], s.end_state[before * n :], s.end_state[(before + 1) * n :]
    )
    s.dense_known = 1


def densify_between(s: Stepper, start: float, stop: float, first: Floats, last: Floats) -> None:
    """The polynomial between two states, from three more slopes; that at the end is known."""
    n = s.n
    size = stop - start
    for stage in range(STAGES + 1, ALL_STAGES):
        for i in range(n):
            s.rest[i] = 0.0
        for k in range(STARTS[stage], STARTS[stage + 1]):
            for i in range(n):
                s.rest[i] += A[k] * s.slope[FROM[k] * n + i]
        for i in range(n):
            s.rest[i] = first[i] + size * s.rest[i]
        rates(s, start + C[stage] * size, s.rest, s.slope[stage * n :])
    for i in range(n):
        change = last[i] - first[i]
        s.dense[i] = change
        s.dense[n + i] = size * s.slope[i] - change
        s.dense[2 * n + i] = 2.0 * change - size * (s.slope[STAGES * n + i] + s.slope[i])
        for row in range(4):
            total = 0.0
            for stage in range(ALL_STAGES):
                total += D[row * ALL_STAGES + stage] * s.slope[stage * n + i]
            s.dense[(3 + row) * n + i] = size * total


def polynomial(s: Stepper, time: float, out: Floats) -> None:
    """The scaled states within the last step."""
    if s.dense_known == 0:
        densify(s)
    before = s.ends - 2
    at = (time - s.end_time[before]) / (s.end_time[before + 1] - s.end_time[before])
    value_at(s, at, s.end_state[before * s.n :], out)


def first_bend_of_pair(s: Stepper, size: float, least: float) -> float:
    """The share of the step that is tried at which a law bends first; 1 if none does, or so near that no step of the least size leads there."""
    rates(s, s.time + size, s.new, s.slope[STAGES * s.n :])
    densify_between(s, s.time, s.time + size, s.state, s.new)
    return first_bend_along(s, size, least)


def first_bend_along(s: Stepper, size: float, least: float) -> float:
    """The same where the polynomial of the step that is tried is known."""
    for k in range(5):
        bends_at(s, size, PLACES[k], s.bend_seen[k * s.bend_count :])
    return first_between(s, size, PLACES, 5, max(NEAREST, 2.0 * least / size), NEAREST)
