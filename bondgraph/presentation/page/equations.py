"""Equations of a model in causal order, typeset, each with the line that caused it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from compiler.api import Expression, LinearLoop, Source, Span, StateSpace

from .markup import Html, tag
from .mathml import formula, math, name, number, row, sign

LARGEST = 320_000  # most characters of markup; `bondgraph equations` shows the rest


def equations_markup(space: StateSpace, sources: Sequence[Source]) -> Html:
    """Return a list of the equations; if they are too many for a page, the first ones and a reference to the others."""
    rows: list[Html] = []
    size = 0
    for equation, span, words in _equations(space):
        rows.append(tag("li", equation, _place(span, sources), *([tag("small", words)] if words else [])))
        size += len(rows[-1])
        if size > LARGEST:
            rows.append(
                tag("li", f"and more: {len(space.steps) + len(space.states)} in all; `bondgraph equations` prints them")
            )
            break
    return tag("ol", *rows, class_="equations", tabindex=0)


def _place(span: Span, sources: Sequence[Source]) -> Html:
    numbers = [n for n, source in enumerate(sources) if source.name == span.source.name]
    words = f"{span.source.name.rpartition('/')[2]}:{span.line}"
    return tag(
        "a", words, class_="place", **({"data_to": f"{numbers[0]}:{span.line}", "href": "#text"} if numbers else {})
    )


def _equations(space: StateSpace) -> Iterator[tuple[Html, Span, str]]:
    def named(key: object) -> Html:
        assert isinstance(key, int)
        return name(space.variables[key].name)

    def entry(value: int | float) -> Html:
        return number(value) if isinstance(value, float) else named(value)

    def written(expression: Expression) -> Html:
        return formula(expression, named)

    unknowns = {u.residual: u for u in space.unknowns}
    for step in space.steps:
        if isinstance(step, LinearLoop):
            matrix, targets = _matrix([list(map(entry, r)) for r in step.matrix]), [[named(t)] for t in step.targets]
            right = _matrix([[entry(e)] for e in step.right])
            yield math(matrix, _matrix(targets), sign("="), right), step.span, f"loop of {', '.join(step.members)}"
        elif step.target in unknowns:
            unknown = unknowns[step.target]
            words = f"solved for {space.variables[unknown.variable].name}, loop of {', '.join(unknown.members)}"
            yield math(tag("mn", "0"), sign("="), written(step.expression)), step.span, words
        else:
            yield math(named(step.target), sign("="), written(step.expression)), step.span, ""
    for state in space.states:
        d = tag("mi", "d", mathvariant="normal")
        rate = tag("mfrac", d, tag("mrow", d, tag("mi", "t")))
        start = f"{state.start:.6g}" if isinstance(state.start, float) else space.variables[state.start].name
        yield math(rate, named(state.variable), sign("="), named(state.rate)), state.span, f"starts at {start}"


def _matrix(rows: Sequence[Sequence[Html]]) -> Html:
    if len(rows) == 1 and len(rows[0]) == 1:
        return rows[0][0]
    shown = [tag("mtr", *(tag("mtd", cell) for cell in cells[:12])) for cells in rows[:12]]
    return row(sign("("), tag("mtable", *shown), sign(")"))
