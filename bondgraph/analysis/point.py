"""All variables of a model at one state and time, evaluated number by number with the compiled steps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from compiler.api import Compilation, LinearLoop, StateSpace, evaluate

from ..errors import RunFailed, UsageError
from ..simulation.loops.loops import LoopSolver
from .following import led


def values_at(compilation: Compilation, state: Mapping[str, float], time: float) -> dict[int, float]:
    """Return variable -> value; states that are not given have their initial values. Raises `UsageError`, `RunFailed`."""
    space, program = compilation.state_space, compilation.program
    state = led(compilation, program.defaults, state)
    unknown = sorted(set(state) - set(program.states.names))
    if unknown:
        raise UsageError("BR221", f"`{unknown[0]}` is no state; states are {', '.join(program.states.names) or 'none'}")
    constants, inputs = program.constants(np.array(program.defaults)), np.array(program.input_defaults)
    x = np.array(program.start(constants), dtype=float)
    for i, name in enumerate(program.states.names):
        x[i] = state.get(name, x[i])
    mode = program.mode_at(time, x, inputs, constants)
    with np.errstate(all="ignore"):
        x = LoopSolver(program, constants, inputs, np.where(x != 0, np.abs(x), 1.0)).solve(time, x, mode)
    values: dict[int, float] = {}
    known = dict(zip(program.parameters.names, program.defaults, strict=True))
    for number, variable in enumerate(space.variables):
        if variable.role in ("parameter", "input", "mode", "delayed"):
            values[number] = known.get(variable.name, variable.value or 0.0)
        elif variable.role == "time":
            values[number] = time
    moving = [*(s.variable for s in space.states), *(u.variable for u in space.unknowns)]
    values |= dict(zip(moving, map(float, x), strict=True))
    _steps(space, values)
    return values


def _steps(space: StateSpace, values: dict[int, float]) -> None:
    """Evaluate the computed variables, in order."""

    def entry(e: int | float) -> float:
        return e if isinstance(e, float) else values[e]

    for step in space.steps:
        if isinstance(step, LinearLoop):
            matrix: Any = np.array([[entry(e) for e in row] for row in step.matrix])
            size = np.abs(matrix).max(axis=1)
            right = np.array([entry(e) for e in step.right])
            try:
                found = np.linalg.solve(matrix / size[:, None], right / size)
            except np.linalg.LinAlgError as problem:
                raise RunFailed("BR224", f"the loop of {', '.join(step.members)} has no unique solution") from problem
            values.update(zip(step.targets, map(float, found), strict=True))
            continue
        try:
            values[step.target] = evaluate(step.expression, values.__getitem__)
        except (ArithmeticError, ValueError) as problem:
            name = space.variables[step.target].name
            raise RunFailed("BR225", f"`{name}` has no value at this state: {problem}") from problem
