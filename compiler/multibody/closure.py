"""Joints that close a loop: constraint equations with multipliers.

Each row of a closing joint states that one constraint residual (a length, an angle) is zero. It is written three times: the residual
and its rate, which the run keeps at zero (`Invariant`), and its acceleration, which determines the row's multiplier. The
multiplier acts on both bodies by the transpose of the row's Jacobian, like any applied force, so that the matrix of the multipliers
is symmetric and no energy is added.
"""

from __future__ import annotations

from collections.abc import Iterable, Set

from ..algebra.expression import ONE, ZERO, Expression, Symbol, add, multiply, negate
from ..graph.mechanism import CONTACTS, COUPLINGS, POSE, Joint, reactions_of
from .coordinates import is_turning
from .errors import ClosedLoop
from .kinematics import Kinematics
from .loop_coordinates import Leaves
from .loop_frames import LoopCoordinate, Row, Sides
from .motion import MechanismEquations, PortMotion
from .recursion import Recursion
from .rolling import contact_rows
from .tree import loop_of
from .vectors import NULL, Vector


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
