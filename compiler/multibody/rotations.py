"""Rotations: about a coordinate axis by an angle, or general.

Rotations about one axis merge into one angle, so a planar mechanism needs no matrix. Displacements by a rotation are computed without
the cancellation of 1 - cos: `swing` is (R - 1) v with 2 sin^2(angle/2), as displacements of 1e-9 m on arms of 1e-3 m need it.
A rotation of a symmetric or any 2 x 2 block needs four products, with those of sine and cosine.

Rotation vectors r (axis times angle) come from quaternions. With w the angular velocity of B relative to A, r' = w - 1/2 r x w + g r x (r x w) in the
axes of A, and + 1/2 in those of B; g = (1 - a/2 cot(a/2)) / a^2, a = |r| (J. Stuelpnagel, On the parametrization of the three-dimensional rotation
group, SIAM Review 6 (1964)). Near zero angle these are series. A quaternion distinguishes angles up to 2 pi from the opposite rotation; at 2 pi,
where the axis is not determined, r has no rate. A body that turns freely has `attitude` instead.
"""

from __future__ import annotations

import math
from typing import Protocol

from ..algebra.expression import ONE, ZERO, Expression, Number, add, call, divide, multiply, negate, select
from ..fast_dataclass import dataclass
from .assignment_emitter import AssignmentEmitter
from .vectors import UNIT, Matrix, Vector, applied, cross, matrix_of, plus, product, scaled, summed, transposed

HALF, TWO = Number(0.5), Number(2.0)
Quaternion = tuple[Expression, Expression, Expression, Expression]  # w, x, y, z
SLIGHT = Number(1e-4)  # tan^2 of half the angle below which the series are exact to round-off


class Turn(Protocol):
    """A rotation R. Result vectors get names."""

    @property
    def is_none(self) -> bool: ...
    def apply(self, script: AssignmentEmitter, v: Vector, name: str) -> Vector: ...
    def back(self, script: AssignmentEmitter, v: Vector, name: str) -> Vector: ...
    def swing(self, script: AssignmentEmitter, v: Vector, name: str) -> Vector: ...
    def symmetric(self, script: AssignmentEmitter, m: Matrix, name: str) -> Matrix: ...
    def similar(self, script: AssignmentEmitter, m: Matrix, name: str) -> Matrix: ...
    def deviation(self, script: AssignmentEmitter, name: str) -> Matrix: ...
    def quaternion(self, script: AssignmentEmitter, name: str) -> Quaternion: ...


