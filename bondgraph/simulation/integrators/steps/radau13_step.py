"""One step of Radau IIA of 3, 5 or 7 stages (orders 5, 9, 13), chosen as it goes; one source, as machine code and as Python where there is none.

Hairer and Wanner, Stiff differential equations solved by Radau methods, J. Comput. Appl. Math. 111, 1999: the transformation to one real and up to
three complex systems, the estimate, and the choice of order by the contraction of Newton's iteration. An iteration that contracts fast solves more
stages for little; one that hardly does needs fewer. Within a step the collocation polynomial holds, in the form of that of DOP853; the estimate is
of its order, so states between the ends have the tolerance, too, and those at the ends are far better.
"""

from __future__ import annotations

from math import isfinite, sqrt, ulp

from compiler.api import Floats, Numbers

from ..linear_algebra.factors import back_complex
from ..linear_algebra.sparse import FINE, SINGULAR
from ..outcomes import ERROR, NEWTON, ROUND_OFF
from ..workspace import IntegratorWorkspace
from .dop853_dense import NEAREST, PLACES
from .evaluation import has_loops, put_end, put_end_rates, put_terms, renew
from .kinks import first_bend
from .newton_matrices import factorise_pair, factorise_real, solve_real
from .peaks import first_peak
from .radau13_coefficients import MU, TI, WITHIN, C, E, T
from .radau_step import BENT, MOST_BENDS, misses
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

FIRST, FIRST_MATRIX = (0, 3, 8), (0, 9, 34)  # index of the first number and of the first matrix for 3, 5 and 7 stages
LEAST, MOST, ROWS = 3, 7, 7
ITERATIONS = (6, 11, 16)
# Factor on the allowed error of the iteration: the guess of a long step errs in smooth directions, so the first contraction is better than the next.
TIGHT = 1e-2
FAST, SLOW = 0.002, 0.8  # contraction below which more stages are solved for, and above which fewer
EVEN, UNEVEN = 1.2, 0.8  # ratios of two steps between which the number of stages may rise
WAITING = 3  # steps after a change of the number of stages before it rises


