"""Diagram model: contents of a diagram before the layout, that is nodes with letters, bonds with strokes, signals.

It is made from the causal graph, so that every stroke is the compiler's. Parallel bonds between the same two nodes, with equal strokes, are one
multibond; junctions that such bonds pass through together are one junction, and so are those that the text declares as one of a width, and what a
transducer of multibonds is made of. A junction that is off has each of its bonds at a source of zero in the graph; a diagram has the junction
itself, with all its bonds. Signals are quantities of other elements that laws read.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from compiler.api import (
    BondGraph,
    CausalGraph,
    Compilation,
    Element,
    GraphNode,
    Junction,
    Kind,
    MechanismNode,
    Quantity,
    Reading,
    letters,
)

from ..text.causality import explain

TAIL, HEAD = 0, 1
# Number of a junction in the whole graph -> for each of its bonds the source of zero in the graph; None for one that gives nothing and is left out.
OffJunctions = dict[int, tuple[int | None, ...]]
OUTSIDE = frozenset({"parameter", "constant"})  # constant quantities need no arrow


@dataclass(frozen=True, slots=True)
class Signal:
    """An arrow into an element: from the node whose variable its law reads, or from outside (None) with a name."""

    source: int | None
    target: int
    label: str


def signals_of(graph: BondGraph, of: Mapping[int, int]) -> Iterator[Signal]:
    """Yield the signals of every modulated element: one arrow from each node that it reads, directly or through named signals.

    If there is none, one arrow from outside with the names of the signals. `of` maps a node of the graph to its node of the diagram.
    """
    numbers = {node.name: number for number, node in enumerate(graph.nodes)}
    seen: set[tuple[int | None, int]] = set()
    for number, node in enumerate(graph.nodes):
        if not isinstance(node, Element) or not node.modulated:
            continue
        target, names = of[number], _names(graph, node)
        read = [of[m] for m in _read(graph, node, numbers)]
        sources: list[int | None] = [s for s in dict.fromkeys(read) if s != target]
        if not sources and names and not read:
            sources = [None]
        for source in sources:
            if (source, target) not in seen:
                seen.add((source, target))
                yield Signal(source, target, ", ".join(names))


def _names(graph: BondGraph, node: Element) -> list[str]:
    """Return the named quantities that a law reads, without constant ones."""
    names = [a.name for a in node.arguments if isinstance(a, Quantity)]
    quantities = {**graph.outputs, **graph.quantities}
    return [n for n in dict.fromkeys(names) if n in quantities and quantities[n].role not in OUTSIDE]


def _read(graph: BondGraph, node: Element, numbers: Mapping[str, int]) -> list[int]:
    """Return the nodes whose variables a law reads, through any signals."""
    quantities = {**graph.outputs, **graph.quantities}
    waiting, done, found = list(node.arguments), set[str](), dict[int, None]()
    while waiting:
        item = waiting.pop(0)
        if isinstance(item, Reading):
            number = numbers.get(item.node)
            if number is None and (item.node, item.port) in graph.walls:  # a port of a model: the node inside
                number = graph.bonds[graph.walls[item.node, item.port]].head.node
            if number is not None:
                found[number] = None
        elif isinstance(item, Quantity) and item.name in quantities and item.name not in done:
            done.add(item.name)
            definitions = [quantities[item.name].definition]
            if item.name in graph.integrals:
                definitions.append(graph.integrals[item.name].rate)
            if item.name in graph.delays:
                definitions.append(graph.delays[item.name].value)
            waiting += [a for d in definitions if d is not None for a in d.arguments]
    return list(found)


@dataclass(frozen=True, slots=True)
class DiagramNode:
    """An element, a junction, or a box: a mechanism or a submodel that is not expanded."""

    name: str
    letter: str  # letter as drawn: `I`, `MSe`, `0`; the kind of a box
    label: str  # text beside the letter; empty for a junction without a name
    shape: str  # element, junction or box; in a layout also signal or stub
    members: tuple[int, ...]  # nodes of the graph
    place: str  # file:line
    inside: str  # its instance, or empty
    derivative: bool = False
    loop: bool = False


@dataclass(frozen=True, slots=True)
class DiagramLine:
    """A bond or a multibond from `tail` to `head`; the stroke is at the end that receives the effort."""

    bonds: tuple[int, ...]  # indices in the graph; none for a bond of a junction that is off, where nothing is computed
    tail: int
    head: int
    ports: tuple[str, str]  # at tail and head, as far as they have names
    stroke: int  # TAIL or HEAD
    domain: str
    place: str
    derivative: bool = False
    loop: bool = False

    @property
    def ends(self) -> tuple[int, int]:
        return self.tail, self.head


@dataclass(frozen=True, slots=True)
class DiagramModel:
    """Contents of a diagram."""

    name: str
    nodes: tuple[DiagramNode, ...]
    lines: tuple[DiagramLine, ...]
    signals: tuple[Signal, ...]
    left_out: tuple[str, ...]
    instances: Mapping[str, str]  # instance -> its model


def diagram_model_of(compilation: Compilation, closed: bool = False) -> DiagramModel:
    """Return the contents of the diagram of a scene. `closed`: instances of the model are boxes. Raises `CompilationFailed`."""
    causal = compilation.causal
    graph = causal.graph
    found = explain(compilation)
    looping = frozenset(name for loop in found.loops for name in loop.members)
    instances = _instances(compilation.whole_graph)
    switched = off_junctions(compilation)
    bundles = {end: f"off {number}" for number, ends in switched.items() for end in ends if end is not None}
    homes = _boxes(graph, instances if closed else {}, bundles)
    groups = _twins(causal, homes)
    of = {member: number for number, group in enumerate(groups) for member in group}
    derivative = frozenset(end.node for end in causal.derivative)
    nodes = [_node(graph, group, instances, derivative, looping, closed) for group in groups]
    places = _switch_off(compilation.whole_graph, switched, of, nodes, instances)
    lines = (*_lines(causal, of, nodes), *_idle_lines(compilation, switched, of, nodes, places))
    signals = tuple(s for s in signals_of(graph, of) if s.source is not None or nodes[s.target].shape != "box")
    kept = {node.name for node in (*graph.nodes, *nodes)}
    left_out = tuple(n.name for n in compilation.whole_graph.nodes if n.name not in kept)
    return DiagramModel(graph.name, tuple(nodes), lines, signals, left_out, instances)


# ---------------------------------------------------------------- nodes


def _instances(graph: BondGraph) -> dict[str, str]:
    """Return the instances declared in the model itself, with the names of their models."""
    found = {name: "" for name in graph.stands if "." not in name}
    for node in graph.nodes:
        first, dot, rest = node.name.partition(".")
        if dot and first in found and "." not in _plain(rest):
            found[first] = node.definition.partition(".")[0]
    return found


def _plain(name: str) -> str:
    """Return a name without text in parentheses."""
    return name.partition("(")[0]


def _boxes(graph: BondGraph, instances: Mapping[str, str], bundles: Mapping[int, str]) -> tuple[tuple[int, ...], ...]:
    """Return the nodes of each instance together, and those of each multibond and of each of `bundles`; all others alone."""
    boxes: dict[str, list[int]] = {}
    for number, node in enumerate(graph.nodes):
        first = _plain(node.name).partition(".")[0]
        inside = first in instances and first != _plain(node.name)
        bundle = bundles.get(number) or ("" if isinstance(node, MechanismNode) else node.bundle)
        boxes.setdefault(first if inside else f"\0{bundle or number}", []).append(number)
    return tuple(map(tuple, boxes.values()))


def _twins(causal: CausalGraph, homes: Sequence[tuple[int, ...]]) -> list[tuple[int, ...]]:
    """Group junctions of one kind whose bonds go, with equal arrows and strokes, to the same multiports: each group is one junction."""
    graph = causal.graph
    home = {member: number for number, group in enumerate(homes) for member in group}
    alike: dict[object, list[int]] = defaultdict(list)
    for number, group in enumerate(homes):
        alike[_signature(causal, group, home) or number].append(number)
    groups = [tuple(m for number in numbers for m in homes[number]) for numbers in alike.values()]
    order = {group: min(group) for group in groups}
    return sorted((g for g in groups if all(m < len(graph.nodes) for m in g)), key=order.__getitem__)


def _signature(causal: CausalGraph, group: tuple[int, ...], home: Mapping[int, int]) -> object:
    """Return the properties that a junction shares with its twins; None for nodes that cannot have twins."""
    graph = causal.graph
    (number, *more) = group
    node = graph.nodes[number]
    if more or not isinstance(node, Junction) or not graph.incident[number]:
        return None
    around = []
    for bond in graph.incident[number]:
        ends = graph.bonds[bond]
        outwards = ends.tail.node == number
        other = (ends.head if outwards else ends.tail).node
        ports = getattr(graph.nodes[other], "ports", ())
        if len(ports) < 2 or graph.nodes[other].kind.value in letters("transducer"):
            return None
        around.append((home[other], outwards, causal.decides_effort(bond, number)))
    return node.kind, node.name.rpartition(".")[0] if "(" not in node.name else "", tuple(sorted(around))


def _node(
    graph: BondGraph, group: tuple[int, ...], instances: Mapping[str, str], derivative: frozenset[int],
    looping: frozenset[str], closed: bool,
) -> DiagramNode:  # fmt: skip
    first = graph.nodes[group[0]]
    name = first.name
    instance = _plain(name).partition(".")[0]
    inside = instance if instance in instances and instance != _plain(name) else ""
    if closed and inside:
        name, letter, label, shape, inside = inside, instances[inside] or "model", inside, "box", ""
    else:
        whole = next((graph.nodes[m] for m in group if isinstance(graph.nodes[m], Element)), first)
        name = first.name if isinstance(first, MechanismNode) else first.bundle or first.name
        letter, shape = _letter(whole), _shape(whole)
        label = _label(graph, group)
    place = first.span.file_and_line
    marks = (any(m in derivative for m in group), any(graph.nodes[m].name in looping for m in group))
    return DiagramNode(name, letter, label, shape, group, place, inside, *marks)


def _switch_off(
    whole: BondGraph,
    switched: OffJunctions,
    of: Mapping[int, int],
    nodes: list[DiagramNode],
    instances: Mapping[str, str],
) -> dict[int, int]:
    """Draw junctions that are off as junctions, in the place of their sources; return their nodes of the diagram, by their numbers in the whole graph."""
    places: dict[int, int] = {}
    for number, ends in switched.items():
        junction = whole.nodes[number]
        sources = tuple(end for end in ends if end is not None)
        at = of[sources[0]] if sources else len(nodes)
        inside = _plain(junction.name).partition(".")[0]
        node = DiagramNode(
            junction.name, str(junction.kind.value), f"{junction.name} (off)", "junction", sources, junction.span.file_and_line,
            inside if inside in instances and "." in junction.name else "",
        )  # fmt: skip
        if at == len(nodes):
            nodes.append(node)
        elif nodes[at].shape != "box":
            nodes[at] = node
        places[number] = at
    return places


def _letter(node: GraphNode) -> str:
    if isinstance(node, Element):
        spreads = node.kind is Kind.RESISTOR and len(node.ports) > 1 and node.ports[-1].domain == "thermal"
        return f"{'M' * node.modulated}{node.kind.value}{'S' * spreads}"
    return str(node.kind.value)


def _shape(node: GraphNode) -> str:
    if isinstance(node, MechanismNode):
        return "box"
    return "junction" if isinstance(node, Junction) else "element"


def _label(graph: BondGraph, group: tuple[int, ...]) -> str:
    names = [graph.nodes[m].name for m in group]
    first = graph.nodes[group[0]]
    if isinstance(first, Junction) and first.bundle:
        return "" if "(" in first.bundle else first.bundle
    if isinstance(first, Junction) and any("(" in n for n in names):
        return ""
    if len(names) == 1:
        return names[0]
    stem = names[0].rpartition(".")[0]
    return stem if all(n.rpartition(".")[0] == stem for n in names) else ", ".join(names)


# ---------------------------------------------------------------- bonds


def _lines(causal: CausalGraph, of: Mapping[int, int], nodes: Sequence[DiagramNode]) -> Iterator[DiagramLine]:
    """Yield the lines between different nodes: parallel bonds with equal strokes as one."""
    graph = causal.graph
    alike: dict[tuple[int, int, int, str], list[int]] = defaultdict(list)
    for number, bond in enumerate(graph.bonds):
        tail, head = of[bond.tail.node], of[bond.head.node]
        if tail != head:
            whole = "" if _bundled(nodes[tail], nodes[head], graph, number) else str(number)
            alike[tail, head, causal.effort_from[number], whole].append(number)
    doors = _doors(graph)
    for (tail, head, effort_from, _), bonds in alike.items():
        ports = tuple(
            _stem([_port(graph, b, side, nodes[number], doors) for b in bonds])
            for side, number in enumerate((tail, head))
        )
        first = graph.bonds[bonds[0]]
        place = first.span.file_and_line
        derivative = any(end in causal.derivative for b in bonds for end in (graph.bonds[b].tail, graph.bonds[b].head))
        loop = nodes[tail].loop and nodes[head].loop
        domains = dict.fromkeys(graph.bonds[b].domain for b in bonds)
        yield DiagramLine(
            tuple(bonds), tail, head, (ports[0], ports[1]), 1 - effort_from, ", ".join(domains), place, derivative, loop
        )


def _doors(graph: BondGraph) -> dict[int, str]:
    """Return the ports of the instances that bonds pass through, by the numbers of the bonds."""
    doors: dict[int, str] = {}
    for (port, _), crossing in graph.walls.items():  # those of the bonds that are drawn
        if port.count(".") == 1:
            doors.setdefault(crossing, port.partition(".")[2])
    return doors


def _idle_lines(
    compilation: Compilation,
    switched: OffJunctions,
    of: Mapping[int, int],
    nodes: Sequence[DiagramNode],
    places: Mapping[int, int],
) -> Iterator[DiagramLine]:
    """Yield the bonds of junctions that are off whose sources are left out, as they give nothing. Such a junction gives the flow, one of kind 0 the effort."""
    whole, graph = compilation.whole_graph, compilation.causal.graph
    numbers = {node.name: of[number] for number, node in enumerate(graph.nodes)}
    doors = _doors(whole)
    for number, sources in switched.items():
        for index, source in zip(whole.incident[number], sources, strict=True):
            bond = whole.bonds[index]
            other = bond.head.node if bond.tail.node == number else bond.tail.node
            far = places.get(other, numbers.get(whole.nodes[other].name))
            if source is not None or far is None or (other in switched and other < number):
                continue
            outwards = bond.tail.node == number
            tail, head = (places[number], far)[:: 1 if outwards else -1]
            ports = tuple(_port(whole, index, side, nodes[n], doors) for side, n in enumerate((tail, head)))
            stroke = TAIL if outwards is (whole.nodes[number].kind is Kind.ONE) else HEAD
            yield DiagramLine((), tail, head, (ports[0], ports[1]), stroke, bond.domain, bond.span.file_and_line)


def _bundled(tail: DiagramNode, head: DiagramNode, graph: BondGraph, number: int) -> bool:
    """Return True if a bond may share a line with parallel ones; False between two single junctions, where each bond is separate."""
    kinds = {graph.nodes[m].kind for n in (tail, head) for m in n.members}
    if kinds <= {Kind.ZERO, Kind.ONE} and len(tail.members) == len(head.members) == 1:
        return False  # bonds in both directions between two junctions
    return number >= 0


def _port(graph: BondGraph, bond: int, side: int, node: DiagramNode, doors: Mapping[int, str]) -> str:
    end = graph.bonds[bond].tail if side == TAIL else graph.bonds[bond].head
    if node.shape == "box" and not isinstance(graph.nodes[end.node], MechanismNode):
        return doors.get(bond, "")
    ports = getattr(graph.nodes[end.node], "ports", ())
    return ports[end.port].name if len(ports) > 1 or (ports and node.shape == "box") else ""


def _stem(names: Iterable[str]) -> str:
    """Return the common part of port names: `flex[1]` of `flex[1].x`, `flex[1].y`; else all of them."""
    names = list(names)
    if len(names) == 1:
        return names[0]
    stems = list(dict.fromkeys(n.rpartition(".")[0] for n in names))
    return ", ".join(stems if all(stems) else dict.fromkeys(names))


def off_junctions(compilation: Compilation) -> OffJunctions:
    """Return the junctions that are off in a scene, but for those of a multibond."""
    whole, graph = compilation.whole_graph, compilation.causal.graph
    switched, off = {s.junction for s in whole.switches}, set(compilation.off)
    sources = {node.name: number for number, node in enumerate(graph.nodes) if isinstance(node, Element)}
    junctions = {node.name for node in graph.nodes if isinstance(node, Junction)}
    switched_off: OffJunctions = {}
    for number, node in enumerate(whole.nodes):
        if not isinstance(node, Junction) or node.bundle or node.name not in switched - junctions:
            continue
        names = [
            f"{node.name} ({count})" if count > 1 else node.name for count in range(1, len(whole.incident[number]) + 1)
        ]
        ends = tuple(map(sources.get, names))
        if node.name in off or any(end is not None for end in ends):
            switched_off[number] = ends
    return switched_off
