"""Ports of bodies, frames and tree joints: wrenches act on them, poses and rates are read from them.

A body's port is at its centre of mass, a frame's at its point: force and torque in world axes, or in those of a frame's body.

Reactions of tree joints: the total wrench through a joint on its second body, at the joint's point, in world axes.
It includes both the constraint wrench and the efforts on the joint's port. Only reactions that are read are written.
"""

from __future__ import annotations

from collections.abc import Mapping

from ..algebra.expression import ZERO, Expression, Symbol, add, negate
from ..graph.mechanism import GROUND, PLANAR_POSE, POSE, Body, Frame, Joint
from .kinematics import Kinematics
from .link_state import LinkState, Marker
from .motion import MechanismEquations, PortMotion
from .recursion import PLACES, Recursion
from .rotations import (
    NO_TURN,
    AxialTurn,
    Turn,
    composed,
    of_rotation_vector,
    rates_from_spin,
    rotation_vector,
    torque_from_efforts,
)
from .vectors import UNIT, Vector, cross, minus, negated, plus, scaled

UNITS = ("N*m", "N*m", "N*m", "N", "N", "N")  # of a wrench


class PortWriter:
    """Writer of ports. `efforts` act through them."""

    def __init__(self, kinematics: Kinematics, efforts: Mapping[str, Expression], result: MechanismEquations) -> None:
        self.kinematics, self.script, self.efforts, self.result = kinematics, kinematics.script, efforts, result
        self.planar = kinematics.mechanism.planar

    # ------------------------------------------------------------ tree joints
    def tree_joint(self, moving: LinkState) -> None:
        """Ports of a link's coordinates."""
        link = moving.link
        if isinstance(link.part, Body):
            return
        if link.step.kind == "ball":
            self._ball(moving)
            return
        for coordinate in moving.coordinates:
            displacement = self.script.held(coordinate.name, coordinate.value)
            self.result.motions[coordinate.name] = PortMotion(coordinate.rate, coordinate.value, displacement)

    def _ball(self, moving: LinkState) -> None:
        """Rotation vector of the second body relative to the first, its rates, and the torque dual to these."""
        link, attitude, script = moving.link, moving.attitude, self.script
        assert attitude is not None
        name = link.part.name
        r = rotation_vector(script, attitude.parts, f"{name}.vector")
        rates = rates_from_spin(script, attitude.parts, r, attitude.spin, True, f"{name}.turning")
        efforts = [self.efforts.get(c, ZERO) for c in link.coordinates]
        sign = negate if link.reverse else _same
        dual: Vector = (sign(efforts[0]), sign(efforts[1]), sign(efforts[2]))
        moving.drive = torque_from_efforts(script, attitude.parts, r, dual, True, f"{name}.torque")
        for letter, value, rate in zip(link.coordinates, r, rates, strict=True):
            rest = self.kinematics.states.rest(link.part, letter.rpartition(".")[2])
            held = script.held(letter, sign(value) + rest, "1")
            self.result.motions[letter] = PortMotion(
                script.let(f"{letter}.omega", sign(rate), "1/s"), Symbol(held), held
            )

    # ------------------------------------------------------------ bodies and frames
    def body(self, body: Body) -> None:
        """Ports of a body, at its centre of mass."""
        centre = self.script.place(body.position, f"{body.name} at")
        placed = self.kinematics.placed(body.name, centre, body.name)
        self._pose(body.name, placed, self._drawn(body), centre)

    def _drawn(self, body: Body) -> Turn:
        """Rotation of a body's own axes in the drawing."""
        vector = self.script.place(body.turn, f"{body.name} turn", "1")
        return of_rotation_vector(self.script, vector, f"{body.name} drawn")

    def frame(self, frame: Frame) -> None:
        """Ports of a frame, at its point, in world axes or its body's own."""
        point = self.script.place(frame.position, f"{frame.name} at")
        placed = self.kinematics.placed(frame.body, point, frame.name)
        bodies = [b for b in self.kinematics.mechanism.bodies if b.name == frame.body and frame.axes == "body"]
        own = [composed(self.script, placed.turn, self._drawn(b), f"{frame.name}.own") for b in bodies]
        self._pose(frame.name, placed, NO_TURN, point, *own)

    def _pose(self, name: str, placed: Marker, drawn: Turn, point: Vector, own: Turn | None = None) -> None:
        script, states = self.script, self.kinematics.states.scalars
        letters = PLANAR_POSE if self.planar else POSE
        velocity, spin = placed.velocity, placed.spin
        if own is not None:
            velocity = own.back(script, velocity, f"{name}.v own")
            spin = own.back(script, spin, f"{name}.omega own")
        turned = [f"{name}.{c}" in self.efforts for c in letters]
        for i, letter in enumerate(("x", "y") if self.planar else ("x", "y", "z")):
            port = f"{name}.{letter}"
            state = states.get(port)
            pose = state.value if state is not None else script.let(port, point[i] + placed.displacement[i], "m")
            shift = placed.displacement[i] if state is None else state.moved
            displacement = script.held(f"{port} moved", shift, "m") if turned[i] and own is None else None
            self.result.motions[port] = PortMotion(velocity[i], pose, displacement)
        attitude = composed(script, placed.turn, drawn, f"{name}.pose")
        self._attitude(name, attitude, spin, states, placed)
        if any(turned):
            self._push(name, placed, own)

    def _attitude(self, name: str, turn: Turn, spin: Vector, states: Mapping[str, object], placed: Marker) -> None:
        script = self.script
        if self.planar:
            port = f"{name}.phi"
            state = self.kinematics.states.scalars.get(port)
            angle = turn.angle if isinstance(turn, AxialTurn) else ZERO
            pose = state.value if state is not None else angle
            moved = placed.turn.angle if isinstance(placed.turn, AxialTurn) else ZERO
            displacement = script.held(f"{port} moved", moved, "1") if port in self.efforts else None
            self.result.motions[port] = PortMotion(spin[2], pose, displacement)
            return
        parts = turn.quaternion(script, f"{name}.pose")
        for letter, part in zip("wxyz", parts, strict=True):
            self.result.readings[f"{name}.attitude.{letter}"] = part
        if isinstance(turn, AxialTurn):
            vector = scaled(turn.angle, UNIT[turn.axis])
        else:
            vector = rotation_vector(script, parts, f"{name}.vector")
        for i, letter in enumerate(("rx", "ry", "rz")):
            self.result.motions[f"{name}.{letter}"] = PortMotion(spin[i], vector[i], None)

    def _push(self, name: str, placed: Marker, own: Turn | None) -> None:
        e = [self.efforts.get(f"{name}.{c}", ZERO) for c in POSE]
        force: Vector = (e[0], e[1], e[2])
        torque: Vector = (e[3], e[4], self.efforts.get(f"{name}.phi", e[5]))
        if own is not None:
            force = own.apply(self.script, force, f"{name}.force")
            torque = own.apply(self.script, torque, f"{name}.torque")
        if placed.body != GROUND:
            self.kinematics.push(placed, force, torque, name)


