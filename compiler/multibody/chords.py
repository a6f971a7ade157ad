"""Chords: `free` joints and distances, which constrain nothing and are explicit functions of the poses of their bodies.

A free joint measures the gap between the two places of its point (which is zero in the drawing) along axes that turn with
the first body, with the second, by half of the rotation between them, or not at all, and the rotation vector of the second body
relative to the first. Its efforts are dual to the rates of these, so the wrench of an energy in them follows from power, for all motions:
forces F on the second and -F on the first body, and a moment gap x F, split between the bodies according to the motion of the axes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from ..algebra.expression import ZERO, Expression, Symbol, add, call, divide, multiply
from ..fast_dataclass import dataclass
from ..graph.mechanism import PLANAR_POSE, POSE, Joint
from .kinematics import Kinematics
from .link_state import Marker
from .motion import PortMotion
from .rotations import (
    HALF,
    NO_TURN,
    AxialTurn,
    Quaternion,
    Turn,
    composed,
    conjugate,
    of_quaternion,
    quaternion_product,
    rates_from_spin,
    rotation_vector,
    torque_from_efforts,
)
from .vectors import NULL, UNIT, Vector, cross, dot, minus, negated, plus, scaled


@dataclass(frozen=True, slots=True)
class _Ends:
    """Both sides of a free joint, its axes on each of them and in the drawing, and the relative motion."""

    first: Marker
    second: Marker
    base: Turn
    far: Turn
    drawn: Turn
    gap: Vector
    spin: Vector  # of the second against the first


@dataclass(frozen=True, slots=True)
class RelativeMotion:
    """Coordinates of a free joint from zero in the drawing: gap and rotation vector with their rates.

    The force is that on its second side, in world axes.
    """

    gap: Vector
    turned: Vector
    rates: Vector
    turning: Vector
    force: Vector
    second: Marker


@dataclass(frozen=True, slots=True)
class _Relative:
    """Rotation of the second body relative to the first: quaternion, rotation vector and angular velocity, in the axes `inside`."""

    parts: Quaternion
    vector: Vector
    spin: Vector
    inside: Turn
    axial: AxialTurn | None = None  # if it is about one axis at all times
    back: Turn = NO_TURN  # in world axes: rotation of the torque on the second body to that on the first


@dataclass(frozen=True, slots=True)
class _Axes:
    """Axes in which the gap is measured, and their angular velocity. `follow`: the part of a moment that acts on the second body."""

    turn: Turn
    spin: Vector
    follow: Callable[[Vector], Vector]


class Chords:
    """Writer of chords. The efforts act on their coordinates."""

    def __init__(self, kinematics: Kinematics) -> None:
        self.kinematics, self.script = kinematics, kinematics.script

    def sides(self, joint: Joint, points: tuple[Vector, Vector]) -> tuple[Marker, Marker]:
        """Both sides of a joint."""
        bodies = [self.kinematics.on[end] for end in (joint.first, joint.second)]
        names = ["first", "second"] if bodies[0] == bodies[1] else bodies
        first, second = (
            self.kinematics.placed(body, point, f"{joint.name}.{name}")
            for body, point, name in zip(bodies, points, names, strict=True)
        )
        return first, second

    # ------------------------------------------------------------ free joints
    def free(self, joint: Joint, efforts: Mapping[str, Expression]) -> dict[str, PortMotion]:
        """Motions of a free joint's ports. Its wrench acts on the bodies."""
        script, name = self.script, joint.name
        motion = self.relative_motion(joint, efforts)
        along, rates = (motion.gap, motion.turned), (motion.rates, motion.turning)
        letters = PLANAR_POSE if joint.planar else POSE
        chosen = [(0, 0), (0, 1), (1, 2)] if joint.planar else [(k, i) for k in (0, 1) for i in range(3)]
        motions = {}
        for letter, (kind, i) in zip(letters, chosen, strict=True):
            rest = script.constant(joint.rest[letter], f"{name}.{letter} rest") if letter in joint.rest else ZERO
            held = script.held(f"{name}.{letter}", along[kind][i] + rest, ("m", "1")[kind])
            flow = script.let(f"{name}.{letter}.{('v', 'omega')[kind]}", rates[kind][i], ("m/s", "1/s")[kind])
            motions[f"{name}.{letter}"] = PortMotion(flow, Symbol(held), held)
        return motions

    def relative_motion(self, joint: Joint, efforts: Mapping[str, Expression]) -> RelativeMotion:
        """Motion of the second side in the joint's axes. The joint's wrench acts on the bodies."""
        script, name = self.script, joint.name
        ends = self._ends(joint)
        relative = self._relative(joint, ends)
        axes = self._axes(joint, ends, relative)
        drift = minus(ends.second.velocity, ends.first.velocity)
        drift = script.vector(f"{name}.drift", minus(drift, cross(axes.spin, ends.gap)), "m/s")
        turning = rates_from_spin(script, relative.parts, relative.vector, relative.spin, False, f"{name}.turning")
        gap, rates = axes.turn.back(script, ends.gap, f"{name}.along"), axes.turn.back(script, drift, f"{name}.rates")
        force = self._push(joint, efforts, ends, relative, axes)
        return RelativeMotion(gap, relative.vector, rates, turning, force, ends.second)

    def _ends(self, joint: Joint) -> _Ends:
        script, name = self.script, joint.name
        point = script.place(joint.position, f"{name} at")
        first, second = self.sides(joint, (point, point))
        gap = script.vector(f"{name}.gap", minus(second.displacement, first.displacement), "m")
        drawn = self.kinematics.joint_turn(joint)
        base = composed(script, first.turn, drawn, f"{name}.axes")
        far = composed(script, second.turn, drawn, f"{name}.far axes")
        spin = script.vector(f"{name}.spin", minus(second.spin, first.spin), "1/s")
        return _Ends(first, second, base, far, drawn, gap, spin)

    def _relative(self, joint: Joint, ends: _Ends) -> _Relative:
        script, name = self.script, joint.name
        base, far = ends.base, ends.far
        if isinstance(base, AxialTurn) and isinstance(far, AxialTurn) and (base.axis == far.axis or base.is_none or far.is_none):  # fmt: skip
            axis = far.axis if base.is_none else base.axis
            angle = ZERO if base.angle == far.angle else _between(ends, axis, far.angle - base.angle)
            turn = AxialTurn(axis, script.let(f"{name}.turn", angle, "1"))
            vector = scaled(turn.angle, UNIT[axis])
            spin = base.back(script, ends.spin, f"{name}.own spin")
            return _Relative(turn.quaternion(script, name), vector, spin, base, turn)
        first, second = base.quaternion(script, f"{name}.base"), far.quaternion(script, f"{name}.far")
        if joint.axes == "world":
            return self._seen_from_world(joint, ends, first, second)
        p = self._named(quaternion_product(conjugate(first), second), name)
        spin = base.back(script, ends.spin, f"{name}.own spin")
        return _Relative(p, rotation_vector(script, p, f"{name}.vector"), spin, base)

    def _seen_from_world(self, joint: Joint, ends: _Ends, first: Quaternion, second: Quaternion) -> _Relative:
        """Rotation S from the first body to the second, in world axes, relative to the drawing.

        Its angular velocity is that of the second body minus S times that of the first.
        """
        script, name = self.script, joint.name
        drawn = ends.drawn.quaternion(script, f"{name}.drawn")
        across = quaternion_product(second, conjugate(first))
        p = self._named(quaternion_product(conjugate(drawn), quaternion_product(across, drawn)), name)
        turn = of_quaternion(script, p, f"{name}.across")
        own = [ends.drawn.back(script, side.spin, f"{name}.{n}") for side, n in ((ends.first, "a"), (ends.second, "b"))]
        spin = minus(own[1], turn.apply(script, own[0], f"{name}.brought"))
        spin = script.vector(f"{name}.own spin", spin, "1/s")
        return _Relative(p, rotation_vector(script, p, f"{name}.vector"), spin, ends.drawn, None, turn)

    def _named(self, p: Quaternion, name: str) -> Quaternion:
        w, x, y, z = (self.script.let(f"{name}.relative.{c}", part, "1") for c, part in zip("wxyz", p, strict=True))
        return w, x, y, z

    def _axes(self, joint: Joint, ends: _Ends, relative: _Relative) -> _Axes:
        match joint.axes:
            case "world":
                return _Axes(ends.drawn, NULL, lambda moment: NULL)
            case "to":
                return _Axes(ends.far, ends.second.spin, lambda moment: moment)
            case "middle":
                return self._middle(joint, ends, relative)
        return _Axes(ends.base, ends.first.spin, lambda moment: NULL)

    def _middle(self, joint: Joint, ends: _Ends, relative: _Relative) -> _Axes:
        """Half of the rotation.

        With R its matrix, its angular velocity relative to the first body is (1 + R)^-1 of the whole one w, that is
        1/2 (w - t x w), with t along the axis and of length tan(a/4).
        """
        script, name = self.script, joint.name
        if relative.axial is not None:
            angle = script.let(f"{name}.half turn", multiply(HALF, relative.axial.angle), "1")
            axes = composed(script, ends.base, AxialTurn(relative.axial.axis, angle), f"{name}.middle")
            return _Axes(axes, plus(ends.first.spin, scaled(HALF, ends.spin)), lambda moment: scaled(HALF, moment))
        w, x, y, z = relative.parts
        above = script.let(f"{name}.above", w + call("sqrt", add(w * w, x * x, y * y, z * z)))
        half = of_quaternion(script, (above, x, y, z), f"{name}.half")
        axes = composed(script, ends.base, half, f"{name}.middle")
        tangent = script.vector(f"{name}.tangent", (divide(x, above), divide(y, above), divide(z, above)))
        t = ends.base.apply(script, tangent, f"{name}.tangent world")
        spin = script.vector(f"{name}.follow", scaled(HALF, minus(ends.spin, cross(t, ends.spin))), "1/s")
        return _Axes(axes, plus(ends.first.spin, spin), lambda moment: scaled(HALF, plus(moment, cross(t, moment))))

    def _push(
        self, joint: Joint, efforts: Mapping[str, Expression], ends: _Ends, relative: _Relative, axes: _Axes
    ) -> Vector:  # fmt: skip
        """Apply the wrench to both bodies. Returns the force on the second, in world axes."""
        script, name = self.script, joint.name
        e = [efforts.get(f"{name}.{letter}", ZERO) for letter in POSE]
        dual: Vector = (e[3], e[4], efforts.get(f"{name}.phi", e[5]))
        force = axes.turn.apply(script, (e[0], e[1], e[2]), f"{name}.force")
        own = torque_from_efforts(script, relative.parts, relative.vector, dual, False, f"{name}.torque")
        torque = relative.inside.apply(script, own, f"{name}.torque world")
        seen = relative.back.back(script, own, f"{name}.torque seen")
        reaction = torque if relative.back.is_none else relative.inside.apply(script, seen, f"{name}.reaction")
        moment = NULL if joint.axes == "world" else script.vector(f"{name}.moment", cross(ends.gap, force), "N*m")
        kept = script.vector(f"{name}.kept", axes.follow(moment), "N*m")
        self.kinematics.push(ends.second, force, minus(torque, kept), f"{name}.second")
        self.kinematics.push(ends.first, negated(force), negated(plus(reaction, minus(moment, kept))), f"{name}.first")
        return force

    # ------------------------------------------------------------ distances
    def distance(self, joint: Joint, points: tuple[Vector, Vector], efforts: Mapping[str, Expression]) -> dict[str, PortMotion]:  # fmt: skip
        """Distance between two points. Its effort pushes them apart."""
        script, name = self.script, joint.name
        first, second = self.sides(joint, points)
        drawn = minus(points[1], points[0])
        across = script.vector(f"{name}.across", plus(drawn, minus(second.displacement, first.displacement)), "m")
        held = script.held(f"{name}.d", call("sqrt", dot(across, across)), "m")
        x, y, z = (divide(c, Symbol(held)) for c in across)
        way = script.vector(f"{name}.way", (x, y, z))
        flow = script.let(f"{name}.d.v", dot(way, minus(second.velocity, first.velocity)), "m/s")
        effort = efforts.get(f"{name}.d", ZERO)
        if effort != ZERO:
            force = script.vector(f"{name}.force", scaled(effort, way), "N")
            self.kinematics.push(second, force, NULL, f"{name}.second")
            self.kinematics.push(first, negated(force), NULL, f"{name}.first")
        return {f"{name}.d": PortMotion(flow, Symbol(held), held)}


def _between(ends: _Ends, axis: int, otherwise: Expression) -> Expression:
    """Angle between two bodies that only turn about one axis, without the rounding of the angles of the joint's axes."""
    first, second = ends.first.turn, ends.second.turn
    if isinstance(first, AxialTurn) and isinstance(second, AxialTurn) and {first.axis, second.axis} == {axis}:
        return second.angle - first.angle
    return otherwise
