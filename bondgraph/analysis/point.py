"""All variables of a model at one state and time, evaluated number by number with the compiled steps."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from compiler.api import Compilation, LinearLoop, StateSpace, evaluate

from ..errors import RunFailed, UsageError
from ..simulation.loops.loops import LoopSolver
from ..simulation.monitors.finite import given_values, linear_loop
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
        x = LoopSolver(program, constants, inputs).solve(time, x, mode)
    values = given_values(space, dict(zip(program.parameters.names, program.defaults, strict=True)), time, x)
    _steps(space, values)
    return values


def _steps(space: StateSpace, values: dict[int, float]) -> None:
    """Evaluate the computed variables, in order."""

    for step in space.steps:
        if isinstance(step, LinearLoop):
            matrix, right = linear_loop(step, values)
            size = np.abs(matrix).max(axis=1)
            try:
                solution = np.linalg.solve(matrix / size[:, None], right / size)
            except np.linalg.LinAlgError as problem:
                raise RunFailed("BR224", f"the loop of {', '.join(step.members)} has no unique solution") from problem
            values.update(zip(step.targets, map(float, solution), strict=True))
            continue
        try:
            values[step.target] = evaluate(step.expression, values.__getitem__)
        except (ArithmeticError, ValueError) as problem:
            name = space.variables[step.target].name
            raise RunFailed("BR225", f"`{name}` has no value at this state: {problem}") from problem
