"""Indicators of located conditions: left less right side, or a function with the same sign that polynomials follow better.

A bell exp(-((x - a)/w)^2) against a level is a parabola against its logarithm, and u^6 is u^2 against a root: neither is narrow or flat near its zeros.
A level and a factor are parameters of the run: their signs decide there.
"""

from __future__ import annotations

from collections.abc import Callable

from ..algebra.expression import ONE, ZERO, Apply, Expression, Number, add, call, divide, multiply, power, select

LEAST = Number(1e-300)


def indicator(left: Expression, right: Expression, is_fixed: Callable[[Expression], bool]) -> Expression:
    """Return an expression with the sign of `left - right`. `is_fixed`: True for what is constant between two events."""
    for moving, level, side in ((left, right, 1.0), (right, left, -1.0)):
        if is_fixed(level) and not is_fixed(moving):
            found = _against(moving, level, is_fixed)
            if found is not None:
                return multiply(Number(side), found)
    return left - right


def _against(moving: Expression, level: Expression, is_fixed: Callable[[Expression], bool]) -> Expression | None:
    """Return an expression with the sign of `moving - level` for an exponential or a high even power with a factor; None for others."""
    factors = moving.operands if isinstance(moving, Apply) and moving.operator == "multiply" else (moving,)
    inner = [x for x in factors if not is_fixed(x)]
    factor = multiply(*(x for x in factors if is_fixed(x)))
    if len(inner) != 1 or not isinstance(inner[0], Apply):
        return None
    operator, operands = inner[0].operator, inner[0].operands
    if operator == "exp":
        return _exponential(factor, operands[0], level)
    if operator == "power" and isinstance(operands[1], Number) and operands[1].value in (4.0, 6.0, 8.0, 10.0, 12.0):
        return _even_power(factor, operands[0], operands[1].value, level)
    return None


def _exponential(factor: Expression, exponent: Expression, level: Expression) -> Expression:
    """Return an expression with the sign of `factor exp(exponent) - level`: a logarithm has it where both have one sign."""
    alike = select(call("less", ZERO, call("sign", factor) * call("sign", level)), ONE, ZERO)
    zero = call("log", _size(level)) - call("log", _size(factor))
    return add(multiply(call("sign", factor), alike, exponent - zero), multiply(ONE - alike, factor - level))


def _even_power(factor: Expression, base: Expression, degree: float, level: Expression) -> Expression:
    """Return an expression with the sign of `factor base^degree - level`."""
    sign = call("sign", factor)
    ratio = divide(level, select(call("equal", factor, ZERO), ONE, factor))
    zero = call("sign", ratio) * power(call("abs", ratio), Number(2.0 / degree))
    return add(multiply(sign, power(base, Number(2.0)) - zero), multiply(call("abs", sign) - ONE, level))


def _size(x: Expression) -> Expression:
    return call("max", call("abs", x), LEAST)
