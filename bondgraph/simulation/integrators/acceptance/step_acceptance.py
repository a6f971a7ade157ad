"""Step acceptance: growth of tolerances, and work; see `numerics/quadrature.py`."""

from __future__ import annotations

from math import sqrt

from ....numerics import quadrature
from ..dense_output.polynomials import collocation
from ..projection.projection import put_multipliers
from ..workspace import IntegratorWorkspace

PLACES, KRONROD, GAUSS = (tuple(a.tolist()) for a in (quadrature.PLACES, quadrature.KRONROD, quadrature.GAUSS))
DEEPEST = quadrature.DEEPEST


def grow(s: IntegratorWorkspace) -> None:
    """Raise the magnitude of a state that exceeds it; tolerances given by the author stay."""
    for i in range(s.n):
        s.peak[i] = max(s.peak[i], abs(s.state[i]))
        s.greatest[i] = max(s.greatest[i], abs(s.state[i]))
        s.absolute[i] = s.resting[i] * (1.0 if s.held[i] != 0 else s.peak[i])


def add_work(s: IntegratorWorkspace) -> None:
    """Add the work of a step, which is halved where the two quadratures differ by more than the tolerance allows.

    The halves are visited from left to right: `at` is the start of a part, in units of the smallest parts, `depth` the number of halvings.
    """
    start = s.end_time[s.ends - 2]
    end = min(s.time, s.until)
    whole = end - start
    smallest = 1
    for _ in range(DEEPEST):
        smallest *= 2
    at = 0
    width = smallest
    depth = 0
    while at < smallest:
        a = start + whole * float(at) / float(smallest)
        b = start + whole * float(at + width) / float(smallest)
        if depth == 0:
            b = end
        good = part_of_work(s, a, b, depth)
        if good or depth >= DEEPEST:
            for k in range(s.power_count):
                s.work[k] += s.partial[k]
            at += width
            # Go up again while this part was a right half.
            while width < smallest and at % (2 * width) == 0:
                width *= 2
                depth -= 1
        else:
            width = width // 2
            depth += 1


def part_of_work(s: IntegratorWorkspace, a: float, b: float, depth: int) -> bool:
    """Put the work between two instants into `partial`; return True if it is accurate enough."""
    m = s.power_count
    for k in range(m):
        s.partial[k] = 0.0
        s.partial[m + k] = 0.0
    for q in range(7):
        time = a + PLACES[q] * (b - a)
        collocation(s, time, s.si)
        for i in range(s.n):
            s.si[i] *= s.magnitude[i]
        if s.closed.multipliers > 0:
            put_multipliers(s.closed, time, s.si)
        s.powers(time, s.si, s.inputs, s.constants, s.mode, s.power)
        for k in range(m):
            s.partial[k] += KRONROD[q] * s.power[k]
            s.partial[m + k] += GAUSS[q] * s.power[k]
    for k in range(m):
        s.partial[k] *= b - a
        s.partial[m + k] *= b - a
        if depth == 0:
            s.traffic += abs(s.partial[k])
    for k in range(m):
        doubt = 200.0 * abs(s.partial[m + k] - s.partial[k]) / max(s.traffic, 1e-300)
        if doubt * sqrt(doubt) > 0.1 * s.tolerance:
            return False
    return True
