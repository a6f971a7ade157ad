"""One step of Radau IIA (see `radau.py`), of three stages (order 5), or of 3, 5 or 7 (orders 5, 9, 13), chosen as it goes: the row of the method has the most.

Hairer and Wanner, Stiff differential equations solved by Radau methods, J. Comput. Appl. Math. 111, 1999: the transformation to one real and up to
three complex systems, the estimate, and the choice of order by the contraction of Newton's iteration. An iteration that contracts fast solves more
stages for little; one that hardly does needs fewer. Within a step of variable order the collocation polynomial holds, in the form of that of DOP853; the
estimate is of its order, so states between the ends have the tolerance, too, and those at the ends are far better.
"""

from __future__ import annotations

from math import isfinite, sqrt, ulp

from compiler.api import Floats, Numbers

from .. import radau, tolerances
from ..linear_algebra.factors import back_complex
from ..linear_algebra.sparse import ANEW, FINE, SINGULAR
from ..methods import STAGES, THROUGH_ENDS
from ..outcomes import ERROR, NEWTON, ORDER, ROUND_OFF
from ..workspace import IntegratorWorkspace
from .dop853_dense import NEAREST, PLACES
from .evaluation import drop_noise, has_loops, put_end, put_end_rates, put_terms, rates, renew, renew_at
from .kinks import first_bend
from .missed_rates import keep_missed, keep_missed_by_rows
from .newton_matrices import factorise_pair, factorise_real, solve_complex, solve_real
from .peaks import first_peak
from .radau_coefficients import MU, TI, WITHIN, C, E, T
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
from .trial_interpolant import along_rows, along_stages

