"""One step of Radau IIA of order 5 (see `radau.py`)."""

from __future__ import annotations

from math import isfinite, sqrt, ulp
from typing import TYPE_CHECKING

from ...segments import timeline
from .. import radau, tolerances
from ..linear_algebra.sparse import ANEW, FINE, SINGULAR
from ..outcomes import ERROR, NEWTON, ORDER, ROUND_OFF
from ..projection.projection import hold, put_multipliers
from ..workspace import IntegratorWorkspace
from .kinks import after_bend, bends_of, first_bend
from .newton_matrices import factorise, factorise_real, solve_complex, solve_real
from .norms import factor, most_left, squares

if TYPE_CHECKING:
    from compiler.api import Floats, Numbers

C, E, D = (tuple(a.tolist()) for a in (radau.C, radau.E, radau.D))
T, TI, P = (tuple(a.ravel().tolist()) for a in (radau.T, radau.TI, radau.P))
MU_REAL, MU_RE, MU_IM = float(radau.MU_REAL), float(radau.MU_COMPLEX.real), float(radau.MU_COMPLEX.imag)
NEWTON_ITERATIONS, STUBBORN, PATIENT = radau.NEWTON_ITERATIONS, radau.STUBBORN, radau.PATIENT
UNSOLVED, SOLVED, ROUNDED, NOISE = radau.UNSOLVED, radau.SOLVED, radau.ROUNDED, radau.NOISE
SHORTER, GROWN, INFINITE = radau.SHORTER, radau.GROWN, tolerances.INFINITE
NEARLY, UNCONVERGED, MOST_SOLVING, DAMPED = radau.NEARLY, radau.UNCONVERGED, radau.MOST_SOLVING, radau.DAMPED
STAGNANT, ASIDE, FINEST, RINGING = tolerances.STAGNANT, tolerances.ASIDE, tolerances.FINEST, tolerances.RINGING
BENT, NEAREST, MOST_BENDS, BEYOND = radau.BENT, radau.NEAREST, radau.MOST_BENDS, radau.BEYOND
POWER = 0.25  # exponent of the estimate in the step size
SMALLEST, LARGEST = float(radau.SMALLEST), float(radau.LARGEST)
LOOKS, BETWEEN = tuple(timeline.LOOKS.tolist()), tuple(timeline.BETWEEN.ravel().tolist())
CUBIC = tuple(timeline.CUBIC.ravel().tolist())
SEEN, UNSEEN = len(timeline.SEEN), len(timeline.LOOKS) - len(timeline.SEEN)


def radau_step(s: IntegratorWorkspace) -> int:
    """Make one accepted step; return 0, or the reason why there is none."""
    n = s.n
    least = 10.0 * ulp(s.time)
    size = first_size(s, s.size, least, SEEN, UNSEEN, LOOKS, BETWEEN, CUBIC)
    reason = ERROR
    rejected = 0
    bent = 0
    unconverged = 0
    share = 1.0
    if s.known == 0:
        renew(s)
    for i in range(n):
        s.per_tolerance[i] = 1.0 / (s.absolute[i] + abs(s.state[i]) * s.relative)
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
        if norm > BENT and bent < MOST_BENDS and s.bend_count > 0:
            share = first_bend(s, size)
            if share < 1.0:
                bent += 1
                size *= share
                continue
        if norm > 1.0 and is_rounding(s, norm, 1.0, 0.0):
            norm = 1.0
        if norm <= 1.0:
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
        wish = max(SMALLEST, safety * (factor(s, size, norm, POWER) if isfinite(norm) else 0.1))
        rejected += 1
        if is_stubborn(s, rejected, size, norm):
            return ROUND_OFF
        size *= wish if rejected <= PATIENT else SMALLEST
    # a shorter step rounds by more
    grown = GROWN if norm == 1.0 else min(LARGEST, safety * factor(s, size, norm, POWER))
    accept(s, end, size, norm, grown, rejected > 0, iterations)
    if bent > 0:
        after_bend(s, size / max(share, NEAREST))
    if s.bend_count > 0:
        look_at_side(s, BEYOND * size if bent > 0 else 0.0)
    return 0


def is_rounding(s: IntegratorWorkspace, norm: float, careful: float, size: float) -> bool:
    """Return whether an estimate is rounding, which a shorter step has more of: followed, it leads to modes far below the tolerance.

    `careful`: the factor of the method on its estimates; `size`: as for `rounding`.
    """
    if s.relative >= FINEST or not norm <= careful * s.stagnation_tolerance:
        return False
    for i in range(s.n):
        s.per_tolerance[i] = 1.0 / (s.absolute[i] + abs(s.state[i]) * s.relative)
    if norm > careful * RINGING * rounding(s, size):
        return False
    s.rounded = max(s.rounded, norm / careful)
    return True


