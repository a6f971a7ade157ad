"""The bond graph of a file's main model as a picture whose parts know their places in the text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from .answers import LinkedDiagram, TextPlace
from .workspace import Workspace, place_of

if TYPE_CHECKING:
    from compiler.api import Compilation

    from ..presentation.diagram.figure import Group

MOST_NODES = 300  # a larger drawing takes half a minute and is not readable: then instances are boxes


def diagram(workspace: Workspace, path: Path) -> LinkedDiagram | None:
    """Return the diagram of a file; None if it has errors, no model, or more parts than one can read."""
    main = workspace.names(path, complete=True)[1].main
    return None if main is None else _drawn(main)


def _drawn(main: Compilation) -> LinkedDiagram | None:
    from ..presentation.diagram.compose import compose
    from ..presentation.diagram.diagram_model import diagram_model_of
    from ..presentation.diagram.frames import place_framed
    from ..presentation.diagram.svg import svg_text
    from ..presentation.diagram.text_links import text_links

    model = diagram_model_of(main, closed=len(main.causal.graph.nodes) > MOST_NODES)
    if len(model.nodes) > MOST_NODES:
        return None
    named, layout, frames = place_framed(model)
    figure = compose(named, layout, frames)
    nodes, lines = text_links(main, named)
    places = {"node": iter(nodes), "bond": iter(lines)}
    parts: dict[str, tuple[TextPlace, ...]] = {}

    def numbered() -> Iterator[Group]:
        for number, group in enumerate(figure.groups):
            spans = next(places[group.kind]) if group.kind in places else ()
            if spans:
                parts[str(number)] = tuple(dict.fromkeys(map(place_of, spans)))
                group = replace(group, facts={"id": str(number), **group.facts})
            yield group

    text = svg_text(replace(figure, groups=tuple(numbered())))
    return LinkedDiagram(named.name, text, parts)
