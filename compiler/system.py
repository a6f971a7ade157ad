"""System of units: a graph that is cut at the ports of some instances. Each unit is a graph of its own, and links go between their variables."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import NamedTuple

from .algebra.expression import Number, Symbol
from .algebra.formula import Bound, bind
from .causality import CausalGraph
from .codegen.errors import NoPart, NotInUnit
from .equations.system import letter_of, port_name, unit_of
from .errors import CompilationFailed
from .graph.elements import Kind
from .graph.network import (
    TIME,
    Bond,
    BondEnd,
    BondGraph,
    Element,
    Event,
    Junction,
    Law,
    Named,
    Node,
    Port,
    PortVariable,
    Quantity,
    Reading,
    Reference,
    Sampling,
)
from .graph.samples import FOLLOWING, ITSELF
from .semantics import Built
from .source import Span

_COPIED = ("parameter", "constant", *FOLLOWING)  # roles of what any unit computes of what it reads


class UnitLink(NamedTuple):
    """Value that goes from a variable of a unit to one of another."""

    giver: str
    given: str
    taker: str
    taken: str


class System(NamedTuple):
    """Units by name, that of the rest with the name of the model, and what goes between them.

    `bonds`: the two links of each bond that is cut. `whole`: the model, of which what goes between units is an output.
    """

    units: Mapping[str, BondGraph]
    links: tuple[UnitLink, ...]
    bonds: tuple[tuple[UnitLink, ...], ...]
    whole: BondGraph

    def alone(self, built: Built, name: str) -> Built:
        """Return one unit of a model, or with an empty name the whole, with the plan of its experiment."""
        graph = self.units[name] if name else self.whole
        own = graph.quantities.keys() | {node.name for node in graph.nodes}
        tolerances = {n: t for n, t in built.plan.tolerances.items() if n in own or n.rpartition(".")[0] in own}
        return replace(built, graph=graph, plan=replace(built.plan, tolerances=tolerances))


def cut(causal: CausalGraph, parts: Sequence[str]) -> System:
    """Cut a graph at the ports of its instances `parts`: what is no part of them is one unit more. Raises `CompilationFailed`."""
    graph = causal.graph
    for part in parts:
        if part not in graph.stands:
            names = ", ".join(f"`{n}`" for n in list(graph.stands)[:12])
            hint = "It consists of no instances, such as `Wheel wheel`, at whose ports it could be cut."
            if names:
                hint = f"Its instances are {names}."
            raise CompilationFailed([NoPart(graph.span, part, hint)])
    return _Cutter(causal, parts).system()


class _Unit:
    """A unit while it is cut out."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.numbers: dict[int, int] = {}  # of nodes, by those in the whole
        self.bonds: dict[int, Bond] = {}  # by numbers in the whole
        self.quantities: dict[str, Named] = {}
        self.outputs: dict[str, Named] = {}
        self.events: list[Event] = []
        self.waiting: list[Named] = []


