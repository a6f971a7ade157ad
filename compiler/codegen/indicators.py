"""Indicators of located conditions: left less right side, or a function with the same sign that polynomials follow better.

A bell exp(-((x - a)/w)^2) against a level is a parabola against its logarithm, which is not narrow.
A level and a factor are parameters of the run: their signs decide there. A window `|u| < r` is two conditions, u < r and -r < u:
each crosses zero straight, however narrow the window is, while a square, or a kink, that dips below zero for 1e-12 of the range has no place for a polynomial.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf

from ..algebra.expression import (
    ONE,
    ZERO,
    Apply,
    Expression,
    Number,
    add,
    call,
    divide,
    multiply,
    negate,
    power,
    rebuild,
    select,
)
from ..algebra.operators import OPERATORS

LEAST = Number(1e-300)
ROUNDED = Number(2.0**-50)  # of each of the terms that cancel: below as much of them their sum is zero
Window = tuple[Expression, Expression, Expression, Expression]  # u, r, a sign, and what a factor of zero leaves


def indicator(left: Expression, right: Expression, is_fixed: Callable[[Expression], bool]) -> Expression:
    """Return an expression with the sign of `left - right`. `is_fixed`: True for what is constant between two events."""
    for moving, level, side in ((left, right, 1.0), (right, left, -1.0)):
        if is_fixed(level) and not is_fixed(moving):
            found = _against(moving, level, is_fixed)
            if found is not None:
                return multiply(Number(side), found)
    return left - right


def rounding(
    x: Expression, is_fixed: Callable[[Expression], bool], sizes: dict[Expression, Expression] | None = None
) -> Expression:
    """Return the size up to which an expression is but the rounding of terms that cancel, `x/3 + x/7 - x*(10/21)`; zero if it has none.

    A function of such terms is as unsure as its values at both ends of what its operands may be differ. `sizes`: sizes of others; added to.
    """
    sizes = {} if sizes is None else sizes
    if x not in sizes:
        sizes[x] = ZERO if is_fixed(x) or not isinstance(x, Apply) else _rounding(x, is_fixed, sizes)
    return sizes[x]


def _rounding(x: Apply, is_fixed: Callable[[Expression], bool], sizes: dict[Expression, Expression]) -> Expression:
    row = OPERATORS.get(x.operator)
    if row is None or row.kind == "condition" or row.course == "jumping" or x.operator == "noise":
        return ZERO
    inner = [rounding(o, is_fixed, sizes) for o in x.operands]
    if x.operator == "add":
        own = [call("abs", o) for o in x.operands] if sum(not is_fixed(o) for o in x.operands) > 1 else []
        return add(multiply(Number(float(len(own))), ROUNDED, add(*own)), *inner)
    if x.operator == "select":
        return select(x.operands[0], *inner[1:])
    is_root = x.operator == "power" and not (isinstance(x.operands[1], Number) and x.operands[1].value.is_integer())
    lowest, highest = (0.0, inf) if is_root else row.domain
    moves: list[Expression] = []
    for i, (operand, size) in enumerate(zip(x.operands, inner, strict=True)):
        if size == ZERO:
            continue
        low = call("max", operand - size, Number(lowest)) if lowest > -inf else operand - size
        high = call("min", operand + size, Number(highest)) if highest < inf else operand + size
        ends = [rebuild(x.operator, (*x.operands[:i], end, *x.operands[i + 1 :])) for end in (low, high)]
        # a quotient by what is rounding itself has no bound
        sure = ONE if x.operator != "divide" or i == 0 else call("less", 2.0 * size, call("abs", operand))
        moves += [select(sure, call("abs", end - x), ZERO) for end in ends]
    return add(*moves, multiply(ROUNDED, call("abs", x))) if moves else ZERO


def parts_of(x: Expression, is_fixed: Callable[[Expression], bool]) -> tuple[Expression, Expression, Expression] | None:
    """Return a, b, s such that an expression is the larger of a and b where s > 0, the smaller where s < 0, or a where a condition s holds, else b.

    None if it has no max, min, abs or choice, but for functions that rise around it.

    A condition on it is then one on each of both, with `and` or `or`: a corner that dips below zero for 1e-12 of the range has no place for a polynomial.
    """
    if is_fixed(x) or not isinstance(x, Apply):
        return None
    if x.operator in ("max", "min", "abs"):
        u, *v = x.operands
        return u, v[0] if v else negate(u), Number(-1.0) if x.operator == "min" else ONE
    if x.operator == "select" and not is_fixed(x.operands[0]):
        return x.operands[1], x.operands[2], x.operands[0]
    moving = [i for i, o in enumerate(x.operands) if not is_fixed(o)]
    row = OPERATORS.get(x.operator)
    rises = row is not None and row.course == "rising" and row.is_total
    scaled = len(moving) == 1 and (x.operator == "multiply" or (x.operator == "divide" and moving == [0]))
    for i in moving if scaled or rises or x.operator == "add" else ():
        if (parts := parts_of(x.operands[i], is_fixed)) is not None:
            a, b = (rebuild(x.operator, (*x.operands[:i], part, *x.operands[i + 1 :])) for part in parts[:2])
            if scaled and is_fixed(parts[2]):
                return a, b, multiply(parts[2], *(call("sign", o) for o in x.operands if is_fixed(o)))
            return a, b, parts[2]
    return None


def factors_of(
    x: Expression, is_fixed: Callable[[Expression], bool], most: int
) -> tuple[Expression, Expression] | None:
    """Return a factor and the rest of a product of factors in which the same moves, as in `(v - a)*(v - b)`; None for others, and for more than `most`.

    Between its zeros a product of many is so flat that no polynomial through its values shows them all. Factors of different quantities may cross
    zero together.
    """
    factors = _signs(x)
    moving = [o for o in factors if not is_fixed(o)]
    if not 1 < len(moving) <= most or len({_moving_terms(o, is_fixed) for o in moving}) > 1:
        return None
    factors.remove(moving[0])
    return moving[0], multiply(*factors)


def _signs(x: Expression) -> list[Expression]:
    """Return factors of which a product or quotient has the sign."""
    parts = x.operands if isinstance(x, Apply) and x.operator in ("multiply", "divide") else ()
    return [sign for part in parts for sign in _signs(part)] or [x]


def _moving_terms(x: Expression, is_fixed: Callable[[Expression], bool]) -> frozenset[Expression]:
    """Return the terms of a sum that move; of one alone without its fixed factors."""
    terms = [t for t in _operands(x, "add") if not is_fixed(t)]
    if len(terms) > 1:
        return frozenset(terms)
    return frozenset(f for t in terms for f in _operands(t, "multiply") if not is_fixed(f))


def _operands(x: Expression, operator: str) -> Sequence[Expression]:
    return x.operands if isinstance(x, Apply) and x.operator == operator else (x,)


def count_parts(x: Expression, is_fixed: Callable[[Expression], bool], most: int) -> int:
    """Return the number of expressions of which one is one everywhere, without its max, min, abs and choices; or any number above `most`."""
    if (parts := parts_of(x, is_fixed)) is None:
        return 1
    count = count_parts(parts[0], is_fixed, most)
    return count if count > most else count + count_parts(parts[1], is_fixed, most - count)


def window(left: Expression, right: Expression, is_fixed: Callable[[Expression], bool]) -> Window | None:
    """Return u, r, s and the fixed rest such that `left < right` is |u| < r where s > 0, and |u| > r where s < 0; None for other forms.

    Forms: even powers, their products, absolute values, and roots of these, beside what is fixed.
    """
    for moving, level, side in ((left, right, ONE), (right, left, Number(-1.0))):
        if is_fixed(level) and not is_fixed(moving):
            if isinstance(moving, Apply) and moving.operator == "add":
                level = level - add(*(x for x in moving.operands if is_fixed(x)))
                moving = add(*(x for x in moving.operands if not is_fixed(x)))
            if isinstance(moving, Apply) and moving.operator == "sqrt":
                moving, level = moving.operands[0], multiply(level, call("abs", level))
            return None if level == ZERO else _window(moving, level, side, is_fixed)
    return None


def _window(
    moving: Expression, level: Expression, side: Expression, is_fixed: Callable[[Expression], bool]
) -> Window | None:
    factors = _operands(moving, "multiply")
    factor = multiply(*(x for x in factors if is_fixed(x)))
    bases: dict[Expression, float] = {}
    for x in factors:
        match x:
            case Apply(operator="power", operands=(base, Number(n))) if not is_fixed(x):
                bases[base] = bases.get(base, 0.0) + n
            case _ if not is_fixed(x):
                bases[x] = bases.get(x, 0.0) + 1
    ratio = divide(level, select(call("equal", factor, ZERO), ONE, factor))
    sign = multiply(side, call("sign", factor))
    if all(isinstance(x, Apply) and x.operator == "abs" and n == 1 for x, n in bases.items()):
        return multiply(*(x.operands[0] for x in bases if isinstance(x, Apply))), ratio, sign, multiply(side, level)
    degrees = set(bases.values())
    if any(n <= 0 or n % 2 for n in degrees):
        return None
    degree = degrees.pop() if len(degrees) == 1 else 2.0
    u = multiply(*(power(x, Number(n / degree)) for x, n in bases.items()))
    r = multiply(call("sign", ratio), power(call("abs", ratio), Number(1.0 / degree)))
    return u, r, sign, multiply(side, level)


def _against(moving: Expression, level: Expression, is_fixed: Callable[[Expression], bool]) -> Expression | None:
    """Return an expression with the sign of `moving - level` for an exponential with a factor; None for others."""
    factors = _operands(moving, "multiply")
    inner = [x for x in factors if not is_fixed(x)]
    factor = multiply(*(x for x in factors if is_fixed(x)))
    if len(inner) != 1 or not isinstance(inner[0], Apply) or inner[0].operator != "exp":
        return None
    return _exponential(factor, inner[0].operands[0], level)


def _exponential(factor: Expression, exponent: Expression, level: Expression) -> Expression:
    """Return an expression with the sign of `factor exp(exponent) - level`: a logarithm has it where both have one sign."""
    alike = select(call("less", ZERO, call("sign", factor) * call("sign", level)), ONE, ZERO)
    zero = call("log", _size(level)) - call("log", _size(factor))
    return add(multiply(call("sign", factor), alike, exponent - zero), multiply(ONE - alike, factor - level))


def _size(x: Expression) -> Expression:
    return call("max", call("abs", x), LEAST)
