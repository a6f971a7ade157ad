"""The two sides of a closing joint, and their constraint rows.

Kinds of rows: a point of the second body does not move from that of the first along a direction (fixed in the world, or turning with the
first body); directions of both bodies stay at right angles; an angle in the plane; a length; two coordinates in a ratio; a rotation and
a displacement in a ratio.
"""

from __future__ import annotations

from collections.abc import Callable

from ..algebra.expression import ONE, ZERO, Expression, Number, add, call, divide, multiply, negate, select
from ..fast_dataclass import dataclass
from ..graph.mechanism import Joint
from .axes import snapped
from .errors import RodWithoutLength
from .kinematics import Kinematics
from .link_state import Marker
from .motion import MechanismEquations
from .recursion import Recursion
from .rotations import AxialTurn, unit
from .vectors import NULL, UNIT, Vector, cross, dot, is_null, minus, negated, plus, scaled

TWO, HALF = Number(2.0), Number(0.5)
TURN = Number(0.15915494309189535)  # 1/(2 pi)
BESIDE = Number(0.6)  # a direction whose x is smaller is not along x
Accelerations = tuple[Vector, Vector]  # of a placed point, and of the spin


@dataclass(frozen=True, slots=True)
class Row:
    """One constraint: its residual, rate and acceleration (available after the recursion), and the action of a multiplier."""

    name: str  # of the multiplier
    unit: str  # of the gap
    gap: Expression
    rate: Expression
    acceleration: Callable[[], Expression]
    push: Callable[[Expression], None]
    rate_only: bool = False  # it constrains velocities, and has no residual


@dataclass(frozen=True, slots=True)
class LoopCoordinate:
    """A joint's coordinate: value, rate, acceleration (available after the recursion), and the action of an effort."""

    value: Expression
    rate: Expression
    acceleration: Callable[[], Expression]
    push: Callable[[Expression], None]


