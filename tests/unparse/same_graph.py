"""Two graphs are the same but for names: parts in the same order, the same laws over the same references, the same numbers."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from compiler.algebra.expression import Expression, Number, Symbol, substitute
from compiler.algebra.formula import Bound
from compiler.compilation import Compilation
from compiler.graph.mechanism import Body, Joint
from compiler.graph.network import BondEnd, BondGraph, Element, Junction, MechanismNode, PortVariable, Quantity, Reading


def _delays_alone(graph: BondGraph) -> dict[str, str]:
    """Delays and rates by the name of the signal or output that is one and nothing else."""
    entries = {**graph.quantities, **graph.outputs}
    read = {n: q.definition.expression for n, q in entries.items() if q.definition is not None}
    names = {n: getattr(x.key, "name", "") for n, x in read.items() if isinstance(x, Symbol)}
    return {
        n: name
        for n, name in names.items()
        if name in graph.delays or (name in entries and entries[name].role == "rate")
    }


class Same:
    """Compares a graph with the one that its text gives; nodes and quantities correspond by their order."""

    def __init__(self, first: BondGraph, second: BondGraph) -> None:
        self.first, self.second = first, second
        assert [n.kind for n in first.nodes] == [n.kind for n in second.nodes]
        self.nodes = {a.name: b.name for a, b in zip(first.nodes, second.nodes, strict=True)}
        self.parts: dict[tuple[str, str], str] = {}
        for a, b in zip(first.nodes, second.nodes, strict=True):
            if isinstance(a, MechanismNode) and isinstance(b, MechanismNode):
                for x, y in zip(_parts(a), _parts(b), strict=True):
                    self.parts[a.name, x.name] = y.name
        self.quantities = self._quantities()

    def _quantities(self) -> dict[str, str]:
        outputs = dict(zip(self.first.outputs, self.second.outputs, strict=True))
        # A delay has no name where it is written; in the text it has a signal of its own, or the one that is the delay and nothing else.
        alone = _delays_alone(self.first)
        again = _delays_alone(self.second)
        mine = [n for n in self.first.quantities if n not in outputs and n not in alone.values()]
        theirs = [n for n in self.second.quantities if n not in outputs.values() and n not in again.values()]
        found = dict(zip(mine, theirs, strict=True)) | {a: b for a, b in outputs.items() if a in self.first.quantities}
        return found | {delay: again[(found | outputs)[name]] for name, delay in alone.items()}

    # ------------------------------------------------------------ expressions with references put in, names of the second
    def reference(self, argument: Any) -> Expression:
        match argument:
            case float():
                return Number(argument)
            case Quantity(name):
                return Symbol(Quantity(self.quantities.get(name, name)))
            case Reading(node, port, variable):
                part, _, freedom = port.partition(".")
                port = f"{self.parts[node, part]}.{freedom}" if (node, part) in self.parts else port
                return Symbol(Reading(self.nodes[node], port, variable))
        raise AssertionError(argument)

    def mine(self, x: Expression, arguments: tuple[Any, ...]) -> Expression:
        return substitute(x, lambda s: s if isinstance(s.key, PortVariable) else self.reference(arguments[s.key]))

    @staticmethod
    def theirs(x: Expression, arguments: tuple[Any, ...]) -> Expression:
        def put(s: Symbol) -> Expression:
            if isinstance(s.key, PortVariable):
                return s
            argument = arguments[s.key]
            return Number(argument) if isinstance(argument, float) else Symbol(argument)

        return substitute(x, put)

    def bounds(self, a: Bound | None, b: Bound | None) -> None:
        assert (a is None) == (b is None)
        if a is not None and b is not None:
            assert self.mine(a.formula.expression, a.arguments) == self.theirs(b.formula.expression, b.arguments)

    # ------------------------------------------------------------ all of it
    def check(self) -> None:
        first, second = self.first, self.second
        for mine, theirs in zip(first.requirements, second.requirements, strict=True):
            self.bounds(mine.condition, theirs.condition)
            assert mine.text == theirs.text
        assert first.name == second.name
        assert self.ends(first, mapped=True) == self.ends(second, mapped=False)
        for a, b in zip(first.nodes, second.nodes, strict=True):
            self.node(a, b)
        for name, mapped in self.quantities.items():
            a, b = first.quantities[name], second.quantities[mapped]
            assert (a.unit, a.value, a.description) == (b.unit, b.value, b.description), name
            if a.role in ("parameter", "constant", "input"):
                assert a.role == b.role
            if name not in first.delays:
                self.bounds(a.definition, b.definition)
        for past, other in zip(first.delays.values(), second.delays.values(), strict=True):
            self.bounds(past.value, other.value)
            self.bounds(past.lag, other.lag)
        for (name, a), (mapped, b) in zip(first.outputs.items(), second.outputs.items(), strict=True):
            assert a.unit == b.unit, name
            if name not in self.quantities:
                self.bounds(a.definition, second.quantities[mapped].definition)
        for name, integral in first.integrals.items():
            again = second.integrals[self.quantities[name]]
            self.bounds(integral.rate, again.rate)
            self.bounds(integral.start, again.start)

    def ends(self, graph: BondGraph, mapped: bool) -> list[tuple[Any, ...]]:
        """All bonds in order; a mechanism's port by name, as they are numbered in the order in which the text reaches them."""

        def end(at: BondEnd) -> tuple[int, Any]:
            node = graph.nodes[at.node]
            if not isinstance(node, MechanismNode):
                return at
            name = node.ports[at.port].name
            return at.node, self._port(node, name) if mapped else name

        return [(end(b.tail), end(b.head)) for b in graph.bonds]

    def node(self, a: Any, b: Any) -> None:
        if isinstance(a, Junction):
            assert a.domain == b.domain
        elif isinstance(a, Element):
            assert a.ports == b.ports
            assert (a.modulated, a.prefer, a.require) == (b.modulated, b.prefer, b.require)
            self.law(a, b)
            for mine, theirs in ((a.starts, b.starts), (a.nominals, b.nominals)):
                assert mine.keys() == theirs.keys()
                for port, (variable, bound) in mine.items():
                    assert variable == theirs[port][0]
                    self.bounds(bound, theirs[port][1])
        else:
            self.mechanism(a, b)

    def law(self, a: Element, b: Element) -> None:
        pairs = list(zip(a.law.equations, b.law.equations, strict=True))
        sides = [(x, y) for p, q in pairs for x, y in zip(p, q, strict=True)]
        assert (a.law.energy is None) == (b.law.energy is None)
        if a.law.energy is not None and b.law.energy is not None:
            sides.append((a.law.energy, b.law.energy))
        for x, y in sides:
            assert self.mine(x, a.arguments) == self.theirs(y, b.arguments), a.name

    def mechanism(self, a: MechanismNode, b: MechanismNode) -> None:
        assert {self._port(a, p.name) for p in a.ports} == {p.name for p in b.ports}
        for x, y in zip(_parts(a), _parts(b), strict=True):
            if isinstance(x, Body):
                self.bounds(x.mass, y.mass)
            vectors = [
                (getattr(x, n), getattr(y, n)) for n in ("position", "turn", "axis", "other_axis") if hasattr(x, n)
            ]
            if isinstance(x, Body):
                vectors.append(tuple(tuple(getattr(b.inertia, f.name) for f in fields(b.inertia)) for b in (x, y)))
            for p, q in ((p, q) for mine, theirs in vectors for p, q in zip(mine, theirs, strict=True)):
                self.bounds(p, q)
            for field in ("kind", "axes", "locked", "planar"):
                assert getattr(x, field, None) == getattr(y, field, None)
            if isinstance(x, Joint):
                self.bounds(x.ratio, y.ratio)
            rests = getattr(x, "rest", {}), getattr(y, "rest", {})
            assert rests[0].keys() == rests[1].keys()
            for key in rests[0]:
                self.bounds(rests[0][key], rests[1][key])
            for field in ("body", "first", "second"):
                mine = getattr(x, field, None)
                assert self.parts.get((a.name, str(mine)), mine) == getattr(y, field, None)
            starts = getattr(x, "starts", {}), getattr(y, "starts", {})
            assert starts[0].keys() == starts[1].keys()
            for key in starts[0]:
                self.bounds(starts[0][key], starts[1][key])
        assert a.mechanism.planar == b.mechanism.planar
        for p, q in zip(a.mechanism.gravity, b.mechanism.gravity, strict=True):
            self.bounds(p, q)

    def _port(self, node: MechanismNode, port: str) -> str:
        part, _, freedom = port.rpartition(".")
        return f"{self.parts[node.name, part]}.{freedom}"


