"""Signals: quantities of other elements that laws read, drawn with full arrows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from compiler.api import BondGraph, Element, Quantity, Reading

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
