"""The polynomial of order 7 within a step of the explicit pair, and where a law bends along it; see `pair.py`.

A step that is tried and one that is accepted are looked at alike: both go from a state and a time to others, with slopes at all stages.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .. import pair, radau
from .step import rates
from .stepper import Stepper

if TYPE_CHECKING:
    from ....door import Floats

C, STARTS, FROM, A, D = pair.C, pair.STARTS, pair.FROM, pair.A, pair.D
STAGES, ALL_STAGES = pair.STAGES, pair.ALL_STAGES
PLACES = 4  # parts of a step at whose ends it is seen whether a law has bent
NEAREST = pair.NEAREST
ON_IT, CLOSE, ROUNDS = radau.ON_IT, radau.CLOSE, radau.ROUNDS


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


def value_at(s: Stepper, at: float, first: Floats, out: Floats) -> None:
    """The scaled states at a share of a step that begins with `first`."""
    n = s.n
    back = 1.0 - at
    for i in range(n):
        value = at * s.dense[6 * n + i] + s.dense[5 * n + i]
        value = back * value + s.dense[4 * n + i]
        value = at * value + s.dense[3 * n + i]
        value = back * value + s.dense[2 * n + i]
        value = at * value + s.dense[n + i]
        value = back * value + s.dense[i]
        out[i] = first[i] + at * value


def first_bend_of_pair(s: Stepper, size: float) -> float:
    """The share of the step that is tried at which a law bends first; 1 if none does. As `radau.Radau._bend`, along this method's polynomial."""
    m = s.bend_count
    rates(s, s.time + size, s.new, s.slope[STAGES * s.n :])
    densify_between(s, s.time, s.time + size, s.state, s.new)
    for k in range(PLACES + 1):
        bends_at(s, size, float(k) / float(PLACES), s.bend_seen[k * m :])
    first = 1.0
    for j in range(m):
        largest = 0.0
        for k in range(PLACES + 1):
            largest = max(largest, abs(s.bend_seen[k * m + j]))
        if abs(s.bend_seen[j]) <= ON_IT * largest:
            s.bend_seen[j] = 0.0
    for k in range(PLACES):
        for j in range(m):
            if s.bend_seen[k * m + j] * s.bend_seen[(k + 1) * m + j] < 0.0 and float(k) / float(PLACES) < first:
                found = bend_between(s, size, k, j)
                if found > NEAREST:
                    first = min(first, found)
    return first if first < 1.0 - CLOSE else 1.0


def bend_between(s: Stepper, size: float, k: int, j: int) -> float:
    """Nearly a zero of a bend between two of the places, by false position."""
    m = s.bend_count
    a = float(k) / float(PLACES)
    b = float(k + 1) / float(PLACES)
    at_a = s.bend_seen[k * m + j]
    at_b = s.bend_seen[(k + 1) * m + j]
    for _ in range(ROUNDS):
        new = b - at_b * (b - a) / (at_b - at_a)
        bends_at(s, size, new, s.bend_seen[(PLACES + 1) * m :])
        value = s.bend_seen[(PLACES + 1) * m + j]
        if value * at_b < 0.0:
            a = b
            at_a = at_b
        else:
            at_a *= 0.5
        b = new
        at_b = value
        if value == 0.0 or abs(b - a) < CLOSE:
            break
    return b


def bends_at(s: Stepper, size: float, at: float, out: Floats) -> None:
    """All bends at a share of the step that is tried."""
    value_at(s, at, s.state, s.rest)
    for i in range(s.n):
        s.si[i] = s.rest[i] * s.magnitude[i]
    s.bends(s.time + at * size, s.si, s.inputs, s.constants, s.mode, out)
