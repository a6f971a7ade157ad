"""Joints that close a loop: constraint equations with multipliers.

Each row of a closing joint says that some part of its gap (a length, an angle) stays zero. It is written three times: the gap
and its rate, which the run holds at zero (`Invariant`), and its acceleration, whose vanishing decides the row's multiplier. The
multiplier acts on both bodies by the transpose of the row's slopes, as any applied force does, so that the matrix of the multipliers
is symmetric and no energy comes in.

What rows are made of: a point of the second body that does not leave that of the first along a direction (of the world, or one that
turns with the first body); directions of both bodies that stay at right angles; an angle in the plane; a length; two coordinates
in a ratio.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..algebra.expression import ONE, ZERO, Expression, Number, Symbol, add, call, divide, multiply, negate, select
from ..graph.mechanism import COUPLINGS, POSE, Joint, reactions_of
from .axes import snapped
from .errors import ClosedLoop, NoCoordinate, RodWithoutLength
from .motion import Motion
from .placed import Placed
from .tree import loop_of
from .turns import AxialTurn, unit
from .vectors import NULL, UNIT, Vector, cross, dot, is_null, minus, negated, plus, scaled

if TYPE_CHECKING:
    from .mechanics import Mechanics

TWO, HALF = Number(2.0), Number(0.5)
BESIDE = Number(0.6)  # a direction whose x is smaller is not along x
KINDS = frozenset({"hinge", "slide", "weld", "rod", "gear", "rack", "ball", "cylinder", "universal", "planar"})
Accelerations = tuple[Vector, Vector]  # of a placed point, and of the spin


@dataclass(frozen=True, slots=True)
class Row:
    """One constraint: what stays zero, its rate and its acceleration (once the recursion is written), and how a multiplier acts."""

    name: str  # of the multiplier
    unit: str  # of the gap
    gap: Expression
    rate: Expression
    acceleration: Callable[[], Expression]
    push: Callable[[Expression], None]


@dataclass(frozen=True, slots=True)
class Coordinate:
    """A joint's coordinate: value, rate, acceleration (once the recursion is written), and how an effort is put on it."""

    value: Expression
    rate: Expression
    acceleration: Callable[[], Expression]
    push: Callable[[Expression], None]


