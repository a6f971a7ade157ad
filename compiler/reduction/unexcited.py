"""States that nothing excites: zero at the start, with rates that vanish as long as they are zero.

A run need not compute them. The set is the greatest one with that property: all states with a start of 0 are taken, then those that
something moves are removed, each variable once. A variable counts as zero only if its equation certainly has the value zero: what is
multiplied by a zero must have a value for all numbers, so that no division by a variable, no logarithm and no table is passed over, and no
condition may be at its bound.
"""

from __future__ import annotations

from collections.abc import Callable, Set
from dataclasses import replace
from functools import lru_cache

from ..algebra.expression import ZERO, Apply, Expression, Number, Symbol, call, substitute
from ..algebra.formula import Formula
from ..algebra.operators import OPERATORS
from ..equations.system import Assignment, EquationSystem
from .order import needed
from .singular import LARGEST
from .state_space import Entry, LinearLoop, StateSpace, Step

CONTINUOUS = frozenset({"abs", "min", "max"})  # besides the smooth functions
TOTAL = CONTINUOUS | {"add", "multiply", "sin", "cos", "tanh", "atan", "select"}  # finite for all numbers


def at_rest(space: StateSpace, settable: Set[str]) -> frozenset[int]:
    """Return the states that nothing excites in a run from the starts, with the variables that are zero with them; empty if there are none.

    `settable`: parameters whose values only a run knows. Where junctions switch, starts of other quantities bind the states, or constraints
    are kept by projection, a run may change a state otherwise than by its rate: then there are none.
    """
    if space.switches or space.claims or space.invariants or space.balances:
        return frozenset()
    return _Rest(space, settable).variables()


def without(system: EquationSystem, zero: Set[int]) -> EquationSystem:
    """Return the equations with these variables put to zero; those that are states are no longer states."""
    nothing = Formula(0, ZERO)
    variables = list(system.variables)
    assignments = [
        Assignment(a.target, nothing, (), a.span, a.owner) if a.target in zero else a for a in system.assignments
    ]
    for state in (s for s in system.states if s.variable in zero):
        variables[state.variable] = replace(variables[state.variable], role="computed")
        assignments.append(Assignment(state.variable, nothing, (), state.span, variables[state.variable].name))
    return replace(
        system, variables=tuple(variables), assignments=tuple(assignments),
        states=tuple(s for s in system.states if s.variable not in zero),
        following=tuple(f for f in system.following if f.state not in zero),
    )  # fmt: skip


class _Rest:
    def __init__(self, space: StateSpace, settable: Set[str]) -> None:
        self.space, self.settable = space, settable
        self.zero = self._candidates()
        self.values: dict[int, Expression | None] | None = None  # a number, its symbol, or None if it may have no value

    def variables(self) -> frozenset[int]:
        """Zero variables, first by the shape of the laws alone, which is enough for most models, then with a value for all that a law reads."""
        steps = self.space.steps if self.zero else ()
        for step in steps:
            if self._vanishes(step):
                self.zero.update(step.targets)
        self._remove([s.variable for s in self.space.states if s.rate not in self.zero])
        if self._states:
            self.values = {}
            for step in steps:
                if isinstance(step, Assignment) and not step.implicit:
                    self.values[step.target] = _settled(step, self._value)
            self._remove([t for s in steps if not self.zero.isdisjoint(s.targets) and not self._vanishes(s) for t in s.targets])  # fmt: skip
        return frozenset(self.zero if self._states else ())

    @property
    def _states(self) -> bool:
        return any(s.variable in self.zero for s in self.space.states)

    def _candidates(self) -> set[int]:
        """States with a start of 0 that no event reads or sets."""
        roots = [v for e in self.space.events for v in (e.condition, *(s.target for s in e.settings))]
        at_events = needed(roots, self.space.inputs) if roots else set[int]()
        return {s.variable for s in self.space.states if isinstance(s.start, float) and s.start == 0.0} - at_events

    def _remove(self, moving: list[int]) -> None:
        """Remove variables from the zeros, and then what no longer vanishes."""
        users: dict[int, list[Step]] = {}
        for step in self.space.steps:
            if not self.zero.isdisjoint(step.targets):
                for variable in step.read:
                    users.setdefault(variable, []).append(step)
        moved_by: dict[int, list[int]] = {}
        for state in self.space.states:
            moved_by.setdefault(state.rate, []).append(state.variable)
        while moving:
            variable = moving.pop()
            if variable in self.zero:
                self.zero.remove(variable)
                moving += moved_by.get(variable, ())
                moving += [t for s in users.get(variable, ()) if not self._vanishes(s) for t in s.targets]

    def _vanishes(self, step: Step) -> bool:
        """Return True if a step computes zero; before values are known, if it may."""
        if isinstance(step, LinearLoop):
            solved = self.values is None or (
                len(step.targets) <= LARGEST and all(isinstance(self._value(g), Number) for g in step.gains)
            )
            return solved and all(map(self._is_zero, step.right))
        if step.implicit:
            return False
        if self.values is None:
            return _may_vanish(step.formula, frozenset(i for i, a in enumerate(step.arguments) if self._is_zero(a)))
        return _settled(step, lambda v: ZERO if v in self.zero else self._value(v)) == ZERO

    def _is_zero(self, entry: Entry) -> bool:
        return entry == 0.0 if isinstance(entry, float) else entry in self.zero

    def _value(self, variable: int) -> Expression | None:
        """Return a number, or the symbol of a variable that surely has a finite value."""
        quantity = self.space.variables[variable]
        if quantity.role == "computed":
            value = None if self.values is None else self.values.get(variable)
            return value if value is None or isinstance(value, Number) else Symbol(variable)
        if quantity.role == "parameter" and quantity.value is not None and quantity.name not in self.settable:
            return Number(quantity.value)
        return Symbol(variable)


