"""A flat bond graph as the text of one model without instances, which compiles to an equal graph."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import groupby

from ..algebra.expression import Expression, Number, Symbol, substitute, symbols
from ..algebra.formula import bind
from ..errors import CompilationFailed, Diagnostic, InternalError
from ..graph.domains import BUNDLES, DOMAINS, multibond_of
from ..graph.elements import SOURCES, TRANSDUCERS, Kind
from ..graph.network import (
    BondEnd,
    BondGraph,
    Delay,
    Element,
    Event,
    Junction,
    MechanismNode,
    Named,
    Node,
    PortVariable,
    Quantity,
    Reading,
    Requirement,
)
from ..graph.units import JOULE, ONE, SECOND, Dimension
from .errors import UnwrittenDomain, UnwrittenFile
from .literals import NotWritable, bond_lines, braces, description_text, former_name, number_text, unit_text
from .mechanism import mechanism_lines
from .reference_names import Words, choose_names, is_field, lone_bonds

ROLES = {"parameter": "parameter", "constant": "constant", "input": "input", "mode": "mode"}  # all others are signals


def write_text(graph: BondGraph) -> str:
    """Return the .bg text of a graph: elements, bonds, laws, quantities, mechanisms, with numbers in SI.

    Names that a text cannot have (`comb[1].folded`) are mapped one to one; the former ones follow in comments. Raises
    `CompilationFailed` with all parts that cannot be written.
    """
    return _Writer(graph).text()


def _is_plain(graph: BondGraph) -> bool:
    """Return True if the graph has ports, all of them untyped, and no units."""
    domains = {d for n in graph.nodes for d in ([n.domain] if isinstance(n, Junction) else [p.domain for p in n.ports])}
    named = (*graph.quantities.values(), *graph.outputs.values())
    return domains == {"untyped"} and all(n.unit == "1" for n in named)


def _delay_of(named: Named, graph: BondGraph) -> Delay | None:
    """Delay that a quantity reads and nothing else; None for any other."""
    read = None if named.definition is None else named.definition.expression
    return graph.delays.get(getattr(read.key, "name", "")) if isinstance(read, Symbol) else None


def _unit_of(dimension: Dimension) -> str:
    """Unit behind a declared name."""
    return "" if dimension == ONE else f": {unit_text(dimension)}"


class _Writer:
    """Writer of one graph."""

    def __init__(self, graph: BondGraph) -> None:
        self.graph = graph
        self.plain = _is_plain(graph)
        self.shared = shared_ports(graph)
        self.heating = heating_resistors(graph)
        separate = [n for n in graph.outputs if n not in graph.quantities or graph.quantities[n].role in ROLES]
        self.names = choose_names(graph, self.shared, separate, self.plain)
        self.words = Words(graph, self.names, self.plain)
        self.mistakes: list[Diagnostic] = []
        self.held: list[str] = []  # modes for what one line of an `every` sets together
        # signals and outputs that are a delay and nothing else, by name: the text needs no second name for it
        entries = (*graph.quantities.values(), *graph.outputs.values())
        self.delayed = {n.name: d for n in entries if (d := _delay_of(n, graph)) is not None}

    def text(self) -> str:
        """The whole text."""
        graph = self.graph
        nodes = [n for n in graph.nodes if n.name not in self.shared]
        unneeded = {d.name for d in self.delayed.values()}
        inner = [
            q for n, q in graph.quantities.items() if not self._is_output(n) and n not in unneeded and q.role != "rate"
        ]
        parts = [line for n in nodes for line in self._told(n, self._node(n))]
        quantities = [line for q in inner for line in self._told(q, self._quantity(q))]
        outputs = [line for n, o in graph.outputs.items() for line in self._told(o, self._output(n, o))]
        limits = [line for r in graph.requirements for line in self._told(r, self._requirement(r))]
        events = [line for e in graph.events if not e.stops for line in self._told(e, self._event(e))]
        quantities += [f"constant {name} = {number_text(value)}" for value, name in self.words.constants.items()]
        quantities += self.held
        self._check_domains()
        if self.mistakes:
            raise CompilationFailed(self.mistakes)
        blocks = [quantities, parts, list(bond_lines(self._bonds())), events, limits, outputs]
        body = "\n\n".join("\n".join(f"  {line}" for line in lines) for lines in blocks if lines)
        head = f"# {graph.name}, flat: its instances are opened, its numbers are in SI.\n"
        return f"{head}{'plain ' if self.plain else ''}model {graph.name} {{\n{body}\n}}\n"

    def _requirement(self, required: Requirement) -> Iterator[str]:
        yield f"require {self.words.condition(required.condition)}{description_text(required.text)}"

    def _event(self, event: Event) -> Iterator[str]:
        if event.span.unit is not None:
            raise NotWritable(UnwrittenFile, file=event.span.source.name)
        if event.sampling is not None:
            unit = ONE if self.plain else SECOND
            pairs = zip(("every", "offset", "delay", "jitter", "seed"), event.sampling.values(), strict=True)
            words = [f"{w} {self.words.bound(x, ONE if w == 'seed' else unit)}" for w, x in pairs if x is not None]
            yield f"{' '.join(words)} {{"
        else:
            yield f"when {self.words.condition(event.condition)} {{"
        for _, line in groupby(event.actions, lambda action: action.span):
            actions = [(self.words.reference(action.target), action.value) for action in line]
            if event.sampling is None or len(actions) == 1:
                yield from (
                    f"  {target.text} = {self.words.bound(value, target.dimension)}" for target, value in actions
                )
                continue
            names = [self._held(f"new_{target.text}", target.dimension) for target, _ in actions]
            for name, (target, value) in zip(names, actions, strict=True):
                yield f"  {name} = {self.words.bound(value, target.dimension)}"
            yield from (f"  {target.text} = {name}" for name, (target, _) in zip(names, actions, strict=True))
        yield "}"

    def _held(self, like: str, dimension: Dimension) -> str:
        """Name of a further mode."""
        name = self.names.free(like, set(), self.names.taken)
        self.names.taken.add(name)
        self.held.append(f"mode {name}{_unit_of(dimension)} = 0")
        return name

    def _told(self, item: Node | Named | Requirement | Event, lines: Iterator[str]) -> list[str]:
        """Lines of one part; none if it cannot be written, which adds a diagnostic."""
        try:
            return list(lines)
        except NotWritable as refused:
            self.mistakes.append(refused.diagnostic(item.span, item.name))
            return []

    def _check_domains(self) -> None:
        """Check the bonds whose domain only a law can imply: its letters must be able to."""
        for tail, head, bond in lone_bonds(self.graph):
            domain = DOMAINS[bond.domain]
            if not (self.plain or (domain.typed and domain.guessed)):
                self.mistakes.append(UnwrittenDomain(bond.span, head.name, tail.name))

    def _is_output(self, name: str) -> bool:
        return name in self.graph.outputs and name not in self.names.outputs

    # ------------------------------------------------------------ quantities
    def _quantity(self, named: Named) -> Iterator[str]:
        if named.role == "solve":
            yield from self._solve(named)
            return
        yield self._item(ROLES.get(named.role, "signal"), self.names.quantities[named.name], named)

    def _solve(self, first: Named) -> Iterator[str]:
        """The equations of a `solve`, and what it looks for, at the first of its unknowns."""
        if first.together[0] != first.name:
            return
        unknowns = [self.graph.quantities[name] for name in first.together]
        zeros = [n.definition for n in unknowns if n.definition is not None]
        role = f"solve {', '.join(f'{self.words.bound(zero, self.words.usual(zero))} = 0' for zero in zeros)} for"
        for named in unknowns:
            yield self._item(role, self.names.quantities[named.name], named)
            role = "  ,"

    def _output(self, name: str, named: Named) -> Iterator[str]:
        if name in self.names.outputs:
            yield self._item("output", self.names.outputs[name], named)
        else:
            yield self._item("output", self.names.quantities[name], self.graph.quantities[name])

    def _item(self, role: str, name: str, named: Named) -> str:
        dimension = self.words.dimension(named)
        integral = self.graph.integrals.get(named.name)
        if integral is not None:
            rate = self.words.bound(integral.rate, dimension / SECOND)
            start = self.words.bound(integral.start, dimension)
            value = f"integral({rate}, {start})"
        elif (delay := self.graph.delays.get(named.name) or self.delayed.get(named.name)) is not None:
            lag = self.words.bound(delay.lag, ONE if self.plain else SECOND)
            value = f"delay({self.words.bound(delay.value, dimension)}, {lag})"
        elif named.role == "solve":
            value = "" if named.guess is None else self.words.bound(bind(Number(named.guess)), dimension)
        elif named.definition is not None:
            value = self.words.bound(named.definition, dimension)
        else:
            raise InternalError(f"`{named.name}` has no value")
        unit = _unit_of(dimension)
        if unit and _NUMBER_WITH_UNIT.fullmatch(value):  # `k: N/m = 5`: a bare number is in that unit
            value = value.split()[0]
        return f"{role} {name}{unit}{f' = {value}' * bool(value)}{description_text(named.description)}{former_name(named.name, name)}"

    # ------------------------------------------------------------ nodes
    def _node(self, node: Node) -> Iterator[str]:
        if isinstance(node, MechanismNode):
            yield from mechanism_lines(node.mechanism, self.names, self.words)
        elif isinstance(node, Junction):
            name = self.names.nodes[node.name]
            domain = "" if self.plain else f" : {node.domain}"
            active = (
                f"active = {self.words.condition(s.active)}" for s in self.graph.switches if s.junction == node.name
            )
            yield f"{node.kind.value} {name}{domain}{braces(active)}{former_name(node.name, name)}"
        else:
            yield element_line(node, self.words, node.name in self.heating)

    # ------------------------------------------------------------ bonds
    def _bonds(self) -> Iterator[tuple[str, str, str]]:
        for bond in self.graph.bonds:
            if self.shared.get(self.graph.nodes[bond.tail.node].name) == bond.head:
                continue  # from a junction that several bonds of one part make
            yield self._place(bond.tail), "->", self._place(bond.head)

    def _place(self, end: BondEnd) -> str:
        node = self.graph.nodes[end.node]
        if node.name in self.shared:
            return self._place(self.shared[node.name])
        name = self.names.nodes[node.name]
        if isinstance(node, Junction) or node.kind in TRANSDUCERS:
            return name
        port = node.ports[end.port].name
        if isinstance(node, MechanismNode):
            part, _, freedom = port.rpartition(".")
            return f"{name}.{self.names.parts[node.mechanism.name, part]}.{freedom}"
        return f"{name}.{port}" if port else name


_NUMBER_WITH_UNIT = re.compile(r"-?[0-9.e+-]+ (\[[^\]]*\]|\w+)")


def shared_ports(graph: BondGraph) -> dict[str, BondEnd]:
    """Map from the junctions that the compiler adds at a mechanism's port with several bonds to that port."""
    found = {}
    for bond in graph.bonds:
        node, other = graph.nodes[bond.tail.node], graph.nodes[bond.head.node]
        if not (isinstance(node, Junction) and isinstance(other, MechanismNode)):
            continue
        if node.name == f"{other.name}.{other.ports[bond.head.port].name}":
            found[node.name] = bond.head
    return found


