"""Kinks of laws within a tried step. They are searched at a few places, chosen by the method."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .. import radau
from ..workspace import IntegratorWorkspace
from .trial_interpolant import tried_at

if TYPE_CHECKING:
    from compiler.api import Floats, Numbers

PLACES = (0.0, *radau.C.tolist())
NEAREST, ON_IT, CLOSE = radau.NEAREST, radau.ON_IT, radau.CLOSE
ROUNDS = 12  # most iterations of false position (Illinois: Dowell and Jarratt, BIT 11, 1971)


def first_bend(s: IntegratorWorkspace, size: float) -> float:
    """Return the fraction of a Radau step at which a law first has a kink, along the collocation polynomial; 1 if there is none."""
    for k in range(4):
        for i in range(s.n):
            s.rest[i] = s.state[i]
            if k > 0:
                s.rest[i] = s.state[i] + s.z[(k - 1) * s.n + i]
        bends_of(s, s.time + PLACES[k] * size, s.rest, s.bend_seen[k * s.bend_count :])
    return first_between(s, size, PLACES, 4, NEAREST, ON_IT)


def first_between(
    s: IntegratorWorkspace, size: float, places: Numbers, count: int, nearest: float, on_it: float
) -> float:
    """Return the fraction of a step at which a law first has a kink, from the kink functions at `count` places (in `bend_seen`); 1 if there is none.

    Kinks nearer to the start than `nearest` are ignored, and those whose value there is below `on_it` times its largest.
    """
    m = s.bend_count
    first = 1.0
    for j in range(m):
        largest = 0.0
        for k in range(count):
            largest = max(largest, abs(s.bend_seen[k * m + j]))
        if abs(s.bend_seen[j]) <= on_it * largest:
            s.bend_seen[j] = 0.0
    for k in range(count - 1):
        for j in range(m):
            if s.bend_seen[k * m + j] * s.bend_seen[(k + 1) * m + j] < 0.0 and places[k] < first:
                found = false_position(s, size, j, places[k], places[k + 1], k, count)
                if found > nearest:
                    first = min(first, found)
    return first if first < 1.0 - CLOSE else 1.0


def false_position(s: IntegratorWorkspace, size: float, j: int, a: float, b: float, k: int, count: int) -> float:
    """Return an approximate zero of a kink function between the places a and b, the k-th and the next, where its signs differ."""
    m = s.bend_count
    at_a = s.bend_seen[k * m + j]
    at_b = s.bend_seen[(k + 1) * m + j]
    for _ in range(ROUNDS):
        new = b - at_b * (b - a) / (at_b - at_a)
        bends_at(s, size, new, s.bend_seen[count * m :])
        value = s.bend_seen[count * m + j]
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


def bends_at(s: IntegratorWorkspace, size: float, at: float, out: Floats) -> None:
    """Evaluate all kink functions at a fraction of the step."""
    tried_at(s, at, s.rest)
    bends_of(s, s.time + at * size, s.rest, out)


def bends_of(s: IntegratorWorkspace, time: float, scaled: Floats, out: Floats) -> None:
    """Evaluate all kink functions at a scaled state."""
    for i in range(s.n):
        s.si[i] = scaled[i] * s.magnitude[i]
    s.bends(time, s.si, s.inputs, s.constants, s.mode, out)


def after_bend(s: IntegratorWorkspace, size: float) -> None:
    """Prepare the step after one that ends at a kink: no polynomial spans it, and the next step may have the size planned for this one."""
    n = s.n
    if s.ends == 3:
        s.ends = 2
        for k in range(2):
            s.end_time[k] = s.end_time[k + 1]
        for i in range(2 * n):
            s.end_state[i] = s.end_state[n + i]
            s.end_slope[i] = s.end_slope[n + i]
    s.size = max(s.size, size)
