"""A mechanism in space in absolute coordinates: each body has a place and a quaternion, a velocity in world axes and an angular velocity in its own.

Quaternions turn bodies from how they were drawn; what turns by one does not depend on its length. Angles of joints are states, which count whole turns.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, hypot, pi, sin
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import zeta

from compiler.algebra.expression import (
    ONE,
    ZERO,
    Expression,
    Number,
    add,
    call,
    divide,
    multiply,
    negate,
    power,
    select,
)
from compiler.graph.mechanism import ATTITUDE, CONTACTS, COUPLINGS, GROUND, HOLDING_NOTHING, POSE, Body, Frame, Joint
from compiler.graph.network import MechanismNode
from tests.second_opinion.linkage import Linkage
from tests.second_opinion.writer import NotHeld

if TYPE_CHECKING:
    from tests.second_opinion.assembly import Assembly

Vector = tuple[Expression, ...]
UNDRAWN: Vector = (ONE, ZERO, ZERO, ZERO)
AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
POLES = 3  # of the rates of a rotation vector, at whole turns
MIDDLE = Number(0.5)


# ---------------------------------------------------------------- vectors and quaternions
def vector(numbers: Any) -> Vector:
    return tuple(Number(float(n)) for n in numbers)


def plus(*vectors: Vector) -> Vector:
    return tuple(add(*parts) for parts in zip(*vectors, strict=True))


def scaled(factor: Expression, v: Vector) -> Vector:
    return tuple(multiply(factor, c) for c in v)


def minus(a: Vector, b: Vector) -> Vector:
    return plus(a, scaled(Number(-1.0), b))


def dot(a: Vector, b: Vector) -> Expression:
    return add(*(multiply(c, d) for c, d in zip(a, b, strict=True)))


def cross(a: Vector, b: Vector) -> Vector:
    return tuple(multiply(a[i], b[j]) - multiply(a[j], b[i]) for i, j in ((1, 2), (2, 0), (0, 1)))


def product(p: Vector, q: Vector) -> Vector:
    """Of quaternions: first the turn q, then p."""
    return (
        multiply(p[0], q[0]) - dot(p[1:], q[1:]),
        *plus(scaled(p[0], q[1:]), scaled(q[0], p[1:]), cross(p[1:], q[1:])),
    )


def inverse(q: Vector) -> Vector:
    return (q[0], *(negate(c) for c in q[1:]))


def turned(q: Vector, v: Vector) -> Vector:
    across = cross(q[1:], v)
    return plus(v, scaled(divide(Number(2.0), dot(q, q)), plus(scaled(q[0], across), cross(q[1:], across))))


def quaternion(v: Any) -> Vector:
    """Of a rotation vector in numbers."""
    angle = hypot(*v)
    return vector((cos(angle / 2), *(sin(angle / 2) * c / (angle or 1.0) for c in v)))


def triad(a: Vector) -> tuple[Vector, Vector, Vector]:
    """A direction in numbers and two others, all at right angles."""
    first = np.array([c.value for c in a])  # type: ignore[attr-defined]
    second = np.cross(first, AXES[int(np.argmin(np.abs(first)))])
    second /= np.linalg.norm(second)
    return a, vector(second), vector(np.cross(first, second))


def rotation_vector(q: Vector) -> Vector:
    """The shorter turn that a quaternion is."""
    square = dot(q[1:], q[1:])
    far = divide(multiply(Number(2.0), call("atan2", call("sqrt", square), q[0])), call("sqrt", square))
    t = divide(square, q[0] * q[0])
    near = divide(Number(2.0) - multiply(Number(2 / 3), t), q[0])
    return scaled(select(call("less", square, Number(1e-10)), near, far), q[1:])


def vector_rates(r: Vector, spin: Vector) -> Vector:
    """Rates of a rotation vector by the angular velocity in the axes from which it turns: w - r x w/2 + c r x (r x w), c = 2 sum of 1/((2 pi m)^2 - r.r)."""
    square = dot(r, r)
    poles = [divide(Number(2.0), Number((2 * pi * m) ** 2) - square) for m in range(1, POLES + 1)]
    rest = [
        Number(float(2 * zeta(2 * k, POLES + 1) / (2 * pi) ** (2 * k))) * power(square, Number(k - 1.0))
        for k in range(1, 13)
    ]
    across = cross(r, spin)
    return plus(spin, scaled(negate(MIDDLE), across), scaled(add(*poles, *rest), cross(r, across)))


class SpatialLinkage(Linkage):
    """Bodies, joints in space and the forces on them."""

    pose_names = POSE

    def __init__(self, a: Assembly, node: MechanismNode) -> None:
        self.known: dict[str, dict[str, Expression]] = {}
        super().__init__(a, node)

    def _place(self, body: Body) -> None:
        at, attitude = [self.value(c) for c in body.position], quaternion([self.value(c) for c in body.turn])
        self.drawn[body.name] = vector(at), attitude
        rates = self.rate[body.name] = self._moving(6)
        place = self._posed(at, rates[:3])
        first = len(self.a.rates)
        turn = self._posed((1.0, 0.0, 0.0, 0.0), [ZERO] * 4)
        self.a.rates[first : first + 4] = scaled(MIDDLE, product(turn, (ZERO, *rates[3:])))
        self.pose[body.name] = place, turn

    def direction(self, given: Any) -> Vector:
        """Unit vector in the drawing."""
        numbers = [self.value(c) for c in given]
        return vector(c / hypot(*numbers) for c in numbers)

    # ------------------------------------------------------------ points
    def fixed(self, place: str, at: Any) -> tuple[Any, Any]:
        body = self.mechanism.body_of(place)
        if body == GROUND:
            return vector(at), UNDRAWN
        (x, turn), (x_0, _) = self.pose[body], self.drawn[body]
        return plus(x, turned(turn, minus(vector(at), x_0))), turn

    def point(self, place: str) -> Any:
        return tuple(self.value(c) for c in self.mechanism.point_of(place))

    def spin(self, place: str) -> Vector:
        """Angular velocity in world axes."""
        body = self.mechanism.body_of(place)
        return vector((0, 0, 0)) if body == GROUND else turned(self.pose[body][1], self.rate[body][3:])

    def attitude(self, place: str) -> Vector:
        """How a body's own axes are turned, or what has a frame since the drawing."""
        _, turn = self.fixed(place, self.point(place))
        return product(turn, self.drawn[place][1]) if place in self.drawn else turn

    # ------------------------------------------------------------ joints
    def coordinates(self, joint: Joint) -> dict[str, Expression]:
        if joint.kind == "distance":
            d = minus(*(self.fixed(end, self.point(end))[0] for end in (joint.second, joint.first)))
            return {"d": call("sqrt", dot(d, d))}
        if joint.name not in self.known:
            found = self._coordinates(joint)
            self.known[joint.name] = {
                n: c + (self.value(joint.rest[n]) if n in joint.rest else 0.0) for n, c in found.items()
            }
        return self.known[joint.name]

    def _sides(self, joint: Joint) -> list[tuple[Vector, Vector]]:
        """The joint's point on both bodies, and how these are turned."""
        return [self.fixed(end, [self.value(c) for c in joint.position]) for end in (joint.first, joint.second)]

    def _coordinates(self, joint: Joint) -> dict[str, Expression]:
        if joint.kind in (*CONTACTS, "rod", "weld"):
            return {}
        (p, s), (q, t) = self._sides(joint)
        between, spin = product(inverse(s), t), minus(self.spin(joint.second), self.spin(joint.first))
        if joint.kind in ("planar", "ball", "free"):
            own = quaternion([self.value(c) for c in joint.turn])
            axes = product(s, own)
            between = product(inverse(own), product(between, own))
            middle = product(axes, plus(between, UNDRAWN))
            x = dict(
                zip(
                    "xyz",
                    turned(inverse({"from": axes, "to": product(t, own), "middle": middle}[joint.axes]), minus(q, p)),
                    strict=True,
                )
            )
            spin = turned(inverse(axes), spin)
            if joint.kind == "planar":
                return {
                    "x": x["x"],
                    "y": x["y"],
                    "phi": self._turning(2 * call("atan2", between[3], between[0]), spin[2]),
                }
            turns = [self._turning(c, ZERO) for c in rotation_vector(between)]
            for state, rate in zip(turns, vector_rates(tuple(turns), spin), strict=True):
                self.a.rates[state.key.number] = rate  # type: ignore[attr-defined]
            return {**(x if joint.kind == "free" else {}), **dict(zip(("rx", "ry", "rz"), turns, strict=True))}
        axis = self.direction(joint.axis)
        about = turned(s, axis)
        if joint.kind == "universal":
            other = self.direction(joint.other_axis)
            there, back = turned(between, other), turned(inverse(between), axis)
            first = call("atan2", dot(axis, cross(other, there)), dot(other, there))
            second = call("atan2", dot(other, cross(back, axis)), dot(axis, back))
            return {
                "phi1": self._turning(first, dot(about, spin)),
                "phi2": self._turning(second, dot(turned(t, other), spin)),
            }
        x = {"x": dot(about, minus(q, p))}
        if joint.kind == "slide":
            return x
        phi = {"phi": self._turning(2 * call("atan2", dot(axis, between[1:]), between[0]), dot(about, spin))}
        return {**x, **phi} if joint.kind == "cylinder" else phi

    def _turning(self, posed: Expression, rate: Expression) -> Expression:
        """A state that counts turns: how it follows from the poses but for whole turns, and its rate."""
        state = self.a.state(rate, 0.0)
        self.turns[state] = posed
        return state

    def _hold(self, joint: Joint) -> None:
        if joint.locked or joint.axes == "world":
            raise NotHeld("a locked joint, or one in world axes")
        if joint.kind in COUPLINGS:
            super()._hold(joint)
            return
        self.coordinates(joint)  # whatever is read, as states are counted before
        if joint.kind == "rod":
            ends = [self.point(end) for end in (joint.second, joint.first)]
            d = minus(*(self.fixed(end, at)[0] for end, at in zip((joint.second, joint.first), ends, strict=True)))
            self._tie(call("sqrt", dot(d, d)) - hypot(*(a - b for a, b in zip(*ends, strict=True))))
        elif joint.kind in CONTACTS:
            self._roll(joint)
        elif joint.kind not in HOLDING_NOTHING:
            self._join(joint)

    def _join(self, joint: Joint) -> None:
        """Displacements and turns that the joint does not leave."""
        kind = joint.kind
        (p, s), (q, t) = self._sides(joint)
        if kind in ("weld", "ball", "planar"):
            own = quaternion([self.value(c) for c in joint.turn])
            a, b, c = (turned(own, vector(AXES[i])) for i in ((2, 0, 1) if kind == "planar" else (0, 1, 2)))
        else:
            a, b, c = triad(self.direction(joint.axis))
        guided = {"slide": (b, c), "cylinder": (b, c), "screw": (b, c), "planar": (a,)}.get(kind)
        for n in [vector(e) for e in AXES] if guided is None else [turned(s, n) for n in guided]:
            self._tie(dot(n, minus(q, p)))
        squares = [] if kind == "ball" else [(b, a), (c, a)]
        if kind == "universal":
            squares = [(a, self.direction(joint.other_axis))]
        if kind in ("slide", "weld"):
            squares.append((c, b))
        for near, far in squares:
            self._tie(dot(turned(s, near), turned(t, far)))
        if kind == "screw":
            lead = Number(self.value(joint.ratio) / (2 * pi))
            self._tie(dot(turned(s, a), minus(q, p)) - multiply(lead, self.from_drawing(joint.name)))

    def at_joint(self, joint: Joint, body: str, wrench: Sequence[Expression]) -> Sequence[Expression]:
        (q, _), (x, turn) = self._sides(joint)[1], self.pose[body]
        force = tuple(wrench[:3])
        return [*force, *minus(turned(turn, tuple(wrench[3:])), cross(minus(q, x), force))]

    def _roll(self, joint: Joint) -> None:
        """The point of contact is on the plane, and the body's material there does not slip."""
        at, normal = [self.value(c) for c in joint.position], self.direction(joint.other_axis)
        (_, s), (q, t) = self._sides(joint)
        radius = Number(-self.value(joint.ratio))
        axis = vector((0, 0, 0)) if all(self.value(c) == 0 for c in joint.axis) else self.direction(joint.axis)

        def arm(n: Vector, a: Vector) -> Vector:
            down = minus(n, scaled(dot(n, a), a))
            return (
                scaled(divide(radius, call("sqrt", dot(down, down))), down)
                if joint.kind == "wheel"
                else vector((0, 0, 0))
            )

        n, a = turned(s, normal), turned(t, axis)
        there, reach = plus(vector(at), arm(normal, axis)), arm(n, a)
        plane, _ = self.fixed(joint.first, [self.a.number(c) for c in there])
        x = plus(q, reach)
        slip = minus(
            plus(self._velocities(q), cross(self.spin(joint.second), reach)),
            plus(self._velocities(plane), cross(self.spin(joint.first), minus(x, plane))),
        )
        level = [turned(s, d) for d in triad(normal)[1:]] if joint.kind == "wheel" else [cross(n, a)]
        self._tie(dot(n, minus(x, plane)))
        for d in level:
            self._tie(None, dot(slip, d))

    def _velocities(self, x: Vector) -> Vector:
        return tuple(self.velocity(c) for c in x)

    # ------------------------------------------------------------ what others read, and push
    def coordinate(self, path: str) -> Expression:
        part, freedom = path.rsplit(".", 1)
        for joint in self.mechanism.joints:
            if joint.name == part:
                return self.coordinates(joint)[freedom]
        if part.endswith(".attitude"):
            return self.attitude(part.removesuffix(".attitude"))[ATTITUDE.index(freedom)]
        place = POSE.index(freedom)
        return (
            self.fixed(part, self.point(part))[0][place]
            if place < 3
            else rotation_vector(self.attitude(part))[place - 3]
        )

    def flow(self, path: str) -> Expression:
        part, freedom = path.rsplit(".", 1)
        parts = [p for p in (*self.mechanism.bodies, *self.mechanism.frames) if p.name == part]
        if not parts or freedom not in POSE:
            return self.velocity(self.coordinate(path))
        place = POSE.index(freedom)
        rates = self._velocities(self.fixed(part, self.point(part))[0]) if place < 3 else self.spin(part)
        if isinstance(parts[0], Frame) and parts[0].axes == "body" and parts[0].body != GROUND:
            rates = turned(inverse(self.attitude(parts[0].body)), rates)
        return rates[place % 3]

    def inertial(self, body: Body) -> list[Expression]:
        mass = self.a.opened(body.mass)
        *linear, alpha_x, alpha_y, alpha_z = self.accelerations(body)
        spin, own = self.rate[body.name][3:], self.drawn[body.name][1]
        xx, yy, zz, xy, xz, yz = (self.a.opened(getattr(body.inertia, c)) for c in ("xx", "yy", "zz", "xy", "xz", "yz"))

        def momentum(w: Vector) -> Vector:
            w = turned(inverse(own), w)
            return turned(own, tuple(dot(row, w) for row in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))))

        turning = plus(momentum((alpha_x, alpha_y, alpha_z)), cross(spin, momentum(spin)))
        return [*(multiply(mass, c) for c in linear), *turning]

    # ------------------------------------------------------------ starts
    def closed(self) -> list[Expression]:
        return [*super().closed(), *(dot(turn, turn) - 1.0 for _, turn in self.pose.values())]

    def unsaid(self, rate: bool) -> list[str]:
        """Those of joints, and poses of bodies that no joint holds."""
        holding = [j for j in self.mechanism.joints if j.kind not in HOLDING_NOTHING | CONTACTS]
        tied = {self.mechanism.body_of(end) for j in holding if j.kind not in COUPLINGS for end in (j.first, j.second)}
        loose = [b for b in self.mechanism.bodies if b.name not in tied]
        return [
            *super().unsaid(rate),
            *(f"{b.name}.{c}" for b in loose for c in POSE if c + ".f" * rate not in b.starts),
        ]