class Sides:
    """The two sides of a closing joint, and their constraint rows."""

    def __init__(
        self, kinematics: Kinematics, recursion: Recursion, result: MechanismEquations,
        wrenches: dict[str, tuple[Vector, Vector]], joint: Joint,
    ) -> None:  # fmt: skip
        self.kinematics, self.recursion, self.result = kinematics, recursion, result
        self.wrenches, self.joint, self.script = wrenches, joint, kinematics.script
        bodies = [kinematics.on[end] for end in (joint.first, joint.second)]
        if joint.kind == "rod":
            drawn = [kinematics.mechanism.point_of(end) for end in (joint.first, joint.second)]
        else:
            drawn = [joint.position, joint.position]
        points = [
            self.script.place(p, f"{joint.name} at {end}") for p, end in zip(drawn, ("first", "second"), strict=True)
        ]
        names = ["first", "second"] if bodies[0] == bodies[1] else bodies
        self.first, self.second = (
            kinematics.placed(body, point, f"{joint.name}.{name}")
            for body, point, name in zip(bodies, points, names, strict=True)
        )
        self.gap = self.script.vector(
            f"{joint.name}.open", minus(self.second.displacement, self.first.displacement), "m"
        )
        self.slip = self.script.vector(f"{joint.name}.slip", minus(self.second.velocity, self.first.velocity), "m/s")
        self.spin = self.script.vector(f"{joint.name}.turning", minus(self.second.spin, self.first.spin), "1/s")
        self._known: list[tuple[Accelerations, Accelerations]] = []

    def rows(self) -> list[Row]:
        """All constraints of the joint."""
        match self.joint.kind:
            case "rod":
                return self._rod()
            case "hinge" | "ball" | "universal" if not self.joint.locked:
                return [*self._pinned(), *self._turned()]
            case "slide" | "cylinder" | "planar" if not self.joint.locked:
                return [*self._guided(), *self._turned()]
            case "screw" if not self.joint.locked:
                return [*self._guided(), *self._turned(), self._screwed()]
        return [*self._pinned(), *self._turned()]

    def _pinned(self) -> list[Row]:
        return [self.row_along(UNIT[i], UNIT[i], "xyz"[i]) for i in range(2 if self.joint.planar else 3)]

    def _guided(self) -> list[Row]:
        """Rows without gap across a slide's axis, or along the normal of a planar joint, in directions that turn with the first body."""
        if self.joint.kind == "planar":
            directions = [self.axes()[2]]
        elif self.joint.planar:
            a = self.axes()[0]
            directions = [(negate(a[1]), a[0], ZERO)]
        else:
            directions = list(self.axes()[1:])
        words = ("across",) if len(directions) == 1 else ("across.1", "across.2")
        return [self.row_along(n, self.on(self.first, n, w), w) for n, w in zip(directions, words, strict=True)]

    def _turned(self) -> list[Row]:
        """Rows for the relative rotation of the bodies that the joint does not allow."""
        joint = self.joint
        leaves = joint.kind if not joint.locked else "weld"
        if leaves == "ball" or (joint.planar and leaves == "hinge"):
            return []
        if joint.planar:
            return [self._angle()]
        a, b, c = self.axes()
        if leaves == "universal":
            other = self.direction(joint.other_axis, "other_axis")
            return [self._square(a, other, "turn")]
        if leaves == "planar":
            a, b, c = c, a, b
        rows = [self._square(b, a, "turn.1"), self._square(c, a, "turn.2")]
        return rows if leaves in ("hinge", "cylinder", "planar", "screw") else [*rows, self._square(c, b, "turn.3")]

    # ------------------------------------------------------------ directions
    def direction(self, given: object, word: str) -> Vector:
        v = unit(self.script.place(given, f"{self.joint.name}.{word}", "1"))  # type: ignore[arg-type]
        return self.script.vector(f"{self.joint.name}.{word} direction", snapped(v))

    def axes(self) -> tuple[Vector, Vector, Vector]:
        """The joint's axis and two directions at right angles to it, in the drawing; for a planar joint its own axes."""
        joint, script = self.joint, self.script
        if joint.kind in ("planar", "free"):
            turn = self.kinematics.joint_turn(joint)
            x, y, z = (turn.apply(script, UNIT[i], f"{joint.name}.{'xyz'[i]} axis") for i in range(3))
            return x, y, z
        if joint.kind in ("weld", "ball"):
            return UNIT
        return self.axes_along(self.direction(joint.axis, "axis"))

    def axes_along(self, a: Vector) -> tuple[Vector, Vector, Vector]:
        """A unit direction and two others at right angles to it, in the drawing."""
        for i in range(3):
            if a in (UNIT[i], negated(UNIT[i])):
                return a, UNIT[(i + 1) % 3], UNIT[(i + 2) % 3]
        near = call("less", call("abs", a[0]), BESIDE)
        beside: Vector = (select(near, ONE, ZERO), select(near, ZERO, ONE), ZERO)
        b = self.script.vector(f"{self.joint.name}.beside", unit(cross(a, beside)))
        return a, b, self.script.vector(f"{self.joint.name}.third", cross(a, b))

    def on(self, side: Marker, v: Vector, word: str) -> Vector:
        """A direction of the drawing, rotated with a side."""
        turned = side.turn.apply(self.script, v, f"{self.joint.name}.{side.body}.{word}")
        return self.script.vector(f"{self.joint.name}.{side.body}.{word}", turned)

    # ------------------------------------------------------------ rows
    def accelerations(self) -> tuple[Accelerations, Accelerations]:
        if not self._known:
            first, second = (
                self.recursion.seen(side, f"{self.joint.name}.{word}")
                for side, word in ((self.first, "first"), (self.second, "second"))
            )
            self._known.append((first, second))
        return self._known[0]

    def push(self, force: Vector, torque: Vector, back: Vector) -> None:
        """Apply a force and a torque to the second body. The first body gets the negative force, and `back`."""
        name = self.joint.name
        self.kinematics.push(self.second, force, torque, f"{name}.second")
        self.kinematics.push(self.first, negated(force), back, f"{name}.first")

    def reacts(self, force: Vector, torque: Vector) -> None:
        old = self.wrenches.get(self.joint.name, (NULL, NULL))
        self.wrenches[self.joint.name] = (plus(old[0], force), plus(old[1], torque))

    def row_along(self, drawn: Vector, n: Vector, word: str) -> Row:
        """Row without gap along n. If n turns with the first body, its rotation adds terms to the rates."""
        turns = n != drawn
        w, gap, slip = self.first.spin, self.gap, self.slip
        swept = minus(slip, cross(w, gap)) if turns else slip

        def acceleration() -> Expression:
            (near, angular), (far, _) = self.accelerations()
            a = minus(far, near)
            if turns:
                a = minus(a, plus(cross(angular, gap), scaled(TWO, cross(w, slip))))
                a = plus(a, cross(w, cross(w, gap)))
            return dot(n, a)

        def push(force: Expression) -> None:
            f = scaled(force, n)
            self.push(f, NULL, negated(cross(gap, f)) if turns else NULL)
            self.reacts(f, NULL)

        return Row(f"{self.joint.name}.{word}", "m", dot(n, gap), dot(n, swept), acceleration, push)

    def _square(self, near: Vector, far: Vector, word: str) -> Row:
        """Row: a direction of the first body and one of the second keep their angle of the drawing."""
        b, a = self.on(self.first, near, f"{word}.near"), self.on(self.second, far, f"{word}.far")
        name = f"{self.joint.name}.{word}"
        m = self.script.vector(f"{name}.m", cross(a, b))
        drawn = dot(near, far)
        gap = add(dot(b, a), negate(self.script.let(f"{name}.drawn", drawn))) if drawn != ZERO else dot(b, a)

        def acceleration() -> Expression:
            (_, first), (_, second) = self.accelerations()
            turning = plus(cross(cross(self.second.spin, a), b), cross(a, cross(self.first.spin, b)))
            return dot(minus(second, first), m) + dot(self.spin, turning)

        def push(torque: Expression) -> None:
            t = scaled(torque, m)
            self.push(NULL, t, negated(t))
            self.reacts(NULL, t)

        return Row(name, "1", gap, dot(self.spin, m), acceleration, push)

    def _angle(self) -> Row:
        """Row: two bodies turn together in the plane."""
        turned = self.turns_together(self.plane_angle())
        return Row(f"{self.joint.name}.phi", "1", turned.value, turned.rate, turned.acceleration, turned.push)

    def _screwed(self) -> Row:
        """Row of a screw: the rotation is x/l for the displacement x along the axis.

        A direction of the second body stays at right angles to one that is rotated by x/l from the first body. So turns of the thread
        are not confused, whatever their number.
        """
        script, name = self.script, f"{self.joint.name}.thread"
        _, b, c = self.axes()
        way, lead = self.slid(), self.lead()
        angle = script.let(f"{name}.angle", divide(way.gap, lead), "1")
        cosine, sine = script.let(f"{name}.cos", call("cos", angle)), script.let(f"{name}.sin", call("sin", angle))
        near, other, far = self.on(self.first, b, "b"), self.on(self.first, c, "c"), self.on(self.second, b, "b")
        along = script.vector(f"{name}.along", plus(scaled(cosine, near), scaled(sine, other)))
        across = script.vector(f"{name}.across", minus(scaled(cosine, other), scaled(sine, near)))
        m = script.vector(f"{name}.m", scaled(lead, cross(far, across)))
        share = script.let(f"{name}.share", dot(along, far))

        def acceleration() -> Expression:
            (_, first), (_, second) = self.accelerations()
            turning = divide(way.rate, lead)
            moved = plus(cross(self.first.spin, across), scaled(negate(turning), along))
            swept = plus(cross(self.first.spin, along), scaled(turning, across))
            carried = cross(self.second.spin, far)
            arm = plus(cross(carried, across), cross(far, moved))
            change = dot(swept, far) + dot(along, carried)
            ahead = dot(minus(second, first), m) + multiply(lead, dot(self.spin, arm))
            return ahead - way.acceleration() * share - way.rate * change

        def push(force: Expression) -> None:
            t = scaled(force, m)
            self.push(NULL, t, negated(t))
            self.reacts(NULL, t)
            way.push(negate(force * share))

        rate = dot(self.spin, m) - way.rate * share
        return Row(name, "m", multiply(lead, dot(across, far)), rate, acceleration, push)

    def lead(self) -> Expression:
        """Displacement of a screw per radian."""
        per_turn = self.script.constant(self.joint.ratio, f"{self.joint.name} lead", "m")
        return self.script.let(f"{self.joint.name} lead per radian", multiply(TURN, per_turn))

    def slid(self) -> Row:
        """Gap along the axis."""
        drawn = self.axes()[0]
        return self.row_along(drawn, self.on(self.first, drawn, "a"), "x")

    def _rod(self) -> list[Row]:
        """Row: two points keep their distance l. The residual is (d^2 - l^2)/(2 l), without the cancellation of squares."""
        script, name = self.script, self.joint.name
        drawn = minus(self.second.point, self.first.point)
        if is_null(drawn):
            self.result.diagnostics.append(RodWithoutLength(self.joint.span, name))
            return []
        length = script.let(f"{name}.length", call("sqrt", dot(drawn, drawn)), "m")
        u = script.vector(f"{name}.drawn", scaled(divide(ONE, length), drawn))
        share = script.vector(f"{name}.moved", scaled(divide(ONE, length), self.gap))
        d = script.vector(f"{name}.d", plus(u, share))

        def acceleration() -> Expression:
            (near, _), (far, _) = self.accelerations()
            return dot(d, minus(far, near)) + divide(dot(self.slip, self.slip), length)

        def push(force: Expression) -> None:
            self.push(scaled(force, d), NULL, NULL)
            self.reacts(scaled(force, d), NULL)

        gap = dot(plus(u, scaled(HALF, share)), self.gap)
        return [Row(f"{name}.length", "m", gap, dot(d, self.slip), acceleration, push)]

    def plane_angle(self) -> Expression:
        near, far = self.first.turn, self.second.turn
        assert isinstance(near, AxialTurn)
        assert isinstance(far, AxialTurn)
        return far.angle - near.angle

    def turns_together(self, value: Expression) -> LoopCoordinate:
        def push(torque: Expression) -> None:
            self.push(NULL, (ZERO, ZERO, torque), (ZERO, ZERO, negate(torque)))
            self.reacts(NULL, (ZERO, ZERO, torque))

        def acceleration() -> Expression:
            (_, first), (_, second) = self.accelerations()
            return second[2] - first[2]

        return LoopCoordinate(value, self.spin[2], acceleration, push)
