"""Sequences of operators to an expression, by precedence, with checks of their combination."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NoReturn

from lark import Token

from ..source import Span
from . import tree
from .errors import TooDeep, Unexpected
from .refused import Refused, place_of

MAXIMUM_DEPTH = 120  # height of an expression

# Precedence of an operator. Its right operand needs a higher one, so that equal operators are applied from left to right.
_IF, _OR, _AND, _NOT, _COMPARE, _SUM, _PRODUCT, _SIGN, _POWER = range(1, 10)
_BINDS = {
    "if": _IF, "or": _OR, "and": _AND, "<": _COMPARE, "<=": _COMPARE, ">": _COMPARE, ">=": _COMPARE, "==": _COMPARE, "!=": _COMPARE,
    "+": _SUM, "-": _SUM, "*": _PRODUCT, "/": _PRODUCT, "^": _POWER, "else": 0,
}  # fmt: skip
_CHAINS: dict[int, tuple[type, str]] = {_SUM: (tree.Sum, "-"), _PRODUCT: (tree.Product, "/")}


def deepened(kind: type, span: Span, operands: Sequence[tree.ExpressionSyntax], *values: Any) -> Any:
    """A node one level higher than its operands. Raises `Refused` beyond the limit."""
    depth = 1 + max((o.depth for o in operands), default=0)
    if depth > MAXIMUM_DEPTH:
        raise Refused(TooDeep, span.start, span.end, limit=MAXIMUM_DEPTH)
    return kind(span, depth, *values)


class Operators:
    """Operands and operators in the order of the text, while the sequence grows. `finish` makes the expression."""

    __slots__ = ("items", "place")

    def __init__(self, items: list[Any]) -> None:
        self.items = items
        self.place = 0

    def append(self, operator: Token, right: Any) -> None:
        self.items.append(operator)
        if type(right) is Operators:  # an operand with signs before it
            self.items += right.items
        else:
            self.items.append(right)

    def prepend(self, operator: Token) -> None:
        """A sign or `not` before an operand."""
        self.items.insert(0, operator)
        if len(self.items) > MAXIMUM_DEPTH:
            raise Refused.at(TooDeep, operator, limit=MAXIMUM_DEPTH)

    def finish(self) -> Any:
        """Return the expression. Raises `Refused` if two operators do not fit together."""
        self.place = 0
        result = self._climb(_IF, 0)
        if self.place < len(self.items):
            self._refuse(self.items[self.place])
        return result

    # ------------------------------------------------------------ one level after the other
    def _climb(self, least: int, level: int) -> Any:
        """The longest expression from here with operators of at least this precedence (precedence climbing)."""
        items = self.items
        if level > MAXIMUM_DEPTH:
            token = next(t for t in items[self.place :] + items[::-1] if isinstance(t, Token))
            raise Refused.at(TooDeep, token, limit=MAXIMUM_DEPTH)
        left = items[self.place]
        self.place += 1
        if isinstance(left, Token):
            left = self._prefix(left, least, level)
        while self.place < len(items):
            operator = items[self.place]
            binds = _BINDS[operator.value]
            if binds < least:
                break
            if binds in _CHAINS:
                left = self._chain(left, binds, level)
                continue
            self.place += 1
            left = self._pair(left, operator, binds, level)
        return left

    def _prefix(self, operator: Token, least: int, level: int) -> Any:
        own = _SIGN if operator.value == "-" else _NOT
        if least > own:
            self._refuse(operator)
        operand = self._climb(own, level + 1)
        span = Span(operand.span.source, place_of(operator)[0], operand.span.end)
        if own == _SIGN:
            return deepened(tree.Negative, span, (operand,), operand)
        return deepened(tree.Logical, span, (operand,), "not", (operand,))

    def _chain(self, first: Any, binds: int, level: int) -> Any:
        """A sum or product: one node for all its terms, however many."""
        kind, inverse = _CHAINS[binds]
        items, parts = self.items, [(1, first)]
        while self.place < len(items) and _BINDS[items[self.place].value] == binds:
            sign = -1 if items[self.place].value == inverse else 1
            self.place += 1
            parts.append((sign, self._climb(binds + 1, level + 1)))
        span = Span(first.span.source, first.span.start, parts[-1][1].span.end)
        return deepened(kind, span, [part for _, part in parts], tuple(parts))

    def _pair(self, left: Any, operator: Token, binds: int, level: int) -> Any:
        if binds == _IF:
            return self._choice(left, operator, level)
        right = self._climb(_SIGN if binds == _POWER else binds + 1, level + 1)
        span = left.span.to(right.span)
        if binds == _POWER:
            return deepened(tree.Power, span, (left, right), left, right)
        if binds == _COMPARE:
            after = self.items[self.place] if self.place < len(self.items) else None
            if after is not None and _BINDS[after.value] == _COMPARE:
                self._refuse(after, f"Two comparisons are joined by `and`: `a {operator} b and b {after} c`.")
            return deepened(tree.Comparison, span, (left, right), str(operator), left, right)
        return deepened(tree.Logical, span, (left, right), str(operator), (left, right))

    def _choice(self, value: Any, word: Token, level: int) -> tree.ChoiceSyntax:
        condition = self._climb(_OR, level + 1)
        if self.place >= len(self.items) or self.items[self.place].value != "else":
            self._refuse(
                word,
                "An `if` needs an `else`: `1 if a > 2 else 0`; conditional parts stand in braces: `if n > 1 { … }`.",
            )
        self.place += 1
        otherwise = self._climb(_IF, level + 1)
        operands = (value, condition, otherwise)
        return deepened(tree.ChoiceSyntax, value.span.to(otherwise.span), operands, *operands)  # type: ignore[no-any-return]

    @staticmethod
    def _refuse(token: Token, hint: str = "") -> NoReturn:
        usual = {
            "else": "`else` follows an `if`: `1 if a > 2 else 0`.",
            "not": "`not` stands before a condition: put brackets around `not …`.",
        }
        hint = hint or usual.get(str(token), "Put brackets around what belongs together.")
        raise Refused.at(Unexpected, token, found=f"`{token}`", hint=hint)