class _Cutter:
    """All units of a cut. What a unit reads and does not compute becomes an input of it, and an output of another one."""

    def __init__(self, causal: CausalGraph, parts: Sequence[str]) -> None:
        self.causal, self.graph = causal, causal.graph
        self.parts = sorted(parts, key=len, reverse=True)  # of nested ones the inner one comes first
        self.units: dict[str, _Unit] = defaultdict(_Unit)
        self.links: dict[UnitLink, None] = {}
        self.cuts: list[list[UnitLink]] = []  # those of each bond
        self.given: dict[str, Named] = {}  # by the names in links, as the whole has it
        self.rest = self.graph.name
        while self.rest.lower() in (part.lower() for part in parts):  # files are named after units
            self.rest += "_"
        self.owners = [self._owner(node.name) for node in self.graph.nodes]
        self.places = {node.name: k for k, node in enumerate(self.graph.nodes)}

    def _owner(self, name: str) -> str:
        return next((p for p in self.parts if name == p or name.startswith(f"{p}.")), "")

    def system(self) -> System:
        graph = self.graph
        for number, (node, owner) in enumerate(zip(graph.nodes, self.owners, strict=True)):
            unit = self.units[owner]
            unit.numbers[number] = len(unit.nodes)
            unit.nodes.append(self._node(owner, node))
        for number in range(len(graph.bonds)):
            self._bond(number)
        for named in graph.quantities.values():
            owner = self._owner(named.name)
            if owner or named.role not in _COPIED or named.name in graph.integrals:
                self.units[owner].waiting.append(named)
            if owner and named.role == "output":
                self.units[owner].outputs[named.name] = named
        for event in graph.events:
            self._event(event)
        for named in graph.outputs.values():
            self._output(named)
        while any(unit.waiting for unit in self.units.values()):
            for name, unit in list(self.units.items()):
                while unit.waiting:
                    self._define(name, unit.waiting.pop())
        names = {owner: owner or self.rest for owner in self.units}
        renamed = {k: k._replace(giver=names[k.giver], taker=names[k.taker]) for k in self.links}
        links, bonds = tuple(renamed.values()), tuple(tuple(renamed[k] for k in pair) for pair in self.cuts)
        whole = replace(graph, outputs={**graph.outputs, **self.given})
        return System({names[owner]: self._whole(owner) for owner in self.units}, links, bonds, whole)

    def _whole(self, owner: str) -> BondGraph:
        """Return the graph of a unit."""
        graph, unit = self.graph, self.units[owner]
        place = {number: k for k, number in enumerate(unit.bonds)}
        names = dict.fromkeys((*(n for n in graph.quantities if n in unit.quantities), *unit.quantities))
        quantities = {name: unit.quantities[name] for name in names}

        def is_here(reference: Reference) -> bool:
            if isinstance(reference, Quantity):
                return reference == TIME or reference.name in quantities
            return self._giver(owner, reference) is None

        own = (r for r in graph.requirements if self._owner(r.name) == owner)
        requirements = tuple(r for r in own if all(is_here(a) for a in r.condition.arguments))
        return replace(
            graph, name=owner or self.rest, nodes=tuple(unit.nodes), bonds=tuple(unit.bonds.values()), quantities=quantities, outputs=unit.outputs,
            integrals={
                n: replace(i, rate=self._read(owner, i.rate), start=self._read(owner, i.start))
                for n, i in graph.integrals.items() if self._owner(n) == owner
            },
            requirements=requirements, walls={wall: place[k] for wall, k in graph.walls.items() if k in place}, events=tuple(unit.events),
            switches=tuple(s for s in graph.switches if s.junction in {n.name for n in unit.nodes}),
            delays={n: d for n, d in graph.delays.items() if self._owner(n) == owner},
        )  # fmt: skip

    # ------------------------------------------------------------ power
    def _node(self, owner: str, node: Node) -> Node:
        if isinstance(node, Element):
            arguments = tuple(self._take(owner, a) for a in node.arguments)
            starts = {k: (v, self._read(owner, b)) for k, (v, b) in node.starts.items()}
            nominals = {k: (v, self._read(owner, b)) for k, (v, b) in node.nominals.items()}
            return replace(node, arguments=arguments, starts=starts, nominals=nominals)
        for bound in _bounds(node):
            self._read(owner, bound)
        return node

    def _bond(self, number: int) -> None:
        """Add a bond to its unit; one between two units to both, each with a source in the place of the other."""
        bond, before = self.graph.bonds[number], len(self.links)
        for owner in dict.fromkeys((self.owners[bond.tail.node], self.owners[bond.head.node])):
            unit = self.units[owner]
            tail, head = (
                BondEnd(unit.numbers[end.node], end.port) if self.owners[end.node] == owner else BondEnd(len(unit.nodes), 0)
                for end in (bond.tail, bond.head)
            )  # fmt: skip
            unit.bonds[number] = Bond(tail, head, bond.domain, bond.span)
            inner = next(e.node for e in (bond.tail, bond.head) if self.owners[e.node] == owner)
            if len(unit.nodes) in (tail.node, head.node):
                unit.nodes.append(self._source(owner, number, self.causal.decides_effort(number, inner)))
        if links := list(self.links)[before:]:
            self.cuts.append(links)

    def _source(self, owner: str, number: int, is_effort_known: bool) -> Element:
        """Return the source in the place of the rest at a bond, whose value is an input; what answers is an output."""
        bond = self.graph.bonds[number]
        imposed, answer = ("f", "e") if is_effort_known else ("e", "f")
        name = self._port(owner, number)
        variable, result = (f"{name}_{letter_of(bond.domain, v)}" for v in (imposed, answer))
        self._open(owner, variable, unit_of(bond.domain, imposed), bond.span)
        reading = Bound(ITSELF, (Reading(name, "", answer),))
        self.units[owner].outputs[result] = Named(
            result, "output", unit_of(bond.domain, answer), reading, None, bond.span
        )
        wall = next(w for w, k in self.graph.walls.items() if k == number)
        self.given[result] = replace(
            self.units[owner].outputs[result], definition=Bound(ITSELF, (Reading(*wall, answer),))
        )
        other = next(o for o in (self.owners[bond.tail.node], self.owners[bond.head.node]) if o != owner)
        self.links[UnitLink(owner, result, other, f"{self._port(other, number)}_{letter_of(bond.domain, answer)}")] = (
            None
        )
        kind = Kind.FLOW_SOURCE if imposed == "f" else Kind.EFFORT_SOURCE
        law = Law(((Symbol(PortVariable(0, imposed)), Symbol(0)),), None, 1)
        return Element(
            name, kind, True, (Port("", bond.domain),), law, (Quantity(variable),), (), {}, {}, None, None, f"{self.graph.name}.{name}", bond.span
        )  # fmt: skip

    def _port(self, owner: str, number: int) -> str:
        """Return the name of a bond in a unit: of its own port, or of that of the unit beyond."""
        names = [f"{w}.{c}".rstrip(".") for (w, c), k in self.graph.walls.items() if k == number]
        own = [n for n in names if owner and self._owner(n) == owner]
        return min(own or names, key=len)

    # ------------------------------------------------------------ signals
    def _read(self, owner: str, bound: Bound) -> Bound:
        """Return a definition as a unit reads it."""
        return Bound(bound.formula, tuple(self._take(owner, a) for a in bound.arguments))

    def _take(self, owner: str, reference: Reference) -> Reference:
        """Return a reference as a unit reads it: of what another one holds it reads an input."""
        giver = self._giver(owner, reference)
        if giver is None:
            if isinstance(reference, Quantity) and reference.name in self.graph.quantities:
                self.units[owner].waiting.append(self.graph.quantities[reference.name])
            return reference
        named = self._given(giver, reference)
        self._open(owner, named.name, named.unit, named.span)
        self.links[UnitLink(giver, named.name, owner, named.name)] = None
        return Quantity(named.name)

    def _giver(self, owner: str, reference: Reference) -> str | None:
        """Return the unit that holds what another one reads; None if it has it itself, or computes it."""
        if isinstance(reference, float) or reference == TIME:
            return None
        if isinstance(reference, Reading):
            number = self.graph.walls.get((reference.node, reference.port))
            if number is not None and owner != _NOWHERE and number in self.units[owner].bonds:
                return None
            node = self.places[reference.node] if number is None else self.graph.bonds[number].tail.node
            giver = self.owners[node]
        else:
            giver, named = self._owner(reference.name), self.graph.quantities.get(reference.name)
            roles = ("parameter", "constant", "input") if giver else _COPIED
            if named is not None and named.role in roles and named.name not in self.graph.integrals:
                return None
        return None if giver == owner else giver

    def _given(self, giver: str, reference: Reference) -> Named:
        """Return the output with which a unit gives a quantity or a reading."""
        unit = self.units[giver]
        if isinstance(reference, Quantity):
            named = self.graph.quantities[reference.name]
            unit.waiting.append(named)
        else:
            assert isinstance(reference, Reading)
            name, domain, span = self._reading(reference)
            named = Named(name, "output", unit_of(domain, reference.variable), Bound(ITSELF, (reference,)), None, span)
        self.given.setdefault(named.name, named)
        return unit.outputs.setdefault(named.name, named)

    def _reading(self, reading: Reading) -> tuple[str, str, Span]:
        """Return name, domain and place of what is read at a node."""
        number = self.graph.walls.get((reading.node, reading.port))
        if number is not None:
            bond = self.graph.bonds[number]
            return f"{reading.node}.{letter_of(bond.domain, reading.variable)}", bond.domain, bond.span
        node = self.graph.nodes[self.places[reading.node]]
        if isinstance(node, Junction):
            return f"{node.name}.{letter_of(node.domain, reading.variable)}", node.domain, node.span
        port = next(i for i, p in enumerate(node.ports) if p.name == reading.port)
        return port_name(node, port, reading.variable), node.ports[port].domain, node.span

    def _open(self, owner: str, name: str, unit: str, span: Span) -> None:
        """Add an input that comes from another unit."""
        self.units[owner].quantities[name] = Named(name, "input", unit, bind(Number(0.0)), None, span)

    def _define(self, owner: str, named: Named) -> None:
        """Add a quantity to a unit, with what it reads. An input that is given nothing but what another unit holds is that itself."""
        quantities = self.units[owner].quantities
        if named.name in quantities:
            return
        quantities[named.name] = named
        integral, delay = self.graph.integrals.get(named.name), self.graph.delays.get(named.name)
        definitions = [
            *((integral.rate, integral.start) if integral else ()),
            *((delay.value, delay.lag) if delay else ()),
        ]
        for definition in definitions:
            self._read(owner, definition)
        bound = named.definition
        if bound is None:
            return
        if named.role == "input" and owner and bound.formula == ITSELF:
            giver = self._giver(owner, bound.arguments[0])
            if giver is not None:
                output = self._given(giver, bound.arguments[0])
                self._open(owner, named.name, named.unit, named.span)
                self.links[UnitLink(giver, output.name, owner, named.name)] = None
                return
        quantities[named.name] = replace(named, definition=self._read(owner, bound))

    # ------------------------------------------------------------ what belongs to one unit
    def _homes(self, bounds: Iterable[Bound]) -> set[str]:
        """Return the units that hold what definitions read."""
        homes, known, waiting = set[str](), set[Reference](), [a for b in bounds for a in b.arguments]
        while waiting:
            reference = waiting.pop()
            if reference in known:
                continue
            known.add(reference)
            giver = self._giver(_NOWHERE, reference)
            if giver is not None:
                homes.add(giver)
            elif isinstance(reference, Quantity) and reference.name in self.graph.quantities:
                definition = self.graph.quantities[reference.name].definition
                waiting += definition.arguments if definition is not None else ()
        return homes

    def _home(self, bounds: Iterable[Bound]) -> str:
        """Return the one unit that holds what definitions read; if there are several, that of the rest."""
        homes = self._homes(bounds)
        if len(homes) == 1:
            return homes.pop()
        return "" if homes else next(iter(self.units))

    def _output(self, named: Named) -> None:
        """Add an output of the model to a unit."""
        definition = named.definition
        is_memory = named.name in self.graph.integrals
        owner = self._owner(named.name) if is_memory else self._home([definition] if definition is not None else [])
        self.units[owner].waiting.append(named)
        read = named if definition is None else replace(named, definition=self._read(owner, definition))
        self.units[owner].outputs[named.name] = read

    def _event(self, event: Event) -> None:
        """Add an event to the unit whose quantities it sets. Raises `CompilationFailed` if there are several."""
        targets = [Bound(ITSELF, (action.target,)) for action in event.actions]
        homes = sorted(self._homes(targets))
        if len(homes) > 1:
            what = f"an event that sets what belongs to two units, {' and '.join(f'`{h or self.graph.name}`' for h in homes[:2])},"
            raise CompilationFailed([NotInUnit(event.span, what, "Write an event for each, or cut elsewhere.")])
        owner = homes[0] if homes else self._home([event.condition])
        sampling = event.sampling
        if sampling is not None:
            period, *others = (None if v is None else self._read(owner, v) for v in sampling.values())
            assert period is not None
            sampling = Sampling(period, *others)
        actions = tuple(replace(a, value=self._read(owner, a.value)) for a in event.actions)
        self.units[owner].events.append(
            replace(event, condition=self._read(owner, event.condition), actions=actions, sampling=sampling)
        )


_NOWHERE = "?"  # no unit


def _bounds(part: object) -> Iterator[Bound]:
    """Yield the definitions within a mechanism."""
    if isinstance(part, Bound):
        yield part
    elif isinstance(part, Mapping):
        for value in part.values():
            yield from _bounds(value)
    elif isinstance(part, tuple):
        for value in part:
            yield from _bounds(value)
    elif is_dataclass(part) and not isinstance(part, Span | Port):
        for field in fields(part):
            yield from _bounds(getattr(part, field.name))
