"""Where a law bends within a step: see `radau.Radau._bend`."""

from __future__ import annotations

from .. import radau
from .stepper import Stepper

C, P = tuple(radau.C.tolist()), tuple(radau.P.ravel().tolist())
NEAREST, ON_IT, CLOSE, ROUNDS = radau.NEAREST, radau.ON_IT, radau.CLOSE, radau.ROUNDS


def first_bend(s: Stepper, size: float) -> float:
    """The share of a step at which a law bends first, along the collocation polynomial; 1 if none does."""
    m = s.bend_count
    for k in range(4):
        for i in range(s.n):
            s.si[i] = s.state[i] * s.magnitude[i]
            if k > 0:
                s.si[i] = (s.state[i] + s.z[(k - 1) * s.n + i]) * s.magnitude[i]
        s.bends(s.time + place(k) * size, s.si, s.inputs, s.constants, s.mode, s.bend_seen[k * m :])
    first = 1.0
    for j in range(m):
        largest = 0.0
        for k in range(4):
            largest = max(largest, abs(s.bend_seen[k * m + j]))
        if abs(s.bend_seen[j]) <= ON_IT * largest:
            s.bend_seen[j] = 0.0
    for k in range(3):
        for j in range(m):
            if s.bend_seen[k * m + j] * s.bend_seen[(k + 1) * m + j] < 0.0 and place(k) < first:
                found = false_position(s, size, k, j)
                if found > NEAREST:
                    first = min(first, found)
    return first if first < 1.0 - CLOSE else 1.0


def place(k: int) -> float:
    """The k-th place at which a step is looked at, as a share of it."""
    return 0.0 if k == 0 else C[k - 1]


def false_position(s: Stepper, size: float, k: int, j: int) -> float:
    """Nearly a zero of a bend between two places of unlike signs."""
    m = s.bend_count
    a = place(k)
    b = place(k + 1)
    at_a = s.bend_seen[k * m + j]
    at_b = s.bend_seen[(k + 1) * m + j]
    for _ in range(ROUNDS):
        new = b - at_b * (b - a) / (at_b - at_a)
        value = bend_at(s, size, new, j)
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


def bend_at(s: Stepper, size: float, at: float, j: int) -> float:
    """One bend at a share of the step, along the collocation polynomial."""
    n = s.n
    m = s.bend_count
    a = at * P[0] + at * at * P[1] + at * at * at * P[2]
    b = at * P[3] + at * at * P[4] + at * at * at * P[5]
    c = at * P[6] + at * at * P[7] + at * at * at * P[8]
    for i in range(n):
        s.si[i] = (s.state[i] + (a * s.z[i] + b * s.z[n + i] + c * s.z[2 * n + i])) * s.magnitude[i]
    s.bends(s.time + at * size, s.si, s.inputs, s.constants, s.mode, s.bend_seen[4 * m :])
    return s.bend_seen[4 * m + j]


def after_bend(s: Stepper, size: float) -> None:
    """After a step that ends at a bend: no polynomial spans it, and the next step may be as long as this one was to be."""
    n = s.n
    if s.ends == 3:
        s.ends = 2
        for k in range(2):
            s.end_time[k] = s.end_time[k + 1]
        for i in range(2 * n):
            s.end_state[i] = s.end_state[n + i]
            s.end_slope[i] = s.end_slope[n + i]
    s.size = max(s.size, size)
