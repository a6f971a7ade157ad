"""Writer of a mechanism's equations: expressions with several uses get names of the mechanism's own."""

from __future__ import annotations

from typing import Protocol

from ..algebra.expression import Expression, Number, Symbol
from ..algebra.formula import Bound
from ..errors import Diagnostic
from ..graph.mechanism import Mechanism
from ..graph.mechanism import Vector as Place
from ..source import Span
from .vectors import Matrix, Vector


class EquationWriter(Protocol):
    """Methods of the equations' builder that this room needs."""

    @property
    def switching(self) -> bool: ...
    def variable(self, name: str, role: str, unit: str = "", value: float | None = None) -> int: ...
    def assign(self, target: int, expression: Expression, span: Span, owner: str) -> None: ...
    def folded(self, bound: Bound) -> Expression: ...
    def state(
        self, variable: int, rate: int, start: Expression, name: str, span: Span, given: bool = True, drawn: Expression | None = None
    ) -> None: ...  # fmt: skip
    def claim(self, value: Expression, start: Expression, name: str, span: Span) -> None: ...
    def definition(self, variable: int) -> Expression | float | None: ...
    def unit_of(self, variable: int) -> str: ...
    def smoothly(self, target: int) -> None: ...
    def vanishing(self, target: int, expression: Expression, span: Span, owner: str) -> None: ...
    def invariant(
        self, position: int | None, velocity: int | None, name: str, span: Span, multiplier: int | None = None, part: int | None = None
    ) -> None: ...  # fmt: skip
    def momentum(self, variable: int, rate: int) -> None: ...
    def balance(self, variable: int, told: Diagnostic) -> None: ...
    def differentiated(self, target: int, of: int, span: Span, owner: str, quantity: int) -> None: ...


class AssignmentEmitter:
    """Writer of assignments of one mechanism."""

    def __init__(self, mechanism: Mechanism, builder: EquationWriter) -> None:
        self.builder, self.owner, self.span = builder, mechanism.name, mechanism.span
        self._constants: dict[str, Expression] = {}

    def named(self, name: str) -> str:
        """Full name of a variable of the mechanism."""
        return f"{self.owner}.{name}"

    def let(self, name: str, expression: Expression, unit: str = "") -> Expression:
        """Name an expression, unless it is a variable or number already."""
        if isinstance(expression, Number | Symbol):
            return expression
        return Symbol(self.computed(name, expression, unit))

    def computed(self, name: str, expression: Expression, unit: str = "") -> int:
        """A new variable that an expression computes."""
        variable = self.builder.variable(self.named(name), "computed", unit)
        self.builder.assign(variable, expression, self.span, self.owner)
        self.builder.smoothly(variable)
        return variable

    def held(self, name: str, expression: Expression, unit: str = "") -> int:
        """Variable with the value of an expression."""
        if isinstance(expression, Symbol):
            assert isinstance(expression.key, int)
            return expression.key
        return self.computed(name, expression, unit)

    def vector(self, name: str, v: Vector, unit: str = "") -> Vector:
        """Name the components of a vector."""
        x, y, z = (self.let(f"{name}.{c}", item, unit) for c, item in zip("xyz", v, strict=True))
        return x, y, z

    def matrix(self, name: str, m: Matrix) -> Matrix:
        """Name the entries of a matrix."""
        a, b, c = (self.vector(f"{name}.{c}", row) for c, row in zip("xyz", m, strict=True))
        return a, b, c

    def constant(self, bound: Bound, name: str, unit: str = "") -> Expression:
        """A bound expression of the text as a named constant; the same name gives the same constant."""
        if name not in self._constants:
            self._constants[name] = self.let(name, self.builder.folded(bound), unit)
        return self._constants[name]

    def place(self, place: Place, name: str, unit: str = "m") -> Vector:
        """A vector of the drawing, in world axes."""
        x, y, z = (self.constant(p, f"{name}.{c}", unit) for c, p in zip("xyz", place, strict=True))
        return x, y, z
