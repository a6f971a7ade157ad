"""One step of the Rosenbrock method of `rodas.py`; one source, as machine code and as Python where there is none (`plain.py`).

It has no iteration, so its Jacobian must be that of the start of the step, and it needs the partial derivative of the rates by time there. A step
that would damp a growing mode of the model is halved, as for Radau: then the matrix has a negative determinant.
"""

from __future__ import annotations

from math import isfinite, sqrt, ulp

from .. import radau, rodas
from ..linear_algebra.sparse import ANEW, SINGULAR
from ..outcomes import ERROR, NEWTON, ORDER, ROUND_OFF
from ..workspace import IntegratorWorkspace
from .dop853_dense import NEAREST, PLACES
from .evaluation import look_at_side, put_end, rates, renew
from .kinks import after_bend, first_bend
from .missed_rates import keep_missed_by_rows
from .newton_matrices import factorise_real, solve_real
from .norms import factor
from .peaks import first_peak
from .step_control import BETWEEN, BEYOND, CUBIC, GROWN, LOOKS, SEEN, UNSEEN, first_size, is_rounding, is_stubborn

STAGES, WRITTEN, ROWS, GAMMA = rodas.STAGES, rodas.WRITTEN, rodas.ROWS, rodas.GAMMA
C, D, A, COUPLING, WITHIN = rodas.C, rodas.D, rodas.A, rodas.COUPLING, rodas.WITHIN
SHORTEST, LONGEST, SAFETY, POWER, ASIDE = rodas.SHORTEST, rodas.LONGEST, rodas.SAFETY, rodas.POWER, rodas.ASIDE
CAREFUL, MOST_BENDS, BENT = rodas.CAREFUL, rodas.MOST_BENDS, radau.BENT
NODES = (C[2], C[1], C[3], 1.0)  # fractions of a step at which it evaluates rates, in order
LEAP = 1e3  # times its magnitude, or itself: a state that a step leads further was not followed, whatever the estimate says beside its new size


def rodas_step(s: IntegratorWorkspace) -> int:
    """Make one accepted step; return 0, or the reason why there is none."""
    least = 10.0 * ulp(s.time)
    size = first_size(s, s.size, SEEN, UNSEEN, LOOKS, BETWEEN, CUBIC)
    reason = ERROR
    rejected = 0
    bent = 0
    wish = 0.0  # planned size of a step that a kink has cut
    if s.current == 0:
        renew(s)
    while True:
        if size < least and s.time + size < s.stop:
            return reason
        end = s.stop if s.time + size >= s.stop else s.time + size
        size = end - s.time
        s.factorisations += 1
        s.factorised_size = size
        done = factorise_real(s, 1.0 / (GAMMA * size))
        if done == ANEW:
            return ORDER
        if done == SINGULAR or (s.negative != 0 and s.differential == s.n):
            reason = NEWTON
            size *= 0.5
            continue
        norm = try_step(s, size)
        if s.bend_count > 0 and bent < MOST_BENDS and isfinite(norm):
            share = first_bend(s, size, PLACES, 5, max(NEAREST, 100.0 * least / size))
            if share < 1.0 or (wish > 0.0 and norm > BENT):
                wish = max(wish, size)
                bent += 1
                size *= share if norm <= BENT else 0.5 * share
                continue
        if norm > 0.1 and is_rounding(s, norm, CAREFUL, 0.0):
            norm = 1.0
        if norm <= 1.0:
            share = first_peak(s, size, NODES, 0, 4)
            size *= share
            if share < 1.0:
                continue
            break
        reason = ERROR
        rejected += 1
        if is_stubborn(s, rejected, size, norm):
            return ROUND_OFF
        size *= max(SHORTEST, SAFETY * factor(s, size, norm, POWER)) if isfinite(norm) else 0.1
    grown = GROWN if norm == 1.0 else max(SHORTEST, min(LONGEST, SAFETY * factor(s, size, norm, POWER)))
    s.size = size * (min(grown, 1.0) if rejected > 0 else grown)
    rates(s, end, s.new, s.rate)
    for i in range(s.n):
        s.per_tolerance[i] = 1.0 / (s.absolute[i] + abs(s.state[i]) * s.relative)
    keep_missed_by_rows(s, end, size)
    put_end(s, end, s.rate)
    s.last_size = size
    s.last_error = max(norm, 1e-2)
    s.current = 0
    if wish > 0.0 and s.bend_count > 0:
        look_at_side(s, BEYOND * size)
        if s.current != 0:  # another branch of a law applies
            after_bend(s, wish)
    return 0


