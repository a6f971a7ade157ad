"""One step of Radau IIA of 3, 5 or 7 stages (orders 5, 9, 13), chosen as it goes; one source, as machine code and as Python where there is none.

Hairer and Wanner, Stiff differential equations solved by Radau methods, J. Comput. Appl. Math. 111, 1999: the transformation to one real and up to
three complex systems, the estimate, and the choice of order by the contraction of Newton's iteration. An iteration that contracts fast solves more
stages for little; one that hardly does needs fewer. Within a step the collocation polynomial holds, in the form of that of DOP853; the estimate is
of its order, so states between the ends have the tolerance, too, and those at the ends are far better.
"""

from __future__ import annotations

from math import isfinite, sqrt, ulp
from typing import TYPE_CHECKING

import numpy as np

from ..linear_algebra.factors import ComplexFactors, back_complex, eliminate_complex
from ..linear_algebra.sparse import FINE, SINGULAR
from ..outcomes import ERROR, NEWTON, ROUND_OFF
from ..workspace import IntegratorWorkspace
from .dop853_dense import first_bend_along
from .kinks import after_bend
from .newton_matrices import factorise_real, solve_real
from .norms import factor, most_left
from .radau_step import (
    BENT,
    BETWEEN,
    BEYOND,
    CUBIC,
    GROWN,
    LARGEST,
    LOOKS,
    MOST_BENDS,
    NEAREST,
    PATIENT,
    SEEN,
    SMALLEST,
    UNSEEN,
    drop_noise,
    first_size,
    has_loops,
    is_rounding,
    is_stubborn,
    look_at_side,
    misses,
    onto_constraints,
    put_end,
    put_terms,
    rates,
    renew,
    share,
    stagnant,
)  # fmt: skip

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    from compiler.api import Floats, Numbers


