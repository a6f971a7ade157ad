"""Common factors: products in laws and their derivatives are computed from shared parts.

A product is a sign, one part with all factors that depend on parameters alone (computed once per run), and the varying factors. Among
these, the pair that occurs in most products becomes a part, until no pair occurs in two (multiple-operand form of Hosangadi, Fallah and
Kastner, IEEE Trans. CAD 25, 2006). A sign stays outside, so that a product and its negative share one part. Sums keep the order of the
author's text: their rounding depends on it, that of a product hardly does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from heapq import heapify, heappop, heappush
from itertools import combinations, count
from operator import is_
from typing import Any

from ..algebra.expression import MINUS_ONE, Apply, Expression, Number
from .dependence import INPUT, MODE, STATE, TIME
from .events import Count, Located, LoweredEvents
from .limits import Limit, LimitValue
from .lowered import Lowered, Solved
from .order import operations_in_order

LONGEST = 12  # factors; a longer product has too many pairs to look at, and stays as it is
PRINTED = (
    "values", "labels", "rates", "jacobian", "claims", "forced", "invariants", "invariant_slopes", "dependents", "sensitivities", "outputs",
    "switches", "crossings", "events", "limits", "delayed", "bends", "peaks", "signals", "solved", "energy",
)  # fmt: skip

_HOLDERS = (Count, Limit, LimitValue, Located, LoweredEvents, Solved)  # classes with expressions among their fields


def with_shared_products(lowered: Lowered) -> Lowered:
    """Return the same values computed with fewer multiplications."""
    printed = {name: getattr(lowered, name) for name in PRINTED}
    roots: list[Expression] = []
    _gather(printed, roots)
    order = operations_in_order(roots, {})
    products = _Products(_moving(order, lowered))
    for node in order:
        if node.operator == "multiply":
            products.read(node)
    products.pair()
    new: dict[Expression, Expression] = {}
    for node in order:
        new[node] = products.written(node, new)
    return replace(lowered, **{name: _mapped(value, new) for name, value in printed.items()})


def _moving(order: Sequence[Apply], lowered: Lowered) -> dict[Expression, bool]:
    """For all operations and symbols: True if they change along a run."""
    moves: dict[Expression, bool] = {}
    for node in order:  # operands first
        found = False
        for operand in node.operands:
            if type(operand) is Number:
                continue
            known = moves.get(operand)
            if known is None:
                known = moves[operand] = lowered.dependence(operand) & (TIME | INPUT | STATE | MODE) != 0
            found = found or known
        moves[node] = found
    return moves


class _Part:
    """Product shared by several products: of two factors, or of all factors that depend on parameters alone."""

    def __init__(self, factors: Sequence[Expression | _Part]) -> None:
        self.factors = factors
        self.value: Expression | None = None  # once it is written


Factor = Expression | _Part
Pair = tuple[int, int]  # numbers of factors, the lower one first


class _Products:
    """Every product as a sign and a list of factors. Factors are numbered in the order of their first use."""

    def __init__(self, moves: Mapping[Expression, bool]) -> None:
        self.moves = moves
        self.numbers: dict[Factor, int] = {}
        self.factors: list[Factor] = []
        self.constants: dict[tuple[int, ...], _Part] = {}
        self.made_of: dict[Apply, list[int]] = {}
        self.negative: set[Apply] = set()

    def _number(self, factor: Factor) -> int:
        number = self.numbers.setdefault(factor, len(self.factors))
        if number == len(self.factors):
            self.factors.append(factor)
        return number

    def read(self, node: Apply) -> None:
        """Split a product into sign and factors."""
        if len(node.operands) > LONGEST:
            return
        still: list[Expression] = []
        moving: list[Expression] = []
        negative = False
        for operand in node.operands:
            if isinstance(operand, Number):
                if operand.value < 0.0:
                    negative, operand = not negative, Number(-operand.value)
                if operand.value != 1.0:
                    still.append(operand)
            else:
                (moving if self.moves[operand] else still).append(operand)
        if negative:
            self.negative.add(node)
        numbers = [self._number(o) for o in still]
        if len(numbers) > 1:
            key = tuple(sorted(numbers, key=lambda i: (not isinstance(self.factors[i], Number), i)))
            part = self.constants.setdefault(key, _Part([self.factors[i] for i in key]))
            numbers = [self._number(part)]
        self.made_of[node] = numbers + [self._number(o) for o in moving]

    def pair(self) -> None:
        """Make parts of the pairs that occur in several products, the most frequent first."""
        having: dict[Pair, dict[Apply, None]] = {}
        for node, numbers in self.made_of.items():
            for pair in _pairs(numbers):
                having.setdefault(pair, {})[node] = None
        # of pairs that are as frequent, the one met first: so equal laws are put together in the same way
        turn = count()
        heap = [(-len(nodes), next(turn), pair) for pair, nodes in having.items() if len(nodes) > 1]
        heapify(heap)
        while heap:
            frequency, _, pair = heappop(heap)
            nodes = having[pair]
            if len(nodes) < 2:
                continue
            if len(nodes) != -frequency:
                heappush(heap, (-len(nodes), next(turn), pair))
                continue
            part = self._number(_Part([self.factors[i] for i in pair]))
            touched: dict[Pair, None] = {}
            for node in list(nodes):
                touched |= dict.fromkeys(self._put(node, pair, part, having))
            for other in touched:
                if len(having[other]) > 1:
                    heappush(heap, (-len(having[other]), next(turn), other))

    def _put(self, node: Apply, pair: Pair, part: int, having: dict[Pair, dict[Apply, None]]) -> Sequence[Pair]:
        """Replace a pair by a part, and return the pairs that the product then has."""
        numbers = self.made_of[node]
        for old in _pairs(numbers):
            having[old].pop(node, None)
        for number in pair:
            numbers.remove(number)
        numbers.append(part)
        now = _pairs(numbers)
        for new in now:
            having.setdefault(new, {})[node] = None
        return now

    def written(self, node: Apply, new: dict[Expression, Expression]) -> Expression:
        """A node over operands that are already rewritten."""
        numbers = self.made_of.get(node)
        if numbers is None:
            operands = tuple([new.get(o, o) if type(o) is Apply else o for o in node.operands])
            same = all(map(is_, operands, node.operands))  # not equality, which goes as deep as they do
            return node if same else Apply(node.operator, operands, node.closed)
        parts = tuple([self._written(self.factors[i], new) for i in numbers])
        value = parts[0] if len(parts) == 1 else Apply("multiply", parts, True)
        return Apply("multiply", (MINUS_ONE, value), node.closed) if node in self.negative else value

    def _written(self, factor: Factor, new: dict[Expression, Expression]) -> Expression:
        if isinstance(factor, Expression):
            return new.get(factor, factor)
        if factor.value is None:
            factor.value = Apply("multiply", tuple(self._written(f, new) for f in factor.factors), True)
        return factor.value


def _pairs(numbers: Sequence[int]) -> list[Pair]:
    if len(numbers) < 3:
        return [(min(numbers), max(numbers))] if len(numbers) == 2 else []
    return list(dict.fromkeys(combinations(sorted(numbers), 2)))


def _gather(value: object, found: list[Expression]) -> None:
    """All expressions in fields, tables and lists."""
    if isinstance(value, Expression):
        found.append(value)
    elif isinstance(value, dict):
        for key, item in value.items():
            for part in (key, item):
                if type(part) is Apply:
                    found.append(part)
                elif type(part) is not int:
                    _gather(part, found)
    elif isinstance(value, (tuple, list)):
        for item in value:
            if type(item) is Apply:
                found.append(item)
            elif type(item) is not int:
                _gather(item, found)
    elif isinstance(value, _HOLDERS):
        for field in fields(value):
            _gather(getattr(value, field.name), found)


def _mapped(value: Any, new: dict[Expression, Expression]) -> Any:
    """The same object with other expressions."""
    if isinstance(value, Expression):
        return new.get(value, value)
    if isinstance(value, dict):
        return {
            (key if type(key) is int else _mapped(key, new)): (new[item] if type(item) is Apply else _mapped(item, new))
            for key, item in value.items()
        }
    if isinstance(value, (tuple, list)):
        return type(value)([item if type(item) is int else _mapped(item, new) for item in value])
    if isinstance(value, _HOLDERS):
        return replace(value, **{f.name: _mapped(getattr(value, f.name), new) for f in fields(value) if f.init})
    return value
