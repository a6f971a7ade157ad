"""Steady rotation: an angle that nothing reads goes on at a constant rate while all else is at rest (an ignorable coordinate)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array, Program

from ...errors import RunFailed
from ...numerics.scales import group_numbers, largest_of_group
from ...quantities import behind

if TYPE_CHECKING:
    from ...compiled_scene import CompiledScene
    from ..constraints.constraints import Constraints

SHIFTS = (-1e6, -37.0, -1.0, -1e-3, 1e-3, 1.0, 59.0, 1e6)  # shifts of a state, to see if a condition reads it
CANCELLED = 1e-14  # relative to the terms of parameters and inputs in a rate: rounding where they cancel
SHARE = 1e-4  # relative change of a parameter that shows its term
ROUNDING = 1e-8  # relative to the terms in a rate: below it an angle is constant
TURNING = ("1", "1/s")  # units of an angle and of its rate


def unread_states(constraints: Constraints, time: float, state: Array, mode: Array) -> Any:
    """Return a mask (n,) of the states that no rate, unknown of a loop, loop joint or event reads: nothing restores them."""
    program, fixed, count = constraints.program, (constraints.inputs, constraints.constants, mode), constraints.count
    key = "states that no rate reads"
    if key not in program.kept:
        free = np.ones(count + len(program.unknowns.names), dtype=bool)
        free[np.asarray(program.pattern[1], dtype=int)] = False
        free[np.asarray(program.invariant_pattern[1], dtype=int)] = False
        program.kept[key] = free[:count]
    unread = np.array(program.kept[key])
    hybrid = program.hybrid
    if hybrid is not None:
        for i in np.flatnonzero(unread):
            moved = np.repeat(np.asarray(state, dtype=float)[None], len(SHIFTS) + 1, axis=0)
            moved[1:, i] += SHIFTS
            rows = [
                np.concatenate([f(time, x, *fixed) for f in (hybrid.roots, hybrid.triggers, hybrid.values)])
                for x in moved
            ]  # fmt: skip
            unread[i] = all(np.array_equal(row, rows[0], equal_nan=True) for row in rows)
    return unread


def drivers(program: Program, place: int) -> str:
    """Return the states that the rate of a state reads, for messages."""
    rows, columns = (np.asarray(part, dtype=int) for part in program.pattern)
    names = program.variables.names
    read = [f"`{names[j]}`" for j in columns[rows == place]]
    return f"its rate reads {', '.join(read[:4])}{' …' if len(read) > 4 else ''}" if read else "its rate reads no state"


def given_terms(constraints: Constraints, time: float, state: Array, mode: Array) -> Any:
    """Return the largest term (n,) of a parameter or an input in each rate, found by changing each of them by a small fraction."""
    program, inputs, count = constraints.program, constraints.inputs, constraints.count
    parameters = np.asarray(constraints.parameters, dtype=float)
    constants = program.constants(parameters)
    others = [(inputs, program.constants(moved)) for moved in _each_moved(parameters)]
    others += [(moved, constants) for moved in _each_moved(np.asarray(inputs, dtype=float))]
    rates = np.asarray(program.derivative(time, state, inputs, constants, mode), dtype=float)[:count]
    terms = np.zeros(count)
    for given, other in others:
        rate = np.asarray(program.derivative(time, state, given, other, mode), dtype=float)[:count]
        terms = np.fmax(terms, np.abs(rate - rates) / SHARE)
    return terms


def _each_moved(given: Array) -> list[Any]:
    """Return copies of the values, each with one nonzero entry changed by a small fraction."""
    return [np.where(np.arange(len(given)) == i, given * (1 + SHARE), given) for i in np.flatnonzero(given)]


def steady_rates(constraints: Constraints, time: float, state: Array, mode: Array) -> dict[str, float]:
    """Return the rates, by name, of the states that move on while all others rest; empty if all rest."""
    program, inputs, constants = constraints.program, constraints.inputs, constraints.constants
    rates = np.asarray(program.derivative(time, state, inputs, constants, mode), dtype=float)
    unread = unread_states(constraints, time, state, mode)
    names, count = program.states.names, len(program.states.names)
    moving = np.flatnonzero(unread & (rates[:count] != 0))
    if not len(moving):
        return {}
    from scipy.sparse import coo_array

    entries = np.abs(np.asarray(program.jacobian_entries(time, state, inputs, constants, mode), dtype=float))
    size = len(np.asarray(state))
    jacobian = coo_array((entries, program.pattern), shape=(size, size)).tocsr()
    units = group_numbers(program.variables.units)
    scale = largest_of_group(np.abs(np.asarray(state, dtype=float)), units)
    fastest = float(jacobian.max()) if jacobian.nnz else 0.0
    terms = jacobian @ (np.maximum(scale, jacobian @ scale / fastest) if fastest > 0 else scale)
    terms = np.maximum(ROUNDING * terms[:count], CANCELLED * given_terms(constraints, time, state, mode))
    return {names[i]: float(rates[i]) for i in moving if abs(rates[i]) > terms[i]}


def check_steady(made: CompiledScene, program: Program, moving: dict[str, float]) -> None:
    """Raise `RunFailed` for a drift that is no steady rotation: an angle whose speed is determined by a balance."""
    rows, columns = (np.asarray(part, dtype=int) for part in program.pattern)
    rates_of = {made.state_space.variables[s.variable].name: s.rate for s in made.state_space.states} if moving else {}
    for name, rate in moving.items():
        place = program.states.names.index(name)
        unit, own = program.states.units[place], made.state_space.variables[rates_of[name]].unit
        constant = sorted(set(columns[rows == place].tolist()) - set(rows.tolist()))
        if (unit, own) == TURNING and not constant:
            continue
        why = f"nothing changes `{program.states.names[constant[0]]}`" if constant else "nothing reads it"
        raise RunFailed(
            "BR756", f"no equilibrium was found: `{name}` drifts for ever, by {rate:.6g}{behind(own)} ({drivers(program, place)}; {why});",
            "leave it out, or let something balance what drives it",
        )  # fmt: skip
