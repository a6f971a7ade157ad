"""Joints that close a loop: constraint equations with multipliers.

Each row of a closing joint states that one constraint residual (a length, an angle) is zero. It is written three times: the residual
and its rate, which the run keeps at zero (`Invariant`), and its acceleration, which determines the row's multiplier. The
multiplier acts on both bodies by the transpose of the row's Jacobian, like any applied force, so that the matrix of the multipliers
is symmetric and no energy is added.

Coordinates that a closing joint leaves free, computed from the poses of its two bodies: values, rates, and action of an effort.
They have the same values as those of the same joint in the tree. An angle in space follows from poses only up to whole turns. So an angle
that is read is a state with the rate of the angle, and the run keeps it on the pose: it counts turns, and does not drift. The angle of a
screw follows from its displacement.
"""

from __future__ import annotations

from collections.abc import Iterable, Set

from ..algebra.expression import ONE, ZERO, Expression, Symbol, add, call, divide, multiply, negate
from ..errors import InternalError
from ..graph.mechanism import CONTACTS, COUPLINGS, POSE, Joint, reactions_of
from .coordinates import is_turning
from .errors import ClosedLoop
from .kinematics import Kinematics
from .loop_frames import LoopCoordinate, Row, Sides
from .motion import MechanismEquations, PortMotion
from .recursion import Recursion
from .rolling import contact_rows
from .rotations import (
    AxialTurn,
    Quaternion,
    conjugate,
    quaternion_product,
    rates_from_spin,
    rotation_vector,
    torque_from_efforts,
)
from .tree import loop_of
from .vectors import NULL, UNIT, Vector, cross, dot, minus, negated, scaled


class Closure:
    """Closing joints of one mechanism. Call `begin` before the recursion, `end` after it."""

    def __init__(
        self, kinematics: Kinematics, recursion: Recursion, efforts: dict[str, Expression], result: MechanismEquations,
        used: Set[str],
    ) -> None:  # fmt: skip
        self.kinematics, self.script, self.recursion = kinematics, kinematics.script, recursion
        self.efforts, self.result, self.used = efforts, result, used
        self.rows: list[tuple[Row, int, Expression, Joint]] = []
        self.wrenches: dict[str, tuple[Vector, Vector]] = {}  # joint -> on its second body, of its multipliers and port
        self.left: dict[str, dict[str, LoopCoordinate]] = {}  # joint -> the coordinates that it leaves

    def begin(self) -> None:
        """Write the ports of the closing joints, their rows, and the multipliers as forces."""
        tree = self.kinematics.tree
        for joint in tree.closing:
            if joint.locked and joint.starts:
                loop = " - ".join(loop_of(tree, joint, self.kinematics.mechanism))
                self.result.diagnostics.append(ClosedLoop(joint.span, joint.name, loop))
                continue
            sides = None if joint.kind in COUPLINGS else self._sides(joint)
            for row in self._rows(joint, sides):
                if row.gap != ZERO or row.rate != ZERO:  # else it holds by the way that all of it is drawn
                    self._begin(row, joint)
            if sides is not None and joint.name in self.used and not joint.locked:
                self._ports(joint, sides)

    def _sides(self, joint: Joint) -> Sides:
        return Sides(self.kinematics, self.recursion, self.result, self.wrenches, joint)

    def _rows(self, joint: Joint, sides: Sides | None) -> list[Row]:
        if sides is None:
            return self._coupled(joint)
        return contact_rows(sides) if joint.kind in CONTACTS else sides.rows()

    def _begin(self, row: Row, joint: Joint) -> None:
        builder, name = self.script.builder, self.script.named(row.name)
        length = row.unit == "m"
        multiplier = builder.variable(f"{name} multiplier", "computed", "N" if length else "N*m")
        # A row that follows from others takes no part: which, the run decides, as ranks depend on the pose.
        part = builder.variable(f"{name} takes part", "parameter", "1", 1.0)
        gap = None if row.rate_only else self.script.held(f"{row.name} gap", row.gap, row.unit)
        rate = self.script.held(f"{row.name} gap rate", row.rate, "m/s" if length else "1/s")
        builder.invariant(gap, rate, name, joint.span, multiplier, part)
        row.push(Symbol(multiplier))
        self.rows.append((row, multiplier, Symbol(part), joint))

    def _ports(self, joint: Joint, sides: Sides) -> None:
        for letter, coordinate in self._coordinates(joint, sides).items():
            name, turns = f"{joint.name}.{letter}", is_turning(letter)
            rest = self.script.constant(joint.rest[letter], f"{name} rest") if letter in joint.rest else ZERO
            held = self.script.held(name, add(rest, coordinate.value), "1" if turns else "m")
            flow = self.script.let(f"{name} rate", coordinate.rate, "1/s" if turns else "m/s")
            self.result.motions[name] = PortMotion(flow, Symbol(held), held)
            effort = self.efforts.get(name, ZERO)
            if effort != ZERO:
                coordinate.push(effort)

    def _coordinates(self, joint: Joint, sides: Sides | None = None) -> dict[str, LoopCoordinate]:
        """Coordinates that a closing joint leaves free, written once, as an angle may be a state."""
        if joint.name not in self.left:
            self.left[joint.name] = Leaves(self._sides(joint) if sides is None else sides).coordinates()
        return self.left[joint.name]

    def end(self, reacting: Iterable[Joint]) -> None:
        """Write the accelerations of the residuals, which determine the multipliers, and the reactions of the joints `reacting`."""
        for row, multiplier, part, joint in self.rows:
            closing = self.script.let(f"{row.name} gap acceleration", row.acceleration())
            rest = add(multiply(part, closing), multiply(ONE - part, Symbol(multiplier)))
            self.script.builder.vanishing(multiplier, rest, joint.span, self.script.named(joint.name))
        for joint in reacting:
            if joint.name in self.wrenches:
                force, torque = self.wrenches[joint.name]
                parts = dict(zip((*POSE, "phi"), (*force, *torque, torque[2]), strict=True))
                for c in reactions_of(joint.kind, joint.planar):
                    self.result.readings[f"{joint.name}.reaction.{c}"] = parts[c]

    # ------------------------------------------------------------ couplings
    def _coupled(self, joint: Joint) -> list[Row]:
        """Row of a gear or rack: the second coordinate is `ratio` times the first."""
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

    def _coordinate(self, name: str) -> LoopCoordinate:
        """Coordinate of a hinge or slide, of the tree or closing, relative to the drawing."""
        joint = next(j for j in self.kinematics.mechanism.joints if j.name == name)
        port = f"{name}.{joint.freedoms[0]}"
        found = self.kinematics.states.scalars.get(port)
        if found is None:
            return next(iter(self._coordinates(joint).values()))
        known, efforts = found, self.efforts

        def push(effort: Expression) -> None:
            efforts[port] = efforts.get(port, ZERO) + effort

        return LoopCoordinate(known.moved, known.rate, lambda: known.acceleration, push)


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
