"""Names of the text for names of the graph. Valid ones stay, also `mass[1]`; `comb[1].folded` becomes `comb_1_folded`.

All stay distinct, and none takes a letter that a law needs for its own variables.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field

from ..fast_dataclass import dataclass
from ..graph.domains import DOMAINS
from ..graph.elements import OF_NODE, TRANSDUCERS
from ..graph.mechanism import Mechanism
from ..graph.network import Bond, BondEnd, BondGraph, Element, MechanismNode, Quantity, Reading
from ..semantics.names.scope import RESERVED
from .literals import word_of
from .ports import seen_at_a_node


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
