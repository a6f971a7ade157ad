"""Constraint projection in the subset of Python that becomes machine code: see `constraints.Constraints.project`.

The normal equations J J' of the residuals' Jacobian are factorised, L D L' on a fixed pattern (`normal_equations.py` chooses the order once): the pivots show
dependent rows, and a few solutions give the smallest singular value of J. Newton's method recovers the digits lost by squaring.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt

from compiler.api import Floats, Ints, Record

from . import limits
from .limits import ITERATIONS, NOISE, ROUNDING

WEAK = limits.WEAK * limits.WEAK  # relative to its diagonal entry: smaller pivots count as weak
DROPPED = 1e-15  # relative to its diagonal entry: round-off after cancellation
INVERSE, SETTLED = 100, 1e-8  # inverse iterations for the smallest singular value, and relative change at their end
FRESH = 0.3  # share of a random vector mixed into that of the last pose, so that another loop may become the weakest

Function = Callable[[float, "Floats", "Floats", "Floats", "Floats", "Floats"], None]


class NormalEquations(Record):
    """J J' of some rows of the Jacobian, in the order of its factors."""

    rows: int
    invariant: Ints  # rows: the number among the invariants
    length: Ints  # rows: 1 where a residual is a length
    entry_start: Ints  # rows + 1
    entry: Ints  # the index among all derivatives
    column: Ints  # the state
    # below + rows + 1: products that add up to an entry of the square, entries below the diagonal first
    pair_start: Ints
    pair_one: Ints
    pair_other: Ints
    below: int
    l_start: Ints  # rows + 1
    l_row: Ints
    update: Ints  # places that a column updates, in the order of the elimination
    value: Floats  # derivatives in units of the magnitudes
    lower: Floats  # below
    pivot: Floats  # rows
    own: Floats  # rows: squared norms of the rows of the Jacobian
    size: Floats  # rows: size of a residual
    right: Floats  # rows
    weakest: float  # smallest pivot, relative to its diagonal entry
    vector: Floats  # rows: the direction of the smallest singular value
    fresh: Floats  # rows


class ProjectionWorkspace(Record):
    """Constraints of a program."""

    invariant: Function
    invariant_slopes: Function
    solved: Function
    inputs: Floats
    constants: Floats
    mode: Floats
    active: int  # 1 if there are any
    n: int  # states and unknowns
    count: int  # states
    gaps: int  # residuals
    constraints: int  # with residuals, or on rates alone
    magnitude: Floats  # n
    values: Floats  # values of all invariants
    slopes: Floats
    positions: NormalEquations
    velocities: NormalEquations
    multipliers: int
    place: Ints  # multipliers: index of each among the n
    solution: Floats  # n + multipliers
    full: Floats  # n


def project(w: ProjectionWorkspace, time: float, x: Floats) -> int:
    """Project a full state in SI on its invariants; return the number of weak pivots."""
    weak = project_positions(w, w.positions, time, x)
    if w.velocities.rows > 0:
        weak += project_velocities(w, w.velocities, time, x)
    return weak


def project_positions(w: ProjectionWorkspace, q: NormalEquations, time: float, x: Floats) -> int:
    """Make the residuals vanish by Newton's method, with the Jacobian of its first state as long as it converges."""
    known = 0
    weak = 0
    before = 1e300
    for i in range(q.rows):
        q.size[i] = 1.0
    for _ in range(ITERATIONS):
        w.invariant(time, x, w.inputs, w.constants, w.mode, w.values)
        worst = 0.0
        for i in range(q.rows):
            q.right[i] = w.values[q.invariant[i]]
            worst = max(worst, abs(q.right[i]) / q.size[i])
        if worst <= ROUNDING:
            break
        if worst > 0.1 * before:
            if worst < NOISE:
                break
            known = 0
        if known == 0:
            w.invariant_slopes(time, x, w.inputs, w.constants, w.mode, w.slopes)
            weak = factorise_normal(q, w.slopes, w.magnitude)
            measure_rows(q)
            known = 1
        solve_normal(q, q.right)
        apply_correction(q, w.magnitude, x)
        before = worst
    return weak


def project_velocities(w: ProjectionWorkspace, q: NormalEquations, time: float, x: Floats) -> int:
    """Make the rates of the residuals vanish; they are linear in the velocities, the second pass is for round-off."""
    w.invariant_slopes(time, x, w.inputs, w.constants, w.mode, w.slopes)
    weak = factorise_normal(q, w.slopes, w.magnitude)
    for _ in range(2):
        w.invariant(time, x, w.inputs, w.constants, w.mode, w.values)
        for i in range(q.rows):
            q.right[i] = w.values[q.invariant[i]]
        solve_normal(q, q.right)
        apply_correction(q, w.magnitude, x)
    return weak


def apply_correction(q: NormalEquations, magnitude: Floats, x: Floats) -> None:
    """Subtract from the state the minimum-norm change that belongs to the solution in `right`."""
    for i in range(q.rows):
        for k in range(q.entry_start[i], q.entry_start[i + 1]):
            x[q.column[k]] -= magnitude[q.column[k]] * (q.value[k] * q.right[i])


