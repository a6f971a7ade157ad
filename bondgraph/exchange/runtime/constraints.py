"""States on their constraints, with the unknowns of loops that belong to them, and slopes through both. An importer sees neither.

All is evaluated at the projection of the states of an importer, which drift within its tolerance: that is smooth along the constraints, constant across
them, and needs no event. Co-simulation projects its steps as a run does.
"""

from __future__ import annotations

from compiler.api import Floats

from ...simulation.integrators.linear_algebra.factors import back, eliminate
from ...simulation.integrators.loop_newton import solve_loops
from ...simulation.integrators.projection.projection import (
    NormalEquations,
    apply_correction,
    factorise_normal,
    measure_rows,
    project,
    put_multipliers,
    solve_normal,
)
from .instance import NO_SOLUTION, OK, OPEN, SINGULAR, FmuInstance, refused
from .segment import inside

CLOSE = 1e-6  # relative change of a state by its projection that counts as rounded digits
CLOSED = 1e-9  # relative to the size of a residual
WRITTEN = 1e-12  # relative difference of starts that are the same


def connect(s: FmuInstance) -> None:
    """Let constraints and loops read the values of the instance."""
    w = s.solver
    q = w.closed
    q.inputs = w.inputs
    q.constants = w.constants
    q.mode = w.mode
    k = s.loops
    k.inputs = w.inputs
    k.constants = w.constants
    k.mode = w.mode


def put_assembled(s: FmuInstance) -> None:
    """Begin closed mechanisms as the run has assembled them, as far as parameters leave their starts as they were; and loops with its unknowns."""
    w = s.solver
    for i in range(w.differential, w.n):
        s.state[i] = s.assembled[i]
    if w.closed.constraints == 0:
        return
    fits = 1
    if s.claim_count > 0:
        s.find_claims(s.time, s.assembled, w.inputs, w.constants, w.mode, s.claims)
    for k in range(s.claim_count):
        if not abs(s.claims[k] - s.claimed[k]) <= WRITTEN * max(1.0, abs(s.claimed[k])):
            fits = 0
    for i in range(w.differential):
        same = abs(s.starts[i] - s.written[i]) <= WRITTEN * abs(s.written[i])
        if s.is_set[i] == 0 and same and fits != 0:
            s.state[i] = s.assembled[i]


def complete(s: FmuInstance) -> int:
    """Put the projection of the states, and the unknowns that belong to it, into `full`; and the rates where the program has them with the unknowns."""
    if s.full_known != 0:
        return OK
    w = s.solver
    q = w.closed
    time = inside(s)
    if s.unheld != 0 and q.constraints > 0:  # a parameter has changed, and `full` is as it was before
        for i in range(w.n):
            s.starts[i] = s.full[i]
        if project(q, time, s.starts) > 0 or not moves_to(s, s.full) <= CLOSE:
            return refused(s, OPEN)
    s.unheld = 0
    for i in range(w.n):
        s.full[i] = s.state[i]
    if q.constraints > 0:
        if project(q, time, s.full) > 0:
            return refused(s, SINGULAR)
        q.invariant(time, s.full, w.inputs, w.constants, w.mode, q.values)
        for i in range(q.positions.rows):
            if not abs(q.values[q.positions.invariant[i]]) <= CLOSED * q.positions.size[i]:
                return refused(s, OPEN)
        if w.redundant != 0 and lets_go(s, time):
            return refused(s, SINGULAR)
        if q.multipliers > 0:
            put_multipliers(q, time, s.full)
            for i in range(w.n):
                s.rates[i] = q.solution[i]
    elif w.n > w.differential:
        k = s.loops
        k.time = time
        for i in range(w.n):
            k.state[i] = s.full[i]
        for i in range(k.n):
            k.z[i] = s.full[k.places[i]]
        if solve_loops(k, 0) == 0:
            return refused(s, NO_SOLUTION)
        for i in range(k.n):
            s.full[k.places[i]] = k.z[i]
            s.state[k.places[i]] = k.z[i]
    s.full_known = 1
    return OK


