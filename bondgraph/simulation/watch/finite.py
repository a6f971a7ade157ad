"""A reported number that is none: which output it is, when, and which line of the text most likely made it so."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...door import Apply, Assignment, Expression, LinearLoop, Program, StateSpace, evaluate, symbols
from ...errors import RunFailed

SHOWN = 4  # variables of a divisor
PARTIAL = frozenset(
    {"sqrt", "log", "asin", "acos", "acosh", "atanh", "power", "exp", "tan", "sinh", "cosh"}
)  # functions that may have no value
LOOK_FOR = (
    "look for a division by zero, a root or logarithm of a negative number, or a part of the model that nothing ties down "
    "(a circuit without earth)"
)


def check_finite(program: Program, space: StateSpace, instants: Any, values: Any, states: Any, parameters: Any) -> None:
    """Raises `RunFailed` for the first instant at which an output is not finite; shape of `values`: (points, outputs)."""
    wrong = ~np.isfinite(values)
    if not wrong.any():
        return
    point = int(np.flatnonzero(wrong.any(axis=1))[0])
    names = [n for n, bad in zip(program.outputs.names, wrong[point], strict=True) if bad]
    named = ", ".join(f"`{n}`" for n in names[:6]) + (", …" if len(names) > 6 else "")
    cause = cause_of(program, space, float(instants[point]), states[point], parameters)
    raise RunFailed(f"at t = {instants[point]:.9g} s {named} {'is' if len(names) == 1 else 'are'} not finite: {cause}")


def cause_of(program: Program, space: StateSpace, time: float, state: Any, parameters: Any) -> str:
    """The line that most likely makes something no number, at a time and in a state."""
    return _cause(space, _known(program, space, time, state, parameters))


def _known(program: Program, space: StateSpace, time: float, state: Any, parameters: Any) -> dict[Any, float]:
    """The values of what is not computed, by variable."""
    given = dict(zip(program.parameters.names, parameters, strict=True))
    given |= dict(zip(program.inputs.names, program.input_defaults, strict=True))
    numbers = [*(s.variable for s in space.states), *(u.variable for u in space.unknowns)]
    known: dict[Any, float] = {v: float(x) for v, x in zip(numbers, state, strict=True)}
    for number, variable in enumerate(space.variables):
        if variable.role == "time":
            known[number] = time
        elif variable.role in ("parameter", "input", "mode", "delayed"):
            known[number] = float(given.get(variable.name, variable.value or 0.0))
    return known


def _cause(space: StateSpace, known: dict[Any, float]) -> str:
    """The first step that makes something that is not finite of what is."""
    for step in space.steps:
        if isinstance(step, Assignment):
            value = _value(step.expression, known)
            known[step.target] = value
            if not math.isfinite(value):
                name = space.variables[step.target].name
                begin = f"`{name}`, computed at `{step.owner}` (line {step.span.line}),"
                divisor = _vanishing(step.expression, known)
                if divisor is None:
                    asked = _outside(step.expression, known)
                    return f"{begin} has no value there; {LOOK_FOR}" if asked is None else f"{begin} asks for {asked}"
                read = {space.variables[v].name: known[v] for v in sorted(divisor)}
                said = ", ".join(f"`{n}` = {v:.6g}" for n, v in list(read.items())[:SHOWN])
                return f"{begin} is divided by {f'what is zero with {said}' if read else 'a factor of its law that is zero'}"
            continue
        found = _solution(step, known)
        if found is None:
            members = ", ".join(f"`{m}`" for m in step.members[:6])
            return f"the algebraic loop through {members} has no unique solution with these numbers"
        known.update(zip(step.targets, found, strict=True))
    return LOOK_FOR


def _vanishing(x: Expression, known: dict[Any, float]) -> set[Any] | None:
    """What a divisor in an expression reads, if it is zero; None if no divisor is."""
    stack = [x]
    while stack:
        node = stack.pop()
        if not isinstance(node, Apply):
            continue
        stack += node.operands
        if node.operator == "divide" and _value(node.operands[1], known) == 0:
            return {s.key for s in symbols(node.operands[1])}
    return None


def _outside(x: Expression, known: dict[Any, float]) -> str | None:
    """The innermost function of numbers that has no value, as `sqrt(-0.1)`; None if it is none that can be called so."""
    stack, found = [x], None
    while stack:
        node = stack.pop()
        if not isinstance(node, Apply) or math.isfinite(_value(node, known)):
            continue
        operands = [_value(o, known) for o in node.operands]
        if node.operator in PARTIAL and all(map(math.isfinite, operands)):
            shown = ", ".join(map(repr, operands))
            found = f"{operands[0]!r}^{operands[1]!r}" if node.operator == "power" else f"{node.operator}({shown})"
        stack += [o for o, v in zip(node.operands, operands, strict=True) if not math.isfinite(v)]
    return None if found is None else f"`{found}`, which is no number"


def _value(x: Expression, known: dict[Any, float]) -> float:
    try:
        return evaluate(x, known.__getitem__)
    except (ArithmeticError, ValueError):
        return math.nan


def _solution(loop: LinearLoop, known: dict[Any, float]) -> list[float] | None:
    """The solution of a linear loop; None if there is not one."""

    def number(entry: int | float) -> float:
        return entry if isinstance(entry, float) else known[entry]

    matrix = np.array([[number(x) for x in row] for row in loop.matrix])
    try:
        found = np.linalg.solve(matrix, np.array([number(x) for x in loop.right]))
    except np.linalg.LinAlgError:
        return None
    return [float(x) for x in found] if np.isfinite(found).all() else None
