"""Contents of a page: markup for readers and data for the page's scripts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from compiler.api import CompilationFailed, Scene, Source

from ...analysed_model import AnalysedModel
from ...errors import RunFailed, UsageError
from ..text.tables import visible
from .certificate import causality_markup, certificate_markup
from .equations import equations_markup
from .experiments import PROBLEMS, experiment_data
from .markup import Html, joined, tag
from .picture import picture_of
from .runs import PageModel
from .shapes import modes_data
from .text import WORDING, text_markup


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
        for words, step, told in (("−", "0.8", "smaller"), ("+", "1.25", "larger"), ("fit", "0", "as wide as the page"))
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
        return tag("pre", str(problem))