def look_at_side(s: IntegratorWorkspace, ahead: float) -> None:
    """Renew the Jacobian after a step if it belongs to the other side of a kink, also where the step ends at one: it would hide errors filtered by it."""
    for i in range(s.n):
        s.rest[i] = s.state[i] + ahead * s.rate[i]
    bends_of(s, s.time + ahead, s.rest, s.bend_seen)
    for j in range(s.bend_count):
        if sign(s.bend_seen[j]) != s.bend_side[j]:
            renew_at(s, s.time + ahead, s.rest)
            return


def sign(x: float) -> float:
    """Return the sign as numpy does."""
    return 1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0)


def is_stubborn(s: IntegratorWorkspace, rejected: int, size: float, norm: float) -> bool:
    """Return True if much shorter steps have not reduced the error; `rejected`: the number of this try."""
    s.rejected += 1
    last = (rejected - 1) % STUBBORN
    first = rejected % STUBBORN
    s.norms[last] = norm
    s.sizes[last] = size
    return rejected >= STUBBORN and size < SHORTER * s.sizes[first] and norm > 0.5 * s.norms[first]


def accept(
    s: IntegratorWorkspace, end: float, size: float, norm: float, grown: float, rejected: bool, iterations: int
) -> None:
    """Complete a step and choose the size of the next."""
    n = s.n
    if s.closed.gaps > 0:
        onto_constraints(s, end)
    for i in range(n):
        s.rest[i] = (D[0] * s.z[i] + D[1] * s.z[n + i] + D[2] * s.z[2 * n + i]) / size
    put_end(s, end, s.rest)
    for i in range(3 * n):
        s.stages[i] = s.z[i]
    s.last_size = size
    s.last_error = max(norm, 1e-2)
    if has_loops(s):
        for i in range(n):
            s.rate[i] = s.f[n + i]
    else:
        rates(s, end, s.state, s.rate)
    if s.closed.gaps > 0:
        for i in range(s.differential, n):
            s.rate[i] = 0.0
    stale = iterations > 2 and s.contraction > 1e-3
    if rejected:
        grown = min(grown, 1.0)
    if stale:
        renew(s)
    else:
        s.current = 0
        if grown < 1.2:
            grown = 1.0  # the factorisation is used once more
    s.size = size * grown


def put_end(s: IntegratorWorkspace, end: float, slope: Floats) -> None:
    """Go to the end of a step, the state in `new`; the last three step ends are stored."""
    n = s.n
    if s.ends == 3:
        s.first_sloped = 1
        for k in range(2):
            s.end_time[k] = s.end_time[k + 1]
        for i in range(2 * n):
            s.end_state[i] = s.end_state[n + i]
            s.end_slope[i] = s.end_slope[n + i]
    else:
        s.ends += 1
    place = s.ends - 1
    s.end_time[place] = end
    for i in range(n):
        s.end_state[place * n + i] = s.new[i]
        s.end_slope[place * n + i] = slope[i]
        s.state[i] = s.new[i]
    s.node_count = 0
    s.time = end


def onto_constraints(s: IntegratorWorkspace, end: float) -> None:
    """Project the new state on the invariants; the steps' values of multipliers have no meaning then."""
    for i in range(s.n):
        s.si[i] = s.new[i] * s.magnitude[i]
    hold(s.closed, end, s.si)
    for i in range(s.n):
        s.new[i] = s.si[i] / s.magnitude[i]
    for k in range(s.closed.multipliers):
        s.new[s.closed.place[k]] = 0.0


def rates(s: IntegratorWorkspace, time: float, y: Floats, out: Floats) -> None:
    """Compute the scaled rates of scaled states."""
    for i in range(s.n):
        s.si[i] = y[i] * s.magnitude[i]
    if s.closed.multipliers > 0:
        s.closed.solved(time, s.si, s.inputs, s.constants, s.mode, s.closed.solution)
        for i in range(s.n):
            out[i] = s.closed.solution[i] * s.per_unit[i]
    else:
        s.derivative(time, s.si, s.inputs, s.constants, s.mode, out)
        for i in range(s.n):
            out[i] *= s.per_unit[i]
    s.derivatives += 1


