"""Nonlinear laws solved for one of their variables, if the inverse is one real function.

The operations around the variable are removed one by one, each by its inverse. Only operations with one real inverse are accepted: an
odd power (as a signed root), exp, log, tanh and similar ones, a strictly monotone table; not an even power, sin, or
a variable that occurs twice. A general solver would return one of several branches, or not return at all.
"""

from __future__ import annotations

from collections.abc import Iterable

from .expression import (
    ZERO,
    Apply,
    Expression,
    Number,
    Symbol,
    add,
    apply,
    call,
    depends_on,
    divide,
    lift,
    multiply,
    negate,
    operations,
    power,
    symbols,
)
from .operators import OPERATORS
from .table import KINDS, turned_round


def solve_nonlinear(left: Expression, right: Expression, symbol: Symbol) -> Expression | None:
    """The one real solution of left = right for a symbol; None unless it is certain that there is exactly one."""
    if not depends_on(right, symbol):
        found = _peel(left, right, symbol)
    elif not depends_on(left, symbol):
        found = _peel(right, left, symbol)
    else:
        found = _peel(left - right, ZERO, symbol)
    if isinstance(found, Apply) and next(symbols(found), None) is None:
        return None  # numbers that could not be folded: exp(x) = -1
    return found


def _peel(x: Expression, y: Expression, symbol: Symbol) -> Expression | None:
    """Solve x = y, where only x contains the symbol."""
    if x == symbol:
        return y
    if not isinstance(x, Apply):
        return None
    inside = [o for o in x.operands if depends_on(o, symbol)]
    if x.operator == "multiply" and len(inside) > 1:
        return _signed_power(x, inside, y, symbol)
    if len(inside) != 1:
        return None
    inner = inside[0]
    outside = [o for o in x.operands if o is not inner]
    match x.operator:
        case "add":
            return _peel(inner, add(y, *(negate(o) for o in outside)), symbol)
        case "multiply":
            return _peel(inner, divide(y, multiply(*outside)), symbol)
        case "divide":
            top = inner is x.operands[0]
            return _peel(inner, multiply(y, x.operands[1]) if top else divide(x.operands[0], y), symbol)
        case "power" if inner is x.operands[0] and isinstance(x.operands[1], Number):
            root = _root(y, x.operands[1].value)
            return None if root is None else _peel(inner, root, symbol)
        case "power" if inner is x.operands[0]:  # checked when the exponent is known
            return _peel(inner, call("root", y, x.operands[1]), symbol)
        case "linear" | "cubic" | "monotone" if inner is x.operands[1]:
            place = turned_round(x, y)
            return None if place is None else _peel(inner, place, symbol)
    inverse = OPERATORS[x.operator].inverse if x.operator in OPERATORS else None
    return None if inverse is None else _peel(inner, lift(inverse(apply, y)), symbol)


def _root(y: Expression, exponent: float) -> Expression | None:
    """Inverse of x^n: on all numbers if x^n has one there, on the positive ones for a fraction."""
    if exponent == 0:
        return None
    if exponent != int(exponent):
        return power(y, Number(1 / exponent))
    if int(exponent) % 2 == 0:
        return None
    return _signed(y, 1 / exponent)


def _signed(y: Expression, exponent: float) -> Expression:
    """sign(y) |y|^n."""
    return multiply(call("sign", y), power(call("abs", y), Number(exponent)))


def _signed_power(x: Apply, inside: list[Expression], y: Expression, symbol: Symbol) -> Expression | None:
    """Solve products such as sign(u) sqrt(abs(u)) or u abs(u): an odd power of u, which has one inverse."""
    parts = [_power_of(factor) for factor in inside]
    known = [p for p in parts if p is not None]
    if len(known) < len(parts) or len({base for base, _, _ in known}) != 1:
        return None
    exponent = sum(n for _, n, _ in known)
    odd = sum(parity for _, _, parity in known) % 2 == 1
    if not odd or exponent <= 0:
        return None
    outside = [o for o in x.operands if not depends_on(o, symbol)]
    return _peel(known[0][0], _signed(divide(y, multiply(*outside)), 1 / exponent), symbol)


def _power_of(factor: Expression) -> tuple[Expression, float, int] | None:
    """`(u, n, parity)` of a factor that is |u|^n, with the sign of u if parity is 1."""
    match factor:
        case Apply(operator="sign", operands=(u,)):
            return u, 0.0, 1
        case Apply(operator="abs", operands=(u,)):
            return u, 1.0, 0
        case Apply(operator="sqrt", operands=(Apply(operator="abs", operands=(u,)),)):
            return u, 0.5, 0
        case Apply(operator="power", operands=(Apply(operator="abs", operands=(u,)), Number(n))):
            return u, n, 0
        case Apply(operator="power", operands=(u, Number(n))) if n == int(n):
            return u, n, int(n) % 2
    return factor, 1.0, 1


def obstacle(sides: Iterable[Expression]) -> str:
    """Advice for a law that cannot be inverted, if its operators show why; else ""."""
    operators = {node.operator for side in sides for node in operations(side)}
    if operators & set(KINDS):
        return (
            "A table is turned round where its values rise or fall throughout: `linear` and `monotone` then are, `cubic` if its "
            "points are numbers and its curve does not turn back. Use one of those, or a table of the other variable."
        )
    return ""