def heating_resistors(graph: BondGraph) -> set[str]:
    """Resistors whose last port has an outgoing bond and gives the heat: in text an `RS`, without that equation."""
    ends = ((graph.nodes[bond.tail.node], bond.tail.port) for bond in graph.bonds)
    resistors = ((n, port) for n, port in ends if isinstance(n, Element) and n.kind is Kind.RESISTOR)
    return {n.name for n, port in resistors if port == len(n.ports) - 1 and n.gives_heat}


def element_line(node: Element, words: Words, heating: bool) -> str:
    """Declaration of an element. `heating`: its last equation is the heat, which an `RS` has without writing it."""
    name = words.names.nodes[node.name]
    listed = ", ".join(_ports(node, words.plain))
    sides = _sides(node, words, heating)
    kind = f"{'M' if _is_modulated(node, words, sides) else ''}{node.kind.value}{'S' if heating else ''}"
    ports = f"({listed})" if is_field(node) else ""
    law = _law_text(node, words, sides)
    return f"{kind} {name}{ports} : {law}{braces(_attributes(node, words))}{former_name(node.name, name)}"


def _ports(node: Element, plain: bool) -> Iterator[str]:
    """The ports as they are declared: those of one width as one, `p: translation[3]`, those of a `planar` with their domain."""
    for whole, ports in groupby(node.ports, lambda p: multibond_of(p.name)):
        listed = tuple(ports)
        names, domains = [p.name[len(whole) + 1 :] for p in listed], [p.domain for p in listed]
        if not whole:
            yield from (p.name if plain else f"{p.name}: {p.domain}" for p in listed)
        elif listed[0].name.endswith("]"):
            yield f"{whole}: {domains[0]}[{len(listed)}]"
        else:
            yield f"{whole}: {next(name for name, parts in BUNDLES.items() if [*parts.items()] == [*zip(names, domains, strict=True)])}"


