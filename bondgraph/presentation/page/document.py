"""Contents of a page: markup for readers and data for the page's scripts.

The text has numbered lines, with words coloured by their kind; with the diagram come, for each of its nodes and lines, the bonds behind it and their
lines of text. Modes are complex amplitudes of all bonds and poses, about the equilibrium.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any

import numpy as np

from compiler.api import (
    ANALYSIS_STEPS,
    DOMAINS,
    ELEMENT_KINDS,
    BondGraph,
    Compilation,
    CompilationFailed,
    Scene,
    Source,
    Span,
)

from ...analysed_model import AnalysedModel
from ...analysis.modes import Mode, modes
from ...errors import RunFailed, UsageError
from ...keywords import AnalysisRequest
from ..diagram.compose import compose
from ..diagram.diagram_model import diagram_model_of
from ..diagram.frames import place_framed
from ..diagram.svg import svg_text
from ..diagram.text_links import text_links
from ..text.tables import end_name, visible
from .certificate import causality_markup, certificate_markup
from .equations import equations_markup
from .experiments import PROBLEMS, experiment_data
from .markup import Html, joined, preformatted, tag
from .runs import PageModel, packed

LARGEST = 300  # most nodes: a larger drawing takes half a minute and is not readable
WORDS = frozenset((
    "model", "plain", "parameter", "constant", "input", "output", "signal", "port", "import", "from", "for", "in", "function", "multibody",
    "body", "frame", "mode", "solve", "when", "every", "experiment", "set", "sweep", "simulate", "report", "start", *ANALYSIS_STEPS,
    "require", "integral", "delay", "der", "hysteresis", "if", "else", "and", "or", "not", "true", "false", "time", "pi", "ground", "to", "over",
))  # fmt: skip
WORDING = {"words": sorted(WORDS), "kinds": sorted(ELEMENT_KINDS)}  # for the editor
_PIECES = re.compile(
    r'(?P<remark>#.*)|(?P<words>"[^"]*"?)|(?P<number>\b\d[\d.]*(?:[eE][-+]?\d+)?)|(?P<name>[^\W\d]\w*)|(?P<arrow>->|=>)'
)
_BEGINS = re.compile(r"(?:^|[{;])[ \t]*$")  # of a statement: only there a letter is a kind
_DECLARED = re.compile(
    rf"(?:^|[{{;])[ \t]*(?:[01]|{'|'.join(ELEMENT_KINDS)})[ \t]+$|[-=]>[ \t]*$"
)  # before a name, which may equal a word
_NAMED = re.compile(r"[ \t]*(?:[-=]>|[.:\[]|=(?!=))")  # behind one
LONGEST = 4000  # most lines of one file
MOST = 24
SHARES = 4  # most elements named


@dataclass(frozen=True, slots=True)
class Document:
    """Title, markup of the page's sections, and data for its scripts."""

    title: str
    sections: Html
    data: dict[str, Any] = field(default_factory=dict)


def document_of(model: AnalysedModel, live: bool = False) -> Document:
    """Return the page of a model; a live page has no runs yet, it requests them. Raises `CompilationFailed`."""
    watched = PageModel(model)
    compilation = model.compilation(Scene(model.model, None, free=frozenset({"*"})))
    sources = _sources(model)
    picture = picture_of(compilation, sources)
    names = watched.model.experiments
    shown = [{"name": n, "kind": "asked"} if live else experiment_data(watched, n) for n in names]
    modes, trouble = ([], "") if live else _modes(watched)
    data = {
        "model": visible(watched.graph.name), "parts": picture.parts, "places": watched.bonds.places,
        "powers": [(visible(n), k, around) for n, k, around in watched.powers], "scenes": watched.scenes.told,
        "experiments": shown, "modes": modes, "live": live, **(WORDING if live else {}),
    }  # fmt: skip
    sections = _sections(model, picture.drawing, sources, data, trouble)
    return Document(visible(watched.graph.name), joined(sections), data)


def _modes(watched: PageModel) -> tuple[list[dict[str, Any]], str]:
    """Return the modes, or the reason why there are none."""
    try:
        return modes_data(watched), ""
    except PROBLEMS as problem:
        return [], str(problem)


def _sources(model: AnalysedModel) -> list[Source]:
    """Return the model's own text, then every imported file."""
    files = model.compilation().files
    return [model.source, *(f for f in files if f.name != model.source.name and f.name.endswith(".bg"))]


def _sections(
    model: AnalysedModel, drawing: Html, sources: list[Source], data: dict[str, Any], trouble: str
) -> Iterator[Html]:
    certificate = _or_problem(lambda: certificate_markup(model.certificate))
    line = _or_problem(lambda: Html(tag("p", model.certificate.line, class_="line")))
    yield tag("header", tag("h1", data["model"]), line)
    text = text_section(sources)
    diagram = _section("diagram", "Bond graph", _diagram(drawing), tag("p", id="bond", class_="readout", role="status"))
    yield tag("div", text, diagram, class_="beside")
    if data["experiments"] or data["modes"]:
        yield _section("runs", "Runs", *_runs(data))
    yield _section("equations", "Equations", _or_problem(lambda: _equations(model, sources)))
    yield _section("certificate", "Certificate", certificate)
    yield _section("causality", "Causality", _or_problem(lambda: causality_markup(model.compilation())))
    if trouble:
        yield _section("modes", "Modes", tag("p", "No modes: ", trouble))


