"""Parts of steps that evaluate the functions of a program, and store the end of a step."""

from __future__ import annotations

from compiler.api import Floats

from .. import radau
from ..projection.projection import project, put_multipliers
from ..workspace import IntegratorWorkspace

NOISE = radau.NOISE


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


def bends_of(s: IntegratorWorkspace, time: float, scaled: Floats, out: Floats) -> None:
    """Evaluate all kink functions at a scaled state."""
    for i in range(s.n):
        s.si[i] = scaled[i] * s.magnitude[i]
    s.bends(time, s.si, s.inputs, s.constants, s.mode, out)


def renew(s: IntegratorWorkspace) -> None:
    """Compute the Jacobian at the current state."""
    renew_at(s, s.time, s.state)


def renew_at(s: IntegratorWorkspace, time: float, y: Floats) -> None:
    """Compute the Jacobian at a state, and the side of all kinks on which it lies."""
    if s.bend_count > 0:
        bends_of(s, time, y, s.bend_side)
        for j in range(s.bend_count):
            s.bend_side[j] = side_of(s.bend_side[j])
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


def look_at_side(s: IntegratorWorkspace, ahead: float) -> None:
    """Renew the Jacobian after a step if it belongs to the other side of a kink, also where the step ends at one: it would hide errors filtered by it."""
    for i in range(s.n):
        s.rest[i] = s.state[i] + ahead * s.rate[i]
    bends_of(s, s.time + ahead, s.rest, s.bend_seen)
    for j in range(s.bend_count):
        if side_of(s.bend_seen[j]) != s.bend_side[j]:
            renew_at(s, s.time + ahead, s.rest)
            return


def side_of(x: float) -> float:
    """Return the sign as numpy does."""
    return 1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0)


def has_loops(s: IntegratorWorkspace) -> bool:
    """Return True if there are unknowns of algebraic loops; those of loop joints do not count."""
    return s.differential < s.n and s.closed.constraints == 0


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


def put_end_rates(s: IntegratorWorkspace, end: float) -> None:
    """Project the new state on the constraints and compute its rates, which are known where there are unknowns of loops (see `misses`)."""
    n = s.n
    if s.closed.constraints > 0:
        onto_constraints(s, end)
    if has_loops(s):
        for i in range(n):
            s.rate[i] = s.f[n + i]
    else:
        rates(s, end, s.new, s.rate)
    if s.closed.constraints > 0:
        for i in range(s.differential, n):
            s.rate[i] = 0.0


def onto_constraints(s: IntegratorWorkspace, end: float) -> None:
    """Project the new state on the invariants; the steps' values of multipliers have no meaning then."""
    for i in range(s.n):
        s.si[i] = s.new[i] * s.magnitude[i]
    project(s.closed, end, s.si)
    for i in range(s.n):
        s.new[i] = s.si[i] / s.magnitude[i]
    for k in range(s.closed.multipliers):
        s.new[s.closed.place[k]] = 0.0


def put_end(s: IntegratorWorkspace, end: float, slope: Floats) -> None:
    """Go to the end of a step, the state in `new`; the last three step ends are stored."""
    n = s.n
    if s.ends == 3:
        s.first_sloped = 1
        drop_first_end(s)
    s.ends += 1
    place = s.ends - 1
    s.end_time[place] = end
    for i in range(n):
        s.end_state[place * n + i] = s.new[i]
        s.end_slope[place * n + i] = slope[i]
        s.state[i] = s.new[i]
    s.node_count = 0
    s.time = end


def drop_first_end(s: IntegratorWorkspace) -> None:
    """Keep the last two of three step ends."""
    s.ends = 2
    for k in range(2):
        s.end_time[k] = s.end_time[k + 1]
    for i in range(2 * s.n):
        s.end_state[i] = s.end_state[s.n + i]
        s.end_slope[i] = s.end_slope[s.n + i]
