"""Rates that an accepted step has missed, although Newton's corrections or the estimate of the error were within the tolerance.

A law may be so steep within a small part of the tolerance, as a root at zero is, that its slope there tells nothing of where the solution is.
"""

from __future__ import annotations

from compiler.api import Floats

from .. import radau
from ..workspace import IntegratorWorkspace
from .evaluation import rates
from .newton_matrices import solve_real

NEARLY, UNSOLVED, SLOWEST = radau.NEARLY, radau.UNSOLVED, radau.SLOWEST
GROWN = 2.0  # most ratio of what is left then to what was left before


def keep_missed(s: IntegratorWorkspace, end: float, size: float, slope: Floats) -> None:
    """Keep the most that rates at the end of a step, in `rate`, would move each state beside the slope of its polynomial there, in units of the tolerance.

    Newton's method takes what is left for rounding in a stiff law. Then a change by the whole tolerance in its direction turns it round, or makes it many times
    as large. Where it hardly changes, the solution is elsewhere.
    """
    for i in range(s.differential):
        if abs(s.rate[i] - slope[i]) > UNSOLVED * (abs(s.rate[i]) + abs(slope[i])):  # hardly ever
            keep_parts(s, end, size, slope)
            return


def keep_parts(s: IntegratorWorkspace, end: float, size: float, slope: Floats) -> None:
    """Keep what rates would move each state, where some are off."""
    n = s.n
    parts = s.f
    most = 0.0
    for i in range(s.differential):
        off = abs(s.rate[i] - slope[i])
        stagnates = abs(s.change[i]) >= SLOWEST * abs(s.last_change[i])
        is_off = stagnates and off > UNSOLVED * (abs(s.rate[i]) + abs(slope[i]))
        parts[i] = size * off * s.per_tolerance[i] if is_off else 0.0
        most = max(most, parts[i])
    if not most > NEARLY:
        return
    moved = 0.0
    for i in range(n):
        s.w[i] = s.rate[i] - slope[i] if i < s.differential else 0.0
    solve_real(s, s.w)
    for i in range(n):
        moved = max(moved, abs(s.w[i]) * s.per_tolerance[i])
    further = max(1.0, 1.0 / moved) if moved > 0.0 else 0.0
    for i in range(n):
        s.w[i] = s.new[i] + further * s.w[i]
    rates(s, end, s.w, s.change)
    for i in range(s.differential):
        off = s.rate[i] - slope[i]
        left = (s.change[i] - slope[i]) * off
        turns = left <= UNSOLVED * off * off or left >= GROWN * off * off  # no value there tells nothing
        if parts[i] > NEARLY and not turns:
            s.missed[i] = max(s.missed[i], parts[i])


def keep_missed_by_rows(s: IntegratorWorkspace, end: float, size: float) -> None:
    """Do the same for a polynomial in the form of that of DOP853."""
    n = s.n
    for i in range(n):
        s.rest[i] = (s.dense[i] - s.dense[n + i] - s.dense[2 * n + i]) / size
    keep_missed(s, end, size, s.rest)
