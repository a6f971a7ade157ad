"""Structure of a file: what it declares, and what an editor may fold; and commands above models and experiments."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from compiler.api import DeclaredName, EditedFile, Span, first_text, name_span, parts_of, table_of, tree

from .answers import Lens, OutlineNode, TextPlace
from .workspace import Workspace, place_of

_MARK = re.compile(r'"[^"\n]*"|#[^\n]*|[{}\[\]()]')


def outline(workspace: Workspace, path: Path) -> list[OutlineNode]:
    """Return the models, functions and constants of a file, with what they declare."""
    document = workspace.project.document(path)
    # the place behind the partner of each opening brace; the end of the text for one that is never closed
    ends = {start: end for start, end, mark in _pairs(document.text) if mark == "{"}
    nodes: list[OutlineNode] = []
    for statement in document.tree.statements:
        match statement:
            case tree.ModelSyntax():
                detail, children = first_text(statement.statements), _children(statement, ends)
                nodes.append(_node(statement.name, "model", detail, statement.name_span, ends, children))
            case tree.FunctionSyntax(name=name):
                nodes.append(_node(name, "function", "", name_span(statement.span, name), ends))
            case tree.Quantities(items=items):
                nodes += [_node(i.name, "constant", i.span.words, name_span(i.span, i.name), ends) for i in items]
    return [n for n in nodes if n.place.path == path.resolve()]


def _children(model: tree.ModelSyntax, ends: dict[int, int]) -> tuple[OutlineNode, ...]:
    nodes = [_declared(name, ends) for name in table_of(model).values()]
    for statement in model.statements:
        if isinstance(statement, tree.Experiment):
            span = name_span(statement.span, statement.name)
            nodes.append(_node(statement.name, "experiment", first_text(statement.steps), span, ends))
    return tuple(sorted(nodes, key=lambda n: n.place.start))


def _declared(name: DeclaredName, ends: dict[int, int]) -> OutlineNode:
    parts: tuple[OutlineNode, ...] = ()
    if isinstance(name.node, tree.MechanismSyntax):
        parts = tuple(_declared(part, ends) for part in parts_of(name.node, name.owner).values())
    return _node(name.name, name.kind, f"{name.type} {name.description}".strip(), name.span, ends, parts)


def _node(
    name: str, kind: str, detail: str, span: Span, ends: dict[int, int], children: tuple[OutlineNode, ...] = ()
) -> OutlineNode:
    place = place_of(span)
    whole = place
    if kind in ("model", "mechanism", "experiment"):  # up to the brace that closes it
        whole = TextPlace(
            place.path, place.start, ends.get(span.source.text.find("{", span.end) + span.source.before[0], place.end)
        )
    return OutlineNode(name, kind, detail, whole, place, children)


def _pairs(text: str) -> Iterator[tuple[int, int, str]]:
    open_marks: list[tuple[int, str]] = []
    for mark in _MARK.finditer(text):
        if mark[0] in "{[(":
            open_marks.append((mark.start(), mark[0]))
        elif mark[0] in "}])" and open_marks and open_marks[-1][1] == {"}": "{", "]": "[", ")": "("}[mark[0]]:
            start, sign = open_marks.pop()
            yield start, mark.end(), sign
    yield from ((start, len(text), sign) for start, sign in open_marks)


def folds(document: EditedFile) -> list[tuple[int, int]]:
    """Return the first and last line, from 0, of each block, list and group of comments that an editor may fold."""
    text = document.text
    folded = {(text.count("\n", 0, start), text.count("\n", 0, end)) for start, end, _ in _pairs(text)}
    lines = text.split("\n")
    start: int | None = None
    for number, line in enumerate([*lines, ""]):
        if line.lstrip().startswith("#"):
            start = number if start is None else start
        elif start is not None:
            folded.add((start, number - 1))
            start = None
    return sorted((a, b) for a, b in folded if b > a)


def lenses(workspace: Workspace, path: Path) -> list[Lens]:
    """Return the commands of a file, in the order of its text. The diagram is that of its last model."""
    models = [s for s in workspace.project.document(path).tree.statements if isinstance(s, tree.ModelSyntax)]
    listed: list[Lens] = []
    for model in models:
        is_last = model is models[-1]
        if is_last:
            listed.append(Lens(place_of(model.name_span), "Diagram"))
        for experiment in (s for s in model.statements if isinstance(s, tree.Experiment)):
            place = place_of(name_span(experiment.span, experiment.name))
            named = (str(path), "-e", experiment.name, *(() if is_last else ("--model", model.name)))
            listed += [Lens(place, title, (title.lower(), *named)) for title in _titles(model, experiment)]
    return [lens for lens in listed if lens.place.path == path.resolve()]


def _titles(model: tree.ModelSyntax, experiment: tree.Experiment) -> Iterator[str]:
    """Yield the commands that make sense: an experiment without a step cannot run, a model without an input has no frequency response."""
    if any(isinstance(step, tree.Simulate | tree.Analysis) for step in experiment.steps):
        yield "Run"
    yield "Modes"
    if any(isinstance(s, tree.Quantities) and s.role == "input" for s in model.statements):
        yield "Bode"