@dataclass(frozen=True, slots=True)
class AxialTurn:
    """Rotation about the coordinate axis 0, 1 or 2, by an angle (rad)."""

    axis: int
    angle: Expression

    @property
    def is_none(self) -> bool:
        return self.angle == ZERO

    @property
    def cos(self) -> Expression:
        return call("cos", self.angle)

    @property
    def sin(self) -> Expression:
        return call("sin", self.angle)

    def versine(self, script: AssignmentEmitter, name: str) -> Expression:
        """1 - cos."""
        half = call("sin", self.angle / TWO)
        return script.let(f"{name}.versine", multiply(TWO, half, half))

    def apply(self, script: AssignmentEmitter, v: Vector, name: str) -> Vector:
        """R v."""
        return self._turned(script, v, name, self.sin)

    def back(self, script: AssignmentEmitter, v: Vector, name: str) -> Vector:
        """The transposed R times v."""
        return self._turned(script, v, name, negate(self.sin))

    def _turned(self, script: AssignmentEmitter, v: Vector, name: str, s: Expression) -> Vector:
        i, j = (self.axis + 1) % 3, (self.axis + 2) % 3
        if self.is_none or (v[i] == ZERO and v[j] == ZERO):
            return v
        result = list(v)
        result[i] = script.let(f"{name}.{'xyz'[i]}", self.cos * v[i] - s * v[j])
        result[j] = script.let(f"{name}.{'xyz'[j]}", s * v[i] + self.cos * v[j])
        return result[0], result[1], result[2]

    def swing(self, script: AssignmentEmitter, v: Vector, name: str) -> Vector:
        """(R - 1) v."""
        i, j = (self.axis + 1) % 3, (self.axis + 2) % 3
        result: list[Expression] = [ZERO, ZERO, ZERO]
        if not self.is_none and (v[i] != ZERO or v[j] != ZERO):
            less = self.versine(script, name)
            result[i] = script.let(f"{name}.d{'xyz'[i]}", negate(less * v[i]) - self.sin * v[j], "m")
            result[j] = script.let(f"{name}.d{'xyz'[j]}", self.sin * v[i] - less * v[j], "m")
        return result[0], result[1], result[2]

    def symmetric(self, script: AssignmentEmitter, m: Matrix, name: str) -> Matrix:
        """R m R^T of a symmetric matrix."""
        return self.similar(script, m, name, True)

    def similar(self, script: AssignmentEmitter, m: Matrix, name: str, symmetric: bool = False) -> Matrix:
        """R m R^T. In the block of the plane, with w = c^2 (a - d) - c s (b + e), the diagonal is d + w, a - w."""
        if self.is_none:
            return m
        i, j, k = (self.axis + 1) % 3, (self.axis + 2) % 3, self.axis
        new = [list(row) for row in m]
        c, s = self.cos, self.sin
        a, b, e, d = m[i][i], m[i][j], m[j][i], m[j][j]
        if any(x != ZERO for x in (b, e)) or a != d:
            cc, cs = script.let(f"{name}.cc", c * c), script.let(f"{name}.cs", c * s)
            across = script.let(f"{name}.across", ZERO if a == d else a - d)
            along = script.let(f"{name}.along", TWO * b if b == e else b + e)
            w = script.let(f"{name}.w", cc * across - cs * along)
            new[i][i], new[j][j] = script.let(f"{name}.ii", d + w), script.let(f"{name}.jj", a - w)
            p = script.let(f"{name}.p", cs * across + cc * along)
            new[i][j] = script.let(f"{name}.ij", p - e)
            new[j][i] = new[i][j] if b == e else script.let(f"{name}.ji", p - b)
        out: list[Expression] = [ZERO, ZERO, ZERO]  # the block between plane and axis rotates as a vector
        out[i], out[j] = m[i][k], m[j][k]
        turned = self.apply(script, (out[0], out[1], out[2]), f"{name}.k")
        new[i][k], new[j][k] = turned[i], turned[j]
        if symmetric or (m[k][i] == m[i][k] and m[k][j] == m[j][k]):
            new[k][i], new[k][j] = turned[i], turned[j]
        else:
            out[i], out[j] = m[k][i], m[k][j]
            turned = self.apply(script, (out[0], out[1], out[2]), f"{name}.l")
            new[k][i], new[k][j] = turned[i], turned[j]
        return matrix_of(new)

    def deviation(self, script: AssignmentEmitter, name: str) -> Matrix:
        """R - 1."""
        i, j = (self.axis + 1) % 3, (self.axis + 2) % 3
        new: list[list[Expression]] = [[ZERO] * 3 for _ in range(3)]
        if not self.is_none:
            new[i][i] = new[j][j] = negate(self.versine(script, name))
            new[i][j], new[j][i] = negate(self.sin), self.sin
        return matrix_of(new)

    def quaternion(self, script: AssignmentEmitter, name: str) -> Quaternion:
        """Unit quaternion (w, x, y, z)."""
        half = self.angle / TWO
        parts: list[Expression] = [ZERO, ZERO, ZERO]
        parts[self.axis] = call("sin", half)
        return call("cos", half), parts[0], parts[1], parts[2]


@dataclass(frozen=True, slots=True)
class AnyTurn:
    """General rotation, by its deviation R - 1 and a quaternion (of any length) that it comes from."""

    less: Matrix
    parts: Quaternion

    @property
    def is_none(self) -> bool:
        return all(x == ZERO for row in self.less for x in row)

    def apply(self, script: AssignmentEmitter, v: Vector, name: str) -> Vector:
        """R v."""
        return script.vector(name, applied(summed(UNIT, self.less), v))

    def back(self, script: AssignmentEmitter, v: Vector, name: str) -> Vector:
        """The transposed R times v."""
        return script.vector(name, applied(transposed(summed(UNIT, self.less)), v))

    def swing(self, script: AssignmentEmitter, v: Vector, name: str) -> Vector:
        """(R - 1) v."""
        return script.vector(f"{name}.d", applied(self.less, v), "m")

    def symmetric(self, script: AssignmentEmitter, m: Matrix, name: str) -> Matrix:
        """R m R^T of a symmetric matrix: only half of it is computed."""
        r = summed(UNIT, self.less)
        half = script.matrix(f"{name}.half", product(r, m))
        new: list[list[Expression]] = [[ZERO] * 3 for _ in range(3)]
        for i in range(3):
            for j in range(i, 3):
                value = add(*(half[i][k] * r[j][k] for k in range(3)))
                new[i][j] = new[j][i] = script.let(f"{name}.{'xyz'[i]}{'xyz'[j]}", value)
        return matrix_of(new)

    def similar(self, script: AssignmentEmitter, m: Matrix, name: str) -> Matrix:
        """R m R^T."""
        r = summed(UNIT, self.less)
        half = script.matrix(f"{name}.half", product(r, m))
        return script.matrix(name, product(half, transposed(r)))

    def deviation(self, script: AssignmentEmitter, name: str) -> Matrix:
        """R - 1."""
        return self.less

    def quaternion(self, script: AssignmentEmitter, name: str) -> Quaternion:
        """Quaternion (w, x, y, z)."""
        return self.parts


NO_TURN = AxialTurn(2, ZERO)


