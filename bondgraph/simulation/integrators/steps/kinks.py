"""Kinks of laws within a tried step. They are searched at a few places, chosen by the method.

A step need not end at a kink that its error does not show; what a law is between two kinks alone is a peak (see `peaks.py`).
"""

from __future__ import annotations

from compiler.api import Floats, Numbers

from .. import radau
from ..workspace import IntegratorWorkspace
from .evaluation import bends_of, drop_first_end
from .trial_interpolant import tried_at

WORK = 8  # row of `peak_seen` behind those of the places of a method
CLOSE = radau.CLOSE
ROUNDS = 12  # most iterations of false position (Illinois: Dowell and Jarratt, BIT 11, 1971)


def first_bend(s: IntegratorWorkspace, size: float, places: Numbers, count: int, nearest: float) -> float:
    """Return the fraction of a tried step at which a law first has a kink, from the kink functions at `count` places; 1 if there is none.

    Those nearer to the start than `nearest` do not count.
    """
    m = s.bend_count
    first = 1.0
    for k in range(count):
        bends_at(s, size, places[k], s.bend_seen[k * m :])
    for k in range(count - 1):
        for j in range(m):
            at_a = s.bend_seen[k * m + j]
            at_b = s.bend_seen[(k + 1) * m + j]
            if at_a * at_b < 0.0 and places[k] < first:
                found = false_position(s, size, j, places[k], at_a, places[k + 1], at_b)
                if found > nearest:
                    first = min(first, found)
    return first if first < 1.0 - CLOSE else 1.0


def false_position(s: IntegratorWorkspace, size: float, j: int, a: float, at_a: float, b: float, at_b: float) -> float:
    """Return an approximate zero of a kink function, or of the place of a peak, between the fractions a and b, where its values have different signs."""
    for _ in range(ROUNDS):
        new = b - at_b * (b - a) / (at_b - at_a)
        value = crossed_at(s, size, new, j)
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


def crossed_at(s: IntegratorWorkspace, size: float, at: float, j: int) -> float:
    """Return a kink function at a fraction of the step; behind all of them are the places of peaks, and their values."""
    if j < s.bend_count:
        bends_at(s, size, at, s.bend_seen[5 * s.bend_count :])
        return s.bend_seen[5 * s.bend_count + j]
    put_peaks(s, size, at, WORK)
    return s.peak_seen[2 * WORK * s.peak_count + j - s.bend_count]


def put_peaks(s: IntegratorWorkspace, size: float, at: float, row: int) -> None:
    """Evaluate the places and values of all peaks at a fraction of the step into a row of `peak_seen`."""
    tried_at(s, at, s.rest)
    for i in range(s.n):
        s.si[i] = s.rest[i] * s.magnitude[i]
    s.peaks(s.time + at * size, s.si, s.inputs, s.constants, s.mode, s.peak_seen[2 * row * s.peak_count :])


def bends_at(s: IntegratorWorkspace, size: float, at: float, out: Floats) -> None:
    """Evaluate all kink functions at a fraction of the step."""
    tried_at(s, at, s.rest)
    bends_of(s, s.time + at * size, s.rest, out)


def after_bend(s: IntegratorWorkspace, size: float) -> None:
    """Prepare the step after one that ends at a kink: no polynomial spans it, and the next step may have the size planned for this one."""
    if s.ends == 3:
        drop_first_end(s)
    s.size = max(s.size, size)
