"""A law shared by its uses: an expression over numbered slots, and its bindings to arguments."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ..fast_dataclass import dataclass
from .expression import Expression, Number, Symbol, substitute, symbols


@dataclass(frozen=True, slots=True)
class Formula:
    """An expression whose symbols are the slots 0 … arity-1. Equal laws are equal formulas."""

    arity: int
    expression: Expression


@dataclass(frozen=True, slots=True)
class Bound:
    """A formula with the arguments of its slots."""

    formula: Formula
    arguments: tuple[Any, ...]

    @property
    def expression(self) -> Expression:
        """The expression with the arguments in place of the slots."""
        return over(self.formula.expression, self.arguments, Symbol)


def leaf(argument: Any) -> Expression:
    """An argument as an expression: a number, or the symbol of a variable."""
    return Number(argument) if isinstance(argument, float) else Symbol(argument)


def over(x: Expression, arguments: Sequence[Any], read: Callable[[Any], Expression] = leaf) -> Expression:
    """An expression over slots with what `read` gives for their arguments in place of the slots."""
    return substitute(x, lambda slot: read(arguments[slot.key]))


def bind(x: Expression) -> Bound:
    """Split an expression over any symbols into a formula and its arguments."""
    arguments = tuple(symbols(x))
    slots = {symbol: Symbol(i) for i, symbol in enumerate(arguments)}
    return Bound(Formula(len(arguments), substitute(x, slots.__getitem__)), tuple(s.key for s in arguments))
