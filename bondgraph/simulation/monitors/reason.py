"""Cause of an expression without a value at a state, or just beyond it: the operation, and the values that it reads."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from compiler.api import Apply, Expression, Number, Symbol, value_of

SHARE = 1e-12  # relative to the larger of two values: least size for a change of sign


@dataclass(frozen=True, slots=True)
class Reason:
    """Description of the error, as the end of a sentence, and the expression that causes it."""

    words: str
    about: Expression | None


def reason(x: Expression, now: Mapping[Any, float], ahead: Mapping[Any, float]) -> Reason | None:
    """Return the innermost operation without a finite value ahead although its operands are finite, or a divisor that passes zero on the way.

    Branches that are not taken are ignored. None if there is no such operation.
    """
    return _Search(now, ahead).at(x)


class _Search:
    def __init__(self, now: Mapping[Any, float], ahead: Mapping[Any, float]) -> None:
        self.now, self.ahead = now, ahead
        self.values: dict[Expression, tuple[float, float]] = {}

    def at(self, x: Expression) -> Reason | None:
        """Return the first reason in an expression, and store its values."""
        if x in self.values:
            return None
        if isinstance(x, Number):
            self.values[x] = x.value, x.value
            return None
        if isinstance(x, Symbol):
            self.values[x] = self.now.get(x.key, math.nan), self.ahead.get(x.key, math.nan)
            return None
        assert isinstance(x, Apply)
        if x.operator == "select":
            return self._branch(x)
        for operand in x.operands:
            found = self.at(operand)
            if found is not None:
                return found
        pairs = [self.values[o] for o in x.operands]
        self.values[x] = _value(x.operator, [p[0] for p in pairs]), _value(x.operator, [p[1] for p in pairs])
        if not all(math.isfinite(p[1]) for p in pairs):
            return None
        return _wrong(x, pairs, self.values[x][1])

    def _branch(self, x: Apply) -> Reason | None:
        condition, value, otherwise = x.operands
        found = self.at(condition)
        if found is not None:
            return found
        taken = value if self.values[condition][1] else otherwise
        found = self.at(taken)
        if found is None:
            self.values[x] = self.values[taken]
        return found


def _wrong(x: Apply, pairs: list[tuple[float, float]], value: float) -> Reason | None:
    """Return the error in one operation whose operands are finite; None if there is none."""
    if x.operator == "divide":
        before, after = pairs[1]
        small = SHARE * max(abs(before), abs(after))
        if after == 0 and before == 0:
            read = "what is zero" if _reads(x.operands[1]) else "a factor of its law that is zero"
            return Reason(f"is divided by {read}", x.operands[1])
        if after == 0 or (before * after < 0 and min(abs(before), abs(after)) >= small):
            return Reason("is divided by what passes zero there", x.operands[1])
    if math.isfinite(value):
        return None
    return Reason(f"has no value there: {_words(x, [p[1] for p in pairs])}", x)


def _words(x: Apply, values: list[float]) -> str:
    match x.operator:
        case "sqrt":
            return f"the square root of {values[0]:.6g}"
        case "log" | "log10":
            return f"the logarithm of {values[0]:.6g}"
        case "asin" | "acos" | "acosh" | "atanh":
            return f"{x.operator} of {values[0]:.16g}"
        case "power" if values[0] < 0 or (values[0] == 0 and values[1] < 0):
            return f"{values[0]:.6g} to the power of {values[1]:.6g}"
        case "divide":
            return f"{values[0]:.6g} divided by {values[1]:.6g} is too large for a double"
        case "add" | "multiply":
            return "it is too large for a double"
    return f"{x.operator} of {', '.join(f'{v:.6g}' for v in values)} is too large for a double"


def _reads(x: Expression) -> bool:
    if isinstance(x, Apply):
        return any(map(_reads, x.operands))
    return isinstance(x, Symbol)


def _value(operator: str, values: list[float]) -> float:
    try:
        return value_of(operator, values)
    except (ArithmeticError, ValueError, OverflowError):
        return math.nan
