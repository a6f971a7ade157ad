"""Stiff interpolation: stiff states between the ends of a step, computed from their own equations where the polynomials are not accurate.

At the ends of steps a stiff state lies where its rate nearly vanishes, however long the step; between them a polynomial is not bound to that. The
rates at an instant, minus the derivative of the polynomial, give the residual, and Newton's method corrects the stiff states; all others stay unchanged.
"""

from __future__ import annotations

from math import isfinite

from compiler.api import Floats

from .. import radau
from ..linear_algebra.factors import Factors, back, eliminate
from ..methods import STIFF as STEEP
from ..methods import THROUGH_ENDS
from ..steps.evaluation import rates
from ..workspace import IntegratorWorkspace
from .polynomials import ALIKE, BROKEN, collocation, interpolated

STIFF, SURE, NEAR, SLOW = radau.STIFF, radau.SURE, radau.NEAR, radau.SLOW
ITERATIONS, LEFT, PATIENT = radau.BACK_ITERATIONS, radau.LEFT, radau.BACK_PATIENT
MU_REAL = float(radau.MU_REAL)


def misses_stiff_states(s: IntegratorWorkspace) -> bool:
    """Return True if the last step of a method for stiff equations has stiff states that its polynomials may miss.

    Its two polynomials differ in them, or it has only one. A state may be stiff at the end of the step alone, as behind a diode that begins to conduct.
    """
    if STEEP[s.method] == 0 or s.closed.constraints > 0 or s.sparse != 0:
        return False
    has_stiff_states(s, s.jacobian)
    has_quintic = s.ends == 3 and THROUGH_ENDS[s.method] != 0
    for i in range(s.differential):
        if s.steepness[i] > STIFF and (not has_quintic or s.apart[i] != ALIKE):
            return True
    if not has_quintic or s.differs != BROKEN:
        return False
    entries_at(s, s.time, s.state)
    size = s.time - s.end_time[s.ends - 2]
    for k in range(s.entry_count):
        i = s.rows[k]
        if i == s.columns[k] and i < s.differential and -s.inner_jacobian[k] * size > STIFF and s.apart[i] != ALIKE:
            return True
    return False


def has_stiff_states(s: IntegratorWorkspace, entries: Floats) -> bool:
    """Return True if there are stiff states in the last step, by the entries of a Jacobian, and store the steepness of all."""
    size = s.time - s.end_time[s.ends - 2]
    for i in range(s.n):
        s.steepness[i] = 0.0
    for k in range(s.entry_count):
        s.steepness[s.rows[k]] += abs(entries[k]) * size
    for i in range(s.differential):
        if s.steepness[i] > STIFF:
            return True
    return False


def entries_at(s: IntegratorWorkspace, time: float, y: Floats) -> None:
    """Compute the entries of the Jacobian at a scaled state within the step."""
    for i in range(s.n):
        s.si[i] = y[i] * s.magnitude[i]
    s.entries(time, s.si, s.inputs, s.constants, s.mode, s.inner_jacobian)
    s.jacobians += 1
    for k in range(s.entry_count):
        s.inner_jacobian[k] *= s.ratio[k]


def is_off(s: IntegratorWorkspace, time: float) -> bool:
    """Return True if a first Newton correction, with the factors of the step, moves a stiff state."""
    slopes(s, time, s.time - s.end_time[s.ends - 2])
    collocation(s, time, s.w)
    correction(s, s.real, time)
    for i in range(s.differential):
        limit = SURE * (s.absolute[i] + s.relative * abs(s.end_state[(s.ends - 1) * s.n + i]))
        if s.steepness[i] > STIFF and not abs(s.change[i]) <= limit:
            return True
    return False


def bring_back(s: IntegratorWorkspace, time: float, out: Floats) -> bool:
    """Correct the stiff states of a state in SI by Newton's method, with the factors of the step, else with new ones; return True if it converges."""
    size = s.time - s.end_time[s.ends - 2]
    slopes(s, time, size)
    for i in range(s.n):
        s.scale[i] = s.absolute[i] + s.relative * abs(out[i] / s.magnitude[i])
    if has_stiff_states(s, s.jacobian) and brings_back(s, s.real, 0, time, size, out):
        return True
    return brings_back(s, s.inner, 1, time, size, out)


def brings_back(s: IntegratorWorkspace, factors: Factors, own: int, time: float, size: float, out: Floats) -> bool:
    """Return True if Newton's method converges with these factors; new factors (`own`) are renewed where it slows down."""
    n = s.n
    before = 1e300
    slow = 0  # iterations in a row
    for i in range(n):
        s.w[i] = out[i] / s.magnitude[i]
    for _ in range(ITERATIONS):
        if (before == 1e300 or slow > 0) and own != 0 and not renewed(s, time, size):
            return False
        correction(s, factors, time)
        norm = 0.0
        for i in range(n):
            if i < s.differential and s.steepness[i] <= STIFF:
                s.change[i] = 0.0
            share = abs(s.change[i]) / s.scale[i]
            norm = share if not share <= norm else norm
        slow = slow + 1 if norm > SLOW * before else 0
        if not isfinite(norm) or norm > 2.0 * before or slow > own * PATIENT:
            return False
        before = norm
        for i in range(n):
            s.w[i] += s.change[i]
        if norm < LEFT:
            for i in range(n):
                out[i] = s.w[i] * s.magnitude[i]
            return True
    return False


def slopes(s: IntegratorWorkspace, time: float, size: float) -> None:
    """Put the derivative of the polynomial, from two values, into `rest`."""
    n = s.n
    late = s.f
    early = s.f[n:]
    interpolated(s, time + NEAR * size, late)
    interpolated(s, time - NEAR * size, early)
    for i in range(n):
        s.rest[i] = (late[i] - early[i]) / (2.0 * NEAR * size) if i < s.differential else 0.0


def renewed(s: IntegratorWorkspace, time: float, size: float) -> bool:
    """Compute the factors for Newton's method at the state in `w`; return False if the matrix is singular."""
    n = s.n
    entries_at(s, time, s.w)
    has_stiff_states(s, s.inner_jacobian)
    s.factorisations += 1
    matrix = s.inner.matrix
    for i in range(n * n):
        matrix[i] = 0.0
    for i in range(s.differential):
        matrix[i * n + i] = MU_REAL / size
    for k in range(s.entry_count):
        matrix[s.rows[k] * n + s.columns[k]] -= s.inner_jacobian[k]
    return eliminate(s.inner)


def correction(s: IntegratorWorkspace, factors: Factors, time: float) -> None:
    """Put one Newton correction of the state in `w` into `change`."""
    rates(s, time, s.w, s.change)
    for i in range(s.n):
        s.change[i] -= s.rest[i]
    back(factors, s.change)
