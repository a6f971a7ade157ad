"""Junctions that are off: in the graph each of their bonds ends at a source of zero; a diagram has the junction itself, with all its bonds."""

from __future__ import annotations

from compiler.api import Compilation, Element, Junction

# Number of a junction in the whole graph -> for each of its bonds the source of zero in the graph; None for one that gives nothing and is left out.
OffJunctions = dict[int, tuple[int | None, ...]]


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
