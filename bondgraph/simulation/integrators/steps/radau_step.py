"""One step of Radau IIA of order 5 (see `radau.py`)."""

from __future__ import annotations

from math import isfinite, sqrt, ulp

from compiler.api import Floats

from .. import radau, tolerances
from ..linear_algebra.sparse import ANEW, FINE, SINGULAR
from ..outcomes import ERROR, NEWTON, ORDER, ROUND_OFF
from ..workspace import IntegratorWorkspace
from .evaluation import drop_noise, has_loops, put_end, put_end_rates, put_terms, rates, renew, renew_at
from .kinks import first_bend
from .newton_matrices import factorise, factorise_real, solve_complex, solve_real
from .norms import squares
from .peaks import first_peak
from .step_control import (
    choose_next,
    diverges,
    filtered_norm,
    first_try,
    growth,
    has_converged,
    is_rounding,
    look_beyond,
    next_try,
    stage_rates,
    stagnant,
)  # fmt: skip

C, E, D = (tuple(a.tolist()) for a in (radau.C, radau.E, radau.D))
PLACES = (0.0, *C)  # fractions of a step at which kinks are searched
T, TI, P = (tuple(a.ravel().tolist()) for a in (radau.T, radau.TI, radau.P))
MU_REAL, MU_RE, MU_IM = float(radau.MU_REAL), float(radau.MU_COMPLEX.real), float(radau.MU_COMPLEX.imag)
NEWTON_ITERATIONS, UNSOLVED, SOLVED, ROUNDED = radau.NEWTON_ITERATIONS, radau.UNSOLVED, radau.SOLVED, radau.ROUNDED
NEARLY, UNCONVERGED, MOST_SOLVING, DAMPED = radau.NEARLY, radau.UNCONVERGED, radau.MOST_SOLVING, radau.DAMPED
BENT, MOST_BENDS, NEAREST, INFINITE = radau.BENT, radau.MOST_BENDS, radau.NEAREST, tolerances.INFINITE
POWER = 0.25  # exponent of the estimate in the step size


def radau_step(s: IntegratorWorkspace) -> int:
    """Make one accepted step; return 0, or the reason why there is none."""
    n = s.n
    least = 10.0 * ulp(s.time)
    size = first_try(s)
    reason = ERROR
    rejected = 0
    bent = 0
    unconverged = 0
    cut = 1.0
    while True:
        if size < least and s.time + size < s.stop:
            return reason
        end = s.stop if s.time + size >= s.stop else s.time + size
        size = end - s.time
        guess(s, size)
        iterations = newton(s, size)
        if iterations < 0:
            return ORDER
        if iterations == 0:
            reason = NEWTON
            if s.current == 0:
                renew(s)
            else:
                unconverged += 1
                size *= 0.5
                if unconverged == UNCONVERGED and has_loops(s):
                    solve_unknowns(s, size)
            continue
        for i in range(n):
            s.new[i] = s.state[i] + s.z[2 * n + i]
        norm = estimate(s, size, rejected > 0)
        safety = 0.9 * (2.0 * NEWTON_ITERATIONS + 1.0) / (2.0 * NEWTON_ITERATIONS + float(iterations))
        if norm > BENT and s.bend_count > 0 and bent < MOST_BENDS:
            share = first_bend(s, size, PLACES, 4, NEAREST)
            if share < 1.0:
                cut = share
                bent += 1
                size *= cut
                continue
        norm = 1.0 if norm > 1.0 and is_rounding(s, norm, 1.0, 0.0) else norm
        if norm <= 1.0:
            share = first_peak(s, size, C, 0, 3)
            size *= share
            if share < 1.0:
                continue
            if not misses(s, end, size):
                break
            reason = NEWTON
            if s.current != 0:
                unconverged += 1
                size *= 0.5
            if unconverged == UNCONVERGED:
                solve_unknowns(s, size)
            renew(s)
            continue
        reason = ERROR
        rejected += 1
        size = next_try(s, size, norm, safety, POWER, rejected)
        if size == 0.0:
            return ROUND_OFF
    grown = growth(s, size, norm, safety, POWER, rejected)
    put_end_rates(s, end)
    for i in range(n):
        s.rest[i] = (D[0] * s.z[i] + D[1] * s.z[n + i] + D[2] * s.z[2 * n + i]) / size
    put_end(s, end, s.rest)
    for i in range(3 * n):
        s.stages[i] = s.z[i]
    choose_next(s, size, norm, grown, iterations)
    look_beyond(s, size, cut, bent)
    return 0