def lets_go(s: FmuInstance, time: float) -> bool:
    """Return True if a constraint that follows from the others at the start no longer does."""
    w = s.solver
    q = w.closed
    q.invariant_slopes(time, s.full, w.inputs, w.constants, w.mode, q.slopes)
    factorise_normal(q.positions, q.slopes, q.magnitude)
    measure_rows(q.positions)
    smallest = q.positions.size[0]
    for i in range(q.positions.rows):
        smallest = min(smallest, q.positions.size[i])
    widest = 0.0
    for i in range(q.gaps):
        widest = max(widest, abs(q.values[i]))
    return widest > CLOSE * smallest


def refresh(s: FmuInstance) -> None:
    """Put the states on their constraints with the multipliers of the present mode into `full`; what fails then is told where rates are asked for."""
    complete(s)
    if s.solver.closed.multipliers > 0:
        put_multipliers(s.solver.closed, s.time, s.full)


def hold(s: FmuInstance) -> int:
    """Put the states on their constraints, unless that changes them by more than rounded digits."""
    failed = complete(s)
    if failed != OK or s.solver.closed.constraints == 0:
        return failed
    for i in range(s.solver.n):
        s.starts[i] = s.full[i]
    if not moves_to(s, s.state) <= CLOSE:
        return refused(s, OPEN)
    for i in range(s.solver.differential):
        s.state[i] = s.full[i]
    return OK


def moves_to(s: FmuInstance, state: Floats) -> float:
    """Return the largest difference of states from those in `starts`, relative to their magnitudes."""
    w = s.solver
    result = 0.0
    for i in range(w.differential):
        result = max(result, abs(s.starts[i] - state[i]) / max(w.magnitude[i], abs(state[i])))
    return result


def factorise_slopes(s: FmuInstance) -> bool:
    """Prepare `spread` at the slopes; return False where unknowns have none."""
    w = s.solver
    q = w.closed
    if q.constraints > 0:
        q.invariant_slopes(inside(s), s.full, w.inputs, w.constants, w.mode, q.slopes)
        factorise_normal(q.positions, q.slopes, q.magnitude)
        factorise_normal(q.velocities, q.slopes, q.magnitude)
    f = s.behind
    for i in range(f.n * f.n):
        f.matrix[i] = 0.0
    for k in range(s.slope_count):
        row = s.slope_rows[k] - w.differential
        column = s.slope_columns[k] - w.differential
        if 0 <= row < f.n and 0 <= column < f.n:
            f.matrix[row * f.n + column] = s.slopes[k]
    return f.n == 0 or eliminate(f)


def spread(s: FmuInstance) -> None:
    """Complete a direction of states and inputs in `seed`: by their projection, and by the unknowns, which follow."""
    w = s.solver
    if w.closed.constraints > 0:
        spread_over(s, w.closed.positions)
        spread_over(s, w.closed.velocities)
    f = s.behind
    for i in range(f.n):
        s.right[i] = 0.0
    for k in range(s.slope_count):
        row = s.slope_rows[k] - w.differential
        if 0 <= row < f.n:
            s.right[row] -= s.slopes[k] * s.seed[s.slope_columns[k]]
    if f.n > 0:
        back(f, s.right)
    for i in range(f.n):
        s.seed[w.differential + i] = s.right[i]


def spread_over(s: FmuInstance, q: NormalEquations) -> None:
    """Take off the direction in `seed` what leads across some constraints."""
    first = s.solver.n + s.output_count
    for i in range(q.rows):
        q.right[i] = 0.0
        for k in range(s.slope_count):
            if s.slope_rows[k] == first + q.invariant[i]:
                q.right[i] += s.slopes[k] * s.seed[s.slope_columns[k]]
    solve_normal(q, q.right)
    apply_correction(q, s.solver.magnitude, s.seed)