def measure_rows(q: NormalEquations) -> None:
    """Compute the sizes of the rows as `Constraints.sizes`: rows of one unit share the largest."""
    lengths = 0.0
    others = 0.0
    for i in range(q.rows):
        if q.length[i] != 0:
            lengths = max(lengths, q.own[i])
        else:
            others = max(others, q.own[i])
    for i in range(q.rows):
        largest = lengths if q.length[i] != 0 else others
        q.size[i] = sqrt(largest) if largest > 0.0 else 1.0


def factorise_normal(q: NormalEquations, slopes: Floats, magnitude: Floats) -> int:
    """Factorise the square as L D L'; return the number of weak pivots."""
    for k in range(q.entry_start[q.rows]):
        q.value[k] = slopes[q.entry[k]] * magnitude[q.column[k]]
    for t in range(q.below + q.rows):
        total = 0.0
        for k in range(q.pair_start[t], q.pair_start[t + 1]):
            total += q.value[q.pair_one[k]] * q.value[q.pair_other[k]]
        if t < q.below:
            q.lower[t] = total
        else:
            q.pivot[t - q.below] = total
            q.own[t - q.below] = total
    at = 0
    weak = 0
    q.weakest = 1.0
    for k in range(q.rows):
        pivot = q.pivot[k]
        q.weakest = min(q.weakest, pivot / q.own[k] if q.own[k] > 0.0 else 0.0)
        if pivot <= WEAK * q.own[k]:
            weak += 1
        inverse = 1.0 / pivot if pivot > DROPPED * q.own[k] else 0.0
        for r in range(q.l_start[k], q.l_start[k + 1]):
            share = q.lower[r] * inverse
            q.pivot[q.l_row[r]] -= share * q.lower[r]
            for t in range(r + 1, q.l_start[k + 1]):
                q.lower[q.update[at]] -= share * q.lower[t]
                at += 1
        for r in range(q.l_start[k], q.l_start[k + 1]):
            q.lower[r] *= inverse
        q.pivot[k] = inverse
    return weak


def solve_normal(q: NormalEquations, b: Floats) -> None:
    """Replace the right-hand side by the solution."""
    for k in range(q.rows):
        for r in range(q.l_start[k], q.l_start[k + 1]):
            b[q.l_row[r]] -= q.lower[r] * b[k]
    for k in range(q.rows - 1, -1, -1):
        total = b[k] * q.pivot[k]
        for r in range(q.l_start[k], q.l_start[k + 1]):
            total -= q.lower[r] * b[q.l_row[r]]
        b[k] = total


def least_singular_value(w: ProjectionWorkspace, q: NormalEquations, time: float, x: Floats) -> float:
    """Return the smallest singular value of the residuals' Jacobian, rows in units of their sizes, by inverse iteration."""
    w.invariant_slopes(time, x, w.inputs, w.constants, w.mode, w.slopes)
    factorise_normal(q, w.slopes, w.magnitude)
    measure_rows(q)
    if q.weakest <= DROPPED:
        return 0.0
    for i in range(q.rows):
        q.vector[i] += FRESH * q.fresh[i]
    last = 0.0
    for _ in range(INVERSE):
        norm = 0.0
        for i in range(q.rows):
            norm += q.vector[i] * q.vector[i]
        norm = sqrt(norm)
        for i in range(q.rows):
            q.vector[i] /= norm
            q.right[i] = q.size[i] * q.vector[i]
        solve_normal(q, q.right)
        found = 0.0
        for i in range(q.rows):
            q.right[i] *= q.size[i]
            found += q.right[i] * q.vector[i]
        for i in range(q.rows):
            q.vector[i] = q.right[i] / found
        if abs(found - last) <= SETTLED * found:
            return 1.0 / sqrt(found)
        last = found
    return 1.0 / sqrt(last)


def put_multipliers(w: ProjectionWorkspace, time: float, x: Floats) -> None:
    """Put the multipliers that belong to a state into it."""
    w.solved(time, x, w.inputs, w.constants, w.mode, w.solution)
    for k in range(w.multipliers):
        x[w.place[k]] = w.solution[w.n + k]


def project_all(w: ProjectionWorkspace, instants: int, times: Floats, states: Floats, weak: Ints) -> None:
    """Project states at several instants on their invariants."""
    for k in range(instants):
        weak[k] = project(w, times[k], states[k * w.n :])


def least_singular_values(w: ProjectionWorkspace, instants: int, times: Floats, states: Floats, out: Floats) -> None:
    """Compute the smallest singular values at several instants."""
    for k in range(instants):
        out[k] = least_singular_value(w, w.positions, times[k], states[k * w.n :])


def rates_projected(
    w: ProjectionWorkspace, instants: int, times: Floats, scaled: Floats, out: Floats, weak: Ints
) -> None:
    """Compute the rates at the projections of states, all in units of the magnitudes; `full` holds the unknowns that are not computed."""
    for k in range(instants):
        for i in range(w.count):
            w.full[i] = scaled[k * w.count + i] * w.magnitude[i]
        weak[k] = project(w, times[k], w.full)
        w.solved(times[k], w.full, w.inputs, w.constants, w.mode, w.solution)
        for i in range(w.count):
            out[k * w.count + i] = w.solution[i] / w.magnitude[i]