def try_step(s: IntegratorWorkspace, size: float) -> float:
    """Compute the stages of a step of this size, its end into `new`, and its polynomial; return the estimate in units of the tolerance."""
    n = s.n
    slope_in_time(s, size)
    for i in range(n):
        s.slope[i] = s.rate[i]
        s.new[i] = s.state[i]
    solve_stage(s, 0, size)
    for stage in range(1, STAGES):
        if stage < WRITTEN:
            argue(s, stage)
        else:
            for i in range(n):
                s.new[i] += s.slope[(stage - 1) * n + i]
        rates(s, s.time + C[stage] * size, s.new, s.slope[stage * n :])
        solve_stage(s, stage, size)
    total = 0.0
    leap = 0.0
    for i in range(n):
        change = s.slope[(STAGES - 1) * n + i]
        s.new[i] += change
        leap = max(leap, abs(s.new[i]) / (LEAP * max(abs(s.state[i]), 1.0)))
        s.error[i] = change / (s.absolute[i] + max(abs(s.state[i]), abs(s.new[i])) * s.relative)
        total += s.error[i] * s.error[i]
    put_polynomial(s)
    norm = CAREFUL * sqrt(total / float(n))
    return max(norm, leap) if leap > 1.0 else norm


def argue(s: IntegratorWorkspace, stage: int) -> None:
    """Put the state at which a stage evaluates the rates, from the stages before it, into `new`."""
    n = s.n
    first = stage * (stage - 1) // 2
    for i in range(n):
        s.new[i] = s.state[i]
    for j in range(stage):
        for i in range(n):
            s.new[i] += A[first + j] * s.slope[j * n + i]


def solve_stage(s: IntegratorWorkspace, stage: int, size: float) -> None:
    """Replace the rates of a stage by the stage."""
    n = s.n
    first = stage * (stage - 1) // 2
    right = s.slope[stage * n :]
    for j in range(stage):
        weight = COUPLING[first + j] / size
        for i in range(s.differential):
            right[i] += weight * s.slope[j * n + i]
    weight = D[stage] * size
    if weight != 0.0:
        for i in range(n):
            right[i] += weight * s.f[i]
    solve_real(s, right)


def slope_in_time(s: IntegratorWorkspace, size: float) -> None:
    """Put the partial derivative of the rates by time at the start of a step, from three values within it, into `f`."""
    n = s.n
    aside = (s.time + ASIDE * size) - s.time
    one = s.f
    two = s.f[n:]
    rates(s, s.time + aside, s.state, one)
    moves = 0
    for i in range(n):
        one[i] -= s.rate[i]
        if one[i] != 0.0:
            moves = 1
    if moves == 0:
        return
    rates(s, s.time + 2.0 * aside, s.state, two)
    for i in range(n):
        one[i] = (4.0 * one[i] - (two[i] - s.rate[i])) / (2.0 * aside)


def put_polynomial(s: IntegratorWorkspace) -> None:
    """Store the polynomial within the step, in the form of that of DOP853."""
    n = s.n
    for i in range(n):
        s.dense[i] = s.new[i] - s.state[i]
    for row in range(6):
        out = s.dense[(row + 1) * n :]
        for i in range(n):
            out[i] = 0.0
        if row < ROWS:
            for stage in range(STAGES):
                for i in range(n):
                    out[i] += WITHIN[row * STAGES + stage] * s.slope[stage * n + i]
    s.dense_known = 1