def guess(s: IntegratorWorkspace, size: float) -> None:
    """Extrapolate the stages from the last step's polynomial."""
    n = s.n
    for i in range(3):
        if s.last_size == 0.0:
            for k in range(n):
                s.z[i * n + k] = 0.0
            continue
        at = 1.0 + C[i] * size / s.last_size
        a = at * (P[0] + at * (P[1] + at * P[2]))
        b = at * (P[3] + at * (P[4] + at * P[5]))
        c = at * (P[6] + at * (P[7] + at * P[8]))
        for k in range(n):
            last = s.stages[2 * n + k]
            s.z[i * n + k] = a * s.stages[k] + b * s.stages[n + k] + c * last - last


def newton(s: IntegratorWorkspace, size: float) -> int:
    """Iterate for the stages by simplified Newton; return the number of iterations, 0 if it fails, -1 if the matrix needs another order."""
    n = s.n
    if s.factorised == 0 or abs(size - s.factorised_size) > 1e-9 * size:
        s.factorisations += 2
        s.factorised_size = size
        s.factorised = factorise(s, size)
        if s.factorised == ANEW:
            s.factorised = SINGULAR
            return -1
        if s.factorised == SINGULAR:
            return 0
    if s.negative != 0 and s.differential == n:
        return 0
    for i in range(3):
        for k in range(n):
            s.w[i * n + k] = TI[3 * i] * s.z[k] + TI[3 * i + 1] * s.z[n + k] + TI[3 * i + 2] * s.z[2 * n + k]
    last = 0.0
    s.contraction = 0.0
    if has_loops(s):
        put_terms(s, s.state)
    for iteration in range(NEWTON_ITERATIONS):
        if not correct(s, size):
            return 0
        norm = sqrt(squares(s)) / sqrt(3.0 * float(n))
        if not isfinite(norm):
            return 0
        if diverges(s, norm, last, NEWTON_ITERATIONS - iteration):
            return stagnant(s, iteration + 1, norm)
        for i in range(3 * n):
            s.w[i] += s.change[i]
        for i in range(3):
            for k in range(n):
                s.z[i * n + k] = T[3 * i] * s.w[k] + T[3 * i + 1] * s.w[n + k] + T[3 * i + 2] * s.w[2 * n + k]
        first = s.last_size == 0.0 and iteration + 1 < NEWTON_ITERATIONS
        allowed = s.first_newton_tolerance if first else s.newton_tolerance
        if has_converged(s, norm, last, allowed, 3):
            return iteration + 1
        last = norm
        for i in range(3 * n):
            s.last_change[i] = s.change[i]
    return stagnant(s, NEWTON_ITERATIONS, last)


def correct(s: IntegratorWorkspace, size: float) -> bool:
    """Compute one Newton correction into `change`; return False if a rate is not finite."""
    n = s.n
    if not stage_rates(s, size, 3, C, 0):
        return False
    for i in range(3):
        for k in range(n):
            s.change[i * n + k] = TI[3 * i] * s.f[k] + TI[3 * i + 1] * s.f[n + k] + TI[3 * i + 2] * s.f[2 * n + k]
    real = MU_REAL / size
    re = MU_RE / size
    im = MU_IM / size
    for k in range(s.differential):
        a = s.w[n + k]
        b = s.w[2 * n + k]
        s.change[k] -= real * s.w[k]
        s.change[n + k] -= re * a - im * b
        s.change[2 * n + k] -= re * b + im * a
    solve_real(s, s.change)
    solve_complex(s, s.change[n:], s.change[2 * n :])
    return True