class Closure:
    """The closing joints of one mechanism. `begin` before the recursion, `end` after it."""

    def __init__(self, mechanics: Mechanics) -> None:
        self.mechanics, self.script = mechanics, mechanics.script
        self.rows: list[tuple[Row, int, Expression, Joint]] = []
        self.wrenches: dict[str, tuple[Vector, Vector]] = {}  # joint -> on its second body, of its multipliers

    def begin(self) -> None:
        """Ports of the closing joints, their rows, and the multipliers as forces."""
        for joint in self.mechanics.tree.closing:
            if joint.kind not in KINDS or (joint.locked and joint.starts):
                loop = " - ".join(loop_of(self.mechanics.tree, joint, self.mechanics.mechanism))
                self.mechanics.result.diagnostics.append(ClosedLoop(joint.span, joint.kind, joint.name, loop))
                continue
            sides = None if joint.kind in COUPLINGS else Sides(self, joint)
            for row in self._coupled(joint) if sides is None else sides.rows():
                if row.gap != ZERO or row.rate != ZERO:  # else it holds by the way that all of it is drawn
                    self._begin(row, joint)
            if sides is not None and joint.name in self.mechanics.used:
                self._ports(joint, sides)

    def _begin(self, row: Row, joint: Joint) -> None:
        builder, name = self.script.builder, self.script.named(row.name)
        length = row.unit == "m"
        multiplier = builder.variable(f"{name} multiplier", "computed", "N" if length else "N*m")
        # A row that follows from others takes no part: which, the run decides, as ranks depend on the pose.
        part = builder.variable(f"{name} takes part", "parameter", "1", 1.0)
        gap = self.script.held(f"{row.name} gap", row.gap, row.unit)
        rate = self.script.held(f"{row.name} gap rate", row.rate, "m/s" if length else "1/s")
        builder.invariant(gap, rate, name, joint.span, multiplier, part)
        row.push(Symbol(multiplier))
        self.rows.append((row, multiplier, Symbol(part), joint))

    def _ports(self, joint: Joint, sides: Sides) -> None:
        coordinates, mechanics = sides.coordinates(), self.mechanics
        for letter in joint.freedoms:
            name = f"{joint.name}.{letter}"
            if letter not in coordinates and (name in mechanics.wanted or name in mechanics.efforts or joint.starts):
                mechanics.result.diagnostics.append(NoCoordinate(joint.span, name, joint.kind))
        for letter, coordinate in coordinates.items():
            name = f"{joint.name}.{letter}"
            rest = self.script.constant(joint.rest[letter], f"{joint.name} rest") if letter in joint.rest else ZERO
            held = self.script.held(name, add(rest, coordinate.value), "1" if letter.startswith("phi") else "m")
            flow = self.script.let(f"{name} rate", coordinate.rate, "1/s" if letter.startswith("phi") else "m/s")
            self.mechanics.result.motions[name] = Motion(flow, Symbol(held), held)
            effort = self.mechanics.efforts.get(name, ZERO)
            if effort != ZERO:
                coordinate.push(effort)

    def end(self) -> None:
        """The accelerations of the gaps, whose vanishing decides the multipliers; reactions that are read."""
        for row, multiplier, part, joint in self.rows:
            closing = self.script.let(f"{row.name} gap acceleration", row.acceleration())
            rest = add(multiply(part, closing), multiply(ONE - part, Symbol(multiplier)))
            self.script.builder.vanishing(multiplier, rest, joint.span, self.script.named(joint.name))
        for joint in self.mechanics.reacting:
            if joint.name in self.wrenches:
                force, torque = self.wrenches[joint.name]
                parts = dict(zip((*POSE, "phi"), (*force, *torque, torque[2]), strict=True))
                for c in reactions_of(joint.kind, joint.planar):
                    self.mechanics.result.readings[f"{joint.name}.reaction.{c}"] = parts[c]

    # ------------------------------------------------------------ couplings
    def _coupled(self, joint: Joint) -> list[Row]:
        """The second coordinate is `ratio` times the first."""
        ratio = self.script.constant(joint.ratio, f"{joint.name}.ratio")
        first, second = self._coordinate(joint.first), self._coordinate(joint.second)
        letter = "phi" if joint.kind == "gear" else "x"

        def push(effort: Expression) -> None:
            second.push(effort)
            first.push(negate(ratio * effort))
            self.wrenches[joint.name] = (
                (NULL, (ZERO, ZERO, effort)) if letter == "phi" else ((effort, ZERO, ZERO), NULL)
            )

        return [
            Row(
                f"{joint.name}.{letter}", "1" if letter == "phi" else "m",
                second.value - ratio * first.value, second.rate - ratio * first.rate,
                lambda: second.acceleration() - ratio * first.acceleration(), push,
            )
        ]  # fmt: skip

    def _coordinate(self, name: str) -> Coordinate:
        """Of a hinge or slide, in the tree or closing; from where it was drawn."""
        joint = next(j for j in self.mechanics.mechanism.joints if j.name == name)
        port = f"{name}.{joint.freedoms[0]}"
        found = self.mechanics.kinematics.states.scalars.get(port)
        if found is None:
            return next(iter(Sides(self, joint).coordinates().values()))
        known, efforts = found, self.mechanics.efforts

        def push(effort: Expression) -> None:
            efforts[port] = efforts.get(port, ZERO) + effort

        return Coordinate(known.moved, known.rate, lambda: known.acceleration, push)


