"""Storages in derivative form: d/dt of their law, by the chain rule over the assignments that lead to it.

The result is affine in the rates of the states, so it joins the equations as a linear loop (E x' = f, solved where it stands).
"""

from __future__ import annotations

from ..algebra.derivative import derivative
from ..algebra.expression import ZERO, Expression, Number, Symbol, add, multiply, substitute
from ..algebra.formula import bind
from ..equations.system import Assignment, EquationSystem, Variable
from ..errors import Diagnostic
from .errors import DerivativeThroughLoop, ForcedStorage


class Differentiator:
    """Adds the assignments of time derivatives."""

    def __init__(self, system: EquationSystem) -> None:
        self.system = system
        self.variables: list[Variable] = list(system.variables)
        self.added: list[Assignment] = []
        self.diagnostics: list[Diagnostic] = []
        self.rates = {s.variable: s.rate for s in system.states}
        self.assigned = {a.target: a for a in system.assignments}
        self._known: dict[int, Expression | None] = {}

    def run(self) -> None:
        for item in self.system.derivatives:
            self._element, self._span = item.owner, item.span
            self._via, self._target = item.owner, self.variables[item.target].name
            before = len(self.diagnostics)
            found = self._rate(item.of)
            if found is not None:
                self._assign(item.target, found, item.owner)
            elif len(self.diagnostics) == before:
                self.diagnostics.append(DerivativeThroughLoop(item.span, item.owner, f"`{self._via}`"))

    def _assign(self, target: int, expression: Expression, owner: str) -> None:
        bound = bind(expression)
        self.added.append(Assignment(target, bound.formula, tuple(bound.arguments), self._span, owner))

    def _rate(self, variable: int) -> Expression | None:
        """The time derivative of a variable, as an expression over variables; None if it cannot be formed."""
        if variable in self.rates:
            return Symbol(self.rates[variable])
        if variable in self._known:
            return self._known[variable]
        self._known[variable] = None  # met again while it is formed: the loop is told below
        kind = self.variables[variable]
        if kind.role == "parameter":
            result: Expression | None = ZERO
        elif kind.role in ("time", "input"):
            self.diagnostics.append(ForcedStorage(self._span, self._element, self._via, self._target))
            result = None
        else:
            result = self._chain(variable)
        self._known[variable] = result
        return result

    def _chain(self, variable: int) -> Expression | None:
        assignment = self.assigned.get(variable)
        if assignment is None:
            return None
        terms = []
        self._via = assignment.owner  # what is named if it turns out to change with time
        for slot, argument in enumerate(assignment.arguments):
            if isinstance(argument, float):
                continue
            if argument in self._known and self._known[argument] is None and argument not in self.rates:
                if not self.diagnostics:
                    self.diagnostics.append(DerivativeThroughLoop(self._span, self._element, f"`{assignment.owner}`"))
                return None
            inner = self._rate(argument)  # first: what jumps with time has no slope, but no derivative either
            if inner is None:
                return None
            slope = ZERO if inner == ZERO else derivative(assignment.formula.expression, Symbol(slot))
            if slope != ZERO:
                terms.append(multiply(self._put(slope, assignment), inner))
        total = add(*terms)
        if isinstance(total, Number | Symbol):
            return total
        target = len(self.variables)
        self.variables.append(Variable(f"d({self.variables[variable].name})/dt", "computed"))
        self._assign(target, total, assignment.owner)
        return Symbol(target)

    @staticmethod
    def _put(expression: Expression, assignment: Assignment) -> Expression:
        def value(symbol: Symbol) -> Expression:
            argument = assignment.arguments[symbol.key]
            return Number(argument) if isinstance(argument, float) else Symbol(argument)

        return substitute(expression, value)