def renew(s: IntegratorWorkspace) -> None:
    """Compute the Jacobian at the current state."""
    renew_at(s, s.time, s.state)


def renew_at(s: IntegratorWorkspace, time: float, y: Floats) -> None:
    """Compute the Jacobian at a state, and the side of all kinks on which it lies."""
    if s.bend_count > 0:
        bends_of(s, time, y, s.bend_side)
        for j in range(s.bend_count):
            s.bend_side[j] = sign(s.bend_side[j])
    for i in range(s.n):
        s.si[i] = y[i] * s.magnitude[i]
    if s.closed.multipliers > 0:
        put_multipliers(s.closed, time, s.si)
    s.entries(time, s.si, s.inputs, s.constants, s.mode, s.jacobian)
    for k in range(s.entry_count):
        s.jacobian[k] *= s.ratio[k]
    s.jacobians += 1
    s.known = 1
    s.current = 1
    s.factorised = 0


def first_size(
    s: IntegratorWorkspace, size: float, least: float, seen: int, unseen: int, looks: Numbers, between: Numbers, through: Numbers
) -> float:  # fmt: skip
    """Return the size of the first try of a step, at most `size`: up to the end if that is near, and short enough to resolve the signals of time."""
    size = min(size, s.stop - s.time, s.longest)
    if s.time + 1.01 * size >= s.stop:
        size = s.stop - s.time
    while size > 2.0 * least and not follows(s, s.time, s.time + size, seen, unseen, looks, between, through):
        size *= 0.5
    return size


def follows(
    s: IntegratorWorkspace, start: float, end: float, seen: int, unseen: int, looks: Numbers, between: Numbers, through: Numbers
) -> bool:  # fmt: skip
    """Return True if a step between two times resolves the signals of time (see `timeline.follower`).

    `looks`: the nodes of the step, and then the places where the polynomial through them (weights in `between`) must fit; `through`: matrix from the
    values at the nodes to the coefficients of that polynomial, highest degree first.
    """
    m = s.signal_count
    if m == 0:
        return True
    for k in range(seen + unseen):
        at = min(max(start + (end - start) * looks[k], s.earliest), s.latest)
        s.signals(at, s.state, s.inputs, s.constants, s.mode, s.seen[k * m :])
    for j in range(m):
        for q in range(unseen):
            off = -s.seen[(seen + q) * m + j]
            for k in range(seen):
                off += between[q * seen + k] * s.seen[k * m + j]
            if abs(off) > s.allowed[j]:
                return False
    if s.steady != 0 and is_steady(s, seen):
        return True
    while s.node_next < s.signal_nodes and s.node_time[s.node_next] < start:
        s.node_next += 1
    node = s.node_next
    while node < s.signal_nodes and s.node_time[node] < end:
        at = (s.node_time[node] - start) / (end - start)
        for j in range(m):
            off = -s.node_value[node * m + j]
            for k in range(seen):
                weight = through[k]
                for row in range(1, seen):
                    weight = weight * at + through[row * seen + k]
                off += weight * s.seen[k * m + j]
            if abs(off) > s.allowed[j]:
                return False
        node += 1
    return True


def is_steady(s: IntegratorWorkspace, seen: int) -> bool:
    """Return True if all signals have the same values at the nodes of a step as throughout a segment on which none is known to change."""
    for k in range(seen):
        for j in range(s.signal_count):
            if s.seen[k * s.signal_count + j] != s.node_value[j]:
                return False
    return True


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
        if last > 0.0:
            s.contraction = norm / last
            left = 1.0
            for _ in range(NEWTON_ITERATIONS - iteration):
                left *= s.contraction
            if s.contraction >= 1.0 or left / (1.0 - s.contraction) * norm > s.newton_tolerance:
                return stagnant(s, iteration + 1, norm)
        for i in range(3 * n):
            s.w[i] += s.change[i]
        for i in range(3):
            for k in range(n):
                s.z[i * n + k] = T[3 * i] * s.w[k] + T[3 * i + 1] * s.w[n + k] + T[3 * i + 2] * s.w[2 * n + k]
        first = s.last_size == 0.0 and iteration + 1 < NEWTON_ITERATIONS
        asked = s.first_newton_tolerance if first else s.newton_tolerance
        left = s.contraction / (1.0 - s.contraction) * norm
        if norm == 0.0 or (last > 0.0 and left < asked and most_left(s, 3) < s.creeping_tolerance):
            return iteration + 1
        last = norm
        for i in range(3 * n):
            s.last_change[i] = s.change[i]
    return stagnant(s, NEWTON_ITERATIONS, last)


