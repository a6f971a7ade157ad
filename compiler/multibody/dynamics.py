"""The motion of a planar mechanism by recursion over its tree: O(bodies) assignments, no mass matrix.

Poses and rates go outwards, articulated inertias and forces inwards, accelerations outwards (Featherstone, Rigid Body
Dynamics Algorithms, chapter 7, here in the plane, about each centre of mass and in world axes). Zeros fold as they are
written, so a shuttle on a slide costs one division and a free platform three.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass, field
from typing import Protocol

from ..algebra.expression import ONE, ZERO, Expression, Number, Symbol, add, call, divide, multiply, negate
from ..algebra.formula import Bound
from ..errors import Diagnostic
from ..graph.mechanism import GROUND, Body, Frame, Joint, Mechanism
from ..graph.mechanism import Vector as Place
from ..source import Span
from .errors import NothingMoves
from .starts import claim_starts, claimed_parts
from .supported import unsupported
from .tree import Link, spanning_tree

Vector = tuple[Expression, Expression]
Wrench = list[Expression]  # torque, force x, force y
HALF = Number(0.5)


class Writer(Protocol):
    """What this room needs of the equations' builder."""

    def variable(self, name: str, role: str, unit: str = "", value: float | None = None) -> int: ...
    def assign(self, target: int, expression: Expression, span: Span, owner: str) -> None: ...
    def folded(self, bound: Bound) -> Expression: ...
    def state(self, variable: int, rate: int, start: Expression, name: str, span: Span, given: bool = True) -> None: ...
    def claim(self, value: Expression, start: Expression, name: str, span: Span) -> None: ...


@dataclass(frozen=True, slots=True)
class Motion:
    """What the graph sees of one port: its flow, its pose (absolute for a body, relative for a joint), and the variable of
    its displacement from the reference, whose rate the flow is."""

    flow: Expression
    pose: Expression
    displacement: int | None


@dataclass(slots=True)
class MechanismEquations:
    """Motions by port (`guide[1].x`), the variable of the mechanism's energy, and what is wrong."""

    motions: dict[str, Motion] = field(default_factory=dict)
    energy: int | None = None
    diagnostics: list[Diagnostic] = field(default_factory=list)


@dataclass(slots=True)
class _State:
    """One body while it is computed: all in world axes, about its centre of mass."""

    position: Vector  # absolute
    shift: Vector  # from the reference
    turn: Expression  # angle from the reference
    velocity: Vector
    spin: Expression
    arm: Vector  # from the parent's centre (or the ground's origin) to this one
    axes: list[Wrench] = field(default_factory=list)  # motion per coordinate rate: (spin, velocity)
    bias: Wrench = field(default_factory=lambda: [ZERO, ZERO, ZERO])  # acceleration that rates alone cause
    rates: list[Expression] = field(default_factory=list)
    force: Wrench = field(default_factory=lambda: [ZERO, ZERO, ZERO])  # applied, at the centre
    drives: list[Expression] = field(default_factory=list)  # effort on each coordinate


def mechanism_equations(
    mechanism: Mechanism, efforts: Mapping[str, Expression], wanted: Set[str], builder: Writer
) -> MechanismEquations:
    """Write the equations of a mechanism. `efforts` drive its ports; `wanted` are the ports that are read elsewhere."""
    refused = list(unsupported(mechanism, {*efforts, *wanted}))
    if refused:
        return MechanismEquations(diagnostics=refused)
    tree = spanning_tree(mechanism)
    result = MechanismEquations(diagnostics=list(tree.diagnostics))
    if result.diagnostics:
        return result
    return _Dynamics(mechanism, tree.links, tree.chords, efforts, wanted, builder, result).write()


