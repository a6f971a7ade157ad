"""Nodes and bonds of the graph, made from the elaborated declarations: elements with their laws, junctions, mechanisms."""

from __future__ import annotations

from dataclasses import replace

from ...algebra.expression import ZERO, Symbol
from ...algebra.formula import Bound, bind
from ...errors import Diagnostic
from ...graph.domains import components_of
from ...graph.elements import ELEMENTS, TRANSDUCERS, Kind
from ...graph.network import (
    Bond,
    BondEnd,
    BondGraph,
    Element,
    Integral,
    Junction,
    Law,
    MechanismNode,
    Node,
    Port,
    Quantity,
    Reading,
    Switch,
)
from ...source import Span
from ...syntax import tree
from ..expressions.template import CompiledLaw
from ..mechanisms.blocks import build_mechanism
from ..mechanisms.part_attributes import counted, of_dimension, static
from ..names.domain_table import junction_width
from ..names.errors import UnknownAttribute, WrongConnection, WrongLaw, WrongMechanism, WrongValue
from ..names.scope import ElementEntry, Scope
from ..names.statement_errors import AlreadyTold, Wrong, suggestion
from ..resolution.cycles import refuse_frequencies
from ..resolution.elaboration_cache import ElaborationCache
from ..resolution.resolver import read_condition
from .connect import Connector
from .elaborate import Elaborator
from .laws import compile_law
from .transducers import expand_transducers, has_many_ports

MOST_NAMES = 12  # that a message lists

# A scope (which lives as long as this does), an element's kind, its ports with their domains, and a law's words.
_Wording = tuple[int, str, tuple[tuple[str, str, bool], ...], str]