FIRST, FIRST_MATRIX = (0, 3, 8), (0, 9, 34)  # index of the first number and of the first matrix for 3, 5 and 7 stages
LEAST, ROWS = 3, 7
ITERATIONS = (6, 11, 16)
D = tuple(radau.D.tolist())
NODES = (0.0, *C[:LEAST])  # fractions of a step at which kinks are searched, at order 5
UNSOLVED, SOLVED, ROUNDED, NEARLY = radau.UNSOLVED, radau.SOLVED, radau.ROUNDED, radau.NEARLY
UNCONVERGED, MOST_SOLVING, DAMPED = radau.UNCONVERGED, radau.MOST_SOLVING, radau.DAMPED
BENT, MOST_BENDS, NEAR, INFINITE = radau.BENT, radau.MOST_BENDS, radau.NEAREST, tolerances.INFINITE
# Of variable order. Factors on the allowed error of the iteration: the guess of a long step errs in smooth directions, so the first contraction is better
# than the next.
TIGHT = (0.05, 0.01, 0.01)
FAST, SLOW = 0.002, 0.8  # contraction below which more stages are solved for, and above which fewer
EVEN, UNEVEN = 1.2, 0.8  # ratios of two steps between which the number of stages may rise
WAITING = 3  # steps after a change of the number of stages before it rises


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
    if s.last_size == 0.0:
        use_stages(s, LEAST)
    while True:
        if size < least and s.time + size < s.stop:
            return reason
        end = s.stop if s.time + size >= s.stop else s.time + size
        size = end - s.time
        guess_stages(s, size)
        iterations = solve_stages(s, size)
        if iterations < 0:
            return ORDER
        if iterations == 0:
            reason = NEWTON
            if s.current == 0:
                renew(s)
            else:
                unconverged += 1
                size *= 0.5
                use_stages(s, max(LEAST, s.stage_count - 2))
                if unconverged == UNCONVERGED and has_loops(s):
                    solve_unknowns(s, size)
            continue
        last = (s.stage_count - 1) * n
        power = 1.0 / float(s.stage_count + 1)  # of the estimate in the step size
        for i in range(n):
            s.new[i] = s.state[i] + s.z[last + i]
        norm = estimate_stages(s, size, rejected > 0)
        most = 2.0 * float(ITERATIONS[(s.stage_count - LEAST) // 2])
        safety = 0.9 * (most + 1.0) / (most + float(iterations))
        if norm > BENT and s.bend_count > 0 and bent < MOST_BENDS:
            share = first_bend_of_stages(s, size, least)
            if share < 1.0:
                cut = share
                bent += 1
                size *= cut
                continue
        norm = 1.0 if norm > 1.0 and is_rounding(s, norm, 1.0, 0.0) else norm
        if norm <= 1.0:
            put_rows_of_stages(s)
            share = first_peak(s, size, C, FIRST[(s.stage_count - LEAST) // 2], s.stage_count)
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
        size = next_try(s, size, norm, safety, power, rejected)
        if size == 0.0:
            return ROUND_OFF
    accept_stages(s, end, size, norm, growth(s, size, norm, safety, power, rejected), iterations)
    look_beyond(s, size, cut, bent)
    return 0


def use_stages(s: IntegratorWorkspace, stages: int) -> None:
    """Set the number of stages from now on."""
    if stages != s.stage_count:
        s.stage_count = stages
        s.factorised = 0
        s.since_order = 0


def accept_stages(s: IntegratorWorkspace, end: float, size: float, norm: float, grown: float, iterations: int) -> None:
    """Complete a step, and choose the size and the number of stages of the next."""
    n = s.n
    put_end_rates(s, end)
    if THROUGH_ENDS[s.method] != 0:
        for i in range(n):
            s.rest[i] = (D[0] * s.z[i] + D[1] * s.z[n + i] + D[2] * s.z[2 * n + i]) / size
        keep_missed(s, end, size, s.rest)
        put_end(s, end, s.rest)
        for i in range(LEAST * n):
            s.stages[i] = s.z[i]
    else:
        keep_missed_by_rows(s, end, size)
        put_end(s, end, s.rate)
        for i in range(ROWS * n):
            s.stages[i] = s.dense[i]
        s.dense_known = 1
    s.smoothed_contraction = max(s.contraction, 0.5 * s.smoothed_contraction)
    ratio = size / s.last_size if s.last_size > 0.0 else 1.0
    s.since_order += 1
    choose_next(s, size, norm, grown, iterations)
    if s.smoothed_contraction >= SLOW:
        use_stages(s, max(LEAST, s.stage_count - 2))
    elif (
        s.smoothed_contraction <= FAST
        and iterations > 1
        and ratio > UNEVEN
        and ratio < EVEN
        and s.since_order > WAITING
    ):
        use_stages(s, min(STAGES[s.method], s.stage_count + 2))


def first_bend_of_stages(s: IntegratorWorkspace, size: float, least: float) -> float:
    """Return the fraction of the tried step at which a law first has a kink; 1 if there is none, or if it is very near."""
    if THROUGH_ENDS[s.method] != 0:
        return first_bend(s, size, NODES, LEAST + 1, NEAR)
    put_rows_of_stages(s)
    return first_bend(s, size, PLACES, 5, max(NEAREST, 2.0 * least / size))


def put_rows_of_stages(s: IntegratorWorkspace) -> None:
    """Store the collocation polynomial of the tried step of variable order in the form of that of DOP853."""
    if THROUGH_ENDS[s.method] == 0:
        for i in range(ROWS * s.n):
            s.dense[i] = 0.0
        combine_stages(s.n, s.stage_count, WITHIN, s.z, s.dense)


def combine_stages(n: int, stages: int, weights: Numbers, given: Floats, out: Floats) -> None:
    """Multiply rows of n numbers by the matrix of this many stages in `weights`."""
    first = FIRST_MATRIX[(stages - LEAST) // 2]
    for i in range(stages):
        row = out[i * n :]
        a = weights[first + stages * i]
        b = weights[first + stages * i + 1]
        c = weights[first + stages * i + 2]
        for k in range(n):
            row[k] = a * given[k] + b * given[n + k] + c * given[2 * n + k]
        for j in range(LEAST, stages):
            weight = weights[first + stages * i + j]
            for k in range(n):
                row[k] += weight * given[j * n + k]


def guess_stages(s: IntegratorWorkspace, size: float) -> None:
    """Extrapolate the stages from the last step's polynomial."""
    n = s.n
    first = FIRST[(s.stage_count - LEAST) // 2]
    for i in range(s.stage_count):
        row = s.z[i * n :]
        at = 1.0 + C[first + i] * size / s.last_size if s.last_size > 0.0 else 0.0
        if s.last_size == 0.0:
            for k in range(n):
                row[k] = 0.0
        elif THROUGH_ENDS[s.method] != 0:
            along_stages(s, at, s.stages, row)
            for k in range(n):
                row[k] -= s.stages[2 * n + k]
        else:
            along_rows(s, at, s.stages, row)
            for k in range(n):
                row[k] -= s.stages[k]


def solve_stages(s: IntegratorWorkspace, size: float) -> int:
    """Iterate for the stages by simplified Newton; return the number of iterations, 0 if it fails, -1 if the matrix needs another order."""
    n = s.n
    stages = s.stage_count
    most = ITERATIONS[(stages - LEAST) // 2]
    if s.factorised == 0 or abs(size - s.factorised_size) > 1e-9 * size:
        s.factorised_size = size
        s.factorised = factorise_stages_of(s, size)
        if s.factorised == ANEW:
            s.factorised = SINGULAR
            return -1
        if s.factorised == SINGULAR:
            return 0
    if s.negative != 0 and s.differential == n:
        return 0
    combine_stages(n, stages, TI, s.z, s.w)
    last = 0.0
    s.contraction = 0.0
    if has_loops(s):
        put_terms(s, s.state)
    tight = 1.0 if THROUGH_ENDS[s.method] != 0 else TIGHT[(stages - LEAST) // 2]
    for iteration in range(most):
        if not correct_stages(s, size):
            return 0
        total = 0.0
        for i in range(stages):
            of_stage = 0.0
            for k in range(n):
                part = s.change[i * n + k] * s.per_tolerance[k]
                of_stage += part * part
            total += of_stage
        norm = sqrt(total) / sqrt(float(stages * n))
        if not isfinite(norm):
            return 0
        if diverges(s, norm, last, most - iteration):
            return stagnant(s, iteration + 1, norm)
        for i in range(stages * n):
            s.w[i] += s.change[i]
        combine_stages(n, stages, T, s.w, s.z)
        first = s.last_size == 0.0 and iteration + 1 < most
        allowed = tight * (s.first_newton_tolerance if first else s.newton_tolerance)
        if has_converged(s, norm, last, allowed, stages):
            return iteration + 1
        last = norm
        for i in range(stages * n):
            s.last_change[i] = s.change[i]
    return stagnant(s, most, last)


def factorise_stages_of(s: IntegratorWorkspace, size: float) -> int:
    """Factorise mu/h M - J for the real mu and the pairs; return `FINE`, `SINGULAR`, or `ANEW` if another order is needed."""
    first = FIRST[(s.stage_count - LEAST) // 2]
    s.factorisations += (s.stage_count + 1) // 2
    done = factorise_real(s, MU[first] / size)
    if done == FINE:
        done = factorise_pair(s, s.complex, MU[first + 1] / size, MU[first + 2] / size)
    if done == FINE and s.stage_count > 3:
        done = factorise_pair(s, s.second, MU[first + 3] / size, MU[first + 4] / size)
    if done == FINE and s.stage_count > 5:
        done = factorise_pair(s, s.third, MU[first + 5] / size, MU[first + 6] / size)
    return done


def correct_stages(s: IntegratorWorkspace, size: float) -> bool:
    """Compute one Newton correction into `change`; return False if a rate is not finite."""
    n = s.n
    stages = s.stage_count
    nodes = FIRST[(stages - LEAST) // 2]
    if not stage_rates(s, size, stages, C, nodes):
        return False
    combine_stages(n, stages, TI, s.f, s.change)
    real = MU[nodes] / size
    for k in range(s.differential):
        s.change[k] -= real * s.w[k]
    for pair in range(1, stages, 2):
        re = MU[nodes + pair] / size
        im = MU[nodes + pair + 1] / size
        one = s.change[pair * n :]
        two = s.change[(pair + 1) * n :]
        a = s.w[pair * n :]
        b = s.w[(pair + 1) * n :]
        for k in range(s.differential):
            one[k] -= re * a[k] - im * b[k]
            two[k] -= re * b[k] + im * a[k]
    solve_real(s, s.change)
    solve_complex(s, s.change[n:], s.change[2 * n :])
    if stages > 3:
        back_complex(s.second, s.change[3 * n :], s.change[4 * n :])
    if stages > 5:
        back_complex(s.third, s.change[5 * n :], s.change[6 * n :])
    return True


def estimate_stages(s: IntegratorWorkspace, size: float, rejected: bool) -> float:
    """Return the norm of the error in units of the tolerance: the rate at the start against that of the stages' polynomial, filtered for stiff parts."""
    n = s.n
    first = FIRST[(s.stage_count - LEAST) // 2]
    for i in range(n):
        s.rest[i] = 0.0
    for i in range(s.differential):
        total = E[first] * s.z[i] + E[first + 1] * s.z[n + i] + E[first + 2] * s.z[2 * n + i]
        for j in range(LEAST, s.stage_count):
            total += E[first + j] * s.z[j * n + i]
        s.rest[i] = total / size
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
    last = (s.stage_count - 1) * n
    weights = FIRST_MATRIX[(s.stage_count - LEAST) // 2] + s.stage_count * (s.stage_count - 1)  # of the end of the step
    ahead = s.f[n:]
    rates(s, end, s.new, ahead)
    put_terms(s, s.new)
    ratio = 0.0
    moved = 0.0
    for i in range(n):
        s.w[i] = ahead[i] if i >= s.differential else 0.0
        if not abs(s.w[i]) <= ROUNDED * s.terms[i]:
            before = abs(s.f[last + i])
            ratio = max(ratio, abs(s.w[i]) / before if before > 0.0 else INFINITE)
        if i >= s.differential:
            change = 0.0
            for j in range(s.stage_count):
                change += T[weights + j] * s.change[j * n + i]
            moved = max(moved, abs(change) * s.per_tolerance[i])
    if ratio <= UNSOLVED and ratio * moved <= NEARLY * (1.0 - ratio):
        return False
    current = s.current
    renew_at(s, end, s.new)
    s.current = current
    s.factorisations += 1
    s.factorised_size = size
    if factorise_real(s, MU[0] / size) != FINE:
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
        if factorise_real(s, MU[0] / size) != FINE:
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
