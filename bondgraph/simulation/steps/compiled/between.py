"""What is stiff at the reported instants within a step: see `stretch/between.py`, whose names stand here."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

from .. import radau
from ..methods import RADAU
from .factors import back, eliminate
from .polynomials import collocation, quintic
from .step import rates
from .stepper import Stepper

if TYPE_CHECKING:
    from ....door import Floats

STIFF, SURE, NEAR, SLOW = radau.STIFF, radau.SURE, radau.NEAR, radau.SLOW
ITERATIONS, LEFT = radau.BACK_ITERATIONS, radau.LEFT
MU_REAL = float(radau.MU_REAL)


def has_steep_states(s: Stepper) -> int:
    """Whether states follow at once in the last step of Radau; how steeply they do is noted."""
    if s.method != RADAU or s.closed.gaps > 0 or s.sparse != 0:
        return 0
    size = s.time - s.end_time[s.ends - 2]
    for i in range(s.n):
        s.steepness[i] = 0.0
    for k in range(s.entry_count):
        s.steepness[s.rows[k]] += abs(s.jacobian[k]) * size
    for i in range(s.differential):
        if s.steepness[i] > STIFF:
            return 1
    return 0


def is_unsure(s: Stepper, time: float) -> bool:
    """Whether the two polynomials differ in what is stiff, or there is but one."""
    if s.ends < 3:
        return True
    collocation(s, time, s.si)
    for i in range(s.differential):
        limit = SURE * (s.absolute[i] + s.relative * abs(s.end_state[2 * s.n + i]))
        if s.steepness[i] > STIFF and abs(quintic(s, time, i) - s.si[i]) > limit:
            return True
    return False


def bring_back(s: Stepper, time: float, out: Floats) -> None:
    """What is stiff in a state in SI to where its equations want it, if Newton's method finds that."""
    n = s.n
    size = s.time - s.end_time[s.ends - 2]
    slopes(s, time, size)
    before = 1e300
    stale = True
    for i in range(n):
        s.w[i] = out[i] / s.magnitude[i]
        s.scale[i] = s.absolute[i] + s.relative * abs(s.w[i])
    for _ in range(ITERATIONS):
        if stale and not renewed(s, time, size):
            return
        correction(s, time)
        norm = 0.0
        for i in range(n):
            if i < s.differential and s.steepness[i] <= STIFF:
                s.change[i] = 0.0
            share = abs(s.change[i]) / s.scale[i]
            norm = share if not share <= norm else norm
        if not isfinite(norm) or norm > 2.0 * before:
            return
        stale = norm > SLOW * before
        before = norm
        for i in range(n):
            s.w[i] += s.change[i]
        if norm < LEFT:
            for i in range(n):
                out[i] = s.w[i] * s.magnitude[i]
            return


def slopes(s: Stepper, time: float, size: float) -> None:
    """The slope of the polynomial, from two values: into `rest`."""
    n = s.n
    collocation(s, time + NEAR * size, s.f)
    collocation(s, time - NEAR * size, s.f[n:])
    for i in range(n):
        late = s.f[i]
        early = s.f[n + i]
        if s.ends == 3:
            late = quintic(s, time + NEAR * size, i)
            early = quintic(s, time - NEAR * size, i)
        s.rest[i] = (late - early) / (2.0 * NEAR * size) if i < s.differential else 0.0


def renewed(s: Stepper, time: float, size: float) -> bool:
    """The factors for Newton's method at the state in `w`; false if there are none."""
    n = s.n
    for i in range(n):
        s.si[i] = s.w[i] * s.magnitude[i]
    s.entries(time, s.si, s.inputs, s.constants, s.mode, s.inner_jacobian)
    s.jacobians += 1
    s.factorisations += 1
    matrix = s.inner.matrix
    for i in range(n * n):
        matrix[i] = 0.0
    for i in range(s.differential):
        matrix[i * n + i] = MU_REAL / size
    for k in range(s.entry_count):
        matrix[s.rows[k] * n + s.columns[k]] -= s.inner_jacobian[k] * s.ratio[k]
    return eliminate(s.inner)


def correction(s: Stepper, time: float) -> None:
    """One change of Newton's method from the state in `w`: into `change`."""
    rates(s, time, s.w, s.change)
    for i in range(s.n):
        s.change[i] -= s.rest[i]
    back(s.inner, s.change)
