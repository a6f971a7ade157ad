"""Values, units and strokes that the compiler found for names of a file, in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from fractions import Fraction

from compiler import api
from compiler.api import tree

from ..presentation.text.causality import CausalityExplanation, explain


def number(value: float) -> str:
    """A number with the digits that it needs, at most twelve."""
    return f"{value:.12g}"


def scale(unit: tree.Unit | None) -> api.Scale | None:
    """Scale of a unit as written; None if there is none, or it is no unit."""
    if unit is None or any(symbol == "model" for symbol, _, _ in unit.factors):
        return None
    try:
        return api.scale_of(unit)
    except Exception as problem:  # an error of the text that its diagnostics tell
        if type(problem).__name__ != "Wrong":
            raise
        return None


def author_unit(item: tree.SyntaxNode) -> tree.Unit | None:
    """The unit in which an author gives a quantity: that after the colon, else that of its number."""
    if not isinstance(item, tree.Item):
        return None
    value = item.value.operand if isinstance(item.value, tree.Negative) else item.value
    return item.unit or (value.unit if isinstance(value, tree.Literal) else None)


def in_author_unit(value: float, unit: str, written: tree.Unit | None) -> str:
    """A value in SI as the author would write it, with the SI value where that is another one."""
    own = f"{number(value)} {unit}" if unit != "1" else number(value)
    factor = scale(written)
    if factor is None or written is None or factor.to_si(Fraction(1)) == 1:
        return own
    return f"{number(factor.from_si(value))} {written.span.words} = {own}"


def quantity_line(name: api.DeclaredName, survey: api.FileSurvey, home: str, reading: str) -> str:
    """Unit and value of a quantity, as a model reads it; empty if the compiler has not found any."""
    checked = survey.models.get(home)
    if checked is None or checked.parts is None:
        return ""
    graph = checked.parts.graph
    named = graph.quantities.get(reading) or graph.outputs.get(reading)
    if named is None:
        items = [q for n, q in graph.quantities.items() if n.startswith(f"{reading}[")]
        if not items:
            return ""
        values = [number(q.value) if q.value is not None else "…" for q in items]
        return f"({', '.join(values)}) {items[0].unit}"
    written = author_unit(name.node)
    if named.value is not None:
        return in_author_unit(named.value, named.unit, written)
    if written is not None and scale(written) is not None:
        return f"in {written.span.words}"
    return f"in {named.unit}" if named.unit != "1" else "a bare number"


def domain_line(domain: api.Domain, variables: str) -> str:
    """Letters of a domain with their units."""
    return ", ".join(f"`{domain.letter(v)}` in {domain.dimension(v)}" for v in variables)


def entry_of(survey: api.FileSurvey, home: str, name: str) -> object | None:
    """Meaning of a name of a model, as it was elaborated: that of the first item of an array."""
    checked = survey.models.get(home)
    entry = None if checked is None or checked.scope is None else checked.scope.entries.get(name)
    items = getattr(entry, "items", None)
    return next(iter(items.values()), None) if isinstance(items, dict) else entry


def ports(survey: api.FileSurvey, home: str, name: str) -> Mapping[str, api.Domain]:
    """Ports of an element, junction or part with their domains."""
    entry = entry_of(survey, home, name)
    return entry.ports if isinstance(entry, api.ElementEntry | api.PartEntry) else {}


def strokes(compilation: api.Compilation) -> CausalityExplanation | None:
    """Explanation of all strokes of a model; None if it has none."""
    try:
        return explain(compilation)
    except api.CompilationFailed:
        return None


def stroke_lines(
    name: api.DeclaredName, compilation: api.Compilation | None, why: CausalityExplanation | None
) -> Iterator[str]:
    """Strokes at an element, with the reason of each, and the form of a storage."""
    if compilation is None or why is None:
        return
    graph = compilation.causal.graph
    own = [
        i
        for i, node in enumerate(graph.nodes)
        if node.span.offset == name.span.offset and api.path_of(node.span) == name.path
    ]
    for node in own[:1]:
        for bond in graph.incident[node][:6]:
            row = why.strokes[bond]
            yield f"`{row.bond}`: {row.why}"
        derivative = [end for end in compilation.causal.derivative if end.node == node]
        if derivative:
            owner = graph.nodes[node].name
            row_of = next((d for d in why.derivative if owner in (d.storage, d.storage.partition(".")[0])), None)
            yield f"derivative form{': ' + row_of.why if row_of is not None else ''}"
        elif getattr(graph.nodes[node], "stored", ()):
            yield "integral form: it has a state"
    if len(own) > 1:
        yield f"as in the first of {len(own)} instances"


def dimension_of(unit: str) -> api.Dimension | None:
    """Dimension of a unit as a text; None for what is no unit."""
    try:
        return api.read_unit(api.Source("unit", unit)).dimension
    except api.CompilationFailed:
        return None


def declared_dimension(name: api.DeclaredName, survey: api.FileSurvey, home: str) -> api.Dimension | None:
    """Dimension of a quantity: as the compiler found it, else by the unit that its declaration has."""
    checked = survey.models.get(home)
    if checked is not None and checked.parts is not None:
        graph = checked.parts.graph
        named = graph.quantities.get(name.name) or graph.outputs.get(name.name)
        if named is not None:
            return dimension_of(named.unit)
    written = scale(author_unit(name.node))
    return None if written is None else written.dimension
