"""Domains of expressions: check that an expression has a real value for all real values of some of its symbols."""

from __future__ import annotations

from collections.abc import Callable

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


def _moves(x: Expression, varies: Callable[[Symbol], bool]) -> bool:
    return any(varies(s) for s in symbols(x))


def _is_magnitude(x: Expression) -> bool:
    """Return True if the outermost operator of `x` is never negative."""
    row = OPERATORS.get(x.operator) if isinstance(x, Apply) else None
    return row is not None and row.never_negative and row.is_total
