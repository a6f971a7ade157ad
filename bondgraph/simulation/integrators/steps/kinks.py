"""Kinks of laws within a tried step. They are searched at a few places, chosen by the method.

A step need not end at a kink that its error does not show. But what a law is between two kinks alone, both between two places at which the method evaluates it,
nothing in the step has seen: see `is_narrow`.
"""

from __future__ import annotations

from math import isfinite

from compiler.api import Floats, Numbers

from .. import radau
from ..workspace import IntegratorWorkspace
from .evaluation import bends_of, rates
from .trial_interpolant import tried_at

PLACES = (0.0, *radau.C.tolist())
CLOSE = radau.CLOSE
BENT, HALVINGS = radau.BENT, radau.HALVINGS
NEAR_ZERO = 0.1  # of a kink function at a place: where it turns below, by a parabola, it is looked at
ROUNDS = 12  # most iterations of false position (Illinois: Dowell and Jarratt, BIT 11, 1971)


def first_bend(s: IntegratorWorkspace, size: float, nearest: float) -> float:
    """Return the fraction of a Radau step at which a law first has a kink, along the collocation polynomial; 1 if there is none. See `first_between`."""
    for k in range(4):
        for i in range(s.n):
            s.rest[i] = s.state[i]
            if k > 0:
                s.rest[i] = s.state[i] + s.z[(k - 1) * s.n + i]
        bends_of(s, s.time + PLACES[k] * size, s.rest, s.bend_seen[k * s.bend_count :])
    return first_between(s, size, PLACES, 4, nearest)


def first_between(s: IntegratorWorkspace, size: float, places: Numbers, count: int, nearest: float) -> float:
    """Return the fraction of a step at which a law first has a kink, from the kink functions at `count` places (in `bend_seen`); 1 if there is none.

    Those nearer to the start than `nearest` count only if a law is narrow there.
    """
    m = s.bend_count
    first = 1.0
    for k in range(count - 1):
        for j in range(m):
            if places[k] < first:
                at_a = s.bend_seen[k * m + j]
                b = places[k + 1]
                at_b = s.bend_seen[(k + 1) * m + j]
                if at_a * at_b > 0.0:
                    b = turn(s, places, j, k)
                    if b < places[k + 1]:
                        bends_at(s, size, b, s.bend_seen[5 * m :])
                        at_b = s.bend_seen[5 * m + j]
                if at_a * at_b < 0.0:
                    found = false_position(s, size, j, places[k], at_a, b, at_b)
                    reach = 0.25 * (places[k + 1] - places[k])
                    if found < first and (found > nearest or is_narrow(s, size, found, reach)):
                        first = found
    return first if first < 1.0 - CLOSE else 1.0


def turn(s: IntegratorWorkspace, places: Numbers, j: int, k: int) -> float:
    """Return where a kink function of one sign at the k-th place and the next turns between them, near zero or beyond, by a parabola; else the next place.

    A motion there and back, as of what is thrown, passes a kink twice in a step that ends where it began.
    """
    m = s.bend_count
    i = k - 1 if k > 0 else 0
    y = s.bend_seen[i * m + j]
    slope = (s.bend_seen[(i + 1) * m + j] - y) / (places[i + 1] - places[i])
    second = (s.bend_seen[(i + 2) * m + j] - s.bend_seen[(i + 1) * m + j]) / (places[i + 2] - places[i + 1])
    bend = (second - slope) / (places[i + 2] - places[i])
    here = s.bend_seen[k * m + j]
    if here * bend > 0.0:
        at = 0.5 * (places[i] + places[i + 1] - slope / bend)
        value = y + slope * (at - places[i]) + bend * (at - places[i]) * (at - places[i + 1])
        if at > places[k] and at < places[k + 1] and value / here < NEAR_ZERO:
            return at
    return places[k + 1]


def is_narrow(s: IntegratorWorkspace, size: float, at: float, reach: float) -> bool:
    """Return True if what the rates are at a fraction of a tried step, and are not on both sides, moves a state by more than its tolerance allows.

    A place of the method within `reach` would have seen what is wider. What is narrow keeps its height until the sides come as near as it is wide; a kink
    loses half of it at each halving. The bend of the polynomial is subtracted.
    """
    n = s.n
    reach = min(reach, 0.5 * at, 0.5 * (1.0 - at))
    here = s.beside
    bend = s.beside[n:]
    put_slope_of_try(s, size, at - reach, 0.125 * reach, bend, -0.5)
    put_slope_of_try(s, size, at + reach, 0.125 * reach, here, -0.5)
    for i in range(n):
        bend[i] += here[i]
    put_slope_of_try(s, size, at, 0.125 * reach, here, 1.0)
    for i in range(n):
        bend[i] += here[i]
    tried_at(s, at, s.rest)
    rates(s, s.time + at * size, s.rest, here)
    height = height_above(s, size, at, reach, 1.0)
    width = reach
    for _ in range(HALVINGS):
        if height * width <= BENT or not isfinite(height):
            return False
        if height_above(s, size, at, 0.5 * width, 0.5 * width / reach) < 0.5 * height:
            return True
        width *= 0.5
    return False


def put_slope_of_try(s: IntegratorWorkspace, size: float, at: float, near: float, out: Floats, factor: float) -> None:
    """Compute the slope of a tried step's polynomial at a fraction of it, by its values `near`, times a factor."""
    n = s.n
    share = factor / (2.0 * near * size)
    tried_at(s, at + near, s.rest)
    for i in range(n):
        out[i] = s.rest[i]
    tried_at(s, at - near, s.rest)
    for i in range(n):
        out[i] = share * (out[i] - s.rest[i])


def height_above(s: IntegratorWorkspace, size: float, at: float, width: float, share: float) -> float:
    """Return by how much rates at a fraction of a step (in `beside`) differ from the mean of those at a width on both sides, in tolerances a step.

    The bend of the polynomial is subtracted: that in the second row of `beside` times the square of `share`.
    """
    n = s.n
    left = s.beside[2 * n :]
    right = s.beside[3 * n :]
    tried_at(s, at - width, s.rest)
    rates(s, s.time + (at - width) * size, s.rest, left)
    tried_at(s, at + width, s.rest)
    rates(s, s.time + (at + width) * size, s.rest, right)
    most = 0.0
    for i in range(s.differential):
        off = s.beside[i] - 0.5 * (left[i] + right[i]) - share * share * s.beside[n + i]
        most = max(most, abs(off) * s.per_tolerance[i] * size)
    return most


def false_position(s: IntegratorWorkspace, size: float, j: int, a: float, at_a: float, b: float, at_b: float) -> float:
    """Return an approximate zero of a kink function between the places a and b, where its values have different signs."""
    m = s.bend_count
    for _ in range(ROUNDS):
        new = b - at_b * (b - a) / (at_b - at_a)
        bends_at(s, size, new, s.bend_seen[5 * m :])
        value = s.bend_seen[5 * m + j]
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