def text_section(sources: list[Source]) -> Html:
    """Return the section of a page that has the text."""
    return _section("text", "Text", text_markup(sources))


def _section(name: str, heading: str, *inside: Html) -> Html:
    return tag("section", tag("h2", heading, id=f"of-{name}"), *inside, id=name, aria_labelledby=f"of-{name}")


def _diagram(drawing: Html) -> Html:
    if not drawing:
        return tag("p", "The bond graph is too large for a picture that one could read; `bondgraph draw` makes one.")
    zoom = [
        tag("button", words, type="button", data_zoom=step, aria_label=told)
        for words, step, told in (
            ("−", "0.8", "smaller"),
            ("+", "1.25", "larger"),
            ("fit", "0", "fit to the width of the page"),
        )
    ]
    colour = tag("label", tag("input", type="checkbox", id="power", checked=True), " power along the run")
    return joined([tag("div", *zoom, colour, class_="tools"), tag("div", drawing, class_="sheet", tabindex=0)])


def _runs(data: dict[str, Any]) -> Iterator[Html]:
    """Yield the empty elements that the scripts fill: plots, energies, mechanisms."""
    yield tag("div", id="choice", class_="choice", role="group", aria_label="experiments and modes")
    yield tag("div", id="sliders", class_="sliders", hidden=True)
    yield tag("div", tag("div", id="plots"), tag("div", id="stages"), class_="beside")
    yield tag("div", id="told")


def _equations(model: AnalysedModel, sources: list[Source]) -> Html:
    summary = tag("summary", "in the order in which they are computed")
    return tag("details", summary, equations_markup(model.with_inputs().state_space, sources), open=True)


def _or_problem(made: Callable[[], Html]) -> Html:
    """Return the result of `made`, or the error message."""
    try:
        return made()
    except (CompilationFailed, UsageError, RunFailed) as problem:
        return preformatted(str(problem))


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


def text_markup(sources: Sequence[Source]) -> Html:
    """Return all files of a model, the model's own first and open."""
    return joined(_file(number, source) for number, source in enumerate(sources))


def _file(number: int, source: Source) -> Html:
    lines = source.text.split("\n")
    if lines and not lines[-1]:
        lines.pop()
    rows = (
        tag("li", tag("code", *_pieces(line)), data_at=f"{number}:{i}") for i, line in enumerate(lines[:LONGEST], 1)
    )
    listing = tag("ol", *rows, class_="listing")
    more = [tag("p", f"and {len(lines) - LONGEST} lines more")] if len(lines) > LONGEST else []
    name = PurePath(source.name).name
    return tag("details", tag("summary", tag("code", name)), listing, *more, open=number == 0, class_="file")


def _pieces(line: str) -> Iterator[str]:
    """Yield the parts of a line; text that is neither word, number, comment nor arrow is unchanged."""
    done = 0
    for found in _PIECES.finditer(line):
        kind = found.lastgroup or ""
        if kind == "name":
            kind = _kind(line[: found.start()], found[0], line[found.end() :])
        if kind:
            yield line[done : found.start()]
            yield tag("span", found[0], class_=kind)
            done = found.end()
    yield line[done:]


def _kind(before: str, name: str, after: str) -> str:
    """Return the class of a name by what stands around it; the editor has the same rules."""
    if name in ELEMENT_KINDS:
        return "kind" if _BEGINS.search(before) and re.match(r"[ \t]+[^\W\d]", after) else ""
    return "word" if name in WORDS and not _DECLARED.search(before) and not _NAMED.match(after) else ""


def modes_data(watched: PageModel) -> list[dict[str, Any]]:
    """Return the modes, slowest first. Raises as `Model.operating_point`."""
    from ...analysis.equilibrium import equilibrium

    names = tuple(dict.fromkeys([*watched.bonds.names, *watched.scenes.names]))
    if not names:
        return []
    point = watched.model.operating_point(AnalysisRequest(outputs=names))
    rest = equilibrium(point).outputs
    poses = packed([rest[name] for name in watched.scenes.names], single=False)
    return [_mode(watched, mode) | {"rest": poses} for mode in modes(point)[:MOST]]


def _mode(watched: PageModel, mode: Mode) -> dict[str, Any]:
    seen = mode.outputs
    bonds = watched.bonds.values({n: np.asarray(seen[n]) for n in watched.bonds.names}, 1)[:, 0]
    poses = np.array([seen[n] for n in watched.scenes.names], dtype=complex)
    return {
        "frequency": mode.frequency, "damping": None if mode.damping != mode.damping else mode.damping,
        "energy": [(visible(n), share) for n, share in list(mode.energy.items())[:SHARES]],
        "bonds": {"re": packed(bonds.real), "im": packed(bonds.imag)},
        "poses": {"re": packed(poses.real, False), "im": packed(poses.imag, False)},
    }  # fmt: skip
