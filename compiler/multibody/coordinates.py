"""States of a mechanism: coordinates and their rates, with starts; driven and locked coordinates.

A rotation in space is a unit quaternion with the angular velocity in body axes, so no pose is singular. The equations
hold for a quaternion of any length; its length is an invariant of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..algebra.expression import ONE, ZERO, Expression, Symbol, add, call, divide, multiply
from ..fast_dataclass import dataclass
from ..graph.mechanism import Body, Joint
from .assignment_emitter import AssignmentEmitter
from .rotations import (
    HALF,
    Quaternion,
    conjugate,
    of_quaternion,
    of_rotation_vector,
    quaternion_product,
    turned_by_rates,
)
from .tree import Link
from .vectors import Vector, negated


@dataclass(frozen=True, slots=True)
class Coordinate:
    """One coordinate of a link. `value` is its reading, `moved` the displacement from the drawing.

    `target`: variable of its second derivative (None if locked); `driven`: the network determines its rate.
    """

    name: str
    value: Expression
    moved: Expression
    rate: Expression
    target: int | None
    driven: bool = False

    @property
    def acceleration(self) -> Expression:
        """Second derivative of the coordinate."""
        return ZERO if self.target is None else Symbol(self.target)


@dataclass(frozen=True, slots=True)
class Attitude:
    """A rotation in space: quaternion relative to the drawing, angular velocity in body axes, and the variables of its derivatives."""

    parts: Quaternion
    spin: Vector
    targets: tuple[int, ...]


def is_turning(letter: str) -> bool:
    """Return True if a coordinate is an angle: phi, phi1, rx."""
    return letter.startswith(("phi", "r"))


class Coordinates:
    """Builder of the states of links. `flows` are those that the network determines, by port."""

    def __init__(self, script: AssignmentEmitter, flows: Mapping[str, Expression]) -> None:
        self.script, self.flows = script, flows
        self.scalars: dict[str, Coordinate] = {}
        self.attitudes: dict[str, Attitude] = {}

    def scalar(self, link: Link, name: str) -> Coordinate:
        """Add a coordinate that is one number."""
        letter = name.rpartition(".")[2]
        rest = self.rest(link.part, letter)
        if link.fixed:
            value = self._start(link.part, letter, rest)
            made = Coordinate(name, value, self._moved(name, value, rest), ZERO, None)
        else:
            made = self._moving(link.part, name, letter, rest)
        self.scalars[name] = made
        return made

    def _moving(self, part: Joint | Body, name: str, letter: str, rest: Expression) -> Coordinate:
        word, units = ("omega", ("1", "1/s", "1/s^2")) if is_turning(letter) else ("v", ("m", "m/s", "m/s^2"))
        script, builder = self.script, self.script.builder
        full = script.named(name)
        coordinate = builder.variable(full, "state", units[0])
        driven = name in self.flows
        if driven:
            rate = script.held(f"{name}.{word}", self.flows[name], units[1])
        else:
            rate = builder.variable(f"{full}.{word}", "state", units[1])
        acceleration = builder.variable(f"{full}.{word} rate", "computed", units[2])
        self._state(coordinate, rate, part, letter, rest, full)
        if driven:
            # by the name that it has where junctions switch and nothing drives it
            own = builder.variable(f"{full}.{word}", "computed", units[1])
            builder.differentiated(acceleration, rate, part.span, full, own)
        else:
            self._state(rate, acceleration, part, f"{letter}.f", ZERO, f"{full}.{word}")
        moved = self._moved(name, Symbol(coordinate), rest)
        return Coordinate(name, Symbol(coordinate), moved, Symbol(rate), acceleration, driven)

    def _moved(self, name: str, value: Expression, rest: Expression) -> Expression:
        if value == rest:
            return ZERO
        return self.script.let(f"{name} moved", value - rest)

    def rest(self, part: Joint | Body, letter: str) -> Expression:
        """Reading of a coordinate in the drawing."""
        if isinstance(part, Joint):
            return (
                self.script.constant(part.rest[letter], f"{part.name}.{letter} rest") if letter in part.rest else ZERO
            )
        if letter == "phi":
            return self.script.constant(part.turn[2], f"{part.name} angle", "1")
        return self.script.constant(part.position["xyz".index(letter)], f"{part.name} at.{letter}", "m")

    def _start(self, part: Joint | Body, key: str, otherwise: Expression) -> Expression:
        return self.script.builder.folded(part.starts[key]) if key in part.starts else otherwise

    def _state(self, state: int, rate: int, part: Joint | Body, key: str, reference: Expression, name: str) -> None:
        """Add a state. Without a start of the author it starts as drawn, and claims may change it."""
        start, drawn = self._start(part, key, reference), None if key.endswith(".f") else reference
        self.script.builder.state(state, rate, start, name, part.span, key in part.starts, drawn)

    # ------------------------------------------------------------ turns in space
    def attitude(self, link: Link) -> Attitude:
        """Add a quaternion and an angular velocity."""
        part, script = link.part, self.script
        start, spin_start = self._attitude_start(link)
        given = any(k.partition(".")[0] in ("rx", "ry", "rz", "attitude") and not k.endswith(".f") for k in part.starts)
        given_spin = any(k.endswith(".f") and k.startswith("r") for k in part.starts)
        if link.fixed:
            w, x, y, z = start
            made = Attitude((w, x, y, z), (ZERO, ZERO, ZERO), ())
            self.attitudes[part.name] = made
            return made
        builder = script.builder
        names = [script.named(f"{part.name}.attitude.{c}") for c in "wxyz"]
        spins = [script.named(f"{part.name}.spin.{c}") for c in "xyz"]
        p = [builder.variable(n, "state", "1") for n in names]
        omega = [builder.variable(n, "state", "1/s") for n in spins]
        targets = [builder.variable(f"{n} rate", "computed", "1/s^2") for n in spins]
        made = Attitude(_four(p), _three(omega), tuple(targets))
        rates = [builder.variable(f"{n} rate", "computed", "1/s") for n in names]
        for rate, value in zip(rates, quaternion_rates(made.parts, made.spin), strict=True):
            builder.assign(rate, value, script.span, script.owner)
        norm = script.held(f"{part.name}.attitude norm", add(*(c * c for c in made.parts)) - 1, "1")
        builder.invariant(norm, None, script.named(f"{part.name}.attitude"), part.span)
        for variable, rate, value, name, drawn in zip(p, rates, start, names, (ONE, ZERO, ZERO, ZERO), strict=True):
            builder.state(variable, rate, value, name, part.span, given, drawn)
        for variable, rate, value, name in zip(omega, targets, spin_start, spins, strict=True):
            builder.state(variable, rate, value, name, part.span, given_spin)
        self.attitudes[part.name] = made
        return made

    def _attitude_start(self, link: Link) -> tuple[Sequence[Expression], Vector]:
        """Start of a rotation in space relative to the drawing, and its angular velocity in body axes."""
        part, script = link.part, self.script
        zeros: Vector = (ZERO, ZERO, ZERO)
        rests = [self.rest(part, r) if isinstance(part, Joint) else ZERO for r in ("rx", "ry", "rz")]
        starts_turned = isinstance(part, Body) and any(k in part.starts for k in ("rx", "ry", "rz", "attitude.w"))
        drawn_at = script.place(part.turn, f"{part.name} turn", "1") if starts_turned else rests
        vector = [
            self._start(part, r, at) - rest for r, rest, at in zip(("rx", "ry", "rz"), rests, drawn_at, strict=True)
        ]
        rates = tuple(self._start(part, f"{r}.f", ZERO) for r in ("rx", "ry", "rz"))
        v: Vector = (vector[0], vector[1], vector[2])
        f: Vector = (rates[0], rates[1], rates[2])
        name = f"{part.name} start"
        turn = of_rotation_vector(script, v, name)
        p = turn.quaternion(script, name)
        if isinstance(part, Body):
            drawn = of_rotation_vector(script, script.place(part.turn, f"{part.name} turn", "1"), f"{part.name} drawn")
            if "attitude.w" in part.starts:
                p = _unit(tuple(self._start(part, f"attitude.{c}", ZERO) for c in "wxyz"))  # type: ignore[arg-type]
                turn = of_quaternion(script, p, name)
            if starts_turned:
                p = quaternion_product(p, conjugate(drawn.quaternion(script, f"{part.name} drawn")))
                turn = of_quaternion(script, p, f"{name} turned")
            return p, turn.back(script, f, f"{name} spin")
        if f != zeros:
            f = turned_by_rates(script, v, f, f"{name} spin")
        if link.reverse:  # the inverse turn, and the spin seen from the other side
            f = turn.apply(script, f, f"{name} spin seen")
            p, f = conjugate(p), negated(f)
        return p, f


def quaternion_rates(p: Quaternion, spin: Vector) -> Quaternion:
    """Half of p times the angular velocity in body axes."""
    w, x, y, z = quaternion_product(p, (ZERO, *spin))
    return multiply(HALF, w), multiply(HALF, x), multiply(HALF, y), multiply(HALF, z)


def _unit(p: Quaternion) -> Quaternion:
    size = call("sqrt", add(*(c * c for c in p)))
    return divide(p[0], size), divide(p[1], size), divide(p[2], size), divide(p[3], size)


def _four(v: Sequence[int]) -> Quaternion:
    return Symbol(v[0]), Symbol(v[1]), Symbol(v[2]), Symbol(v[3])


def _three(v: Sequence[int]) -> Vector:
    return Symbol(v[0]), Symbol(v[1]), Symbol(v[2])