class Nodes:
    """Builder of the nodes and bonds of the flat graph."""

    def __init__(self, elaborator: Elaborator, known: ElaborationCache) -> None:
        self.elaborator = elaborator
        self.nodes: list[Node] = []
        self.bonds: list[Bond] = []
        self.switches: list[Switch] = []
        self.walls: dict[tuple[str, str], int] = {}
        self.ends: dict[tuple[str, str], BondEnd] = {}
        self._laws = known.laws
        self._alike: dict[_Wording, CompiledLaw] = {}
        self._interned = known.interned

    def build(self) -> None:
        elaborator = self.elaborator
        for scope, declaration, entry in elaborator.elements:
            before = len(self.nodes)
            elaborator.guard(self._element, scope, declaration, entry)
            if (
                len(self.nodes) == before and declaration.kind != "splitter"
            ):  # its law is wrong: its bonds can still be checked
                for number, port in enumerate(entry.ports):
                    self.ends[entry.name, port] = BondEnd(before, number if declaration.kind in ELEMENTS else 0)
                self.nodes.append(_placeholder(entry))
        connector = Connector(elaborator)
        connector.connect()
        for name, kind, domain, scope, span, bundle in connector.anonymous:
            self.ends[name, ""] = BondEnd(len(self.nodes), 0)
            self.nodes.append(Junction(name, Kind(kind), domain, f"{scope.definition.name}.{kind}(…)", span, bundle))
        self._mechanisms(connector)
        self.bonds = connector.bonds(self.ends)
        self.walls = connector.passed
        self._share_ports()
        expand_transducers(self.nodes, self.bonds, self.walls)

    def _element(self, scope: Scope, declaration: tree.Declaration, entry: ElementEntry) -> None:
        if declaration.kind == "splitter":
            return
        index = len(self.nodes)
        definition = f"{scope.definition.name}.{entry.name.removeprefix(scope.path).split('[')[0]}"
        if declaration.kind in ("0", "1"):
            if isinstance(declaration.definition, tree.LawSyntax):
                hint = "A junction has none: a 0-junction shares its effort, a 1-junction its flow."
                raise Wrong(WrongLaw(declaration.definition.span, f"The junction `{entry.name}` has a law", hint))
            wide = junction_width(declaration) is not None or "" not in entry.ports
            bundle = scope.full(entry.name.removeprefix(scope.path).partition("[")[0]) if wide else ""
            for component, domain in entry.ports.items():
                name = f"{entry.name}.{component}" if component else entry.name
                self.ends[entry.name, component] = BondEnd(len(self.nodes), 0)
                self.nodes.append(Junction(name, Kind(declaration.kind), domain.name, definition, entry.span, bundle))
                for attribute in declaration.attributes:
                    self._active(scope, attribute, name)
            return
        compiled, alike = self._law(scope, declaration, entry)
        arguments = tuple(self.elaborator.scalar_at(slot, scope).reference for slot in compiled.slots)
        if alike is not None and not compiled.checks:  # with points of tables, each error has its own place in the text
            self._alike.setdefault(alike, compiled)
        ports = tuple(Port(n, d.name) for n, d in entry.ports.items())
        for number, port in enumerate(ports):
            self.ends[entry.name, port.name] = BondEnd(index, number)
        attributes = _Attributes(self.elaborator, scope, entry, compiled.stored or compiled.remembered)
        for attribute in declaration.attributes:
            self.elaborator.guard(attributes.read, attribute)
        row = ELEMENTS[declaration.kind]
        if compiled.remembered:
            arguments += self._remember(entry, compiled.remembered, attributes.starts.pop(0, None))
        self.nodes.append(
            Element(
                entry.name, row.node, row.letters != declaration.kind or bool(compiled.remembered), ports, compiled.law, arguments, compiled.stored,
                attributes.starts, attributes.nominals, attributes.words.get("prefer"), attributes.words.get("require"), definition, entry.span,
            )
        )  # fmt: skip

    def _remember(
        self, entry: ElementEntry, variables: tuple[str, ...], start: tuple[str, Bound] | None
    ) -> tuple[Quantity, ...]:
        """Add the integrals that a law reads: the displacement is that of its flow, the momentum that of its effort."""
        found = []
        (domain,) = entry.ports.values()
        for variable in variables:
            name = f"{entry.name}.{domain.letter(variable)}"
            rate = bind(Symbol(Reading(entry.name, "", {"q": "f", "p": "e"}[variable])))
            first = start[1] if start is not None and start[0] == variable else bind(ZERO)
            self.elaborator.remember(Integral(name, rate, first, entry.span), str(domain.dimension(variable)))
            found.append(Quantity(name))
        return tuple(found)

    def _active(self, scope: Scope, attribute: tree.Attribute, name: str) -> None:
        """Read the condition under which a junction is active."""
        twice = any(s.junction == name for s in self.switches)
        if attribute.name != "active" or attribute.target is not None or twice:
            raise Wrong(UnknownAttribute(attribute.span, name, attribute.name, "A junction has `active`, once."))
        hint = "A junction is on where a condition holds: `active = not open`, `active = x > 0 m`."
        _, condition = read_condition(self.elaborator, attribute.value, scope, hint)
        self.switches.append(Switch(name, condition, attribute.span))

    def _law(
        self, scope: Scope, declaration: tree.Declaration, entry: ElementEntry
    ) -> tuple[CompiledLaw, _Wording | None]:
        """Return the law of an element, and its text if it is the first element with that text.

        A law is compiled once for all instances, and once for all elements of a scope with the same text.
        """
        elaborator = self.elaborator
        known = self._laws.setdefault(id(declaration), [])
        ports = tuple(entry.ports)
        found = next((law for law in known if law.ports == ports and elaborator.fits(law, scope)), None)
        alike: _Wording | None = None
        if found is None and declaration.definition is not None:
            domains = tuple((port, domain.name, domain.typed) for port, domain in entry.ports.items())
            alike = id(scope), declaration.kind, domains, declaration.definition.span.text
            found = self._alike.get(alike)
        if found is None:
            try:
                compiled = compile_law(
                    declaration, entry.name, entry.ports, scope, elaborator.resolve, elaborator.scalar_at
                )
            except Wrong:
                if elaborator.table_of(scope.definition).diagnostics:
                    raise AlreadyTold from None  # with a wrong domain its letters mean nothing
                raise
            found = replace(compiled, law=self._interned.setdefault(compiled.law, compiled.law))
            known.append(found)
        elaborator.check(found.checks, found.slots, scope)
        if {d.name for d in entry.ports.values()} == {"rotation"} and isinstance(
            declaration.definition, tree.LawSyntax
        ):
            for equation in declaration.definition.equations:
                if equation.left.span.text in ("f", "omega"):
                    refuse_frequencies(elaborator, scope, equation.right, "the flow of a rotation")
        return found, alike

    def _mechanisms(self, connector: Connector) -> None:
        elaborator = self.elaborator
        for scope, statement, entry in elaborator.mechanisms:
            mechanism = build_mechanism(elaborator, statement, entry)
            used = dict.fromkeys(
                t.port for s in connector.segments for t in (s.tail, s.head) if t.node == entry.name and not t.side
            )
            ports = tuple(Port(p, elaborator.port_domain(entry.name, p).name) for p in used)
            for number, port in enumerate(ports):
                self.ends[entry.name, port.name] = BondEnd(len(self.nodes), number)
            if not mechanism.bodies and not elaborator.diagnostics:
                hint = "Declare what moves: `body name { mass = … }`."
                elaborator.tell(WrongMechanism(statement.span, f"The mechanism `{entry.name}` has no body", hint))
            definition = f"{scope.definition.name}.{statement.name}"
            self.nodes.append(MechanismNode(entry.name, Kind.MECHANISM, ports, mechanism, definition, entry.span))

    def _share_ports(self) -> None:
        """Insert a 1-junction at each port of a mechanism with several bonds, which share its flow."""
        by_port: dict[BondEnd, list[int]] = {}
        for number, bond in enumerate(self.bonds):
            for end in (bond.tail, bond.head):
                if isinstance(self.nodes[end.node], MechanismNode):
                    by_port.setdefault(end, []).append(number)
        for end, numbers in by_port.items():
            if len(numbers) < 2:
                continue
            node = self.nodes[end.node]
            assert isinstance(node, MechanismNode)
            port = node.ports[end.port]
            junction = BondEnd(len(self.nodes), 0)
            self.nodes.append(Junction(f"{node.name}.{port.name}", Kind.ONE, port.domain, node.definition, node.span))
            for number in numbers:
                bond = self.bonds[number]
                self.bonds[number] = replace(bond, tail=junction) if bond.tail == end else replace(bond, head=junction)
            first = self.bonds[numbers[0]]
            self.bonds.append(Bond(junction, end, port.domain, first.span))


