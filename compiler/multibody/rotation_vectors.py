"""Rotation vectors r (axis times angle): from quaternions, their rates, and the torques dual to these.

With w the angular velocity of B relative to A, r' = w - 1/2 r x w + g r x (r x w) in the axes of A, and + 1/2 in those of B;
g = (1 - a/2 cot(a/2)) / a^2, a = |r| (J. Stuelpnagel, On the parametrization of the three-dimensional rotation group, SIAM Review 6
(1964)). Near zero angle these are series. A quaternion distinguishes angles up to 2 pi from the opposite rotation; at 2 pi, where the
axis is not determined, r has no rate. A body that turns freely has `attitude` instead.
"""

from __future__ import annotations

from ..algebra.expression import ONE, ZERO, Expression, Number, add, call, divide, multiply, negate, select
from .assignment_emitter import AssignmentEmitter
from .rotations import HALF, TWO, Quaternion
from .vectors import Vector, cross, plus, scaled

SLIGHT = Number(1e-4)  # tan^2 of half the angle below which the series are exact to round-off


def rotation_vector(script: AssignmentEmitter, p: Quaternion, name: str) -> Vector:
    """Rotation vector of a quaternion of any length."""
    known = [k for k in range(1, 4) if p[k] != ZERO]
    if not known:
        return ZERO, ZERO, ZERO
    w, v = p[0], (p[1], p[2], p[3])
    square = script.let(f"{name}.square", add(*(c * c for c in v)))
    is_slight = _is_slight(w, square)
    sine = script.let(f"{name}.sine", call("sqrt", select(is_slight, ONE, square)))
    t = divide(square, select(is_slight, w * w, ONE))
    series = divide(TWO, select(is_slight, w, ONE)) * _polynomial(t, 1.0, -1 / 3, 1 / 5, -1 / 7)
    factor = script.let(f"{name}.factor", select(is_slight, series, TWO * call("atan2", sine, w) / sine))
    return script.vector(name, scaled(factor, v), "1")


def _is_slight(w: Expression, square: Expression) -> Expression:
    """Condition for an angle near zero; an angle near 2 pi has w < 0."""
    return call("less", square, SLIGHT * w * call("abs", w))


def _polynomial(t: Expression, *coefficients: float) -> Expression:
    """Polynomial by Horner's scheme, coefficients lowest first."""
    value: Expression = Number(coefficients[-1])
    for c in reversed(coefficients[:-1]):
        value = add(Number(c), multiply(t, value))
    return value


def _g(script: AssignmentEmitter, p: Quaternion, r: Vector, name: str) -> Expression:
    """(1 - a/2 cot(a/2)) / a^2."""
    square = script.let(f"{name}.sine square", add(*(c * c for c in p[1:])))
    angle_square = script.let(f"{name}.angle square", add(*(c * c for c in r)))
    is_slight = _is_slight(p[0], square)
    half = HALF * call("sqrt", select(is_slight, ONE, angle_square))
    cot = p[0] / call("sqrt", select(is_slight, ONE, square))
    series = _polynomial(angle_square, 1 / 12, 1 / 720, 1 / 30240, 1 / 1209600)
    return script.let(f"{name}.g", select(is_slight, series, (1.0 - half * cot) / select(is_slight, ONE, angle_square)))


def _mapped(script: AssignmentEmitter, p: Quaternion, r: Vector, w: Vector, sign: float, name: str) -> Vector:
    """w + sign/2 r x w + g r x (r x w); simply w if both are along one axis."""
    once = cross(r, w)
    if all(c == ZERO for c in once):
        return w
    once = script.vector(f"{name}.cross", once)
    twice = cross(r, once)
    return script.vector(name, plus(w, scaled(Number(sign / 2), once), scaled(_g(script, p, r, name), twice)))


def rates_from_spin(
    script: AssignmentEmitter, p: Quaternion, r: Vector, spin: Vector, of_second: bool, name: str
) -> Vector:
    """r', from the angular velocity of B relative to A in the axes of B (the second) or A."""
    return _mapped(script, p, r, spin, 1.0 if of_second else -1.0, name)


def torque_from_efforts(script: AssignmentEmitter, p: Quaternion, r: Vector, efforts: Vector, of_second: bool, name: str) -> Vector:  # fmt: skip
    """Torque on B with the power of efforts on r', in the axes of B or A."""
    return _mapped(script, p, r, efforts, -1.0 if of_second else 1.0, name)


def turned_by_rates(script: AssignmentEmitter, r: Vector, rates: Vector, name: str) -> Vector:
    """Angular velocity in the axes of B, from r' (for constant starts).

    w = r' - (1 - cos a)/a^2 r x r' + (a - sin a)/a^3 r x (r x r').
    """
    once = cross(r, rates)
    if all(c == ZERO for c in once):
        return rates
    a = script.let(f"{name}.angle", call("max", call("sqrt", add(*(c * c for c in r))), Number(1e-4)))
    first = multiply(TWO, call("sin", HALF * a), call("sin", HALF * a)) / (a * a)
    second = (a - call("sin", a)) / (a * a * a)
    return script.vector(name, plus(rates, scaled(negate(first), once), scaled(second, cross(r, once))))