def _settled(step: Assignment, read: Callable[[int], Expression | None]) -> Expression | None:
    """Return the value of a step with zeros and known numbers put in; None if there may be none."""
    return _part_of(step, step.formula.expression, read, {})


def _part_of(
    step: Assignment, x: Expression, read: Callable[[int], Expression | None], done: dict[Expression, Expression | None]
) -> Expression | None:
    """Return the value of a part of a step. `done`: those of parts before."""
    if isinstance(x, Symbol):
        argument: Entry = step.arguments[x.key]
        return Number(argument) if isinstance(argument, float) else read(argument)
    if not isinstance(x, Apply):
        return x
    if x not in done:
        operands = [o for o in (_part_of(step, o, read, done) for o in x.operands) if o is not None]
        done[x] = _applied(x.operator, operands) if len(operands) == len(x.operands) else None
    return done[x]


def _applied(operator: str, operands: list[Expression]) -> Expression | None:
    """Return an operator applied to operands that have values; None if it may have none, or jumps or is infinitely steep there."""
    row = OPERATORS[operator]
    numbers = all(isinstance(o, Number) for o in operands)
    if row.kind == "condition":
        return None if numbers and operands[0] == operands[-1] else Apply(operator, tuple(operands))  # not at its bound
    if operator == "select" or not numbers:
        total = operator in TOTAL or (operator == "power" and _is_whole(operands[1]))
        divides = operator == "divide" and isinstance(operands[1], Number) and operands[1] != ZERO
        return call(operator, *operands) if total or divides else None
    first = operands[0]
    ends = isinstance(first, Number) and first.value in row.domain  # as sqrt at 0, acos at 1
    steep = ends or (operator == "power" and first == ZERO and not _is_whole(operands[-1]))
    value = call(operator, *operands) if row.kind == "function" and not steep else None
    return value if isinstance(value, Number) and (row.smooth or operator in CONTINUOUS) else None


def _is_whole(exponent: Expression) -> bool:
    return isinstance(exponent, Number) and exponent.value >= 1 and exponent.value == int(exponent.value)


@lru_cache(maxsize=65536)
def _may_vanish(formula: Formula, zeros: frozenset[int]) -> bool:
    return _may_be_zero(substitute(formula.expression, lambda s: ZERO if s.key in zeros else s))


def _may_be_zero(x: Expression) -> bool:
    """Return True if an expression may be zero where its symbols are not: a product by any factor, a choice by any branch."""
    if not isinstance(x, Apply):
        return x == ZERO
    if x.operator == "add":
        return all(map(_may_be_zero, x.operands))
    if x.operator in ("divide", "power"):
        return _may_be_zero(x.operands[0])
    return x.operator in TOTAL and any(map(_may_be_zero, x.operands))
