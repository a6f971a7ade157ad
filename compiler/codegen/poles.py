"""Poles of laws: divisors that may be zero between two solutions of a loop, on whose sides its determinant may have the same sign."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from ..algebra.expression import Apply, Expression, Number, call, never_negative


def poles(residuals: Iterable[Expression], moves: Callable[[Expression], bool]) -> tuple[Expression, ...]:
    """Return what residuals divide by that moves and may change its sign, except where a condition decides: the author may divide by no zero there."""
    found, seen, waiting = dict[Expression, None](), set[Expression](), list(residuals)
    while waiting:
        node = waiting.pop()
        if node in seen or not isinstance(node, Apply) or node.operator == "select" or not moves(node):
            continue
        seen.add(node)
        waiting += node.operands
        match node:
            case Apply(operator="divide", operands=(_, below)):
                found[below] = None
            case Apply(operator="power", operands=(below, Number(value=n))) if n < 0 and n % 2 == 1:
                found[below] = None
            case Apply(operator="tan", operands=(x,)):
                found[call("cos", x)] = None
    return tuple(x for x in found if moves(x) and not never_negative(x))
