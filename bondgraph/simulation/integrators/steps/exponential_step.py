"""One step of the matrix exponential, for rates that are affine in states and time as long as the mode is the same.

Its states are exact at every instant, so its length matters only to those who look at places within the step: it is halved until a polynomial through
the places at which conditions are searched holds for all states between them. All modes are excited where a segment begins, so the first step is as
short as the fastest of them; later ones grow as fast modes die out.
"""

from __future__ import annotations

from math import ulp

from compiler.api import Floats

from ....numerics import indicators
from ..linear_algebra import exponentials
from ..linear_algebra.exponentials import propagate, use_matrix
from ..outcomes import ERROR, STIFF
from ..workspace import IntegratorWorkspace
from .evaluation import put_end, put_terms, rates, renew

PLACES, LAST = indicators.PLACES, indicators.LAST
SHARES, COEFFICIENTS = tuple(indicators.SHARES.tolist()), tuple(indicators.COEFFICIENTS.ravel().tolist())
LEVELS = exponentials.LEVELS
FIRST = 1.0  # first step, in time constants of the fastest mode
GROWN = 4.0  # ratio of a step to the one before
RESOLVED = 1e-8  # of the largest value of a state: least tolerated error of the polynomial through the places of a step
AFFINE = 1e-9  # relative to their terms: difference of the rates at the end of a step from those of the model
ROUNDED = 1e-12  # relative to the largest of these terms: rounding of the matrices in each of the states


def exponential_step(s: IntegratorWorkspace) -> int:
    """Make one step; return 0, or `STIFF` (`ERROR` if no other method may go on) where the rates are not affine, to rounding."""
    n = s.n
    begins = s.last_size == 0.0  # also where another mode holds from here on
    if begins:
        renew(s)
        use_matrix(s.exponentials, s.rows, s.columns, s.jacobian)
        put_drift(s)
    least = 10.0 * ulp(s.time)
    unit = s.exponentials.unit[s.exponentials.used]
    fastest = s.exponentials.fastest[s.exponentials.used]
    longest = unit
    for _ in range(LEVELS):
        longest *= 2.0
    size = min(longest, s.longest)
    if not begins:
        size = min(GROWN * s.last_size, size)
    elif fastest * size > FIRST:
        size = FIRST / fastest
    size = max(size, least)
    for i in range(n):
        s.slope[i] = s.rate[i]
    while True:
        end = s.stop if s.time + 1.01 * size >= s.stop else s.time + size
        put_places(s, end - s.time)
        if size <= max(unit, least) or is_resolved(s):
            break
        size *= 0.5
    for i in range(n):
        s.new[i] = s.slope[PLACES * n + i]
        s.error[i] = 0.0
    if not ends_affine(s, end):
        return STIFF if s.automatic != 0 else ERROR
    s.last_size = end - s.time
    put_end(s, end, s.rate)
    return 0


def put_drift(s: IntegratorWorkspace) -> None:
    """Compute the derivative of the rates by time, which is constant, from their values at the start and at the end of the segment."""
    t = s.exponentials
    t.drifts = 0
    for i in range(s.n):
        t.drift[i] = 0.0
    if s.latest <= s.time:
        return
    rates(s, s.latest, s.state, s.f)
    for i in range(s.n):
        if s.f[i] != s.rate[i]:
            t.drift[i] = (s.f[i] - s.rate[i]) / (s.latest - s.time)
            t.drifts = 1


def put_places(s: IntegratorWorkspace, size: float) -> None:
    """Put the states at the places of a step of this size behind the rates at its start in `slope`; the rates at its end are left in the tables."""
    n = s.n
    for place in range(PLACES):
        out = s.slope[(place + 1) * n :]
        for i in range(n):
            out[i] = s.state[i]
            s.exponentials.rate[i] = s.slope[i]
        propagate(s.exponentials, s.rows, s.columns, size if place + 1 == PLACES else SHARES[place] * size, out)


def is_resolved(s: IntegratorWorkspace) -> bool:
    """Return True if the polynomials through the states at the places of a step have converged."""
    n = s.n
    for i in range(n):
        largest = s.peak[i]
        for place in range(1, PLACES + 1):
            largest = max(largest, abs(s.slope[place * n + i]))
        error = 0.0
        for k in range(PLACES - LAST, PLACES):
            total = 0.0
            for place in range(PLACES):
                total += COEFFICIENTS[k * PLACES + place] * s.slope[(place + 1) * n + i]
            error += abs(total)
        if not error <= max(RESOLVED, s.relative) * largest:
            return False
    return True


def ends_affine(s: IntegratorWorkspace, end: float) -> bool:
    """Evaluate the rates at the end of a step, in `new`; return True if they are those of the affine form."""
    put_terms(s, s.new)
    rates(s, min(end, s.latest), s.new, s.rate)
    largest = 0.0
    for i in range(s.n):
        s.terms[i] += abs(s.rate[i]) + abs(s.slope[i])
        largest = max(largest, s.terms[i])
    for i in range(s.n):
        if not abs(s.rate[i] - s.exponentials.rate[i]) <= AFFINE * s.terms[i] + ROUNDED * largest:
            return False
    return True


def exponential_within(s: IntegratorWorkspace, time: float, out: Floats) -> None:
    """Put the scaled state within the last step into `out`."""
    before = s.ends - 2
    for i in range(s.n):
        out[i] = s.end_state[before * s.n + i]
        s.exponentials.rate[i] = s.slope[i]
    propagate(s.exponentials, s.rows, s.columns, time - s.end_time[before], out)
