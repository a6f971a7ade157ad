"""Certificate and causality of a model as markup: the kind of equations, and the reason for each stroke."""

from __future__ import annotations

from compiler.api import Certificate, Compilation, Diagnostic

from ..text.causality import explain
from ..text.tables import counted, some_of
from .markup import Html, joined, preformatted, table, tag, text

ROWS = 400


def certificate_markup(certificate: Certificate) -> Html:
    """Return the certificate of a compilation, as a list of facts."""
    facts: list[tuple[str, str]] = [
        ("form", certificate.form),
        ("index as written", str(certificate.index)),
        ("states", f"{len(certificate.states)}, of {counted(certificate.degrees_of_freedom, 'degree')} of freedom"),
        ("equations", ", ".join(_words(certificate))),
        ("in derivative form", _listed(certificate.dependent)),
        ("sharing a state", _listed(certificate.following)),
        ("constraints of closing joints", str(certificate.constraints or "")),
        ("of them redundant", _listed(certificate.redundant)),
        ("at instants", _listed(certificate.events)),
        *(
            (f"{'linear' if x.linear else 'nonlinear'} loop of {x.size}", _listed(x.members))
            for x in certificate.loops[:20]
        ),
        ("names of the states", _listed(certificate.states)),
    ]
    rows = joined(joined([tag("dt", what), tag("dd", words)]) for what, words in facts if words)
    notes = [tag("p", "note: ", note, class_="note") for note in certificate.notes]
    return joined([tag("dl", rows, class_="facts"), *notes])


def _words(certificate: Certificate) -> list[str]:
    words = ["linear" if certificate.linear else "nonlinear"]
    words += ["time-varying"] * certificate.time_varying
    return [*words, "driven" if certificate.driven else "autonomous"]


def _listed(names: tuple[str, ...]) -> str:
    return some_of(names, 40)


def causality_markup(compilation: Compilation) -> Html:
    """Return storages in derivative form and loops with advice, then the strokes one by one."""
    found = explain(compilation)
    parts: list[Html] = []
    for row in found.derivative:
        chain = joined((tag("code", bond) for bond, _ in row.chain), "  ")
        advice = tag("p", "What you can do: ", row.advice, class_="advice")
        head = tag("p", tag("code", row.storage), f" ({row.place}) is in derivative form: {row.why}")
        parts.append(tag("article", head, tag("p", chain), advice))
    for loop in found.loops:
        around = joined((tag("code", name) for name, _, _ in loop.cycle), " → ")
        advice = tag("p", "What you can do: ", loop.advice, class_="advice")
        head = tag("p", f"Algebraic loop of {', '.join(loop.members)}:")
        parts.append(tag("article", head, tag("p", around), advice))
    if not parts:
        parts.append(tag("p", "All storages are in integral form, and there is no algebraic loop."))
    strokes = ((tag("code", r.bond), r.effort_from, r.flow_from, r.why, r.place) for r in found.strokes[:ROWS])
    listing = table(strokes, ("bond", "effort from", "flow from", "why", "line"))
    summary = tag("summary", f"{counted(len(found.strokes), 'stroke')}, one by one")
    return joined([*parts, tag("details", summary, listing)])


def problems_markup(diagnostics: tuple[Diagnostic, ...]) -> Html:
    """Return the errors of a text, each with file, line, column, the line itself, and advice."""
    return tag("ul", *map(_problem, diagnostics), class_="problems")


def _problem(item: Diagnostic) -> Html:
    span = item.span
    place = f"{span.source.name.rpartition('/')[2]}, line {span.line}, column {span.column}"
    head = tag("p", tag("strong", place), f": {item.sentence} ", tag("small", item.code))
    line = span.source.line(span.line)[:200]
    mark = " " * (span.column - 1) + "^" * max(1, min(span.end - span.start, len(line) - span.column + 1))
    excerpt = preformatted(line, text("\n"), tag("span", mark[:201], class_="mark"))
    return tag("li", head, excerpt, *([tag("p", item.help, class_="advice")] if item.help else []))
