"""Domains of expressions: check that an expression has a real value, and a finite slope, for all real values of some of its symbols."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from .expression import Apply, Expression, Number, Symbol, operations, symbols
from .operators import OPERATORS


def is_total(x: Expression, varies: Callable[[Symbol], bool]) -> bool:
    """Return True if `x` has a value for all values of the varying symbols. Sufficient, not necessary: `1/(1 + u^2)` is not recognized."""
    return all(_is_total(node, varies) for node in operations(x))


def _is_total(node: Apply, varies: Callable[[Symbol], bool]) -> bool:
    """The same for one operator whose operands have values."""
    match node:
        case Apply(operator="divide", operands=(_, divisor)):
            return not _moves(divisor, varies)
        case Apply(operator="power", operands=(base, Number(n))):
            return not _moves(base, varies) or (n >= 0 and (n == int(n) or _is_magnitude(base)))
        case Apply(operator="power", operands=(base, exponent)):
            return not _moves(base, varies) or (_is_magnitude(base) and not _moves(exponent, varies))
        case Apply(operator=operator, operands=(inner, *_)) if (
            operator in OPERATORS and not OPERATORS[operator].is_total
        ):
            return not _moves(inner, varies) or (operator in ("sqrt", "root") and _is_magnitude(inner))
    return True


def is_steep(x: Expression, varies: Callable[[Symbol], bool]) -> bool:
    """Return True if a root in `x` has an infinite slope where the varying symbols make a magnitude zero: sign(u)*sqrt(abs(u))."""
    return any(_is_magnitude(root.operands[0]) and _moves(root.operands[0], varies) for root in _roots(x))


def _roots(x: Expression) -> Iterator[Apply]:
    for node in operations(x):
        match node:
            case Apply(operator="power", operands=(_, Number(n))) if 0 < n < 1:
                yield node
            case Apply(operator="sqrt" | "root"):
                yield node


def _moves(x: Expression, varies: Callable[[Symbol], bool]) -> bool:
    return any(varies(s) for s in symbols(x))


def _is_magnitude(x: Expression) -> bool:
    """Return True if the outermost operator of `x` is never negative."""
    row = OPERATORS.get(x.operator) if isinstance(x, Apply) else None
    return row is not None and row.never_negative and row.is_total
