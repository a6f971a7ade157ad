"""Affine expressions: slope and rest of an expression in one symbol, and the solution of affine equations."""

from __future__ import annotations

from collections.abc import Sequence

from .expression import ONE, ZERO, Apply, Expression, Symbol, add, depends_on, divide, multiply, negate


def affine_parts(x: Expression, symbol: Symbol) -> tuple[Expression, Expression] | None:
    """`(slope, rest)` with x = slope*symbol + rest, neither containing the symbol; None if x is not affine in it."""
    if isinstance(x, Symbol) and x == symbol:
        return ONE, ZERO
    if not depends_on(x, symbol):
        return ZERO, x
    if not isinstance(x, Apply):
        return None
    if x.operator == "add":
        parts = [affine_parts(term, symbol) for term in x.operands]
        known = [p for p in parts if p is not None]
        if len(known) < len(parts):
            return None
        return add(*(p[0] for p in known)), add(*(p[1] for p in known))
    if x.operator == "multiply":
        inside = [f for f in x.operands if depends_on(f, symbol)]
        if len(inside) > 1:
            return None
        outside = [f for f in x.operands if f is not inside[0]]
        part = affine_parts(inside[0], symbol)
        if part is None:
            return None
        return multiply(*outside, part[0]), multiply(*outside, part[1])
    if x.operator == "divide" and not depends_on(x.operands[1], symbol):
        part = affine_parts(x.operands[0], symbol)
        if part is None:
            return None
        return divide(part[0], x.operands[1]), divide(part[1], x.operands[1])
    return None


def jointly_affine(x: Expression, unknowns: Sequence[Symbol]) -> tuple[list[Expression], Expression] | None:
    """Slopes by some symbols, and the rest, none of which contains them; None if x is not affine in all of them together."""
    slopes, rest = [], x
    for symbol in unknowns:
        parts = affine_parts(rest, symbol)
        if parts is None or any(depends_on(parts[0], other) for other in unknowns):
            return None
        slopes.append(parts[0])
        rest = parts[1]
    return slopes, rest


def solve_affine(left: Expression, right: Expression, symbol: Symbol) -> Expression | None:
    """Solution of left = right for the symbol, if both are affine in it with a slope other than zero."""
    if left == symbol and not depends_on(right, symbol):
        return right
    if right == symbol and not depends_on(left, symbol):
        return left
    parts = affine_parts(left - right, symbol)
    if parts is None or parts[0] == ZERO:
        return None
    return divide(negate(parts[1]), parts[0])