def radau13_step(s: IntegratorWorkspace) -> int:
    """Make one accepted step; return 0, or the reason why there is none."""
    n = s.n
    least = 10.0 * ulp(s.time)
    size = first_try(s)
    reason = ERROR
    rejected = 0
    bent = 0
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
        if iterations == 0:
            reason = NEWTON
            if s.current == 0:
                renew(s)
            else:
                size *= 0.5
                use_stages(s, max(LEAST, s.stage_count - 2))
            continue
        last = (s.stage_count - 1) * n
        power = 1.0 / float(s.stage_count + 1)
        for i in range(n):
            s.new[i] = s.state[i] + s.z[last + i]
        norm = estimate_stages(s, size, rejected > 0)
        most = 2.0 * float(ITERATIONS[(s.stage_count - LEAST) // 2])
        safety = 0.9 * (most + 1.0) / (most + float(iterations))
        if norm > BENT and s.bend_count > 0 and bent < MOST_BENDS:
            put_rows_of_stages(s)
            share = first_bend(s, size, PLACES, 5, max(NEAREST, 2.0 * least / size))
            if share < 1.0:
                cut = share
                bent += 1
                size *= cut
                continue
        if norm > 1.0 and is_rounding(s, norm, 1.0, 0.0):
            norm = 1.0
        if norm <= 1.0:
            put_rows_of_stages(s)
            share = first_peak(s, size, C, FIRST[(s.stage_count - LEAST) // 2], s.stage_count)
            size *= share
            if share < 1.0:
                continue
            for i in range(n):
                s.f[2 * n + i] = s.f[last + i]  # the place that `misses` reads
            if not misses(s, end, size):
                break
            reason = NEWTON
            if s.current != 0:
                size *= 0.5
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
    for i in range(ROWS * n):
        s.stages[i] = s.dense[i]
    s.dense_known = 1
    put_end_rates(s, end)
    put_end(s, end, s.rate)
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
        use_stages(s, min(MOST, s.stage_count + 2))


def put_rows_of_stages(s: IntegratorWorkspace) -> None:
    """Store the collocation polynomial of the tried step in the form of that of DOP853."""
    n = s.n
    for i in range(ROWS * n):
        s.dense[i] = 0.0
    combine_stages(n, s.stage_count, WITHIN, s.z, s.dense)


def combine_stages(n: int, stages: int, weights: Numbers, given: Floats, out: Floats) -> None:
    """Multiply rows of n numbers by the matrix of this many stages in `weights`."""
    first = FIRST_MATRIX[(stages - LEAST) // 2]
    for i in range(stages):
        row = out[i * n :]
        for k in range(n):
            row[k] = 0.0
        for j in range(stages):
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
        back = 1.0 - at
        for k in range(n):
            row[k] = 0.0
        if s.last_size > 0.0:
            for k in range(n):
                value = at * s.stages[6 * n + k] + s.stages[5 * n + k]
                value = back * value + s.stages[4 * n + k]
                value = at * value + s.stages[3 * n + k]
                value = back * value + s.stages[2 * n + k]
                value = at * value + s.stages[n + k]
                row[k] = at * (back * value + s.stages[k]) - s.stages[k]


def solve_stages(s: IntegratorWorkspace, size: float) -> int:
    """Iterate for the stages by simplified Newton; return the number of iterations, 0 if it fails."""
    n = s.n
    stages = s.stage_count
    most = ITERATIONS[(stages - LEAST) // 2]
    if s.factorised == 0 or abs(size - s.factorised_size) > 1e-9 * size:
        s.factorised = factorise_stages_of(s, size)
        s.factorised_size = size
        if s.factorised == SINGULAR:
            return 0
    if s.negative != 0 and s.differential == n:
        return 0
    combine_stages(n, stages, TI, s.z, s.w)
    last = 0.0
    s.contraction = 0.0
    if has_loops(s):
        put_terms(s, s.state)
    for iteration in range(most):
        if not correct_stages(s, size):
            return 0
        total = 0.0
        for i in range(stages):
            for k in range(n):
                total += (s.change[i * n + k] * s.per_tolerance[k]) * (s.change[i * n + k] * s.per_tolerance[k])
        norm = sqrt(total) / sqrt(float(stages * n))
        if not isfinite(norm):
            return 0
        if diverges(s, norm, last, most - iteration):
            return stagnant(s, iteration + 1, norm)
        for i in range(stages * n):
            s.w[i] += s.change[i]
        combine_stages(n, stages, T, s.w, s.z)
        first = s.last_size == 0.0 and iteration + 1 < most
        allowed = TIGHT * (s.first_newton_tolerance if first else s.newton_tolerance)
        if has_converged(s, norm, last, allowed, stages):
            return iteration + 1
        last = norm
        for i in range(stages * n):
            s.last_change[i] = s.change[i]
    return stagnant(s, most, last)


def factorise_stages_of(s: IntegratorWorkspace, size: float) -> int:
    """Factorise mu/h M - J for the real mu and the pairs; return `FINE` or `SINGULAR`."""
    first = FIRST[(s.stage_count - LEAST) // 2]
    s.factorisations += (s.stage_count + 1) // 2
    if factorise_real(s, MU[first] / size) != FINE or not factorise_pair(
        s, s.complex, MU[first + 1] / size, MU[first + 2] / size
    ):
        return SINGULAR
    if s.stage_count > 3 and not factorise_pair(s, s.second, MU[first + 3] / size, MU[first + 4] / size):
        return SINGULAR
    if s.stage_count > 5 and not factorise_pair(s, s.third, MU[first + 5] / size, MU[first + 6] / size):
        return SINGULAR
    return FINE


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
    back_complex(s.complex, s.change[n:], s.change[2 * n :])
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
    for j in range(s.stage_count):
        weight = E[first + j] / size
        for i in range(s.differential):
            s.rest[i] += weight * s.z[j * n + i]
    return filtered_norm(s, rejected)
