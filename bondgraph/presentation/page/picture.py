"""Diagram of a page: the drawing, and for each of its nodes and lines the bonds behind it and their lines of text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from compiler.api import DOMAINS, BondGraph, Compilation, Source, Span

from ..diagram.compose import compose
from ..diagram.diagram_model import diagram_model_of
from ..diagram.frames import place_framed
from ..diagram.svg import svg_text
from ..diagram.text_links import text_links
from ..text.tables import end_name, visible
from .markup import Html

LARGEST = 300  # most nodes: a larger drawing takes half a minute and is not readable


@dataclass(frozen=True, slots=True)
class Picture:
    """Diagram of a page.

    `drawing`: SVG without its own style. `parts`: the meaning of its nodes and lines, in the order of the drawing.
    """

    drawing: Html
    parts: dict[str, Any]


def picture_of(compilation: Compilation, sources: Sequence[Source]) -> Picture:
    """Return the diagram of a compilation with links to its text; an empty one for a graph that is too large."""
    graph = compilation.causal.graph
    if len(graph.nodes) > LARGEST:
        return Picture(Html(""), {"nodes": [], "lines": [], "bonds": []})
    diagram_model = diagram_model_of(compilation)
    named, layout, frames = place_framed(diagram_model)
    files = {source.name: number for number, source in enumerate(sources)}
    node_places, line_places = text_links(compilation, named)
    nodes = [
        {"name": visible(node.name), "at": _lines_of(places, files)}
        for node, places in zip(named.nodes, node_places, strict=True)
    ]
    lines = [
        {"bonds": line.bonds, "at": _lines_of(places, files)}
        for line, places in zip(named.lines, line_places, strict=True)
    ]
    drawing = svg_text(compose(named, layout, frames), rules=False)
    return Picture(
        Html(drawing), {"nodes": nodes, "lines": lines, "bonds": [_bond(graph, b) for b in range(len(graph.bonds))]}
    )


def _bond(graph: BondGraph, bond: int) -> dict[str, Any]:
    """Return the name of a bond, and the letters and units of its effort, its flow and their product."""
    ends = graph.bonds[bond]
    domain = DOMAINS.get(ends.domain)
    words = " → ".join(end_name(graph, end) for end in (ends.tail, ends.head))
    effort, flow, power = (("e", ""), ("f", ""), ("power", ""))
    if domain is not None:
        effort, flow = ((domain.letter(v), _unit(domain.dimension(v))) for v in ("e", "f"))
        product = _unit(domain.dimension("e") * domain.dimension("f"))
        power = ("power" if domain.is_balanced else f"{effort[0]}*{flow[0]}", product)
    return {"name": visible(words), "domain": visible(ends.domain), "effort": effort, "flow": flow, "power": power}


def _unit(dimension: object) -> str:
    words = str(dimension)
    return "" if words == "1" else words


def _lines_of(places: Iterable[Span], files: Mapping[str, int]) -> list[str]:
    """Return the lines of places, as `file:line`, without those in other files."""
    named = (f"{files[place.source.name]}:{place.line}" for place in places if place.source.name in files)
    return list(dict.fromkeys(named))