def stagnant(s: IntegratorWorkspace, iterations: int, norm: float) -> int:
    """Return the number of iterations that no longer improve, if the remainder is rounding; else 0."""
    if norm > s.stagnation_tolerance or not norm <= STAGNANT * rounding(s, 0.0):
        return 0
    s.contraction = 0.0
    s.rounded = max(s.rounded, norm)
    return iterations


def rounding(s: IntegratorWorkspace, size: float) -> float:
    """Return the norm of the rounding error of a stage, in units of the tolerance, from a second difference of the rates over a very short distance.

    Laws with large numbers that nearly cancel, as lengths of a mechanism next to its displacements, have larger rounding errors than the states.
    `size`: that of an explicit step, or 0: the matrix of the method tells how the rates' rounding reaches the stage.
    """
    n = s.n
    for i in range(n):
        s.rest[i] = s.state[i] * (1.0 + (ASIDE if i % 2 == 0 else -ASIDE))
    rates(s, s.time, s.rest, s.error)
    for i in range(n):
        s.rest[i] = s.state[i] * (1.0 - (ASIDE if i % 2 == 0 else -ASIDE))
    rates(s, s.time, s.rest, s.f)
    for i in range(n):
        s.error[i] += s.f[i] - 2.0 * s.rate[i]
        if not isfinite(s.error[i]):
            s.error[i] = 0.0
        s.error[i] *= size if size > 0.0 else 1.0
    if size == 0.0:
        solve_real(s, s.error)
    total = 0.0
    for i in range(n):
        part = s.error[i] * s.per_tolerance[i]
        total += part * part
    return sqrt(total) / sqrt(float(n))


def correct(s: IntegratorWorkspace, size: float) -> bool:
    """Compute one Newton correction into `change`; return False if a rate is not finite."""
    n = s.n
    for i in range(3):
        for k in range(n):
            s.rest[k] = s.state[k] + s.z[i * n + k]
        rates(s, s.time + size * C[i], s.rest, s.f[i * n :])
    for i in range(3 * n):
        if not isfinite(s.f[i]):
            return False
    for i in range(3):
        drop_noise(s, s.f[i * n :])
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
    """Return the norm of the error in units of the tolerance, filtered through the real matrix as often as needed for stiff parts."""
    n = s.n
    for i in range(n):
        s.rest[i] = 0.0
        if i < s.differential:
            s.rest[i] = (E[0] * s.z[i] + E[1] * s.z[n + i] + E[2] * s.z[2 * n + i]) / size
        s.error[i] = s.rate[i]
    drop_noise(s, s.error)
    for i in range(n):
        s.error[i] += s.rest[i]
    solve_real(s, s.error)
    norm = share(s)
    if norm > 1.0 and (rejected or s.last_size == 0.0):
        for i in range(n):
            s.w[i] = s.state[i] + s.error[i]
        rates(s, s.time, s.w, s.error)
        drop_noise(s, s.error)
        for i in range(n):
            s.error[i] += s.rest[i]
        solve_real(s, s.error)
        norm = share(s)
    for i in range(n):
        s.error[i] = s.error[i] / (
            s.allowed_estimate * (s.absolute[i] + max(abs(s.state[i]), abs(s.new[i])) * s.relative)
        )
    return norm


def share(s: IntegratorWorkspace) -> float:
    """Return the norm of the error in units of the tolerance."""
    total = 0.0
    for i in range(s.n):
        part = s.error[i] / (s.allowed_estimate * (s.absolute[i] + max(abs(s.state[i]), abs(s.new[i])) * s.relative))
        total += part * part
    return sqrt(total) / sqrt(float(s.n))


def has_loops(s: IntegratorWorkspace) -> bool:
    """Return True if there are unknowns of algebraic loops; those of loop joints do not count."""
    return s.differential < s.n and s.closed.gaps == 0


def put_terms(s: IntegratorWorkspace, y: Floats) -> None:
    """Compute the sizes of the terms of each equation at a state, by the Jacobian: rounding is relative to them."""
    for i in range(s.n):
        s.terms[i] = 0.0
    for k in range(s.entry_count):
        s.terms[s.rows[k]] += abs(s.jacobian[k] * y[s.columns[k]])


def drop_noise(s: IntegratorWorkspace, x: Floats) -> None:
    """Set residuals of loop equations that are below rounding to zero."""
    if has_loops(s):
        for k in range(s.differential, s.n):
            if abs(x[k]) <= NOISE * s.terms[k]:
                x[k] = 0.0


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
