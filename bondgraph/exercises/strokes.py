"""Exercise on causality: the bonds without strokes, and marks for strokes that were put by hand.

Any complete assignment that the rules allow is right if no further storage could be in integral form beside those that are. Sets of storages that can be
in integral form together are the independent sets of a matroid (`compiler/causality`), so each such set that is too small can be enlarged by one more.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import suppress

from compiler import api
from compiler.api import BondEnd, BondGraph, Compilation, Kind, Source, Strokes

from ..presentation.text.causality import arrow_of, reason_of
from ..presentation.text.tables import counted, end_name
from .answer import Mark, MarkedAnswer, gaps, lines_of

STROKE = re.compile(r"(\S.*?\s+)(->\||\|->|->)(\s+.*\S)")
TAIL, HEAD = 0, 1


def strokes_to_put(compilation: Compilation) -> str:
    """Return the exercise: each bond with an arrow that has no stroke yet. Raises `CompilationFailed`."""
    graph = compilation.causal.graph
    left_out = len(compilation.whole_graph.nodes) - len(graph.nodes)
    lines = [
        f"# Strokes of {graph.name}: write ->| or |-> for each -> (the stroke is at the end that receives the effort).",
        *[f"# {counted(left_out, 'node')} left out: they give nothing in this run."] * bool(left_out),
    ]
    return "\n".join([*lines, *(arrow_of(graph, bond, None) for bond in range(len(graph.bonds)))])


def mark_strokes(compilation: Compilation, answer: Source) -> MarkedAnswer:
    """Return the marks of an answer. Raises `CompilationFailed` for a model without strokes."""
    with suppress(api.CompilationFailed):
        _ = compilation.state_space  # for its equations the compiler may change its choice of strokes
    causal, bonds = compilation.causal, defaultdict[str, list[int]](list)
    for number in range(len(causal.graph.bonds)):
        bonds[arrow_of(causal.graph, number, None)].append(number)
    put, marks, stray = dict[int, int](), dict[int, Mark](), list[Mark]()
    for line in lines_of(answer):
        match = STROKE.fullmatch(line.text)
        tail, arrow, head = (part.strip() for part in match.groups()) if match else ("", "", "")
        if bonds[f"{tail} -> {head}"]:
            bond = bonds[f"{tail} -> {head}"].pop(0)
            marks[bond] = Mark(line, line.text, "it has no stroke yet" if arrow == "->" else "")
            put |= {} if arrow == "->" else {bond: TAIL if arrow == "->|" else HEAD}
            continue
        fault = "there is no such bond left" if match else "a line has two names and an arrow, `a ->| b` or `a |-> b`"
        if f"{head} -> {tail}" in bonds and match:
            fault = "there is no such bond: its arrow leads the other way, and only the stroke is yours"
        stray.append(Mark(line, line.text, fault))
    wrong = faults(causal.graph, put)
    every = [Mark(m.span, m.words, m.wrong or wrong.get(bond, "")) for bond, m in marks.items()]
    marked = MarkedAnswer((*stray, *every, *gaps(answer, [arrow for arrow, left in bonds.items() for _ in left])))
    strokes = tuple(put[bond] for bond in sorted(put))
    if not marked.right or strokes == causal.effort_from:
        return marked
    try:
        other = api.CausalGraph(causal.graph, strokes, causal.reasons, _derivative(causal.graph, put))
        api.derive_equations(other, compilation.zeros, frozenset())
    except api.CompilationFailed as failed:
        return MarkedAnswer((*every, Mark(every[0].span, "all strokes together", failed.diagnostics[0].sentence)))
    return MarkedAnswer(marked.marks, "another choice than the compiler's, as good as that")


def faults(graph: BondGraph, put: Mapping[int, int]) -> dict[int, str]:
    """Return what is wrong with strokes, by bond. `put`: of each bond that has one, the end that determines the effort."""
    strokes = Strokes(graph)
    for demand in api.demanded_strokes(strokes):
        strokes.put(demand)
    demanded, wrong = set(strokes.trail), dict[int, str]()
    dependent = {strokes.bond_of[end] for end in _derivative(graph, put)}
    integral = {strokes.bond_of[end] for _, ends in _storages(graph) for end in ends} - dependent
    for bond in sorted(put, key=lambda b: (b not in demanded, b not in integral, b)):
        if (reason := strokes.reasons[bond]) is None:
            fault = _put(strokes, bond, put[bond])
        else:
            why = ("" if reason.bond is None else "it ") + reason_of(graph, reason, strokes.effort_from)
            fault = f"it is `{'|->' if put[bond] == TAIL else '->|'}` ({why})"
        if strokes.effort_from[bond] != put[bond]:
            wrong[bond] = fault
    return wrong | _too_few(graph, {b: end for b, end in put.items() if b not in wrong})


def _put(strokes: Strokes, bond: int, end: int) -> str:
    """Put a stroke with its consequences, and return an empty text; if that contradicts strokes put before, return how."""
    tail, mark = strokes.graph.bonds[bond].tail, len(strokes.trail)
    try:
        strokes.put(api.Stroke(bond, tail, end == TAIL, api.StrokeOrigin(api.StrokeReason.FREE, tail.node)))
        return ""
    except api.Contradiction as contradiction:
        node, behind = contradiction.node, contradiction.stroke.bond
        number = "no bond gives" if node is None or strokes.decided[node] is None else "two bonds give"
        strokes.undo(mark)
    if node is None:
        return f"with the other strokes, `{arrow_of(strokes.graph, behind, None)}` would have its stroke at both ends"
    junction = strokes.graph.nodes[node]
    shared = "effort" if junction.kind is Kind.ZERO else "flow"
    return f"with the other strokes, {number} the {shared} of the {junction.kind.value}-junction `{junction.name}`"


def _too_few(graph: BondGraph, put: Mapping[int, int]) -> dict[int, str]:
    """Return the bonds of storages that could be in integral form, too, beside all that are. What its author wants in derivative form may be so."""
    dependent, by_wish = set(_derivative(graph, put)), api.derivative_wishes(graph)
    wishes = {
        node.name: "integral" if not dependent & set(ends) else node.prefer if node.name in by_wish else None
        for node, ends in _storages(graph)
    }
    free = dependent.difference(api.assign_causality(api.preferring(graph, wishes)).derivative)
    bond_of = Strokes(graph).bond_of
    return {bond_of[end]: f"`{end_name(graph, end)}` can be in integral form, too" for end in free}


def _storages(graph: BondGraph) -> Iterator[tuple[api.Element, tuple[BondEnd, ...]]]:
    for number, node in enumerate(graph.nodes):
        if isinstance(node, api.Element) and node.stored:
            yield node, tuple(BondEnd(number, port) for port in range(len(node.ports)))


def _derivative(graph: BondGraph, put: Mapping[int, int]) -> tuple[BondEnd, ...]:
    """Return the ports of storages in derivative form: a displacement does not give the effort there, or a momentum does."""
    bonds = Strokes(graph).bond_of
    ports = [
        (e, stored, bonds[e]) for node, ends in _storages(graph) for e, stored in zip(ends, node.stored, strict=True)
    ]
    gives = {e: (graph.bonds[b].tail == e) is (put[b] == TAIL) for e, _, b in ports if b in put}
    return tuple(e for e, stored, _ in ports if e in gives and gives[e] is not (stored == "q"))