def _sides(node: Element, words: Words, heating: bool) -> list[Expression]:
    """Its energy, or the sides of its equations one after the other, over words."""
    equations = node.law.equations[:-1] if heating else node.law.equations
    sides = [s for pair in equations for s in pair] if node.law.energy is None else [node.law.energy]
    own = {
        s.key: Symbol(words.own(node, s.key))
        for side in sides
        for s in symbols(side)
        if isinstance(s.key, PortVariable)
    }

    def put(symbol: Symbol, named: bool) -> Expression:
        if isinstance(symbol.key, PortVariable):
            return own[symbol.key]
        argument = node.arguments[symbol.key]
        if not isinstance(argument, float):
            return Symbol(words.reference(argument))
        return Symbol(words.constant(argument)) if named else Number(argument)

    written = [substitute(side, lambda s: put(s, named=False)) for side in sides]
    if {s.key for s in own.values()} <= _keys(written):
        return written
    # A constant zero would take a variable out of the law: it keeps a name.
    return [substitute(side, lambda s: put(s, named=True)) for side in sides]


def _keys(sides: Sequence[Expression]) -> set[object]:
    return {s.key for side in sides for s in symbols(side)}


def _is_modulated(node: Element, words: Words, sides: Sequence[Expression]) -> bool:
    """Return True if the law reads a quantity that changes."""
    present = _keys(sides)
    read = [a for a in node.arguments if not isinstance(a, float)]
    return any(words.reference(a) in present and _changes(node, a, words) for a in read)