def composed(script: AssignmentEmitter, first: Turn, second: Turn, name: str) -> Turn:
    """Product of two rotations (first second v): one angle if both are about one axis."""
    if first.is_none:
        return second
    if second.is_none:
        return first
    if isinstance(first, AxialTurn) and isinstance(second, AxialTurn) and first.axis == second.axis:
        return AxialTurn(first.axis, script.let(f"{name}.turn", first.angle + second.angle, "1"))
    # (1 + a)(1 + b) - 1 = a + (1 + a) b
    a, b = first.deviation(script, name), second.deviation(script, f"{name}.own")
    less = summed(a, product(summed(UNIT, a), b))
    p = quaternion_product(first.quaternion(script, name), second.quaternion(script, name))
    w, x, y, z = (script.let(f"{name}.attitude.{c}", part, "1") for c, part in zip("wxyz", p, strict=True))
    return AnyTurn(script.matrix(f"{name}.turn", less), (w, x, y, z))


def quaternion_product(p: Quaternion, q: Quaternion) -> Quaternion:
    """Quaternion of the rotation p after q."""
    return (
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] + p[2] * q[0] + p[3] * q[1] - p[1] * q[3],
        p[0] * q[3] + p[3] * q[0] + p[1] * q[2] - p[2] * q[1],
    )


def conjugate(p: Quaternion) -> Quaternion:
    """Quaternion of the inverse rotation."""
    return p[0], negate(p[1]), negate(p[2]), negate(p[3])


def of_quaternion(script: AssignmentEmitter, p: Quaternion, name: str) -> AnyTurn:
    """Rotation of a quaternion of any length, so a norm that is only nearly 1 does no harm."""
    w, x, y, z = p
    twice = script.let(f"{name}.twice", divide(TWO, add(*(c * c for c in p))))
    xs, ys, zs = (script.let(f"{name}.{c}s", twice * v) for c, v in zip("xyz", (x, y, z), strict=True))
    wx, wy, wz, xx, yy, zz = w * xs, w * ys, w * zs, x * xs, y * ys, z * zs
    xy, xz, yz = x * ys, x * zs, y * zs
    less = (
        (negate(yy + zz), xy - wz, xz + wy),
        (xy + wz, negate(xx + zz), yz - wx),
        (xz - wy, yz + wx, negate(xx + yy)),
    )
    return AnyTurn(script.matrix(f"{name}.turn", less), p)


def about(script: AssignmentEmitter, axis: Vector, angle: Expression, name: str) -> Turn:
    """Rotation about a unit vector by an angle (rad)."""
    for k in range(3):
        if axis[(k + 1) % 3] == ZERO and axis[(k + 2) % 3] == ZERO:
            return AxialTurn(k, multiply(axis[k], angle))
    half = multiply(HALF, angle)
    h, c = script.let(f"{name}.half", call("sin", half)), call("cos", half)
    twice = script.let(f"{name}.twice", multiply(TWO, h, c))
    versine = script.let(f"{name}.versine", multiply(TWO, h, h))
    x, y, z = axis
    less = (
        (versine * (x * x - 1.0), versine * x * y - twice * z, versine * x * z + twice * y),
        (versine * x * y + twice * z, versine * (y * y - 1.0), versine * y * z - twice * x),
        (versine * x * z - twice * y, versine * y * z + twice * x, versine * (z * z - 1.0)),
    )
    return AnyTurn(script.matrix(f"{name}.turn", less), (c, *scaled(h, axis)))


def of_rotation_vector(script: AssignmentEmitter, v: Vector, name: str) -> Turn:
    """Rotation of a constant rotation vector (rad), of a part in the drawing."""
    known = [k for k in range(3) if v[k] != ZERO]
    if len(known) < 2:
        return AxialTurn(known[0], v[known[0]]) if known else NO_TURN
    size = script.let(f"{name}.angle", call("max", call("sqrt", add(*(x * x for x in v))), Number(1e-150)))
    return about(script, tuple(script.let(f"{name}.axis.{c}", divide(x, size)) for c, x in zip("xyz", v, strict=True)), size, name)  # type: ignore[arg-type]  # fmt: skip


def unit(v: Vector) -> Vector:
    """Unit vector along another vector."""
    known = [k for k in range(3) if v[k] != ZERO]
    if all(isinstance(x, Number) for x in v):
        x, y, z = (x.value for x in v if isinstance(x, Number))
        size = math.hypot(x, y, z)  # whose squares neither vanish nor overflow
        if size == 0.0 or abs(size - 1.0) < 4e-16:
            return v
        return Number(x / size), Number(y / size), Number(z / size)
    if len(known) == 1:
        k = known[0]
        return scaled(divide(v[k], call("abs", v[k])), UNIT[k])
    return scaled(divide(ONE, call("sqrt", add(*(x * x for x in v)))), v)


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
