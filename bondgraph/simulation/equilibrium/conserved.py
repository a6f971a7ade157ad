"""Conserved sums of states, for any laws: charges of an isolated node, displacements round a loop, moieties.

They follow from rates that are composed of the same flows (`dependent_rates` of the compiler), with the values of the parameters: w' f = 0 for
all states, inputs and instants. A search for an equilibrium keeps their initial values, and their zero eigenvalues do not affect stability.
States that nothing reads are no part of the search: what they are at its end follows from these sums.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from compiler.api import Array, EquationSystem, Expression, dependent_rates, evaluate

from ...compiled_scene import CompiledScene
from ...errors import RunFailed
from ...numerics.scales import group_numbers, largest_of_group, nonzero
from ...quantities import listed
from ..constraints.constraints import Constraints
from ..segments.timeline import Segment
from .dense import CLOSE, EquilibriumSearch
from .search import KEPT, LARGEST, undetermined
from .steady import unread_states

ROUNDING = 1e-11  # relative to the largest factor: remainder of cancelling factors


def conserved_sums(scene: CompiledScene, parameters: Array) -> Array:
    """Return the factors of the states, (k, n), each row of length 1; k = 0 for most models."""
    rows = scene.kept.get("dependent rates")
    system, n = scene.compilation.equations, len(scene.program.states.names)
    if rows is None:
        rows = scene.kept["dependent rates"] = dependent_rates(system, scene.state_space.states)
    if not rows:
        return np.zeros((0, n))
    value = _constants(system, dict(zip(scene.program.parameters.names, map(float, parameters), strict=True)))
    flows = {flow: i for i, flow in enumerate(dict.fromkeys(f for row in rows.values() for f in row))}
    matrix = np.zeros((len(rows), max(len(flows), 1)))
    try:
        for number, row in enumerate(rows.values()):
            for flow, factor in row.items():
                matrix[number, flows[flow]] = evaluate(factor, value)
    except (ArithmeticError, ValueError):  # a division by zero in a ratio: no sums are known
        return np.zeros((0, n))
    size = nonzero(np.abs(matrix).max(axis=1, keepdims=True))
    left, sizes, _ = np.linalg.svd(matrix / size)
    rank = int((sizes > ROUNDING * sizes.max(initial=0.0)).sum())
    sums = left[:, rank:].T / size[:, 0]
    whole = np.zeros((len(sums), n))
    whole[:, list(rows)] = sums / np.linalg.norm(sums, axis=1, keepdims=True)
    return whole


def with_sums_kept(sums: Array, constraints: Constraints, start: Array, rest: Array, segment: Segment) -> Array:
    """Return a rest with the states that nothing reads where the sums that they are part of have the values of the start. Raises `RunFailed` if a sum of
    others is another."""
    unread = unread_states(constraints, segment.start, rest, segment.mode)
    n, program = len(unread), constraints.program
    own, moved = sums[:, unread], np.array(rest)
    if own.any():
        size = nonzero(np.abs(own).max(axis=0))
        moved[np.flatnonzero(unread)] += np.linalg.lstsq(own / size, sums @ (start - rest)[:n])[0] / size
    there = np.abs(sums) @ largest_of_group(np.abs(start[:n]), group_numbers(program.states.units))
    for row in np.flatnonzero((np.abs(sums @ (moved - start)[:n]) > KEPT * there) & (there > 0)).tolist():
        names = [program.states.names[i] for i in np.flatnonzero(np.abs(sums[row]) > KEPT)]
        raise RunFailed(
            "BR750", f"no equilibrium was found: the search has left the sum of {listed(names)}, which every motion keeps; a run finds where it ends"
        )  # fmt: skip
    return moved


def path_notes(sums: Array, constraints: Constraints, start: Array, rest: Array, segment: Segment) -> tuple[str, ...]:
    """Return the note on states that are at a rest where a search, and not the motion, has left them: of a family of rests which no sum tells apart."""
    n, same = constraints.count, (constraints.inputs, constraints.constants, segment.mode)
    if not n or n > LARGEST or np.array_equal(start[:n], rest[:n]):
        return ()
    search, rates = EquilibriumSearch(constraints, segment), constraints.program.derivative(segment.start, start, *same)
    moves = np.abs(np.asarray(rates, dtype=float)[:n])
    moves[moves <= KEPT * largest_of_group(moves, search.kind)] = 0.0
    moving = (moves > 0) | (np.abs(rest - start)[:n] > KEPT * np.abs(rest)[:n])
    rows, columns = (np.asarray(part, dtype=int) for part in constraints.program.pattern)
    unread = unread_states(constraints, segment.start, rest, segment.mode)
    moving[[i for i in np.flatnonzero(unread) if moving[columns[(rows == i) & (columns < n)]].any()]] = True
    size = CLOSE * largest_of_group(np.maximum(np.abs(start), np.abs(rest))[:n], search.kind)
    vanished = np.concatenate(
        [np.where(np.abs(rest[:n]) < size, 0.0, rest[:n]), rest[n:]]
    )  # what is left of an amount ties no other
    loose = undetermined(search, vanished, sums)
    names = [constraints.program.states.names[i] for i in np.flatnonzero(loose & moving)]
    if not names:
        return ()
    return (
        f"the model has many rests, which differ in {listed(names)}; which of them the motion reaches, a run tells",
    )


def _constants(system: EquationSystem, given: Mapping[str, float]) -> Callable[[int], float]:
    """Return a function that computes a variable from the parameters `given` alone."""
    assigned: dict[int, Expression] = {a.target: a.expression for a in system.assignments if not a.implicit}

    def value(variable: int) -> float:
        quantity = system.variables[variable]
        if quantity.role == "parameter":
            return given.get(quantity.name, quantity.value if quantity.value is not None else np.nan)
        return float(evaluate(assigned[variable], value))

    return value
