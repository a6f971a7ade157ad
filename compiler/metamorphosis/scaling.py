"""Other units of length, mass, time, charge, temperature and amount: every number with a dimension multiplied by its power of ten."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from random import Random
from typing import Any

from ..graph.units import ONE, Dimension, Scale
from ..semantics.expressions.scales import bare, scale_of
from ..syntax import tree
from .printing import unit, with_parts

KELVIN = unit("K")
BASES = ("mass", "length", "time", "current", "temperature", "amount", "light")


class Powers:
    """Powers of ten of the bases; even, so that roots of units still give powers of ten."""

    def __init__(self, seed: int) -> None:
        random = Random(seed)
        powers: Mapping[str, int] = {
            b: random.randrange(-6, 7, 2) for b in ("mass", "length", "time", "charge", "temperature", "amount")
        }
        self.powers = {**powers, "current": powers["charge"] - powers["time"], "light": 0}

    def of(self, dimension: Dimension) -> int:
        """The power of ten by which a quantity grows."""
        power = sum(
            (Fraction(self.powers[b]) * e for b, e in zip(BASES, dimension.exponents, strict=True)), Fraction(0)
        )
        assert power.denominator == 1, f"a root of higher degree in [{dimension}]"
        return power.numerator

    def of_unit(self, words: str) -> float:
        """The factor of a quantity in this unit of SI."""
        return 10.0 ** self.of(scale_of(unit(words or "1")).dimension)

    # ------------------------------------------------------------ the text
    def scaled(self, node: object) -> Any:
        """A tree with all numbers multiplied."""
        match node:
            case tree.Negative(operand=tree.Literal(unit=tree.Unit() as u) as literal) if scale_of(u).offset:
                return self._absolute(-literal.number, scale_of(u))
            case tree.Literal(unit=tree.Unit() as u):
                return self._literal(node, u)
            case tree.Item(unit=tree.Unit() as u) if [s for s, _, _ in u.factors] not in (["model"], ["parameters"]):
                return self._item(node, u)
            case tree.SweepSyntax(unit=tree.Unit() as u):
                values = tuple(self._in_unit(v, u) for v in node.values)
                return replace(node, values=values, unit=KELVIN if scale_of(u).offset else u)
            case tree.Simulate():  # an absolute tolerance in SI means other things in other units
                attributes = tuple(a for a in node.attributes if a.name != "atol")
                return replace(node, range=self.scaled(node.range), attributes=self.scaled(attributes))
            case tree.Unit():
                return node
        return with_parts(node, self.scaled)

    def _literal(self, node: tree.Literal, u: tree.Unit) -> Any:
        if [symbol for symbol, _, _ in u.factors] == ["dB"]:
            return node
        scale = scale_of(u)
        if scale.offset:
            return self._absolute(node.number, scale)
        return replace(node, number=node.number * Fraction(10) ** self.of(scale.dimension))

    def _absolute(self, value: Fraction, scale: Scale) -> tree.ExpressionSyntax:
        kelvin = (value * scale.number + scale.offset) * Fraction(10) ** self.of(scale.dimension)
        return tree.Literal(KELVIN.span, 1, kelvin, KELVIN)

    def _item(self, node: tree.Item, u: tree.Unit) -> tree.Item:
        value = node.value
        value = None if value is None else self._in_unit(value, u)
        return replace(node, value=value, unit=KELVIN if scale_of(u).offset else u, index=self.scaled(node.index))

    def _in_unit(self, value: tree.ExpressionSyntax, u: tree.Unit) -> tree.ExpressionSyntax:
        """A value after `name : unit =`, where a bare number is in that unit."""
        if isinstance(value, tree.VectorSyntax):
            return replace(value, items=tuple(self._in_unit(i, u) for i in value.items))
        if not bare(value):
            return self.scaled(value)  # type: ignore[no-any-return]
        scale = scale_of(u)
        if scale.offset:
            sign = -1 if isinstance(value, tree.Negative) else 1
            number = value.operand if isinstance(value, tree.Negative) else value
            assert isinstance(number, tree.Literal)
            return self._absolute(sign * number.number, scale)
        if isinstance(value, tree.Negative):
            return replace(value, operand=self._in_unit(value.operand, u))
        assert isinstance(value, tree.Literal)
        power = 0 if scale.dimension == ONE else self.of(scale.dimension)
        return replace(value, number=value.number * Fraction(10) ** power)


class InBases(Powers):
    """Units of literals and of numbers behind names as products of base units: `5 mm` as `0.005 m`. What is no decimal number there stays."""

    def __init__(self) -> None:
        super().__init__(0)
        self.powers = dict.fromkeys(self.powers, 0)

    def _literal(self, node: tree.Literal, u: tree.Unit) -> Any:
        scale = self._decimal(node.number, u)
        if scale is None:
            return node
        return replace(node, number=node.number * scale.number, unit=unit(str(scale.dimension)))

    def _item(self, node: tree.Item, u: tree.Unit) -> tree.Item:
        value, sign = node.value, 1
        if isinstance(value, tree.Negative):
            value, sign = value.operand, -1
        scale = self._decimal(value.number, u) if isinstance(value, tree.Literal) and value.unit is None else None
        if scale is None or not isinstance(value, tree.Literal):
            return node if node.value is None or bare(node.value) else replace(node, value=self.scaled(node.value))
        changed: tree.ExpressionSyntax = replace(value, number=value.number * scale.number)
        changed = changed if sign == 1 else tree.Negative(value.span, 2, changed)
        return replace(node, value=changed, unit=unit(str(scale.dimension)))

    def _decimal(self, number: Fraction, u: tree.Unit) -> Scale | None:
        """The scale of a unit, if the number is a decimal one in the base units."""
        scale = scale_of(u)
        if [symbol for symbol, _, _ in u.factors] == ["dB"] or scale.offset or scale.pi_power:
            return None
        below = (number * scale.number).denominator
        for prime in (2, 5):
            while below % prime == 0:
                below //= prime
        return scale if below == 1 else None
