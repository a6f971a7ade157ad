"""Mechanisms drawn by numbers, without a text: through the compiler to a program."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from compiler.algebra.expression import Number, Symbol
from compiler.algebra.formula import Bound, Formula
from compiler.compilation import Compilation
from compiler.graph.elements import Kind
from compiler.graph.mechanism import NOTHING, ORIGIN, UPRIGHT, Body, Frame, Inertia, Joint, Mechanism, Vector
from compiler.graph.network import (
    Bond,
    BondEnd,
    BondGraph,
    Element,
    Law,
    MechanismNode,
    Named,
    Port,
    PortVariable,
    Quantity,
    Reading,
)
from compiler.scene import Plan, Scene
from compiler.semantics.build import Built
from compiler.source import Source, Span

SOURCE = Source("drawn", " ")
SPAN = Span(SOURCE, 0, 1)
Value = float | str  # a number, or the name of a parameter


def bound(value: Value) -> Bound:
    """A number, or a reference to a parameter."""
    if isinstance(value, str):
        return Bound(Formula(1, Symbol(0)), (Quantity(value),))
    return Bound(Formula(0, Number(float(value))), ())


def vector(values: Sequence[Value]) -> Vector:
    """Three numbers or parameters."""
    x, y, z = map(bound, values)
    return x, y, z


def is_turning(port: str) -> bool:
    """Return True for a port of rotation."""
    return port.rpartition(".")[2].startswith(("phi", "r"))


@dataclass
class Drawing:
    """Bodies and joints, with numbers or `parameters`."""

    planar: bool = False
    gravity: Sequence[Value] = (0.0, 0.0, 0.0)
    bodies: list[Body] = field(default_factory=list)
    joints: list[Joint] = field(default_factory=list)
    frames: list[Frame] = field(default_factory=list)
    parameters: dict[str, float] = field(default_factory=dict)

    def body(
        self, name: str, mass: Value, inertia: Sequence[Value] = (0.0,) * 6, at: Sequence[Value] = (0.0,) * 3,
        turn: Sequence[Value] = (0.0,) * 3, start: Mapping[str, Value] | None = None,
    ) -> None:  # fmt: skip
        """`inertia`: xx, yy, zz, xy, xz, yz."""
        starts = {k: bound(v) for k, v in (start or {}).items()}
        self.bodies.append(
            Body(name, bound(mass), Inertia(*map(bound, inertia)), vector(at), vector(turn), starts, SPAN)
        )

    def joint(
        self, name: str, kind: str, first: str, second: str, at: Sequence[Value] = (0.0,) * 3,
        axis: Sequence[Value] | None = None, turn: Sequence[Value] = (0.0,) * 3, other: Sequence[Value] | None = None,
        axes: str = "from", ratio: Value = 0.0, start: Mapping[str, Value] | None = None,
        rest: Mapping[str, Value] | None = None, locked: bool = False,
    ) -> None:  # fmt: skip
        starts, rests = ({k: bound(v) for k, v in (x or {}).items()} for x in (start, rest))
        self.joints.append(
            Joint(
                name, kind, first, second, vector(at), vector(axis) if axis is not None else UPRIGHT, vector(turn), starts, SPAN,
                axes, vector(other) if other is not None else ORIGIN, bound(ratio) if ratio else NOTHING, rests, locked, self.planar,
            )
        )  # fmt: skip

    def frame(self, name: str, body: str, at: Sequence[Value], axes: str = "world") -> None:
        self.frames.append(Frame(name, body, vector(at), SPAN, {}, axes))

    def mechanism(self) -> Mechanism:
        gravity = vector(self.gravity)
        return Mechanism("m", tuple(self.bodies), tuple(self.frames), tuple(self.joints), gravity, SPAN, self.planar)

    def compiled(
        self, outputs: Iterable[str] = (), efforts: Iterable[str] = (), flows: Iterable[str] = (), everything: bool = False
    ) -> Compilation:  # fmt: skip
        """`outputs`: ports that are read, `pin.phi`, or with a variable, `pin.phi:f`; `efforts` and `flows`: ports that an
        input `to PORT` drives."""
        driven = [*((port, "e") for port in efforts), *((port, "f") for port in flows)]
        ports = tuple(Port(port, "rotation" if is_turning(port) else "translation") for port, _ in driven)
        quantities = {n: Named(n, "parameter", "", bound(v), v, SPAN) for n, v in self.parameters.items()}
        quantities |= {f"to {port}": Named(f"to {port}", "input", "", bound(0.0), 0.0, SPAN) for port, _ in driven}
        nodes: list[Element | MechanismNode] = [MechanismNode("m", Kind.MECHANISM, ports, self.mechanism(), "m", SPAN)]
        bonds = []
        for number, (port, variable) in enumerate(driven):
            kind = Kind.EFFORT_SOURCE if variable == "e" else Kind.FLOW_SOURCE
            law = Law(((Symbol(PortVariable(0, variable)), Symbol(0)),), None, 1)
            domain = ports[number].domain
            nodes.append(
                Element(f"source {port}", kind, True, (Port("", domain),), law, (Quantity(f"to {port}"),), (), {}, {}, None, None, "m", SPAN)
            )  # fmt: skip
            bonds.append(Bond(BondEnd(number + 1, 0), BondEnd(0, number), domain, SPAN))
        named = {}
        for output in outputs:
            port, _, variable = output.partition(":")
            definition = Bound(Formula(1, Symbol(0)), (Reading("m", port, variable or "q"),))
            named[output] = Named(output, "output", "", definition, None, SPAN)
        graph = BondGraph("drawn", tuple(nodes), tuple(bonds), quantities, named, {}, SPAN)
        compilation = Compilation(SOURCE, Scene(None, None, (), frozenset("*")), None, everything)
        compilation.__dict__["_built"] = Built(graph, Plan(None), ())
        return compilation
