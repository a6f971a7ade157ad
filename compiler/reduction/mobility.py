"""How many motions closing joints leave a mechanism, told where it was drawn, before anything is run.

The slopes of the gaps by the states come from the assignments that lead to them, as numbers; elimination with the best pivot of all that is
left gives their rank, and the rows that bring nothing new.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache

from ..algebra.derivative import derivative
from ..algebra.expression import Expression, Symbol, evaluate
from ..algebra.formula import Formula
from ..equations.system import Assignment
from .state_space import LinearLoop, StateSpace

SMALL = 1e-9  # share of the largest slope of its unit: what is left of rows that follow from others
LARGEST = 200  # gaps that are looked at

Slopes = dict[int, float]  # state -> slope


def redundant_constraints(space: StateSpace) -> tuple[str, ...] | None:
    """The constraints that follow from others where the mechanism was drawn; None if that cannot be told before a run."""
    bound = [i for i in space.invariants if i.multiplier is not None]
    if not 0 < len(bound) <= LARGEST:
        return () if not bound else None
    try:
        rows = _slopes(space, [i.position for i in bound])
    except (ArithmeticError, ValueError, KeyError):
        return None
    units = [space.variables[i.position].unit for i in bound]
    for unit in set(units):
        largest = max(
            (abs(x) for row, u in zip(rows, units, strict=True) if u == unit for x in row.values()), default=0.0
        )
        for row, u in zip(rows, units, strict=True):
            if u == unit and largest > 0:
                for state in row:
                    row[state] /= largest
    return tuple(bound[i].name for i in sorted(_dependent(rows)))


def _slopes(space: StateSpace, targets: Iterable[int]) -> list[Slopes]:
    """Of variables by the states, at the start. Raises `KeyError` if they depend on loops."""
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
    by: dict[int, Slopes] = {}
    for state in space.states:
        values[state.variable] = state.start if isinstance(state.start, float) else values[state.start]
        by[state.variable] = {state.variable: 1.0}
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
    """The assignments that lead to some variables, in order."""
    needed, stack = set[int](), list(targets)
    while stack:
        number = stack.pop()
        if number not in needed:
            needed.add(number)
            if number in steps:
                stack.extend(a for a in steps[number].arguments if isinstance(a, int))
    return [s for s in space.steps if not isinstance(s, LinearLoop) and s.target in needed]


@lru_cache(maxsize=4096)
def _partial(formula: Formula, slot: int) -> Expression:
    return derivative(formula.expression, Symbol(slot))


def _value(step: Assignment, values: Mapping[int, float]) -> float:
    return _at(step.formula.expression, step, values)


def _at(expression: Expression, step: Assignment, values: Mapping[int, float]) -> float:
    """An expression over the slots of an assignment, for its arguments."""
    return evaluate(expression, lambda slot: _argument(step, slot, values))


def _argument(step: Assignment, slot: int, values: Mapping[int, float]) -> float:
    argument = step.arguments[slot]
    return argument if isinstance(argument, float) else values[argument]


def _dependent(rows: list[Slopes]) -> set[int]:
    """The rows that elimination leaves nothing of."""
    left = {i: dict(row) for i, row in enumerate(rows)}
    while left:
        best = max(left, key=lambda i: max(map(abs, left[i].values()), default=0.0))
        row = left[best]
        column = max(row, key=lambda c: abs(row[c]), default=-1)
        if column < 0 or abs(row[column]) <= SMALL:
            break
        del left[best]
        for other in left.values():
            if column in other:
                factor = other.pop(column) / row[column]
                for c, x in row.items():
                    if c != column:
                        other[c] = other.get(c, 0.0) - factor * x
    return set(left)