def _changes(node: Element, reference: Quantity | Reading, words: Words) -> bool:
    if isinstance(reference, Reading):
        return True
    if words.is_time(reference):
        return node.kind not in SOURCES
    return words.graph.quantities[reference.name].role not in ("parameter", "constant")


def _law_text(node: Element, words: Words, sides: Sequence[Expression]) -> str:
    printer = words.printer
    if node.law.energy is not None:
        has_power = all(DOMAINS[p.domain].has_power for p in node.ports)
        return f"energy = {printer.text(sides[0], JOULE if has_power else printer.usual(sides[0]))}"
    texts = []
    for left, right in zip(sides[0::2], sides[1::2], strict=True):
        wanted = printer.rigid(left) or printer.rigid(right) or printer.usual(left)
        texts.append(f"{printer.text(left, wanted)} = {printer.text(right, wanted)}")
    return ", ".join(texts)


def _attributes(node: Element, words: Words) -> Iterator[str]:
    for word, values in (("start", node.starts), ("nominal", node.nominals)):
        for number, (variable, bound) in values.items():
            port = node.ports[number]
            letter = words.letter(port.domain, variable)
            target = f"{port.name}.{letter}" if port.name else letter
            yield f"{word} {target} = {words.bound(bound, DOMAINS[port.domain].dimension(variable))}"
    for word, value in (("prefer", node.prefer), ("require", node.require)):
        if value is not None:
            yield f"{word} = {value}"