class _Attributes:
    """Attributes of an element. `stored`: what its ports store, or the integrals that its law reads."""

    def __init__(self, elaborator: Elaborator, scope: Scope, entry: ElementEntry, stored: tuple[str, ...]) -> None:
        self.elaborator, self.scope, self.entry, self.stored = elaborator, scope, entry, stored
        self.starts: dict[int, tuple[str, Bound]] = {}
        self.nominals: dict[int, tuple[str, Bound]] = {}
        self.words: dict[str, str] = {}  # of `prefer` and `require`

    def read(self, attribute: tree.Attribute) -> None:
        """Read one attribute. Raises `Wrong`."""
        entry, row = self.entry, ELEMENTS[self.entry.kind]
        numbers = ["start", "nominal"] if row.stored else ["start"] if row.remembered else []
        if attribute.name in numbers:
            self._stored_value(attribute)
            return
        if attribute.name not in ("prefer", "require"):
            known = [*numbers, "prefer", "require"]
            hint = suggestion(attribute.name, known, f"`{entry.kind}` has: {', '.join(known)}.")
            raise Wrong(UnknownAttribute(attribute.span, entry.name, attribute.name, hint))
        word = attribute.value.words if isinstance(attribute.value, tree.PathSyntax) else attribute.value.span.words
        allowed = ["integral", "derivative", "effort", "flow"] if row.stored else ["effort", "flow"]
        if word not in allowed:
            hint = suggestion(word, allowed, f"It can be: {', '.join(allowed)}.")
            raise Wrong(WrongValue(attribute.value.span, attribute.name, entry.name, word, hint))
        self.words[attribute.name] = word

    def _stored_value(self, attribute: tree.Attribute) -> None:
        entry, ports = self.entry, list(self.entry.ports)
        words = attribute.target.words if attribute.target is not None else ""
        stem, _, letter = words.rpartition(".")
        stem, letter = (words, "") if words in ports or components_of(ports, words) else (stem, letter)
        group = list(components_of(ports, stem).values()) or [stem]  # of a multibond all at once, by a list
        variables = [self._variable(port, letter) for port in group]
        misplaced = attribute.name == "nominal" and variables != [self._stored(port) for port in group]
        if None in variables or misplaced:
            names = [
                f"{p}.{d.letter(v)}" if p else d.letter(v) for p, d in entry.ports.items() for v in self._allowed(p)
            ]
            hint = f"Write `{attribute.name} {names[0]} = …`; it can name: {', '.join(names[:MOST_NAMES])}{'…' * (len(names) > MOST_NAMES)}."
            raise Wrong(UnknownAttribute(attribute.span, entry.name, f"{attribute.name} {words}".strip(), hint))
        what = f"{attribute.name} {words}"
        target = self.starts if attribute.name == "start" else self.nominals
        template = self.elaborator.template(attribute.value, self.scope)
        expected = "A single number" if len(group) == 1 else f"A list of {len(group)}"
        parts = counted(template, attribute.value, (len(group),), expected)
        for part, port, variable in zip(parts, group, variables, strict=True):
            of_dimension(
                (part,), attribute.value, self.scope, (entry.ports[port].dimension(variable or ""),), f"`{what}`"
            )
        bounds = static(self.elaborator, template, self.scope, f"`{what}`", attribute.value.span)
        for bound, port, variable in zip(bounds, group, variables, strict=True):
            if ports.index(port) in target:
                raise Wrong(UnknownAttribute(attribute.span, entry.name, what, "It is given twice."))
            target[ports.index(port)] = (variable or "", bound)

    def _stored(self, port: str) -> str:
        return self.stored[list(self.entry.ports).index(port)]

    def _allowed(self, port: str) -> str:
        """Variables by which the start of a port is given."""
        stored = self._stored(port)
        return stored + {"q": "e", "p": "f"}[stored] if ELEMENTS[self.entry.kind].stored else "".join(self.stored)

    def _variable(self, port: str, letter: str) -> str | None:
        """Variable of a port that a letter names; None for one that gives no start."""
        domain = self.entry.ports.get(port)
        if domain is None:
            return None
        variable = domain.variable(letter) if letter else self._stored(port)
        return variable if variable is not None and variable in self._allowed(port) else None


