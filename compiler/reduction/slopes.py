"""Partial derivatives of variables at the start of a run, as numbers, from the assignments that they depend on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Set
from functools import lru_cache

from ..algebra.derivative import derivative
from ..algebra.expression import Expression, Symbol, evaluate
from ..algebra.formula import Formula
from ..equations.system import Assignment, State
from .state_space import LinearLoop, StateSpace, TearingVariable

Slopes = dict[int, float]  # by variable


def slopes_at_start(
    space: StateSpace, targets: Iterable[int], by: Iterable[State] | Iterable[TearingVariable]
) -> list[Slopes] | None:
    """Partial derivatives by the states or unknowns, with unknowns at zero; None if they depend on loops, or have no value there."""
    try:
        return _slopes(space, targets, {x.variable for x in by})
    except (ArithmeticError, ValueError, KeyError):
        return None


def _slopes(space: StateSpace, targets: Iterable[int], chosen: Set[int]) -> list[Slopes]:
    steps = {s.target: s for s in space.steps if not isinstance(s, LinearLoop)}
    targets = list(targets)
    values: dict[int, float] = {}
    for number, variable in enumerate(space.variables):
        if variable.role in ("parameter", "input") and variable.value is not None:
            values[number] = variable.value
        elif variable.role == "time":
            values[number] = 0.0
    starts = [s.start for s in space.states if isinstance(s.start, int)]
    for step in _behind(space, steps, starts):
        values[step.target] = _value(step, values)
    by: dict[int, Slopes] = {variable: {variable: 1.0} for variable in chosen}
    for state in space.states:
        values[state.variable] = state.start if isinstance(state.start, float) else values[state.start]
    values |= {u.variable: 0.0 for u in space.unknowns if u.variable in chosen}
    for step in _behind(space, steps, targets):
        values[step.target] = _value(step, values)
        total: Slopes = {}
        for slot, argument in enumerate(step.arguments):
            if isinstance(argument, int) and by.get(argument):
                slope = _at(_partial(step.formula, slot), step, values)
                for state_number, inner in by[argument].items():
                    total[state_number] = total.get(state_number, 0.0) + slope * inner
        by[step.target] = total
    return [{c: x for c, x in by.get(t, {}).items() if x != 0.0} for t in targets]


def _behind(space: StateSpace, steps: Mapping[int, Assignment], targets: Iterable[int]) -> list[Assignment]:
    """Assignments that some variables depend on, in order."""
    needed, stack = set[int](), list(targets)
    while stack:
        number = stack.pop()
        if number not in needed:
            needed.add(number)
            if number in steps:
                stack.extend(steps[number].read)
    return [s for s in space.steps if not isinstance(s, LinearLoop) and s.target in needed]


@lru_cache(maxsize=4096)
def _partial(formula: Formula, slot: int) -> Expression:
    return derivative(formula.expression, Symbol(slot))


def _value(step: Assignment, values: Mapping[int, float]) -> float:
    return _at(step.formula.expression, step, values)


def _at(expression: Expression, step: Assignment, values: Mapping[int, float]) -> float:
    """An expression over the slots of an assignment, with its arguments put in."""
    return evaluate(expression, lambda slot: _argument(step, slot, values))


def _argument(step: Assignment, slot: int, values: Mapping[int, float]) -> float:
    argument = step.arguments[slot]
    return argument if isinstance(argument, float) else values[argument]