def coefficients(stages: int) -> Sequence[Any]:
    """Return nodes, T, its inverse, eigenvalues (the real one, then pairs), weights of the estimate, and the matrix from stages to dense rows."""
    legendre = np.polynomial.legendre
    radau = np.zeros(stages + 1)
    radau[-2:] = -1.0, 1.0  # P_s - P_(s-1)
    places = np.sort(legendre.legroots(radau))
    for _ in range(3):
        places -= legendre.legval(places, radau) / legendre.legval(places, legendre.legder(radau))
    places[-1] = 1.0
    c = (places + 1) / 2
    basis = legendre.legvander(places, stages - 1)
    whole = np.stack([legendre.legval(places, legendre.legint(row, lbnd=-1)) / 2 for row in np.eye(stages)], axis=1)
    inverse = basis @ np.linalg.inv(whole)
    values, vectors = np.linalg.eig(inverse.T)  # rows of the transformation are left eigenvectors
    order = sorted((k for k in range(stages) if values[k].imag <= 1e-9), key=lambda k: abs(values[k].imag))
    rows = [vectors[:, order[0]].real, *(part for k in order[1:] for part in (vectors[:, k].real, vectors[:, k].imag))]
    forth = np.stack([row / np.abs(row).max() for row in rows[:1]] + rows[1:])
    start = np.linalg.solve(
        basis.T, legendre.legvander(np.array([-1.0]), stages - 1)[0]
    )  # Lagrange polynomials at the start
    powers = np.stack([c ** (r // 2 + 1) * (1 - c) ** ((r + 1) // 2) for r in range(stages)], axis=1)
    eigenvalues = [values[order[0]].real, *(part for k in order[1:] for part in (values[k].real, values[k].imag))]
    return c, np.linalg.inv(forth), forth, np.array(eigenvalues), -start @ inverse, np.linalg.inv(powers)


# Coefficients for 3, 5 and 7 stages one after the other; index of the first number, of the first matrix.
C, T, TI, MU, E, WITHIN = (
    tuple(np.concatenate([np.ravel(coefficients(stages)[item]) for stages in (3, 5, 7)]).tolist()) for item in range(6)
)
FIRST, FIRST_MATRIX = (0, 3, 8), (0, 9, 34)
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
    size = first_size(s, s.size, least, SEEN, UNSEEN, LOOKS, BETWEEN, CUBIC)
    reason = ERROR
    rejected = 0
    bent = 0
    cut = 1.0
    if s.last_size == 0.0:
        use_stages(s, LEAST)
    if s.known == 0:
        renew(s)
    for i in range(n):
        s.per_tolerance[i] = 1.0 / (s.absolute[i] + abs(s.state[i]) * s.relative)
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
        if norm > BENT and bent < MOST_BENDS and s.bend_count > 0:
            put_rows_of_stages(s)
            cut = first_bend_along(s, size, least)
            if cut < 1.0:
                bent += 1
                size *= cut
                continue
        if norm > 1.0 and is_rounding(s, norm, 1.0, 0.0):
            norm = 1.0
        if norm <= 1.0:
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
        wish = max(SMALLEST, safety * (factor(s, size, norm, power) if isfinite(norm) else 0.1))
        rejected += 1
        if is_stubborn(s, rejected, size, norm):
            return ROUND_OFF
        size *= wish if rejected <= PATIENT else SMALLEST
    grown = GROWN if norm == 1.0 else min(LARGEST, safety * factor(s, size, norm, power))
    accept_stages(s, end, size, norm, min(grown, 1.0) if rejected > 0 else grown, iterations)
    if bent > 0:
        after_bend(s, size / max(cut, NEAREST))
    if s.bend_count > 0:
        look_at_side(s, BEYOND * size if bent > 0 else 0.0)
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
    put_rows_of_stages(s)
    for i in range(ROWS * n):
        s.stages[i] = s.dense[i]
    s.dense_known = 1
    if s.closed.gaps > 0:
        onto_constraints(s, end)
    if has_loops(s):
        for i in range(n):
            s.rate[i] = s.f[n + i]
    else:
        rates(s, end, s.new, s.rate)
    if s.closed.gaps > 0:
        for i in range(s.differential, n):
            s.rate[i] = 0.0
    put_end(s, end, s.rate)
    s.smoothed_contraction = max(s.contraction, 0.5 * s.smoothed_contraction)
    ratio = size / s.last_size if s.last_size > 0.0 else 1.0
    s.last_size = size
    s.last_error = max(norm, 1e-2)
    s.since_order += 1
    if iterations > 2 and s.contraction > 1e-3:
        renew(s)
    else:
        s.current = 0
        if grown < 1.2:
            grown = 1.0  # the factorisation is used once more
    s.size = size * grown
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
        if last > 0.0:
            s.contraction = norm / last
            left = 1.0
            for _ in range(most - iteration):
                left *= s.contraction
            if s.contraction >= 1.0 or left / (1.0 - s.contraction) * norm > s.newton_tolerance:
                return stagnant(s, iteration + 1, norm)
        for i in range(stages * n):
            s.w[i] += s.change[i]
        combine_stages(n, stages, T, s.w, s.z)
        first = s.last_size == 0.0 and iteration + 1 < most
        allowed = TIGHT * (s.first_newton_tolerance if first else s.newton_tolerance)
        left = s.contraction / (1.0 - s.contraction) * norm
        if norm == 0.0 or (last > 0.0 and left < allowed and most_left(s, stages) < s.creeping_tolerance):
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


def factorise_pair(s: IntegratorWorkspace, factors: ComplexFactors, real: float, imaginary: float) -> bool:
    """Factorise the matrix of one pair; return False if it is singular."""
    n = s.n
    re = factors.re
    im = factors.im
    for i in range(n * n):
        re[i] = 0.0
        im[i] = 0.0
    for i in range(s.differential):
        re[i * n + i] = real
        im[i * n + i] = imaginary
    for k in range(s.entry_count):
        re[s.rows[k] * n + s.columns[k]] -= s.jacobian[k]
    return eliminate_complex(factors)


def correct_stages(s: IntegratorWorkspace, size: float) -> bool:
    """Compute one Newton correction into `change`; return False if a rate is not finite."""
    n = s.n
    stages = s.stage_count
    nodes = FIRST[(stages - LEAST) // 2]
    for i in range(stages):
        stage = s.z[i * n :]
        for k in range(n):
            s.rest[k] = s.state[k] + stage[k]
        rates(s, s.time + size * C[nodes + i], s.rest, s.f[i * n :])
    for i in range(stages * n):
        if not isfinite(s.f[i]):
            return False
    for i in range(stages):
        drop_noise(s, s.f[i * n :])
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
    for i in range(n):
        s.error[i] = s.rate[i]
    filter_error(s)
    norm = share(s)
    if norm > 1.0 and (rejected or s.last_size == 0.0):
        for i in range(n):
            s.w[i] = s.state[i] + s.error[i]
        rates(s, s.time, s.w, s.error)
        filter_error(s)
        norm = share(s)
    for i in range(n):
        s.error[i] /= s.allowed_estimate * (s.absolute[i] + max(abs(s.state[i]), abs(s.new[i])) * s.relative)
    return norm


def filter_error(s: IntegratorWorkspace) -> None:
    """Solve the real system for a rate in `error`, with the stages' part in `rest`."""
    drop_noise(s, s.error)
    for i in range(s.n):
        s.error[i] += s.rest[i]
    solve_real(s, s.error)