class Sides:
    """The two sides of a closing joint, and the rows that can be made of them."""

    def __init__(self, closure: Closure, joint: Joint) -> None:
        self.closure, self.joint, self.script = closure, joint, closure.script
        mechanics = closure.mechanics
        bodies = [mechanics.kinematics.on[end] for end in (joint.first, joint.second)]
        if joint.kind == "rod":
            drawn = [mechanics.mechanism.point_of(end) for end in (joint.first, joint.second)]
        else:
            drawn = [joint.position, joint.position]
        points = [
            self.script.place(p, f"{joint.name} at {end}") for p, end in zip(drawn, ("first", "second"), strict=True)
        ]
        names = ["first", "second"] if bodies[0] == bodies[1] else bodies
        self.first, self.second = (
            mechanics.placed(body, point, f"{joint.name}.{name}")
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
        return [*self._pinned(), *self._turned()]

    def _pinned(self) -> list[Row]:
        return [self._along(UNIT[i], UNIT[i], "xyz"[i]) for i in range(2 if self.joint.planar else 3)]

    def _guided(self) -> list[Row]:
        """No gap across a slide's axis, or along the normal of a planar joint; they turn with the first body."""
        if self.joint.kind == "planar":
            directions = [self._axes()[2]]
        elif self.joint.planar:
            a = self._axes()[0]
            directions = [(negate(a[1]), a[0], ZERO)]
        else:
            directions = list(self._axes()[1:])
        words = ("across",) if len(directions) == 1 else ("across.1", "across.2")
        return [self._along(n, self._on(self.first, n, w), w) for n, w in zip(directions, words, strict=True)]

    def _turned(self) -> list[Row]:
        """What of the turn between the bodies stays zero."""
        joint = self.joint
        leaves = joint.kind if not joint.locked else "weld"
        if leaves == "ball" or (joint.planar and leaves == "hinge"):
            return []
        if joint.planar:
            return [self._angle()]
        a, b, c = self._axes()
        if leaves == "universal":
            other = self._direction(joint.other_axis, "other_axis")
            return [self._square(a, other, "turn")]
        if leaves == "planar":
            a, b, c = c, a, b
        rows = [self._square(b, a, "turn.1"), self._square(c, a, "turn.2")]
        return rows if leaves in ("hinge", "cylinder", "planar") else [*rows, self._square(c, b, "turn.3")]

    # ------------------------------------------------------------ directions
    def _direction(self, given: object, word: str) -> Vector:
        v = unit(self.script.place(given, f"{self.joint.name}.{word}", "1"))  # type: ignore[arg-type]
        return self.script.vector(f"{self.joint.name}.{word} direction", snapped(v))

    def _axes(self) -> tuple[Vector, Vector, Vector]:
        """The joint's axis and two directions at right angles to it, in the drawing; of a planar joint its own axes."""
        joint, script = self.joint, self.script
        if joint.kind in ("planar", "free"):
            turn = self.closure.mechanics.kinematics.joint_turn(joint)
            x, y, z = (turn.apply(script, UNIT[i], f"{joint.name}.{'xyz'[i]} axis") for i in range(3))
            return x, y, z
        if joint.kind in ("weld", "ball"):
            return UNIT
        a = self._direction(joint.axis, "axis")
        for i in range(3):
            if a in (UNIT[i], negated(UNIT[i])):
                return a, UNIT[(i + 1) % 3], UNIT[(i + 2) % 3]
        near = call("less", call("abs", a[0]), BESIDE)
        beside: Vector = (select(near, ONE, ZERO), select(near, ZERO, ONE), ZERO)
        b = script.vector(f"{joint.name}.beside", unit(cross(a, beside)))
        return a, b, script.vector(f"{joint.name}.third", cross(a, b))

    def _on(self, side: Placed, v: Vector, word: str) -> Vector:
        """A direction of the drawing, as it has turned with a side."""
        turned = side.turn.apply(self.script, v, f"{self.joint.name}.{side.body}.{word}")
        return self.script.vector(f"{self.joint.name}.{side.body}.{word}", turned)

    # ------------------------------------------------------------ rows
    def _accelerations(self) -> tuple[Accelerations, Accelerations]:
        if not self._known:
            first, second = (
                self.closure.mechanics.accelerations(side, f"{self.joint.name}.{word}")
                for side, word in ((self.first, "first"), (self.second, "second"))
            )
            self._known.append((first, second))
        return self._known[0]

    def _push(self, force: Vector, torque: Vector, back: Vector) -> None:
        """On the second body; the first gets the negative of the force and `back`."""
        name, mechanics = self.joint.name, self.closure.mechanics
        mechanics.push(self.second, force, torque, f"{name}.second")
        mechanics.push(self.first, negated(force), back, f"{name}.first")

    def _reacts(self, force: Vector, torque: Vector) -> None:
        old = self.closure.wrenches.get(self.joint.name, (NULL, NULL))
        self.closure.wrenches[self.joint.name] = (plus(old[0], force), plus(old[1], torque))

    def _along(self, drawn: Vector, n: Vector, word: str) -> Row:
        """No gap along n. If it turns with the first body (n is not as drawn), its turning brings gap and slip into the rates."""
        turns = n != drawn
        w, gap, slip = self.first.spin, self.gap, self.slip
        swept = minus(slip, cross(w, gap)) if turns else slip

        def acceleration() -> Expression:
            (near, angular), (far, _) = self._accelerations()
            a = minus(far, near)
            if turns:
                a = minus(a, plus(cross(angular, gap), scaled(TWO, cross(w, slip))))
                a = plus(a, cross(w, cross(w, gap)))
            return dot(n, a)

        def push(force: Expression) -> None:
            f = scaled(force, n)
            self._push(f, NULL, negated(cross(gap, f)) if turns else NULL)
            self._reacts(f, NULL)

        return Row(f"{self.joint.name}.{word}", "m", dot(n, gap), dot(n, swept), acceleration, push)

    def _square(self, near: Vector, far: Vector, word: str) -> Row:
        """A direction of the first body and one of the second keep the angle that they have in the drawing."""
        b, a = self._on(self.first, near, f"{word}.near"), self._on(self.second, far, f"{word}.far")
        name = f"{self.joint.name}.{word}"
        m = self.script.vector(f"{name}.m", cross(a, b))
        drawn = dot(near, far)
        gap = add(dot(b, a), negate(self.script.let(f"{name}.drawn", drawn))) if drawn != ZERO else dot(b, a)

        def acceleration() -> Expression:
            (_, first), (_, second) = self._accelerations()
            turning = plus(cross(cross(self.second.spin, a), b), cross(a, cross(self.first.spin, b)))
            return dot(minus(second, first), m) + dot(self.spin, turning)

        def push(torque: Expression) -> None:
            t = scaled(torque, m)
            self._push(NULL, t, negated(t))
            self._reacts(NULL, t)

        return Row(name, "1", gap, dot(self.spin, m), acceleration, push)

    def _angle(self) -> Row:
        """Two bodies turn together in the plane."""
        turned = self._turns_together(self._plane_angle())
        return Row(f"{self.joint.name}.phi", "1", turned.value, turned.rate, turned.acceleration, turned.push)

    def _rod(self) -> list[Row]:
        """Two points keep their distance l: the gap is (d^2 - l^2)/(2 l), without the cancellation of squares."""
        script, name = self.script, self.joint.name
        drawn = minus(self.second.point, self.first.point)
        if is_null(drawn):
            self.closure.mechanics.result.diagnostics.append(RodWithoutLength(self.joint.span, name))
            return []
        length = script.let(f"{name}.length", call("sqrt", dot(drawn, drawn)), "m")
        u = script.vector(f"{name}.drawn", scaled(divide(ONE, length), drawn))
        share = script.vector(f"{name}.moved", scaled(divide(ONE, length), self.gap))
        d = script.vector(f"{name}.d", plus(u, share))

        def acceleration() -> Expression:
            (near, _), (far, _) = self._accelerations()
            return dot(d, minus(far, near)) + divide(dot(self.slip, self.slip), length)

        def push(force: Expression) -> None:
            self._push(scaled(force, d), NULL, NULL)
            self._reacts(scaled(force, d), NULL)

        gap = dot(plus(u, scaled(HALF, share)), self.gap)
        return [Row(f"{name}.length", "m", gap, dot(d, self.slip), acceleration, push)]

    # ------------------------------------------------------------ coordinates that the joint leaves
    def coordinates(self) -> dict[str, Coordinate]:
        """By letter: slides and angles. What a ball or universal joint leaves has no port where it closes a loop."""
        kind = self.joint.kind
        if self.joint.planar:
            return {"phi": self._turns_together(self._plane_angle())} if kind == "hinge" else {"x": self._slides()}
        a, b, c = self._axes()
        if kind == "hinge":
            return {"phi": self._turns_about(a, b, c)}
        if kind == "slide":
            return {"x": self._slides()}
        return {"x": self._slides(), "phi": self._turns_about(a, b, c)} if kind == "cylinder" else {}

    def _plane_angle(self) -> Expression:
        near, far = self.first.turn, self.second.turn
        assert isinstance(near, AxialTurn)
        assert isinstance(far, AxialTurn)
        return far.angle - near.angle

    def _turns_together(self, value: Expression) -> Coordinate:
        def push(torque: Expression) -> None:
            self._push(NULL, (ZERO, ZERO, torque), (ZERO, ZERO, negate(torque)))
            self._reacts(NULL, (ZERO, ZERO, torque))

        def acceleration() -> Expression:
            (_, first), (_, second) = self._accelerations()
            return second[2] - first[2]

        return Coordinate(value, self.spin[2], acceleration, push)

    def _turns_about(self, a: Vector, b: Vector, c: Vector) -> Coordinate:
        """An angle in space: between -pi and pi."""
        near, other, far = self._on(self.first, b, "b"), self._on(self.first, c, "c"), self._on(self.second, b, "b")
        axis = self._on(self.first, a, "a")

        def push(torque: Expression) -> None:
            self._push(NULL, scaled(torque, axis), negated(scaled(torque, axis)))

        def acceleration() -> Expression:
            (_, first), (_, second) = self._accelerations()
            return dot(axis, minus(second, first)) + dot(cross(self.first.spin, axis), self.spin)

        value = call("atan2", dot(other, far), dot(near, far))
        return Coordinate(value, dot(axis, self.spin), acceleration, push)

    def _slides(self) -> Coordinate:
        """The gap along the axis."""
        drawn = self._axes()[0]
        row = self._along(drawn, self._on(self.first, drawn, "a"), "x")
        return Coordinate(row.gap, row.rate, row.acceleration, row.push)
