"""Small texts beside the text: the stroke of each bond, storages in derivative form, values in SI."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

from compiler.api import Compilation, nodes_in, path_of, tree

from ..presentation.text.causality import CausalityExplanation
from .answers import InlineHint
from .facts import number, scale
from .workspace import Workspace

STROKES = ("\u2192|", "|\u2192")  # effort from the tail: stroke at the head; and the other way


def inline_hints(workspace: Workspace, path: Path, start: int = 0, end: int | None = None) -> list[InlineHint]:
    """Return the hints of a part of a file. Strokes are those of the main model, where all of its instances have the same."""
    document, survey = workspace.names(path)
    last = len(document.text) if end is None else end
    hints = list(_units(document.tree, start, last))
    why = workspace.strokes(path)
    if survey.main is not None and why is not None:
        hints += _strokes(survey.main, why, path.resolve())
    return sorted((h for h in hints if start <= h.at <= last), key=lambda h: h.at)


def _strokes(main: Compilation, why: CausalityExplanation, path: Path) -> Iterator[InlineHint]:
    causal = main.causal
    heads: dict[int, list[int]] = {}
    for bond, drawn in enumerate(causal.graph.bonds):
        if path_of(drawn.span) == path:
            heads.setdefault(drawn.span.offset, []).append(bond)
    for at, bonds in heads.items():
        sides = {causal.effort_from[bond] for bond in bonds}
        if len(sides) == 1:
            row = why.strokes[bonds[0]]
            yield InlineHint(at, STROKES[sides.pop()], f"{row.bond}: {row.why}")
    reasons = {row.storage: row for row in why.derivative}
    shown: set[int] = set()
    for storage in causal.derivative:
        node = causal.graph.nodes[storage.node]
        behind = node.span.offset + node.span.end - node.span.start
        if path_of(node.span) == path and behind not in shown:
            shown.add(behind)
            row_of = reasons.get(node.name)
            yield InlineHint(behind, " derivative form", row_of.why if row_of is not None else "")


def _units(syntax: tree.SyntaxTree, start: int, end: int) -> Iterator[InlineHint]:
    for node in nodes_in(syntax.statements):
        if isinstance(node, tree.Literal) and node.unit is not None and start <= node.span.offset <= end:
            unit = scale(node.unit)
            if unit is None or unit.to_si(Fraction(1)) == 1 or not node.number:
                continue
            si = "" if str(unit.dimension) == "1" else f" {unit.dimension}"
            at = node.span.offset + node.span.end - node.span.start
            yield InlineHint(at, f" = {number(unit.to_si(node.number))}{si}", is_unit=True)
