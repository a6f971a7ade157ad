"""Display of models, results and equations in notebooks: bounded, escaped, and without scripts."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping
from io import BytesIO
from typing import Any

import numpy as np

from compiler.api import Array, CompilationFailed, Scene

from ...analysed_model import AnalysedModel
from ...errors import RunFailed, UsageError
from ...rendering import Summarised
from ...results.result import Result
from ..text.tables import EXTREMES, extremes_shown, short, some_of
from .certificate import problems_markup
from .markup import Html, preformatted, tag

NODES = 150  # most nodes of a picture that is drawn without a request
ROWS = 40
POINTS = 120  # points of a small curve
WIDE, HIGH = 140.0, 24.0


def model_html(model: AnalysedModel) -> Html:
    """Return the certificate, the bond graph, and the settings and outputs; for an invalid model, its errors."""
    try:
        head = [tag("strong", model.name), tag("div", model.certificate.line)]
        return tag("div", *head, Html(picture(model)), _names(model))
    except CompilationFailed as failed:
        return problems_markup(failed.diagnostics)
    except (UsageError, RunFailed) as problem:
        return preformatted(str(problem))


def picture(model: AnalysedModel) -> str:
    """Return the bond graph as SVG; empty if it is too large to be drawn without a request. Raises `CompilationFailed`."""
    from ..diagram import draw, svg_text

    scene = Scene(model.model, None, free=frozenset({"*"}))
    compilation = model.compilation(scene)
    if not 0 < len(compilation.graph.nodes) <= NODES:
        return ""
    return svg_text(draw(compilation))


def _names(model: AnalysedModel) -> Html:
    """Return parameters with their values, inputs, outputs, states."""
    values = {n: p for n, p in model.parameters.items() if "." not in n}
    shown = [f"{n} = {p.value:.6g}{'' if p.unit == '1' else f' {p.unit}'}" for n, p in values.items()]
    lists = (("parameters", shown), ("inputs", model.inputs), ("outputs", model.outputs), ("states", model.states))
    rows = [tag("tr", tag("th", what), tag("td", some_of(names, ROWS))) for what, names in lists if names]
    return tag("details", tag("summary", "what can be set and seen"), tag("table", *rows))


def summary_html(found: Summarised) -> Html:
    """Return the tables of a result, and below them its picture where it has one and matplotlib is there."""
    return tag("div", preformatted(found.summary()), _plotted(found))


def _plotted(found: object) -> Html:
    from importlib.util import find_spec

    if not hasattr(found, "plot") or find_spec("matplotlib") is None:
        return Html("")
    try:
        figure = found.plot()
    except UsageError:  # a study without anything to draw
        return Html("")
    stream = BytesIO()
    figure.savefig(stream, format="png", dpi=110)
    return Html(f'<img src="data:image/png;base64,{b64encode(stream.getvalue()).decode()}" alt="plot">')


def result_html(result: Result) -> Html:
    """Return a row for each output: its last, least and greatest value, and a small curve."""
    heads = tag("tr", *(tag("th", word) for word in ("", "final", *EXTREMES, "unit", "over time")))
    shown = result.shown()
    rows = [
        tag(
            "tr", tag("td", short(item.name)), tag("td", f"{result.final(item.name) * item.scale + item.offset:.6g}"),
            *(tag("td", cell) for cell in extremes_shown(result, item)),
            tag("td", "" if item.unit == "1" else item.unit), tag("td", _curve(result.time, values)),
        )
        for item, values in shown[:ROWS]
    ]  # fmt: skip
    span = f"{len(result.time)} instants" + (
        f", {result.time[0]:.6g} .. {result.time[-1]:.6g} s" if len(result.time) else ""
    )
    more = [tag("p", f"and {len(shown) - ROWS} more")] if len(shown) > ROWS else []
    notes = [tag("p", str(n)) for n in (*result.warnings, *result.notes)[:ROWS]]
    return tag("div", tag("strong", short(result.title)), f", {span}", tag("table", heads, *rows), *more, *notes)


def _curve(time: Array, values: Array) -> Html:
    """Return values over time as a small picture in the colour of the surrounding text."""
    if len(time) < 2 or not time[-1] > time[0]:
        return Html("")
    instants = np.linspace(time[0], time[-1], POINTS)
    course = np.interp(instants, time, values)
    known = course[np.isfinite(course)]
    if not len(known):
        return Html("")
    low, span = float(known.min()), float(np.ptp(known)) or 1.0
    way, pen = [], "M"
    for place, value in enumerate(course):
        if np.isfinite(value):
            way.append(
                f"{pen}{1 + (WIDE - 2) * place / (POINTS - 1):.1f} {1 + (HIGH - 2) * (1 - (value - low) / span):.1f}"
            )
        pen = "L" if np.isfinite(value) else "M"
    line = tag("path", d="".join(way), fill="none", stroke="currentColor")
    return tag("svg", line, width=round(WIDE), height=round(HIGH), viewBox=f"0 0 {WIDE:g} {HIGH:g}")


def equations_latex(equations: Mapping[str, Any], rates: bool, most: int = 40, longest: int = 20_000) -> str:
    """Return equations in sympy as LaTeX, limited in number. `rates`: the left sides are derivatives."""
    import sympy

    from ..text.equations import latex_name

    lines: list[str] = []
    for name, right in list(equations.items())[:most]:
        names = {s: latex_name(str(s)) for s in right.free_symbols}
        shown = sympy.latex(right, symbol_names=names) if right.count_ops() < 400 else r"\ldots"
        left = rf"\frac{{\mathrm{{d}}}}{{\mathrm{{d}}t}} {latex_name(name)}" if rates else "0"
        lines.append(f"{left} &= {shown}")
        if sum(map(len, lines)) > longest:
            break
    if len(lines) < len(equations):
        lines.append(rf"& \text{{and {len(equations) - len(lines)} more}}")
    return "$\\displaystyle\\begin{aligned}" + r" \\ ".join(lines) + "\\end{aligned}$"
