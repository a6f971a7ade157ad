"""Expressions as text, with units for their numbers.

A graph has no units, so the number in `F = 2e4*x^3` has lost its own. Its context restores it: names and variables have known
dimensions, and a number takes the one that its sum, law or definition needs. If there is no number to take it, `1 [N/m]` is
written as a factor, which is folded when the text is read: the laws are the same expressions, bit by bit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

from ..algebra.expression import MINUS_ONE, Apply, Expression, Number, Symbol, negate
from ..algebra.expression import ONE as NUMBER_ONE
from ..algebra.operators import CONDITIONS, OPERATORS
from ..algebra.table import chosen_slopes, is_table, lists
from ..errors import CompilationFailed, InternalError
from ..graph.units import ONE, Dimension
from ..source import Source
from ..syntax import parse_expression
from .errors import UnwrittenNumber, UnwrittenSize
from .literals import NotWritable, number_text, unit_after

MAXIMUM_TERMS = 200_000  # of one expression: parts shared in the graph are written out here


class SymbolText(NamedTuple):
    """Text and dimension of a symbol."""

    text: str
    dimension: Dimension


# Precedences of texts, in the order of the grammar.
CHOICE, OR, AND, NOT, COMPARISON, SUM, PRODUCT, SIGN, POWER, ATOM = range(10)
# Operators with the dimension of all their parts.
SHARING = frozenset(["add", "select", *(row.name for row in OPERATORS.values() if row.units == "same")])
COMPARED = {name: OPERATORS[name].c for name in ("less", "less_equal", "equal")}


class Printer:
    """Conversion of expressions over `SymbolText`s to text of a wanted dimension."""

    def __init__(self, plain: bool) -> None:
        self.plain = plain
        self._rigid: dict[Expression, Dimension | None] = {}
        self._size: dict[Expression, int] = {}

    def text(self, x: Expression, wanted: Dimension) -> str:
        """The expression, in the SI unit of a dimension."""
        if self._terms(x) > MAXIMUM_TERMS:
            raise NotWritable(UnwrittenSize, what=f"more than {MAXIMUM_TERMS} terms")
        text, _ = self._write(x, ONE if self.plain else wanted)
        if text.count("(") > 30:
            _check_depth(text)
        return text

    def _terms(self, x: Expression) -> int:
        if x not in self._size:
            self._size[x] = 1 + sum(map(self._terms, x.operands)) if isinstance(x, Apply) else 1
        return self._size[x]

    # ------------------------------------------------------------ dimensions
    def rigid(self, x: Expression) -> Dimension | None:
        """Dimension of an expression; None if a number in it can take any."""
        if x not in self._rigid:
            self._rigid[x] = self._dimension(x, None)
        return self._rigid[x]

    def usual(self, x: Expression) -> Dimension:
        """Dimension of an expression if its free numbers have no unit."""
        found = self.rigid(x)
        if found is None:
            found = self._dimension(x, ONE)
        return ONE if found is None else found

    def _dimension(self, x: Expression, number: Dimension | None) -> Dimension | None:
        if self.plain:
            return ONE
        if isinstance(x, Number):
            return number
        if isinstance(x, Symbol):
            return x.key.dimension  # type: ignore[no-any-return]
        assert isinstance(x, Apply)
        operator, operands = x.operator, x.operands
        inner = self.rigid if number is None else self.usual
        if operator in ("multiply", "divide"):
            found = [inner(o) for o in operands]
            result = ONE
            for i, dimension in enumerate(found):
                if dimension is None:
                    return None
                result = result / dimension if operator == "divide" and i else result * dimension
            return result
        if operator in ("power", "sqrt"):
            exponent = _exponent(x)
            base = inner(operands[0])
            return ONE if exponent is None else (None if base is None else base**exponent)
        if operator in SHARING:
            known = next((d for d in map(self.rigid, _parts(x)) if d is not None), None)
            return known if known is not None or number is None else self.usual(_parts(x)[0])
        if is_table(x):
            values = lists(x)[1]
            known = next((d for d in map(self.rigid, values) if d is not None), None)
            return known if known is not None or number is None else self.usual(values[0])
        return ONE

    def _common(self, parts: Sequence[Expression]) -> Dimension:
        return next((d for d in map(self.rigid, parts) if d is not None), None) or self.usual(parts[0])

    # ------------------------------------------------------------ text
    def _at(self, level: int, x: Expression, wanted: Dimension) -> str:
        text, found = self._write(x, wanted)
        return text if found >= level else f"({text})"

    def _write(self, x: Expression, wanted: Dimension) -> tuple[str, int]:
        """Text of the wanted dimension, and its precedence."""
        if isinstance(x, Number):
            return self._number(x.value, wanted)
        assert isinstance(x, Symbol | Apply)
        if isinstance(x, Apply) and x.operator in CONDITIONS:
            return self._scaled(f"(1 if {self._condition(x)[0]} else 0)", ATOM, wanted)
        rigid = self.rigid(x)
        if rigid is not None and rigid != wanted and not self._mixed(x):
            text, level = self._write(x, rigid)
            return self._scaled(text, level, wanted / rigid)
        if isinstance(x, Symbol):
            return x.key.text, ATOM
        return self._apply(x, wanted)

    def _mixed(self, x: Expression) -> bool:
        """Return True for a sum or choice whose parts have no common known dimension, so that each is converted to the wanted one."""
        return isinstance(x, Apply) and x.operator in SHARING and len(set(map(self.rigid, _parts(x)))) > 1

    @staticmethod
    def _number(value: float, wanted: Dimension) -> tuple[str, int]:
        if value == 0:
            return "0", ATOM
        if not math.isfinite(value):
            raise NotWritable(UnwrittenNumber, number=value)
        text = number_text(value)
        level = PRODUCT if "2^600" in text else SIGN if value < 0 else ATOM
        if wanted == ONE:
            return text, level
        return (
            (f"{text}*1{unit_after(wanted)}", PRODUCT) if level == PRODUCT else (f"{text}{unit_after(wanted)}", level)
        )

    @staticmethod
    def _scaled(text: str, level: int, unit: Dimension) -> tuple[str, int]:
        """Convert to another unit by a factor of one, which is folded when it is read."""
        if unit == ONE:
            return text, level
        apart = level < PRODUCT or text.startswith("-")
        return f"1{unit_after(unit)}*{f'({text})' if apart else text}", PRODUCT

    def _apply(self, x: Apply, wanted: Dimension) -> tuple[str, int]:
        operator, operands = x.operator, x.operands
        if operator == "add":
            return self._sum(operands, wanted), SUM
        if operator == "multiply":
            return self._product(operands, wanted)
        if operator == "divide":
            return self._quotient(operands[0], operands[1], wanted)
        if operator == "power":
            return self._power(x, wanted)
        if operator == "select":
            condition, value, otherwise = operands
            return (
                f"{self._at(OR, value, wanted)} if {self._condition(condition)[0]} else {self._at(OR, otherwise, wanted)}",
                CHOICE,
            )
        units = OPERATORS[operator].units if operator in OPERATORS else ""
        if units == "root":
            return f"{operator}({self._write(operands[0], wanted**2)[0]})", ATOM
        if units == "same":
            return f"{operator}({', '.join(self._write(o, wanted)[0] for o in operands)})", ATOM
        if is_table(x):
            return self._table(x, wanted), ATOM
        if operator == "noise":  # its place is a count of periods already
            return f"noise({self._write(operands[1], ONE)[0]}, 1, {self._write(operands[2], ONE)[0]})", ATOM
        if units == "ratio":
            common = self._common(operands)
            text = f"{operator}({', '.join(self._write(o, common)[0] for o in operands)})"
        elif units == "bare":
            text = f"{operator}({', '.join(self._write(o, ONE)[0] for o in operands)})"
        else:
            raise InternalError(f"the operator `{operator}` has no name in the language")
        return text, ATOM

    def _table(self, x: Apply, wanted: Dimension) -> str:
        """A curve through points; its slopes follow from them, or are written, too."""
        at, places, values = x.operands[1], *lists(x)[:2]
        unit = self._common((at, *places))
        parts, slopes = [(places, unit), (values, wanted)], chosen_slopes(x)
        if slopes is not None:
            parts.append((slopes, wanted / unit))
        listed = (", ".join(self._write(o, u)[0] for o in part) for part, u in parts)
        return f"{x.operator}({self._write(at, unit)[0]}, {', '.join(f'({part})' for part in listed)})"

    def condition(self, x: Expression) -> str:
        """A condition: 1 if it holds, else 0."""
        if isinstance(x, Number):
            return "true" if x.value else "false"
        return self._condition(x.operands[0])[0] if isinstance(x, Apply) else f"{self._write(x, ONE)[0]} > 0.5"

    def _sum(self, terms: Sequence[Expression], wanted: Dimension) -> str:
        if _is_negative(terms[0]) and isinstance(terms[-1], Number) and not _is_negative(terms[-1]):
            terms = (terms[-1], *terms[:-1])  # `1 - x`: a number goes to the end again when it is read
        text = self._at(PRODUCT, terms[0], wanted)
        for term in terms[1:]:
            minus = _is_negative(term)
            text += f" {'-' if minus else '+'} {self._at(POWER if isinstance(term, Number) else PRODUCT, negate(term) if minus else term, wanted)}"
        return text

    def _product(self, factors: Sequence[Expression], wanted: Dimension) -> tuple[str, int]:
        free = next((i for i, f in enumerate(factors) if self.rigid(f) is None), None)
        units = [self.usual(f) for f in factors]
        if free is not None:
            rest = ONE
            for i, unit in enumerate(units):
                rest = rest if i == free else rest * unit
            units[free] = wanted / rest
        if factors[0] != MINUS_ONE:
            return self._factors(factors, units), PRODUCT
        bare = units[0] == ONE
        taken = _leading(factors[1], bare)  # `-a*b` is (-a)*b: the same, unless a sum or a number takes the sign
        others = tuple(factors[1:]) if bare else (NUMBER_ONE, *factors[1:])
        text = self._factors(others, units[1:] if bare else units)
        return (f"-({text})", SIGN) if taken else (f"-{text}", PRODUCT if len(others) > 1 else SIGN)

    def _factors(self, factors: Sequence[Expression], units: Sequence[Dimension]) -> str:
        return "*".join(
            self._at(POWER if i else PRODUCT, f, u) for i, (f, u) in enumerate(zip(factors, units, strict=True))
        )

    def _quotient(self, top: Expression, bottom: Expression, wanted: Dimension) -> tuple[str, int]:
        if self.rigid(top) is None:
            below = self.usual(bottom)
            above = wanted * below
        else:  # the dimension of the bottom is free
            above = self.usual(top)
            below = above / wanted
        zero = isinstance(bottom, Number) and bottom.value == 0 and below != ONE  # elsewhere a zero needs no unit
        divisor = f"0{unit_after(below)}" if zero else self._at(POWER, bottom, below)
        return f"{self._at(PRODUCT, top, above)}/{divisor}", PRODUCT

    def _power(self, x: Apply, wanted: Dimension) -> tuple[str, int]:
        base, exponent = x.operands
        power = _exponent(x)
        inner = ONE
        if power is not None:
            inner = self.usual(base) if self.rigid(base) is not None else wanted ** (1 / power)
        return f"{self._at(ATOM, base, inner)}^{self._at(ATOM, exponent, ONE)}", POWER

    def _condition(self, x: Expression) -> tuple[str, int]:
        assert isinstance(x, Apply)
        if x.operator in COMPARED:
            common = self._common(x.operands)
            compared = [self._at(SUM, o, common) for o in x.operands]
            return f" {COMPARED[x.operator]} ".join(compared), COMPARISON

        def inner(level: int, operand: Expression) -> str:
            text, found = self._condition(operand)
            return text if found >= level else f"({text})"

        if x.operator == "not":
            return f"not {inner(COMPARISON, x.operands[0])}", NOT
        if x.operator in ("and", "or"):
            level = AND if x.operator == "and" else OR
            left, right = x.operands
            return f"{inner(level, left)} {x.operator} {inner(level + 1, right)}", level
        raise InternalError(f"the condition `{x.operator}` has no name in the language")


def _check_depth(text: str) -> None:
    """Refuse an expression that is nested more deeply than the language accepts."""
    try:
        parse_expression(Source("expression", text))
    except CompilationFailed:
        raise NotWritable(UnwrittenSize, what="more brackets within brackets than the language reads") from None


def _exponent(x: Apply) -> Fraction | None:
    """Exponent of a power or root as the compiler uses it for units; None if it is no number."""
    if x.operator == "sqrt":
        return Fraction(1, 2)
    exponent = x.operands[1]
    found = Fraction(exponent.value).limit_denominator(60) if isinstance(exponent, Number) else None
    return found or None


def _leading(x: Expression, numbers: bool) -> bool:
    """Return True if the text of a factor begins with a sum in brackets, or a number."""
    while isinstance(x, Apply) and x.operator in ("divide", "multiply"):
        x = x.operands[0]
    return (isinstance(x, Apply) and x.operator == "add") or (numbers and isinstance(x, Number))


def _parts(x: Apply) -> tuple[Expression, ...]:
    return x.operands[1:] if x.operator == "select" else x.operands


def _is_negative(x: Expression) -> bool:
    first = x.operands[0] if isinstance(x, Apply) and x.operator == "multiply" else x
    return isinstance(first, Number) and first.value < 0