def _parts(node: MechanismNode) -> tuple[Any, ...]:
    return (*node.mechanism.bodies, *node.mechanism.frames, *node.mechanism.joints)


def same_motion(first: Compilation, second: Compilation, tries: int = 20, tolerance: float = 1e-12) -> int:
    """Both programs give the same derivative, outputs and start at random states. Returns the number of states."""
    one, two = first.program, second.program
    assert len(one.states.names) == len(two.states.names)
    assert one.states.units == two.states.units
    assert one.outputs.units == two.outputs.units
    rng = np.random.default_rng(7)
    with np.errstate(all="ignore"):
        (a, x), (b, y) = ((p, np.asarray(p.start(p.constants(np.array(p.defaults))))) for p in (one, two))
    np.testing.assert_allclose(y, x, rtol=tolerance, atol=0)
    p, q = np.array(a.defaults), np.array(b.defaults)
    u, w = np.array(a.input_defaults), np.array(b.input_defaults)
    with np.errstate(all="ignore"):
        for number in range(tries):
            state = x + rng.normal(size=len(x)) * 10.0 ** rng.uniform(-6, 0)
            time = float(rng.uniform(0, 0.03)) if number else 0.0
            mine = (time, state, u, a.constants(p), a.mode_at(time, state, u, a.constants(p)))
            theirs = (time, state, w, b.constants(q), b.mode_at(time, state, w, b.constants(q)))
            for name in ("derivative", "output"):
                expected, found = getattr(a, name)(*mine), getattr(b, name)(*theirs)
                scale = np.max(np.abs(expected), initial=0.0, where=np.isfinite(expected))
                np.testing.assert_allclose(found, expected, rtol=tolerance, atol=1e-15 * scale, err_msg=name)
    return len(x)
