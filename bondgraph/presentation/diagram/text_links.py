"""Places in the text behind the parts of a diagram: of each declaration, and of the instances that contain it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from compiler.api import Compilation, Span

from .diagram_model import DiagramModel


def text_links(
    compilation: Compilation, diagram: DiagramModel
) -> tuple[list[tuple[Span, ...]], list[tuple[Span, ...]]]:
    """Return the places of the nodes and of the lines of a diagram, in its order; first their own, then those around."""
    graph, stands = compilation.causal.graph, compilation.whole_graph.stands
    nodes = [
        tuple(_places(stands, *((graph.nodes[m].name, graph.nodes[m].span) for m in node.members)))
        for node in diagram.nodes
    ]
    lines = [tuple(_places(stands, *(("", graph.bonds[b].span) for b in line.bonds))) for line in diagram.lines]
    return nodes, lines


def _places(stands: Mapping[str, Span], *named: tuple[str, Span]) -> Iterator[Span]:
    for name, span in named:
        parts = name.partition("(")[0].split(".")
        owners = [".".join(parts[:i]) for i in range(1, len(parts))]
        yield span
        yield from (stands[o] for o in owners if o in stands)
