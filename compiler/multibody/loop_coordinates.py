"""Coordinates that a closing joint leaves free, computed from the poses of its two bodies: values, rates, and action of an effort.

They have the same values as those of the same joint in the tree. An angle in space follows from poses only up to whole turns. So an angle
that is read is a state with the rate of the angle, and the run keeps it on the pose: it counts turns, and does not drift. The angle of a
screw follows from its displacement.
"""

from __future__ import annotations

from ..algebra.expression import ONE, ZERO, Expression, Symbol, call, divide, multiply, negate
from ..errors import InternalError
from .loop_frames import LoopCoordinate, Row, Sides
from .rotation_vectors import rates_from_spin, rotation_vector, torque_from_efforts
from .rotations import AxialTurn, Quaternion, conjugate, quaternion_product
from .vectors import NULL, UNIT, Vector, cross, dot, minus, negated, scaled


class Leaves:
    """Coordinates of one closing joint."""

    def __init__(self, sides: Sides) -> None:
        self.sides, self.joint, self.script = sides, sides.joint, sides.script

    def coordinates(self) -> dict[str, LoopCoordinate]:
        """Coordinates by letter."""
        sides, kind = self.sides, self.joint.kind
        if self.joint.planar and kind == "hinge":
            return {"phi": sides.turns_together(sides.plane_angle())}
        if self.joint.planar:
            return {"x": self._way(sides.slid())}
        match kind:
            case "slide":
                return {"x": self._way(sides.slid())}
            case "hinge":
                return {"phi": self._turns_about()}
            case "cylinder":
                return {"x": self._way(sides.slid()), "phi": self._turns_about()}
            case "screw":
                return {"phi": self._threaded()}
            case "planar":
                drawn = zip("xy", sides.axes()[:2], strict=True)
                ways = {c: self._way(sides.row_along(v, sides.on(sides.first, v, c), c)) for c, v in drawn}
                return {**ways, "phi": self._turns_about()}
            case "universal":
                return self._crossed()
            case "ball":
                return self._turned()
        return {}

    # ------------------------------------------------------------ one axis
    @staticmethod
    def _way(row: Row) -> LoopCoordinate:
        """Row for a direction that is free."""
        return LoopCoordinate(row.gap, row.rate, row.acceleration, row.push)

    def _turns_about(self) -> LoopCoordinate:
        """An angle about the joint's axis, the third one for a planar joint."""
        sides = self.sides
        a, b, c = sides.axes()
        if self.joint.kind == "planar":
            a, b, c = c, a, b
        near, other, far = sides.on(sides.first, b, "b"), sides.on(sides.first, c, "c"), sides.on(sides.second, b, "b")
        axis = sides.on(sides.first, a, "a")
        rate = dot(axis, sides.spin)
        value = self._plainly(a)
        if value is None:
            value = self._counted("phi", dot(other, far), dot(near, far), rate)

        def acceleration() -> Expression:
            (_, first), (_, second) = sides.accelerations()
            return dot(axis, minus(second, first)) + dot(cross(sides.first.spin, axis), sides.spin)

        return LoopCoordinate(value, rate, acceleration, lambda torque: self._twist(scaled(torque, axis)))

    def _plainly(self, axis: Vector) -> Expression | None:
        """The angle, if both bodies turn about the joint's axis alone."""
        near, far = self.sides.first.turn, self.sides.second.turn
        if not (isinstance(near, AxialTurn) and isinstance(far, AxialTurn)):
            return None
        third = UNIT[near.axis if far.is_none else far.axis]
        if axis not in (third, negated(third)) or not (near.is_none or far.is_none or near.axis == far.axis):
            return None
        value = (ZERO if far.is_none else far.angle) - (ZERO if near.is_none else near.angle)
        return value if axis == third else negate(value)

    def _threaded(self) -> LoopCoordinate:
        """Angle of a screw, from its displacement, which counts the turns."""
        sides = self.sides
        way, lead = sides.slid(), sides.lead()
        axis = sides.on(sides.first, sides.axes()[0], "a")
        value = self.script.let(f"{self.joint.name}.phi turned", divide(way.gap, lead), "1")
        return LoopCoordinate(
            value, divide(way.rate, lead), lambda: divide(way.acceleration(), lead),
            lambda torque: self._twist(scaled(torque, axis)),
        )  # fmt: skip

    # ------------------------------------------------------------ several axes
    def _crossed(self) -> dict[str, LoopCoordinate]:
        """Angles of a universal joint: about its first axis, fixed to the first body, and its second, fixed to the second body."""
        sides, script, name = self.sides, self.script, self.joint.name
        a, o = sides.direction(self.joint.axis, "axis"), sides.direction(self.joint.other_axis, "other_axis")
        near, other = sides.on(sides.first, a, "a"), sides.on(sides.second, o, "o")
        drawn, turned = sides.on(sides.first, o, "o drawn"), sides.on(sides.second, a, "a turned")
        lean = script.let(f"{name}.lean", dot(a, o))
        share = divide(ONE, ONE - lean * lean)
        found = {}
        for letter, axis, beside, start, end in (
            ("phi1", near, other, drawn, other),
            ("phi2", other, near, near, turned),
        ):
            dual = script.vector(f"{name}.{letter} dual", scaled(share, minus(axis, scaled(lean, beside))))
            sine = dot(axis, cross(start, end))
            cosine = dot(start, end) - dot(axis, start) * dot(axis, end)
            rate = dot(dual, sides.spin)
            found[letter] = self._plain(self._counted(letter, sine, cosine, rate), rate, dual)
        return found

    def _turned(self) -> dict[str, LoopCoordinate]:
        """Rotation vector of a ball: of the second body relative to the first, up to 2 pi."""
        sides, script, name = self.sides, self.script, self.joint.name
        near = sides.first.turn
        first, second = near.quaternion(script, f"{name}.base"), sides.second.turn.quaternion(script, f"{name}.far")
        parts = quaternion_product(conjugate(first), second)
        w, x, y, z = (script.let(f"{name}.relative.{c}", part, "1") for c, part in zip("wxyz", parts, strict=True))
        p: Quaternion = (w, x, y, z)
        spin = near.back(script, sides.spin, f"{name}.own spin")
        r = rotation_vector(script, p, f"{name}.vector")
        rates = rates_from_spin(script, p, r, spin, False, f"{name}.turning")
        found = {}
        for letter, axis, value, rate in zip(("rx", "ry", "rz"), UNIT, r, rates, strict=True):
            own = torque_from_efforts(script, p, r, axis, False, f"{name}.{letter}.torque")
            dual = near.apply(script, own, f"{name}.{letter}.torque world")
            found[letter] = self._plain(value, rate, script.vector(f"{name}.{letter} dual", dual))
        return found

    def _plain(self, value: Expression, rate: Expression, dual: Vector) -> LoopCoordinate:
        """A coordinate that no gear couples: its acceleration is not needed."""

        def acceleration() -> Expression:
            raise InternalError(
                f"the acceleration of {self.joint.name}, a {self.joint.kind} that closes a loop, is not written"
            )

        return LoopCoordinate(value, rate, acceleration, lambda torque: self._twist(scaled(torque, dual)))

    def _twist(self, torque: Vector) -> None:
        self.sides.push(NULL, torque, negated(torque))
        self.sides.reacts(NULL, torque)

    # ------------------------------------------------------------ whole turns
    def _counted(self, letter: str, sine: Expression, cosine: Expression, rate: Expression) -> Expression:
        """An angle as a state, kept where its sine and cosine (both times the same positive number) are."""
        script, joint = self.script, self.joint
        name = script.named(f"{joint.name}.{letter}")
        angle = script.builder.variable(f"{name} turned", "state", "1")
        start = script.builder.folded(joint.starts[letter]) if letter in joint.starts else ZERO
        if letter in joint.rest and start != ZERO:
            start = start - script.constant(joint.rest[letter], f"{joint.name}.{letter} rest")
        script.builder.state(
            angle,
            script.held(f"{joint.name}.{letter} turning", rate, "1/s"),
            start,
            f"{name} turned",
            joint.span,
            False,
            ZERO,
        )
        s, c = script.let(f"{joint.name}.{letter} sin", sine), script.let(f"{joint.name}.{letter} cos", cosine)
        by, to = call("sin", Symbol(angle)), call("cos", Symbol(angle))
        off = call("atan2", multiply(by, c) - multiply(to, s), multiply(to, c) + multiply(by, s))
        script.builder.invariant(script.held(f"{joint.name}.{letter} off", off, "1"), None, name, joint.span)
        return Symbol(angle)
