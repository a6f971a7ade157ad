"""Collection of equations: variables, assignments, states, and aliases (variables that are known to be equal)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

from ..algebra.expression import Expression, Number, Symbol
from ..algebra.formula import Bound, bind
from ..errors import Diagnostic
from ..source import Span
from .errors import Undetermined
from .system import (
    Argument,
    Assignment,
    Claim,
    Delayed,
    Derivative,
    Discrete,
    EquationSystem,
    EventRow,
    Invariant,
    JunctionSwitch,
    Momentum,
    MomentumBalance,
    PowerPort,
    State,
    Storage,
    Validity,
    Variable,
)

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    Noun = TypeVar("Noun", bound=DataclassInstance)


class EquationCollection:
    """Variables and assignments in the order in which they are written."""

    def __init__(self) -> None:
        self.variables: list[Variable] = []
        self.assignments: list[Assignment] = []
        self.assigned: dict[int, Assignment] = {}
        self.derivatives: list[Derivative] = []
        self.states: list[State] = []
        self.claims: list[Claim] = []
        self.invariants: list[Invariant] = []
        self.balances: list[MomentumBalance] = []
        self.momenta: list[Momentum] = []
        self.pieced: set[int] = set()
        self.ports: list[PowerPort] = []
        self.storages: list[Storage] = []
        self.stored: dict[str, int] = {}
        self.discretes: list[Discrete] = []
        self.events: list[EventRow] = []
        self.delays: list[Delayed] = []
        self.switches: list[JunctionSwitch] = []
        self.diagnostics: list[Diagnostic] = []
        self.alias: dict[int, int] = {}
        self.quantities: dict[str, int] = {}

    def resolved(self, name: str, outputs: Mapping[str, int], limits: Sequence[Validity]) -> EquationSystem:
        """Return all collected equations, with one number for each set of aliases."""
        rooted, root = self._rooted, self.root
        events = [replace(e, settings=rooted(e.settings, "target", "value")) for e in self.events]
        return EquationSystem(
            name, tuple(self.variables), rooted(self.states, "variable", "rate", "start", "nominal", "conjugate", "drawn"),
            {n: root(v) for n, v in outputs.items()}, {n: root(v) for n, v in self.quantities.items()},
            rooted(self.ports, "effort", "flow"), rooted(self.storages, "stored", "arguments"), {n: root(v) for n, v in self.stored.items()},
            rooted(self.claims, "variable", "start"), rooted(limits, "condition", "values"), rooted(self.invariants, "position", "velocity"),
            tuple(self.balances), rooted(self.discretes, "start"), rooted(events, "condition", "sampling"), rooted(self.switches, "condition"),
            rooted(self.delays, "value", "lag"), frozenset(self.pieced), (), tuple(map(self._resolved, self.assignments)),
            rooted(self.derivatives, "target", "of", "conjugate"), rooted(self.momenta, "variable", "rate"),
        )  # fmt: skip

    def variable(self, name: str, role: str, unit: str = "", value: float | None = None) -> int:
        """Add a variable and return its number."""
        self.variables.append(Variable(name, role, unit, value))
        return len(self.variables) - 1

    def assign(self, target: int, expression: Expression, span: Span, owner: str) -> None:
        """`target := expression` (over variable numbers). A plain copy makes the target an alias."""
        if isinstance(expression, Symbol) and self.same_unit(target, expression.key):
            self.join(target, expression.key, span, owner)
            return
        bound = bind(expression)
        self.add(Assignment(target, bound.formula, tuple(bound.arguments), span, owner))

    def join(self, target: int, source: int, span: Span, owner: str) -> None:
        """Make two variables aliases. If they already were, no equation determines them: an error."""
        if self.root(target) == self.root(source):
            self.diagnostics.append(Undetermined(span, owner, self.variables[target].name))
            return
        self.alias[target] = source

    def same_unit(self, target: int, source: int) -> bool:
        """Return True if two variables can be aliases: in u = 1 ohm*i the numbers are equal, but the units are not."""
        units = {self.variables[target].unit, self.variables[source].unit}
        return len(units - {""}) < 2

    def add(self, assignment: Assignment) -> None:
        """Add an assignment without changes."""
        self.assignments.append(assignment)
        self.assigned[assignment.target] = assignment

    def state(
        self, variable: int, rate: int, start: Expression, name: str, span: Span, given: bool = True, drawn: Expression | None = None
    ) -> None:  # fmt: skip
        """Add a state: rate, start over parameters, `given` if the author gave the start, `drawn` for a coordinate's value in the drawing."""
        begins = self.static(start, f"{name} at the start", span)
        rest = None if drawn is None else begins if drawn == start else self.static(drawn, f"{name} drawn", span)
        self.states.append(State(variable, rate, begins, None, span, given, None, rest))

    def claim(self, value: Expression, start: Expression, name: str, span: Span) -> None:
        """Add a start that the author gives to a variable computed from states."""
        variable = self.held(value, name, "", span)
        self.claims.append(Claim(variable, self.static(start, f"{name} at the start", span), name, span))

    def differentiated(self, target: int, of: int, span: Span, owner: str, quantity: int | None = None) -> None:
        """`target := d(of)/dt`, which index reduction expands; `quantity`: what is stored, by its own name and unit."""
        self.derivatives.append(Derivative(target, of, span, owner, quantity))

    def definition(self, variable: int) -> Expression | float | None:
        """Expression that computes a variable explicitly, or the value of a parameter; None otherwise."""
        variable = self.root(variable)
        assignment = self.explicit(variable)
        if assignment is not None:
            return assignment.expression
        found = self.variables[variable]
        return found.value if found.role == "parameter" else None

    def unit_of(self, variable: int) -> str:
        return self.variables[self.root(variable)].unit

    def smoothly(self, target: int) -> None:
        """Declare that the pieces of a target's expression join smoothly: none of its conditions is an event."""
        self.pieced.add(target)

    def vanishing(self, target: int, expression: Expression, span: Span, owner: str) -> None:
        """Add an implicit assignment: the target makes the expression zero."""
        bound = bind(expression)
        self.add(Assignment(target, bound.formula, tuple(bound.arguments), span, owner, True))

    def invariant(
        self, position: int | None, velocity: int | None, name: str, span: Span, multiplier: int | None = None, part: int | None = None
    ) -> None:  # fmt: skip
        """Add an invariant: every state of a run keeps it and its rate at zero, or its rate alone. `multiplier` and `part` as in `Invariant`."""
        self.invariants.append(Invariant(position, velocity, name, span, multiplier, part))

    def momentum(self, variable: int, rate: int) -> None:
        """Add the momentum of a coordinate, which impulses balance."""
        self.momenta.append(Momentum(variable, variable, rate))

    def balance(self, variable: int, told: Diagnostic) -> None:
        """Add an implicit unknown that is solved with the multipliers, see `MomentumBalance`."""
        self.balances.append(MomentumBalance(variable, told))

    def root(self, variable: int) -> int:
        """Variable that an alias is equal to."""
        while variable in self.alias:
            variable = self.alias[variable]
        return variable

    def static(self, expression: Expression, name: str, span: Span) -> Argument:
        """A number, or a variable with the value of an expression of parameters."""
        if isinstance(expression, Number):
            return expression.value
        if isinstance(expression, Symbol):
            assert isinstance(expression.key, int)
            return expression.key
        variable = self.variable(name, "computed")
        self.assign(variable, expression, span, name)
        return variable

    def explicit(self, variable: int) -> Assignment | None:
        """Assignment that computes a variable explicitly; None otherwise."""
        assignment = self.assigned.get(variable)
        return None if assignment is None or assignment.implicit else assignment

    def held(self, expression: Expression, name: str, unit: str, span: Span) -> int:
        """Variable with the value of an expression: the expression itself, if it is one (it gets this unit if it has none), or a new one."""
        if isinstance(expression, Symbol):
            assert isinstance(expression.key, int)
            old = self.variables[expression.key]
            if unit and not old.unit:
                self.variables[expression.key] = replace(old, unit=unit)
            return expression.key
        variable = self.variable(name, "computed", unit)
        self.assign(variable, expression, span, name)
        return variable

    def _rooted(self, nouns: Sequence[Noun], *fields: str) -> tuple[Noun, ...]:
        """Return the same with variables replaced by those that they are equal to, in these fields: one, none, or several with other things."""

        def through(value: Any) -> Any:
            if isinstance(value, tuple):
                return tuple(map(through, value))
            return self.root(value) if isinstance(value, int) else value

        return tuple(replace(noun, **{name: through(getattr(noun, name)) for name in fields}) for noun in nouns)

    def _resolved(self, a: Assignment) -> Assignment:
        residual = (
            None if a.residual is None else Bound(a.residual.formula, tuple(map(self._through, a.residual.arguments)))
        )
        arguments = tuple(map(self._through, a.arguments))
        return Assignment(a.target, a.formula, arguments, a.span, a.owner, a.implicit, residual, a.guess)

    def _through(self, argument: Argument) -> Argument:
        return argument if isinstance(argument, float) else self.root(argument)
