"""Numbers for expressions of a mechanism: parameters with the values of this scene or other ones, arbitrary values for states."""

from __future__ import annotations

from collections.abc import Iterable

from ..algebra.expression import Expression, Number, evaluate, symbols
from .assignment_emitter import AssignmentEmitter


class SampleValues:
    """Numbers for expressions: parameters with the values of this scene, arbitrary values for states and for expressions without finite value.

    `length`: the size of lengths among the states. A displacement of a metre would make all that is in a mechanism of a micrometre rounding.
    """

    def __init__(self, script: AssignmentEmitter, length: float = 1.0) -> None:
        self.script, self.length = script, length
        self.known: dict[int, float] = {}

    def of(self, x: Expression) -> float:
        """Value of an expression."""
        if isinstance(x, Number):
            return x.value
        self._find([s.key for s in symbols(x)])
        return evaluate(x, self.known.__getitem__)

    def parameter(self, variable: int, value: float) -> float:
        """Number for a parameter: its value."""
        return value

    def _find(self, wanted: list[int]) -> None:
        while wanted:  # not by recursion: angles of a long chain are sums of sums
            variable = wanted[-1]
            if variable not in self.known:
                definition = self.script.builder.definition(variable)
                missing: list[int] = []
                if isinstance(definition, Expression):
                    missing = [s.key for s in symbols(definition) if s.key not in self.known]
                    if not missing:
                        self.known[variable] = self._value(variable, definition)
                else:  # a state: some number that no other has
                    self.known[variable] = (
                        self._state(variable) if definition is None else self.parameter(variable, definition)
                    )
                if missing:
                    wanted += missing
                    continue
            wanted.pop()

    def _state(self, variable: int) -> float:
        return _anything(variable) * (self.length if self.script.builder.unit_of(variable) == "m" else 1.0)

    def _value(self, variable: int, definition: Expression) -> float:
        try:
            return evaluate(definition, self.known.__getitem__)
        except (ArithmeticError, ValueError):  # the root of a run's value, which may be any number here
            return _anything(variable)


class Elsewhere(SampleValues):
    """Numbers for expressions in another scene: all parameters have other values."""

    def parameter(self, variable: int, value: float) -> float:
        """Number for a parameter: its value, changed by some percent."""
        return value + 0.03 * _anything(variable) * (abs(value) or 1.0)


def length_of(script: AssignmentEmitter, places: Iterable[Expression]) -> float:
    """Return the largest of some coordinates in the drawing, or 1 m."""
    drawn = SampleValues(script, 0.0)
    return max((abs(drawn.of(x)) for x in places), default=0.0) or 1.0


def _anything(variable: int) -> float:
    return 0.2 + 0.6180339887498949 * (variable + 1) % 1.0