def estimate(s: IntegratorWorkspace, size: float, rejected: bool) -> float:
    """Return the norm of the error in units of the tolerance."""
    n = s.n
    for i in range(n):
        s.rest[i] = 0.0
        if i < s.differential:
            s.rest[i] = (E[0] * s.z[i] + E[1] * s.z[n + i] + E[2] * s.z[2 * n + i]) / size
    return filtered_norm(s, rejected)


def misses(s: IntegratorWorkspace, end: float, size: float) -> bool:
    """Return True if the unknowns of loops do not solve their equations at the end of a step.

    A Jacobian of another place, as of a diode that no longer conducts, may be so much too steep that iterations change nothing. Where the residual is not
    much smaller than before the last change, the Jacobian at the end gives the error. The last iteration's rates are still in `f`; those at the end replace
    the second stage there.
    """
    n = s.n
    if not has_loops(s):
        return False
    ahead = s.f[n:]
    rates(s, end, s.new, ahead)
    put_terms(s, s.new)
    ratio = 0.0
    moved = 0.0
    for i in range(n):
        s.w[i] = ahead[i] if i >= s.differential else 0.0
        if not abs(s.w[i]) <= ROUNDED * s.terms[i]:
            before = abs(s.f[2 * n + i])
            ratio = max(ratio, abs(s.w[i]) / before if before > 0.0 else INFINITE)
        if i >= s.differential:
            moved = max(moved, abs(s.change[i] + s.change[n + i]) * s.per_tolerance[i])
    if ratio <= UNSOLVED and ratio * moved <= NEARLY * (1.0 - ratio):
        return False
    current = s.current
    renew_at(s, end, s.new)
    s.current = current
    s.factorisations += 1
    s.factorised_size = size
    if factorise_real(s, MU_REAL / size) != FINE:
        return True
    solve_real(s, s.w)
    for i in range(s.differential, n):
        if not abs(s.w[i]) * s.per_tolerance[i] <= SOLVED:
            return True
    return False


def solve_unknowns(s: IntegratorWorkspace, size: float) -> None:
    """Solve the equations of loops at the start of a step for their unknowns, far below the tolerance; no change where that fails.

    A law as steep as a diode's may bend within a fraction of the tolerance: from unknowns so far off, no step is short enough for the iteration. Newton's
    method is damped by the natural monotonicity test (Deuflhard, Newton Methods for Nonlinear Problems, section 3.3).
    """
    n = s.n
    for i in range(n):
        s.new[i] = s.state[i]
        s.rest[i] = s.state[i]
    for _ in range(MOST_SOLVING):
        renew_at(s, s.time, s.new)
        put_terms(s, s.new)
        s.factorisations += 1
        if factorise_real(s, MU_REAL / size) != FINE:
            break
        moved = loop_correction(s, s.new, s.error)
        if moved <= SOLVED * SOLVED:
            for i in range(s.differential, n):
                s.state[i] = s.new[i] + s.error[i]
                s.end_state[(s.ends - 1) * n + i] = s.state[i]
            rates(s, s.time, s.state, s.rate)
            break
        share = 2.0
        left = INFINITE
        while left > (1.0 - 0.5 * share) * moved and share > DAMPED:
            share *= 0.5
            for i in range(s.differential, n):
                s.rest[i] = s.new[i] + share * s.error[i]
            left = loop_correction(s, s.rest, s.w)
        for i in range(n):
            s.new[i] = s.rest[i]
    renew(s)


def loop_correction(s: IntegratorWorkspace, y: Floats, out: Floats) -> float:
    """Compute Newton's correction of the unknowns of loops at a state; return the largest, in units of the tolerance."""
    rates(s, s.time, y, out)
    drop_noise(s, out)
    for i in range(s.differential):
        out[i] = 0.0
    solve_real(s, out)
    most = 0.0
    for i in range(s.differential, s.n):
        part = abs(out[i]) * s.per_tolerance[i]
        if not part <= most:
            most = part if isfinite(part) else INFINITE
    return most