def _same(x: Expression) -> Expression:
    return x


def reaction(kinematics: Kinematics, recursion: Recursion, index: int, joint: Joint) -> dict[str, Expression]:
    """`pin.reaction.x` and so on, for the joint whose last link is `index`."""
    script, name = kinematics.script, f"{joint.name}.reaction"
    moving = kinematics.moving[index]
    angular, linear = recursion.acceleration(index)
    a = (*angular, *linear)
    matrix, load = recursion.matrices[index], recursion.loads[index]
    wrench = [
        script.let(f"{name}.own{r}", add(load[r], *(matrix[r][k] * a[k] for k in PLACES)), UNITS[r]) for r in PLACES
    ]
    force = kinematics.world(index, (wrench[3], wrench[4], wrench[5]), f"{name}.f")
    about_reference = kinematics.world(index, (wrench[0], wrench[1], wrench[2]), f"{name}.t")
    # The point is where the second body has it: that of a slide may be far from where the first body does.
    point = script.place(joint.position, f"{joint.name} at")
    second = kinematics.on[joint.second]
    there = kinematics.moved(None if second == GROUND else kinematics.tree.place[second], point, f"{name}.point")
    arm = plus(minus(point, moving.origin), minus(there, kinematics.displacement(index)))
    torque = minus(about_reference, cross(script.vector(f"{name}.arm", arm, "m"), force))
    if moving.link.reverse:
        force, torque = negated(force), negated(torque)
    parts = dict(zip((*POSE, "phi"), (*force, *torque, torque[2]), strict=True))
    letters = PLANAR_POSE if joint.planar else POSE
    return {f"{name}.{c}": parts[c] for c in letters}
