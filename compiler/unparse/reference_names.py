"""Names in the text for names and references of the graph, with their dimensions.

Valid ones stay, also `mass[1]`; `comb[1].folded` becomes `comb_1_folded`.
All stay distinct, and none takes a letter that a law needs for its own variables.
A flat text has no model ports: readings of them become readings of a node at the bond.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field

from ..algebra.expression import Expression
from ..algebra.formula import Bound, over
from ..fast_dataclass import dataclass
from ..graph.domains import DOMAINS
from ..graph.elements import OF_NODE, TRANSDUCERS, Kind
from ..graph.mechanism import Mechanism, domain_of
from ..graph.network import (
    Bond,
    BondEnd,
    BondGraph,
    Element,
    Junction,
    MechanismNode,
    Named,
    PortVariable,
    Quantity,
    Reading,
)
from ..graph.units import ONE, SECOND, Dimension
from ..semantics.names.scope import RESERVED
from .errors import UnwrittenPort
from .expressions import Printer, SymbolText
from .literals import NotWritable, dimension_of, word_of


class Words:
    """The words of one graph."""

    def __init__(self, graph: BondGraph, names: ReferenceNames, plain: bool) -> None:
        self.graph, self.names, self.plain = graph, names, plain
        self.printer = Printer(plain)
        self.constants: dict[float, str] = {}  # numbers that need a name
        self._nodes = {n.name: n for n in graph.nodes}
        outputs = {n for n in graph.outputs if n not in names.outputs}
        self._readable = {w for n, w in names.quantities.items() if n not in outputs}  # words that laws may read

    def bound(self, bound: Bound, wanted: Dimension) -> str:
        """A bound formula as text, in the SI unit of a dimension."""
        return self.printer.text(self._named(bound), wanted)

    def usual(self, bound: Bound) -> Dimension:
        """Dimension of a bound formula in which bare numbers have none."""
        return self.printer.usual(self._named(bound))

    def condition(self, bound: Bound) -> str:
        """A bound condition as text."""
        return self.printer.condition(self._named(bound))

    def _named(self, bound: Bound) -> Expression:
        """A bound formula over words."""
        texts = [a if isinstance(a, float) else self.reference(a) for a in bound.arguments]
        return over(bound.formula.expression, texts)

    def dimension(self, named: Named) -> Dimension:
        """Dimension of a quantity."""
        return ONE if self.plain else dimension_of(named.unit)

    def letter(self, domain: str, variable: str) -> str:
        """Letter for `e`, `f`, `q` or `p`."""
        return variable if self.plain else DOMAINS[domain].letter(variable)

    def is_time(self, reference: Quantity) -> bool:
        """Return True for the time, unless a quantity has that name."""
        return reference.name == "time" and "time" not in self.graph.quantities

    def reference(self, reference: Quantity | Reading) -> SymbolText:
        """Word for a reference in a law or definition."""
        if isinstance(reference, Reading):
            return self._reading(reference)
        if self.is_time(reference):
            return SymbolText("time", ONE if self.plain else SECOND)
        named = self.graph.quantities[reference.name]
        if named.role == "rate":
            assert named.definition is not None
            per_second = self.dimension(named)
            return SymbolText(
                f"der({self.bound(named.definition, per_second if self.plain else per_second * SECOND)})", per_second
            )
        return SymbolText(self.names.quantities[reference.name], self.dimension(named))

    def _reading(self, reading: Reading) -> SymbolText:
        reading = self._at_a_node(reading)
        node, variable = self._nodes[reading.node], reading.variable
        name = self.names.nodes[node.name]
        if isinstance(node, Junction):
            return SymbolText(f"{name}.{self.letter(node.domain, variable)}", DOMAINS[node.domain].dimension(variable))
        if isinstance(node, MechanismNode):
            return self._of_a_part(node, reading)
        port = next(p for p in node.ports if p.name == reading.port)
        letter = self.letter(port.domain, variable)
        if node.kind in TRANSDUCERS:
            path = f"{name}.{letter}{port.name}"
        else:
            path = f"{name}.{port.name}.{letter}" if port.name else f"{name}.{letter}"
        return SymbolText(path, DOMAINS[port.domain].dimension(variable))

    def _of_a_part(self, node: MechanismNode, reading: Reading) -> SymbolText:
        """`stage.pin.phi`, `stage.pin.phi.omega`, `stage.pin.reaction.x`."""
        part, _, inner = reading.port.partition(".")
        domain, variable = DOMAINS[domain_of(reading.port)], reading.variable
        path = f"{self.names.nodes[node.name]}.{self.names.parts[node.mechanism.name, part]}.{inner}"
        alone = variable == "q" or "." in inner  # a reaction or attitude has no letters
        return SymbolText(path if alone else f"{path}.{domain.letter(variable)}", domain.dimension(variable))

    def _at_a_node(self, reading: Reading) -> Reading:
        """A reading of a model's port as a reading of a node. Raises `NotWritable`."""
        found = seen_at_a_node(self.graph, reading)
        if found is None:
            domain = self.graph.bonds[self.graph.walls[reading.node, reading.port]].domain
            words = (reading.node, reading.port, self.letter(domain, reading.variable))
            raise NotWritable(UnwrittenPort, words=".".join(w for w in words if w))
        return found

    def own(self, node: Element, own: PortVariable) -> SymbolText:
        """An element's own variable: by its domain's letter, or by `e f q p` if another name equals that letter."""
        port = node.ports[own.port]
        domain = DOMAINS[port.domain]
        letter = self.letter(port.domain, own.variable) if domain.guessed else own.variable
        if node.kind in TRANSDUCERS:
            text = letter + port.name
        elif not port.name:
            text = letter if letter not in self._readable else own.variable
        elif own.variable == OF_NODE[node.kind].stored and port.name not in self._readable:
            text = port.name
        else:
            text = f"{port.name}.{letter}"
        return SymbolText(text, domain.dimension(own.variable))

    def constant(self, value: float) -> SymbolText:
        """A number with a name."""
        if value not in self.constants:
            self.constants[value] = name = self.names.free("constant_1", set(), self.names.taken)
            self.names.taken.add(name)
        return SymbolText(self.constants[value], ONE)