class _Dynamics:
    def __init__(
        self, mechanism: Mechanism, links: tuple[Link, ...], chords: tuple[Joint, ...], efforts: Mapping[str, Expression],
        wanted: Set[str], builder: Writer, result: MechanismEquations,
    ) -> None:  # fmt: skip
        self.mechanism, self.links, self.chords = mechanism, links, chords
        self.efforts, self.wanted, self.builder, self.result = efforts, wanted, builder, result
        self.place = {link.body.name: i for i, link in enumerate(links)}
        self.bodies: list[_State] = []
        self.accelerations: dict[str, int] = {}  # coordinate -> variable of its second rate
        self.owner, self.span = mechanism.name, mechanism.span
        self.claimed = claimed_parts(mechanism, links)

    def write(self) -> MechanismEquations:
        for link in self.links:
            self.bodies.append(self._kinematics(link))
        for link, body in zip(self.links, self.bodies, strict=True):
            self._body_port(link.body, body)
        for frame in self.mechanism.frames:
            self._frame_port(frame)
        for chord in self.chords:
            self._chord(chord)
        claim_starts(self.mechanism, self.claimed, self.result.motions, self.builder)
        self._gravity()
        self._accelerations()
        self._energy()
        return self.result

    # ------------------------------------------------------------ small things
    def let(self, name: str, expression: Expression, unit: str = "") -> Expression:
        """A name for an expression, unless it is one already."""
        if isinstance(expression, Number | Symbol):
            return expression
        variable = self.builder.variable(f"{self.mechanism.name}.{name}", "computed", unit)
        self.builder.assign(variable, expression, self.span, self.owner)
        return Symbol(variable)

    def geometry(self, bound: Bound, name: str) -> Expression:
        return self.let(name, self.builder.folded(bound))

    def direction(self, angle: Expression, name: str) -> Vector:
        """cos and sin of an angle."""
        return self.let(f"cos({name})", call("cos", angle)), self.let(f"sin({name})", call("sin", angle))

    def rotated(self, turn: Expression, arm: Vector, name: str) -> Vector:
        """A vector that is fixed to a body, after the body's turn from the reference."""
        if turn == ZERO:
            return arm
        c, s = self.cos(turn), self.sin(turn)
        return self.let(f"{name}.x", c * arm[0] - s * arm[1]), self.let(f"{name}.y", s * arm[0] + c * arm[1])

    def swung(self, turn: Expression, arm: Vector, name: str) -> Vector:
        """(R(turn) - 1) arm, without the cancellation that 1 - cos would bring."""
        if turn == ZERO:
            return ZERO, ZERO
        half = call("sin", multiply(HALF, turn))
        less = self.let(f"{name}.versine", multiply(Number(2.0), half, half))
        s = self.sin(turn)
        return self.let(f"{name}.dx", negate(less * arm[0]) - s * arm[1], "m"), self.let(
            f"{name}.dy", s * arm[0] - less * arm[1]
        )

    def cos(self, turn: Expression) -> Expression:
        return call("cos", turn)

    def sin(self, turn: Expression) -> Expression:
        return call("sin", turn)

    # ------------------------------------------------------------ outwards: poses and rates
    def _coordinate(
        self, name: str, letter: str, part: Joint | Body, reference: Expression, unit: tuple[str, str]
    ) -> tuple[Expression, Expression]:
        """A coordinate and its rate as states; the rate's own rate is filled in by the last recursion."""
        full = f"{self.mechanism.name}.{name}"
        key = name.rpartition(".")[2]
        coordinate = self.builder.variable(full, "state", unit[0])
        rate = self.builder.variable(f"{full}.{letter}", "state", unit[1])
        acceleration = self.builder.variable(
            f"{full}.{letter} rate", "computed", f"{unit[1]}^2" if unit[1] == "1/s" else "m/s^2"
        )
        self._started(coordinate, rate, part, key, reference, full)
        self._started(rate, acceleration, part, f"{key}.f", ZERO, f"{full}.{letter}")
        self.accelerations[name] = acceleration
        return Symbol(coordinate), Symbol(rate)

    def _started(self, state: int, rate: int, part: Joint | Body, key: str, reference: Expression, name: str) -> None:
        """A state where the author starts it, else as it was drawn: then claims may move it."""
        given = key in part.starts
        start = self.builder.folded(part.starts[key]) if given else reference
        self.builder.state(state, rate, start, name, self.span, given)

    def _kinematics(self, link: Link) -> _State:
        body = link.body
        at = self._point(body.position, f"{body.name} at")
        if link.joint is None:
            return self._free_body(body, at)
        parent = None if link.parent is None else self.bodies[link.parent]
        parent_at = (
            (ZERO, ZERO)
            if link.parent is None
            else self._point(self.links[link.parent].body.position, f"{self.links[link.parent].body.name} at")
        )
        turn, spin = (ZERO, ZERO) if parent is None else (parent.turn, parent.spin)
        match link.joint.kind:
            case "slide":
                return self._slide(link, at, parent, parent_at, turn, spin)
            case "hinge":
                return self._hinge(link, at, parent, parent_at, turn, spin)
        arm = self.rotated(turn, (at[0] - parent_at[0], at[1] - parent_at[1]), f"{body.name}.arm")
        return self._carried(body.name, arm, at, parent, turn, spin)

    def _point(self, position: Place, name: str) -> Vector:
        return self.geometry(position[0], f"{name}.x"), self.geometry(position[1], f"{name}.y")

    def _free_body(self, body: Body, at: Vector) -> _State:
        angle = self.geometry(body.turn[2], f"{body.name} angle")
        poses, rates = [], []
        for letter, reference, rate_letter, unit in (
            ("x", at[0], "v", ("m", "m/s")),
            ("y", at[1], "v", ("m", "m/s")),
            ("phi", angle, "omega", ("1", "1/s")),
        ):
            pose, rate = self._coordinate(f"{body.name}.{letter}", rate_letter, body, reference, unit)
            poses.append(pose)
            rates.append(rate)
        shift = self.let(f"{body.name}.dx", poses[0] - at[0], "m"), self.let(f"{body.name}.dy", poses[1] - at[1], "m")
        turn = self.let(f"{body.name}.turn", poses[2] - angle, "1")
        state = _State((poses[0], poses[1]), shift, turn, (rates[0], rates[1]), rates[2], (poses[0], poses[1]))
        state.axes = [[ZERO, ONE, ZERO], [ZERO, ZERO, ONE], [ONE, ZERO, ZERO]]
        state.rates = rates
        state.drives = [ZERO, ZERO, ZERO]
        return state

    def _carried(
        self, name: str, arm: Vector, at: Vector, parent: _State | None, turn: Expression, spin: Expression
    ) -> _State:
        """Rigidly carried by the parent: the part that all joints share."""
        if parent is None:
            return _State(at, (ZERO, ZERO), ZERO, (ZERO, ZERO), ZERO, at)
        position = (
            self.let(f"{name}.px", parent.position[0] + arm[0], "m"),
            self.let(f"{name}.py", parent.position[1] + arm[1], "m"),
        )
        shift = self.let(f"{name}.dx", position[0] - at[0], "m"), self.let(f"{name}.dy", position[1] - at[1], "m")
        velocity = (
            self.let(f"{name}.vx", parent.velocity[0] - spin * arm[1], "m/s"),
            self.let(f"{name}.vy", parent.velocity[1] + spin * arm[0], "m/s"),
        )
        state = _State(position, shift, turn, velocity, spin, arm)
        state.bias = [ZERO, negate(spin * spin * arm[0]), negate(spin * spin * arm[1])]
        return state

    def _slide(
        self, link: Link, at: Vector, parent: _State | None, parent_at: Vector, turn: Expression, spin: Expression
    ) -> _State:
        joint, name = link.joint, link.body.name
        assert joint is not None
        u = self.direction(self.builder.folded(joint.turn[2]), f"{joint.name}.along")
        sign = Number(-1.0 if link.reversed else 1.0)
        q, rate = self._coordinate(f"{joint.name}.x", "v", joint, ZERO, ("m", "m/s"))
        d = self.rotated(turn, u, f"{joint.name}.axis")
        d = (multiply(sign, d[0]), multiply(sign, d[1]))
        carried = self.rotated(turn, (at[0] - parent_at[0], at[1] - parent_at[1]), f"{name}.rest")
        slip = (self.let(f"{name}.slip.x", q * d[0], "m"), self.let(f"{name}.slip.y", q * d[1], "m"))
        arm = (
            self.let(f"{name}.arm.x", carried[0] + slip[0], "m"),
            self.let(f"{name}.arm.y", carried[1] + slip[1], "m"),
        )
        state = self._carried(name, arm, at, parent, turn, spin)
        if parent is None:
            state.position = (
                self.let(f"{name}.px", at[0] + slip[0], "m"),
                self.let(f"{name}.py", at[1] + slip[1], "m"),
            )
            state.shift, state.arm = slip, state.position
        state.velocity = (
            self.let(f"{name}.v.x", state.velocity[0] + d[0] * rate, "m/s"),
            self.let(f"{name}.v.y", state.velocity[1] + d[1] * rate, "m/s"),
        )
        state.axes = [[ZERO, d[0], d[1]]]
        two = multiply(Number(2.0), spin, rate)
        state.bias = [ZERO, state.bias[1] - two * d[1], state.bias[2] + two * d[0]]
        self._joint_port(joint, "x", q, rate, state)
        return state

    def _hinge(
        self, link: Link, at: Vector, parent: _State | None, parent_at: Vector, turn: Expression, spin: Expression
    ) -> _State:
        joint, name = link.joint, link.body.name
        assert joint is not None
        pin = self._point(joint.position, f"{joint.name} at")
        q, rate = self._coordinate(f"{joint.name}.phi", "omega", joint, ZERO, ("1", "1/s"))
        sign = Number(-1.0 if link.reversed else 1.0)
        own_turn = self.let(f"{name}.turn", turn + sign * q, "1")
        own_spin = self.let(f"{name}.spin", spin + sign * rate, "1/s")
        near = self.rotated(turn, (pin[0] - parent_at[0], pin[1] - parent_at[1]), f"{joint.name}.near")
        far = self.rotated(own_turn, (at[0] - pin[0], at[1] - pin[1]), f"{joint.name}.far")
        arm = (self.let(f"{name}.arm.x", near[0] + far[0], "m"), self.let(f"{name}.arm.y", near[1] + far[1], "m"))
        position, velocity = ((ZERO, ZERO), (ZERO, ZERO)) if parent is None else (parent.position, parent.velocity)
        place = (self.let(f"{name}.px", position[0] + arm[0], "m"), self.let(f"{name}.py", position[1] + arm[1], "m"))
        speed = (
            self.let(f"{name}.vx", velocity[0] - spin * near[1] - own_spin * far[1], "m/s"),
            self.let(f"{name}.vy", velocity[1] + spin * near[0] + own_spin * far[0], "m/s"),
        )
        shift = (self.let(f"{name}.dx", place[0] - at[0], "m"), self.let(f"{name}.dy", place[1] - at[1], "m"))
        state = _State(place, shift, own_turn, speed, own_spin, arm)
        state.axes = [[sign, multiply(sign, negate(far[1])), multiply(sign, far[0])]]
        state.bias = [ZERO, *(negate(spin * spin * near[i]) - own_spin * own_spin * far[i] for i in (0, 1))]
        self._joint_port(joint, "phi", q, rate, state)
        return state

    def _joint_port(self, joint: Joint, letter: str, coordinate: Expression, rate: Expression, state: _State) -> None:
        port = f"{joint.name}.{letter}"
        state.rates = [rate]
        state.drives = [self.efforts.get(port, ZERO)]
        assert isinstance(coordinate, Symbol)
        assert isinstance(coordinate.key, int)
        self.result.motions[port] = Motion(rate, coordinate, coordinate.key)

    # ------------------------------------------------------------ ports of bodies, frames and chords
    def _variable_of(self, expression: Expression, name: str) -> int | None:
        held = expression if isinstance(expression, Symbol) else None
        if held is None:
            variable = self.builder.variable(f"{self.mechanism.name}.{name}", "computed")
            self.builder.assign(variable, expression, self.span, self.owner)
            return variable
        assert isinstance(held.key, int)
        return held.key

    def _is_used(self, part: str) -> bool:
        return part in self.claimed or any(
            f"{part}.{c}" in self.efforts or f"{part}.{c}" in self.wanted for c in ("x", "y", "phi")
        )

    def _body_port(self, body: Body, state: _State) -> None:
        if not self._is_used(body.name):
            return
        angle = self.geometry(body.turn[2], f"{body.name} angle")
        poses = (state.position[0], state.position[1], self.let(f"{body.name}.phi", angle + state.turn, "1"))
        self._pose_ports(body.name, poses, (*state.velocity, state.spin), (*state.shift, state.turn))
        for i, letter in ((1, "x"), (2, "y"), (0, "phi")):
            state.force[i] = state.force[i] + self.efforts.get(f"{body.name}.{letter}", ZERO)

    def _pose_ports(
        self, name: str, poses: tuple[Expression, ...], rates: tuple[Expression, ...], shifts: tuple[Expression, ...]
    ) -> None:
        for letter, pose, rate, shift in zip(("x", "y", "phi"), poses, rates, shifts, strict=True):
            displacement = (
                self._variable_of(shift, f"{name}.{letter} moved") if f"{name}.{letter}" in self.efforts else None
            )
            self.result.motions[f"{name}.{letter}"] = Motion(rate, pose, displacement)

    def _frame_port(self, frame: Frame) -> None:
        if not self._is_used(frame.name):
            return
        point = self._point(frame.position, f"{frame.name} at")
        if frame.body == GROUND:
            self._pose_ports(frame.name, (*point, ZERO), (ZERO, ZERO, ZERO), (ZERO, ZERO, ZERO))
            return
        index = self.place[frame.body]
        state, body = self.bodies[index], self.links[index].body
        at = self._point(body.position, f"{body.name} at")
        offset = (point[0] - at[0], point[1] - at[1])
        arm = self.rotated(state.turn, offset, f"{frame.name}.arm")
        swing = self.swung(state.turn, offset, frame.name)
        shift = (state.shift[0] + swing[0], state.shift[1] + swing[1])
        rates = (
            self.let(f"{frame.name}.vx", state.velocity[0] - state.spin * arm[1], "m/s"),
            self.let(f"{frame.name}.vy", state.velocity[1] + state.spin * arm[0], "m/s"),
            state.spin,
        )
        poses = (
            self.let(f"{frame.name}.px", point[0] + shift[0], "m"),
            self.let(f"{frame.name}.py", point[1] + shift[1], "m"),
            state.turn,
        )
        self._pose_ports(frame.name, poses, rates, (*shift, state.turn))
        force = [self.efforts.get(f"{frame.name}.{c}", ZERO) for c in ("x", "y")]
        torque = self.efforts.get(f"{frame.name}.phi", ZERO)
        self._push(frame.body, force, torque, arm)

    def _push(self, body: str, force: list[Expression], torque: Expression, arm: Vector) -> None:
        """A force at a point (arm from the centre of mass) and a torque, on a body."""
        if body == GROUND:
            return
        state = self.bodies[self.place[body]]
        state.force[0] = state.force[0] + torque + arm[0] * force[1] - arm[1] * force[0]
        state.force[1] = state.force[1] + force[0]
        state.force[2] = state.force[2] + force[1]

    def _chord(self, joint: Joint) -> None:
        """A free joint: explicit coordinates of B seen from A, and the wrench that is dual to their rates."""
        name = joint.name
        if not self._is_used(name):
            return
        point = self._point(joint.position, f"{name} at")
        turns, spins, arms, shifts, velocities = [], [], [], [], []
        for body in (joint.first, joint.second):
            turn, spin, arm, shift, velocity = self._end(body, point, f"{name}.{body}")
            turns.append(turn)
            spins.append(spin)
            arms.append(arm)
            shifts.append(shift)
            velocities.append(velocity)
        gap = (
            self.let(f"{name}.dx", shifts[1][0] - shifts[0][0], "m"),
            self.let(f"{name}.dy", shifts[1][1] - shifts[0][1], "m"),
        )
        share = {"from": ZERO, "middle": HALF, "to": ONE}[joint.axes]  # whose turn the axes follow
        axes_turn = add(multiply(ONE - share, turns[0]), multiply(share, turns[1]))
        axes_spin = add(multiply(ONE - share, spins[0]), multiply(share, spins[1]))
        c, s = self.direction(self.builder.folded(joint.turn[2]) + axes_turn, f"{name}.axes")
        slip = (
            velocities[1][0] - velocities[0][0] + axes_spin * gap[1],
            velocities[1][1] - velocities[0][1] - axes_spin * gap[0],
        )
        slip = (self.let(f"{name}.slip.x", slip[0], "m"), self.let(f"{name}.slip.y", slip[1], "m"))
        coordinates = (c * gap[0] + s * gap[1], c * gap[1] - s * gap[0], turns[1] - turns[0])
        rates = (c * slip[0] + s * slip[1], c * slip[1] - s * slip[0], spins[1] - spins[0])
        for letter, coordinate, rate in zip(("x", "y", "phi"), coordinates, rates, strict=True):
            held = self._variable_of(coordinate, f"{name}.{letter}")
            assert held is not None
            word, unit = ("omega", "1/s") if letter == "phi" else ("v", "m/s")
            flow = self.let(f"{name}.{letter}.{word}", rate, unit)
            self.result.motions[f"{name}.{letter}"] = Motion(flow, Symbol(held), held)
        e = [self.efforts.get(f"{name}.{letter}", ZERO) for letter in ("x", "y", "phi")]
        force = [self.let(f"{name}.force.x", c * e[0] - s * e[1]), self.let(f"{name}.force.y", s * e[0] + c * e[1])]
        # Power = e . rates for all motions: the axes that turn with a body leave it a moment of the force about the gap.
        moment = self.let(f"{name}.moment", gap[0] * force[1] - gap[1] * force[0])
        self._push(joint.second, force, e[2] - share * moment, arms[1])
        self._push(joint.first, [negate(force[0]), negate(force[1])], negate(e[2]) - (ONE - share) * moment, arms[0])

    def _end(self, body: str, point: Vector, name: str) -> tuple[Expression, Expression, Vector, Vector, Vector]:
        """Of the point fixed to a body: turn, spin, arm from its centre, shift from the reference, velocity."""
        if body == GROUND:
            return ZERO, ZERO, (ZERO, ZERO), (ZERO, ZERO), (ZERO, ZERO)
        index = self.place[body]
        state, at = self.bodies[index], self._point(self.links[index].body.position, f"{body} at")
        offset = (self.let(f"{name}.ox", point[0] - at[0], "m"), self.let(f"{name}.oy", point[1] - at[1], "m"))
        swing = self.swung(state.turn, offset, name)
        arm = (self.let(f"{name}.ax", offset[0] + swing[0], "m"), self.let(f"{name}.ay", offset[1] + swing[1], "m"))
        shift = (
            self.let(f"{name}.sx", state.shift[0] + swing[0], "m"),
            self.let(f"{name}.sy", state.shift[1] + swing[1], "m"),
        )
        velocity = (
            self.let(f"{name}.vx", state.velocity[0] - state.spin * arm[1], "m/s"),
            self.let(f"{name}.vy", state.velocity[1] + state.spin * arm[0], "m/s"),
        )
        return state.turn, state.spin, arm, shift, velocity

    def _gravity(self) -> None:
        g = self.builder.folded(self.mechanism.gravity[0]), self.builder.folded(self.mechanism.gravity[1])
        for link, state in zip(self.links, self.bodies, strict=True):
            mass = self.geometry(link.body.mass, f"{link.body.name} mass")
            state.force[1] = state.force[1] + mass * g[0]
            state.force[2] = state.force[2] + mass * g[1]

    # ------------------------------------------------------------ inwards and outwards: accelerations
    def _accelerations(self) -> None:
        count = len(self.links)
        inertia: list[list[list[Expression]]] = []
        bias: list[Wrench] = []
        for link, state in zip(self.links, self.bodies, strict=True):
            mass = self.geometry(link.body.mass, f"{link.body.name} mass")
            turning = self.geometry(link.body.inertia.zz, f"{link.body.name} inertia")
            inertia.append([[turning, ZERO, ZERO], [ZERO, mass, ZERO], [ZERO, ZERO, mass]])
            bias.append([self.let(f"{link.body.name}.load{i}", negate(f)) for i, f in enumerate(state.force)])
        steps: list[list[tuple[Wrench, Expression, Expression]]] = [[] for _ in range(count)]
        for i in reversed(range(count)):
            self._inwards(i, inertia, bias, steps)
        motion: list[Wrench] = []
        for i in range(count):
            motion.append(self._outwards(i, motion, steps[i]))

    def _inwards(
        self,
        i: int,
        inertia: list[list[list[Expression]]],
        bias: list[Wrench],
        steps: list[list[tuple[Wrench, Expression, Expression]]],
    ) -> None:
        """Project one body's articulated inertia through its joint onto its parent."""
        link, state = self.links[i], self.bodies[i]
        name = link.body.name
        matrix, load = inertia[i], bias[i]
        biased = (
            [add(load[r], *(matrix[r][k] * state.bias[k] for k in range(3))) for r in range(3)]
            if any(b != ZERO for b in state.bias)
            else load
        )
        load = [self.let(f"{name}.bias{r}", biased[r]) for r in range(3)]
        for number, axis in enumerate(state.axes):
            u = [self.let(f"{name}.u{number}{r}", add(*(matrix[r][k] * axis[k] for k in range(3)))) for r in range(3)]
            d = self.let(f"{name}.d{number}", add(*(axis[k] * u[k] for k in range(3))))
            coordinate = link.coordinates[number]
            if d == ZERO:
                what = "inertia" if coordinate.endswith("phi") else "mass"
                self.result.diagnostics.append(NothingMoves(link.body.span, coordinate, name, what))
                return
            drive = self.let(
                f"{name}.drive{number}", state.drives[number] - add(*(axis[k] * load[k] for k in range(3)))
            )
            steps[i].append((u, d, drive))
            if number == len(state.axes) - 1 and link.parent is None:
                return
            matrix = [
                [self.let(f"{name}.i{number}{r}{k}", _less(matrix[r][k], u[r], u[k], d)) for k in range(3)]
                for r in range(3)
            ]
            load = [self.let(f"{name}.b{number}{r}", load[r] + divide(u[r] * drive, d)) for r in range(3)]
        if link.parent is None:
            return
        p, arm = link.parent, state.arm
        moved = _shifted(matrix, arm)
        inertia[p] = [
            [self.let(f"{name}.up{r}{k}", inertia[p][r][k] + moved[r][k]) for k in range(3)] for r in range(3)
        ]
        torque = load[0] + arm[0] * load[2] - arm[1] * load[1]
        bias[p] = [self.let(f"{name}.down{r}", bias[p][r] + x) for r, x in enumerate((torque, load[1], load[2]))]

    def _outwards(self, i: int, motion: list[Wrench], steps: list[tuple[Wrench, Expression, Expression]]) -> Wrench:
        """The acceleration of one body from its parent's."""
        link, state = self.links[i], self.bodies[i]
        if link.parent is None:
            acceleration: Wrench = list(state.bias)
            carried: Wrench = [ZERO, ZERO, ZERO]
        else:
            a, arm = motion[link.parent], state.arm
            carried = [a[0], a[1] - a[0] * arm[1], a[2] + a[0] * arm[0]]
            carried = [self.let(f"{link.body.name}.carried{r}", x) for r, x in enumerate(carried)]
            acceleration = [carried[r] + state.bias[r] for r in range(3)]
        # The coordinates were eliminated first to last, so they come back last to first; each sees the parent's
        # acceleration and those of the coordinates eliminated after it. The bias is already in the drives.
        known = list(carried)
        for number in reversed(range(len(steps))):
            u, d, drive = steps[number]
            rate = divide(drive - add(*(u[k] * known[k] for k in range(3))), d)
            coordinate = link.coordinates[number]
            target = self.accelerations[coordinate]
            self.builder.assign(target, rate, self.span, self.owner)
            axis = state.axes[number]
            value = rate if isinstance(rate, Number) else Symbol(target)
            known = [known[k] + axis[k] * value for k in range(3)]
            acceleration = [acceleration[k] + axis[k] * value for k in range(3)]
        return [self.let(f"{link.body.name}.a{r}", x) for r, x in enumerate(acceleration)]

    def _energy(self) -> None:
        """Kinetic energy and that of gravity, for the energy balance; vanishes from a program that does not ask for it."""
        g = self.builder.folded(self.mechanism.gravity[0]), self.builder.folded(self.mechanism.gravity[1])
        terms = []
        for link, state in zip(self.links, self.bodies, strict=True):
            mass, turning = (self.builder.folded(b) for b in (link.body.mass, link.body.inertia.zz))
            vx, vy = state.velocity
            terms += [HALF * mass * (vx * vx + vy * vy), HALF * turning * state.spin * state.spin]
            terms.append(negate(mass * (g[0] * state.position[0] + g[1] * state.position[1])))
        self.result.energy = self._variable_of(add(*terms), "energy") if add(*terms) != ZERO else None


def _less(x: Expression, u: Expression, v: Expression, d: Expression) -> Expression:
    """x - u v / d."""
    if u == ZERO or v == ZERO:
        return x
    if x == d and u == d and v == d:
        return ZERO  # the axis itself, projected out
    if x in (u, v) and d in (u, v):
        return ZERO
    return x - divide(u * v, d)


def _shifted(m: list[list[Expression]], arm: Vector) -> list[list[Expression]]:
    """X^T m X: an inertia about one point, about another that lies `arm` before it."""
    x, y = arm
    # acceleration at the far point: (a, ax - a y, ay + a x)
    col = [[m[r][0] - m[r][1] * y + m[r][2] * x, m[r][1], m[r][2]] for r in range(3)]
    return [[col[0][k] - y * col[1][k] + x * col[2][k] for k in range(3)], col[1], col[2]]