def _placeholder(entry: ElementEntry) -> Node:
    """Node in place of one with an error, so that its bonds can be checked. The graph is never used."""
    if entry.kind not in ELEMENTS:
        return Junction(entry.name, Kind(entry.kind), next(iter(entry.ports.values())).name, "", entry.span)
    ports = tuple(Port(n, d.name) for n, d in entry.ports.items())
    kind = ELEMENTS[entry.kind].node
    return Element(entry.name, kind, False, ports, Law((), None, 0), (), (), {}, {}, None, None, "", entry.span)


def unconnected(graph: BondGraph) -> list[Diagnostic]:
    """Check that every port of an element has exactly one bond and every junction at least one."""
    bonds: dict[BondEnd, list[Span]] = {}
    for bond in graph.bonds:
        for end in (bond.tail, bond.head):
            bonds.setdefault(end, []).append(bond.span)
    result: list[Diagnostic] = []
    for number, node in enumerate(graph.nodes):
        if isinstance(node, Junction):
            if BondEnd(number, 0) not in bonds:
                what = f"No bond reaches the junction `{node.name}`"
                result.append(WrongConnection(node.span, what, "Connect it, or leave it out."))
            continue
        if isinstance(node, MechanismNode):
            continue
        for port_number, port in enumerate(node.ports):
            spans = bonds.get(BondEnd(number, port_number), [])
            named = port.name and (node.kind not in TRANSDUCERS or has_many_ports(node))
            name = f"{node.name}.{port.name}" if named else node.name
            if len(spans) > 1:
                hint = "Every port has one bond; put a 0- or 1-junction between."
                result.append(
                    WrongConnection(spans[1], f"`{name}` has {len(spans)} bonds", hint, ((spans[0], "one of them"),))
                )
            elif not spans:
                side = {"1": "into side 1", "2": "out of side 2"}.get(port.name, "")
                what = f"No bond goes {side} of `{name}`" if side else f"No bond reaches `{name}`"
                result.append(WrongConnection(node.span, what, "Connect it, or leave it out."))
    return result