@dataclass(slots=True)
class ReferenceNames:
    """Map from names of the graph to names of the text."""

    quantities: dict[str, str] = field(default_factory=dict)
    outputs: dict[str, str] = field(default_factory=dict)
    nodes: dict[str, str] = field(default_factory=dict)
    parts: dict[tuple[str, str], str] = field(default_factory=dict)
    taken: set[str] = field(default_factory=set)

    def free(self, name: str, blocked: set[str], taken: set[str]) -> str:
        """An unused valid name similar to this one."""
        word = re.sub(r"[^A-Za-z0-9_]+", "_", name)
        word = (word if word == name else word.strip("_")) or "unnamed"
        word = word if not word[0].isdigit() else f"n{word}"
        found, number = word, 1
        while found in taken or found in blocked:
            number += 1
            found = f"{word}_{number}"
        return found


def _own_words(node: Element) -> set[str]:
    """Words that the law of an element uses for its own variables."""
    if is_field(node):
        return {p.name for p in node.ports}
    letters = [(p, v, DOMAINS[p.domain].letter(v)) for p in node.ports for v in _variables(node)]
    return {letter + p.name for p, *both in letters for letter in both}


def _variables(node: Element) -> str:
    """Variables that the law of an element may relate."""
    return OF_NODE[node.kind].variables


def is_field(node: Element) -> bool:
    """Return True for an element with named ports, whose variables are written `port.letter`."""
    return node.kind not in TRANSDUCERS and bool(node.ports[0].name)


def choose_names(
    graph: BondGraph, shared: Mapping[str, BondEnd], separate: Sequence[str], plain: bool
) -> ReferenceNames:
    """Give every name of the graph a name of the text; valid ones stay. `separate` outputs need a name of their own."""
    elements = [n for n in graph.nodes if isinstance(n, Element)]
    reserved = {*RESERVED, "energy"}
    always = reserved | _blocked_letters(graph, elements, plain)
    outputs = {("quantity", n) for n in {*graph.outputs} - {*separate}} | {("output", n) for n in separate}
    blocked = _blocked_by_readers(graph, elements)
    names = ReferenceNames()
    wanted = [("quantity", n) for n in graph.quantities] + [("output", n) for n in separate]
    wanted += [("node", n.name) for n in graph.nodes if n.name not in shared]
    home = {"quantity": names.quantities, "output": names.outputs, "node": names.nodes}
    later = []
    letters = {word for element in elements for word in _own_words(element)}
    plain_names = {name for _, name in wanted if name == word_of(name)}

    def refused_for(key: tuple[str, str]) -> set[str]:
        """Words that a name cannot be. Laws do not read outputs, which may have their letters."""
        return (reserved if key in outputs else always) | blocked.get(key, set())

    for kind, name in wanted:
        word = word_of(name)
        refused = name in names.taken or word in refused_for((kind, name))
        if word != name:  # of an array: its word must be free too
            refused = refused or word in plain_names or word in letters
        if word is not None and not refused:
            home[kind][name] = name
            names.taken |= {name, word}
        else:
            later.append((kind, name))
    for kind, name in later:
        home[kind][name] = found = names.free(name, refused_for((kind, name)), names.taken)
        names.taken.add(found)
    for node in graph.nodes:
        if isinstance(node, MechanismNode):
            _part_names(node.mechanism, names, always)
    return names


def _blocked_by_readers(graph: BondGraph, elements: Sequence[Element]) -> dict[tuple[str, str], set[str]]:
    """Names that a quantity or node cannot have, because a law that reads it uses them for its own variables."""
    blocked: dict[tuple[str, str], set[str]] = {}
    for element in elements:
        words = _own_words(element)
        for argument in element.arguments:
            found = seen_at_a_node(graph, argument) if isinstance(argument, Reading) else argument
            if isinstance(found, Quantity | Reading):
                key = ("quantity", found.name) if isinstance(found, Quantity) else ("node", found.node)
                blocked.setdefault(key, set()).update(words)
    return blocked


def _part_names(mechanism: Mechanism, names: ReferenceNames, always: set[str]) -> None:
    """Names of parts, which are looked up before quantities: no quantity may have the name of one."""
    taken = {w for name in names.quantities.values() for w in (name, word_of(name) or name)}
    bodies, frames, joints = mechanism.bodies, mechanism.frames, mechanism.joints
    parts = [b.name for b in bodies] + [f.name for f in frames] + [j.name for j in joints]
    for name in sorted(parts, key=lambda n: n != word_of(n)):  # those that can stay come first
        word = word_of(name)
        stays = word is not None and not {name, word} & (taken | always)
        found = name if stays else names.free(name, always, taken)
        names.parts[mechanism.name, name] = found
        taken.add(found)


def _blocked_letters(graph: BondGraph, elements: Sequence[Element], plain: bool) -> set[str]:
    """Letters that no quantity may have, because a law needs them to name its own variable or to imply its domain."""
    # An output that an experiment does not report is written as a signal, which a law could read.
    read = {n for n, q in graph.quantities.items() if q.role != "output" or n not in graph.outputs}
    blocked: set[str] = set()
    for element in elements:
        if element.kind in TRANSDUCERS:
            blocked |= _own_words(element)
        elif not is_field(element):
            domain = DOMAINS["untyped" if plain else element.ports[0].domain]
            letters = {v: domain.letter(v) if domain.guessed else v for v in _variables(element)}
            blocked |= {v for v, letter in letters.items() if letter == v or letter in read}
    if not plain:
        for tail, _, _ in lone_bonds(graph):
            blocked |= _own_words(tail)
    return blocked


def lone_bonds(graph: BondGraph) -> Iterator[tuple[Element, Element, Bond]]:
    """Bonds between two elements. No junction, field or mechanism gives their domain, so the letters of a law must imply it."""
    for bond in graph.bonds:
        tail, head = graph.nodes[bond.tail.node], graph.nodes[bond.head.node]
        if isinstance(tail, Element) and isinstance(head, Element) and not is_field(tail) and not is_field(head):
            yield tail, head, bond


def seen_at_a_node(graph: BondGraph, reading: Reading) -> Reading | None:
    """The same variable as a reading that a text can have; None if neither end of the bond shows it.

    An element shows both variables, a junction the one that its bonds share, a mechanism the flow (its effort has the sign of the part).
    """
    number = graph.walls.get((reading.node, reading.port))
    if number is None:
        return reading
    bond = graph.bonds[number]
    for end in (bond.tail, bond.head):
        node = graph.nodes[end.node]
        if isinstance(node, Element) or (isinstance(node, MechanismNode) and reading.variable == "f"):
            return Reading(node.name, node.ports[end.port].name, reading.variable)
        if isinstance(node, Junction) and reading.variable == ("e" if node.kind is Kind.ZERO else "f"):
            return Reading(node.name, "", reading.variable)
    return None
