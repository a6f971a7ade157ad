"""Explanation of causality: every stroke with its reason, storages in derivative form with their cause, algebraic loops, and advice."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import networkx as nx

from compiler import api

from .tables import columns, counted, end_name, visible

SCHEMA = "bondgraph-causality/1"
FLOWS = {"C": "flow", "I": "effort", "IC": "other variable"}
LONGEST_SEARCH = 400  # most variables of a loop from which its shortest cycle is searched


@dataclass(frozen=True, slots=True)
class StrokeRow:
    """One bond: the stroke is at the end that receives the effort."""

    bond: str  # in the textbooks' notation: `push ->| body`, `body |-> spring`
    effort_from: str
    flow_from: str
    why: str
    place: str


@dataclass(frozen=True, slots=True)
class DerivativeRow:
    """A storage in derivative form, the chain of bonds to its cause, and advice for the author."""

    storage: str
    place: str
    forced_by: str | None
    forced_at: str | None
    why: str
    chain: tuple[tuple[str, str], ...]  # bonds with their places, from the storage on
    advice: str


@dataclass(frozen=True, slots=True)
class LoopRow:
    """An algebraic loop: its shortest cycle in the order of computation, and advice for the author."""

    members: tuple[str, ...]
    cycle: tuple[tuple[str, str, str], ...]  # variable, element whose equation computes it, line
    variables: int
    advice: str


@dataclass(frozen=True, slots=True)
class CausalityExplanation:
    """Contents of `bondgraph causality`. `diagnostics`: obstacles to equations with these strokes."""

    model: str
    left_out: int
    strokes: tuple[StrokeRow, ...]
    derivative: tuple[DerivativeRow, ...]
    loops: tuple[LoopRow, ...]
    diagnostics: tuple[api.Diagnostic, ...]

    def to_json(self) -> dict[str, Any]:
        """Return JSON values by `bondgraph-causality/1`."""
        return {
            "schema": SCHEMA, "model": self.model, "left_out": self.left_out,
            "strokes": [asdict(r) for r in self.strokes],
            "derivative": [asdict(r) | {"chain": [{"bond": b, "place": p} for b, p in r.chain]} for r in self.derivative],
            "loops": [
                asdict(r) | {"cycle": [{"variable": v, "owner": o, "place": p} for v, o, p in r.cycle]} for r in self.loops
            ],
            "diagnostics": [d.to_json() for d in self.diagnostics],
        }  # fmt: skip

    def text(self) -> str:
        """Return text for readers: a table of the strokes, then storages and loops one by one."""
        return "\n".join(visible(line) for line in self._lines())

    def _lines(self) -> Iterator[str]:
        yield (
            f"causality of {self.model}: {counted(len(self.strokes), 'bond')}, "
            f"{counted(len(self.derivative), 'storage')} in derivative form, {counted(len(self.loops), 'algebraic loop')}"
        )
        if self.left_out:
            yield f"left out because they give nothing in this run: {counted(self.left_out, 'node')}"
        if self.strokes:
            yield ""
            rows = [
                ("bond", "effort from", "flow from", "why", "line"),
                *((r.bond, r.effort_from, r.flow_from, r.why, r.place) for r in self.strokes),
            ]
            yield from columns(rows)
        for row in self.derivative:
            yield from ("", f"`{row.storage}` ({row.place}) is in derivative form: {row.why}")
            yield from (f"    {line}" for line in columns(row.chain))
            yield f"  what you can do: {row.advice}"
        for loop in self.loops:
            more = f" ({loop.variables} variables in all)" if loop.variables > len(loop.cycle) else ""
            yield from ("", f"algebraic loop of {', '.join(f'`{m}`' for m in loop.members)}{more}")
            around = zip((loop.cycle[-1], *loop.cycle), loop.cycle, strict=False)
            cycle = [
                (f"{before} gives {name}", f"by `{owner}`", place) for (before, *_), (name, owner, place) in around
            ]
            yield from (f"    {line}" for line in columns(cycle))
            yield f"  what you can do: {loop.advice}"


def explain(compilation: api.Compilation) -> CausalityExplanation:
    """Return the explanation of a scene. Raises `CompilationFailed` if there are no strokes."""
    causal = compilation.causal
    system, found = None, tuple["api.Diagnostic", ...]()
    try:
        system = compilation.equations
        _ = compilation.state_space
    except api.CompilationFailed as failed:
        found = failed.diagnostics
    graph = causal.graph
    return CausalityExplanation(
        graph.name, len(compilation.whole_graph.nodes) - len(graph.nodes),
        tuple(_stroke(causal, bond) for bond in range(len(graph.bonds))),
        tuple(_derivative(causal, item) for item in api.dependences(causal)),
        () if system is None else tuple(_loops(causal, system)), tuple(found),
    )  # fmt: skip


def told(diagnostics: Sequence[api.Diagnostic]) -> str:
    """Return diagnostics as the other commands show them."""
    return "\n\n".join(map(api.render, diagnostics))


# ---------------------------------------------------------------- strokes


def _stroke(causal: api.CausalGraph, bond: int) -> StrokeRow:
    ends, effort = causal.graph.bonds[bond], causal.effort_from[bond]
    names = [end_name(causal.graph, ends.tail), end_name(causal.graph, ends.head)]
    why = reason_of(causal.graph, causal.reasons[bond], causal.effort_from)
    return StrokeRow(
        arrow_of(causal.graph, bond, effort), names[effort], names[1 - effort], why, ends.span.file_and_line
    )


def reason_of(graph: api.BondGraph, reason: api.StrokeOrigin, effort_from: Sequence[int | None]) -> str:
    """Return the reason of a stroke; `effort_from` has all strokes."""
    owner = f"`{graph.nodes[reason.node].name}`"
    if reason.bond is None:
        return f"{owner}: {reason.because.value}"
    return f"follows at {owner} from {arrow_of(graph, reason.bond, effort_from[reason.bond])}"


def arrow_of(graph: api.BondGraph, bond: int, effort_from: int | None) -> str:
    """Return a bond in the textbooks' notation; without a stroke if nothing is known of it."""
    ends = graph.bonds[bond]
    arrow = "->" if effort_from is None else "|->" if effort_from else "->|"
    return f"{end_name(graph, ends.tail)} {arrow} {end_name(graph, ends.head)}"


# ---------------------------------------------------------------- storages in derivative form


def _derivative(causal: api.CausalGraph, item: api.Dependence) -> DerivativeRow:
    graph = causal.graph
    node = graph.nodes[item.port.node]
    forcing = None if item.forced_by is None else graph.nodes[item.forced_by]
    name = end_name(graph, item.port)
    why, advice = _dependence(name, node, forcing, item.because)
    return DerivativeRow(
        name, node.span.file_and_line, None if forcing is None else forcing.name,
        None if forcing is None else forcing.span.file_and_line, why,
        tuple((arrow_of(graph, b, causal.effort_from[b]), graph.bonds[b].span.file_and_line) for b in item.bonds), advice,
    )  # fmt: skip


# The cause of a storage's derivative form, and advice for its author, by the reason of the stroke.
CAUSES: Mapping[api.StrokeReason, tuple[str, str]] = {
    api.StrokeReason.SOURCE: (
        "{other} decides its {variable} at once",
        "nothing, if it is meant so: the {flow} is the derivative of what `{owner}` gives. As every real source has one, put a small {parting} between them.",
    ),
    api.StrokeReason.MECHANISM: (
        "the mechanism {other} decides its {variable}",
        "give a body of `{owner}` what `{name}` stores, or put a stiff spring (a C on a 0-junction) between them.",
    ),
    api.StrokeReason.INTEGRAL: (
        "it follows from {other}, which is in integral form: together they have one state",
        "nothing, if they belong together: both are computed. To make `{name}` the state, {way} `{owner}`; "
        "to let them move apart, put a small {both} between them.",
    ),
    api.StrokeReason.FREE_END: ("{other} has only this bond", "hang something on `{owner}`, or remove it."),
    api.StrokeReason.CANCELS: (
        "bonds to and fro at {other} cancel", "remove both of them, or turn the arrow of one, if that is meant.",
    ),
}  # fmt: skip


def _dependence(name: str, node: Any, forcing: Any, because: api.StrokeReason) -> tuple[str, str]:
    """Return the cause of a storage's derivative form, and advice for the author."""
    stored = node.kind.value
    parting = "R or I on a 1-junction" if stored == "C" else "R or C on a 0-junction"
    word = "require" if because is api.StrokeReason.REQUIRED else "prefer"
    if forcing is None and because in (api.StrokeReason.REQUIRED, api.StrokeReason.WISHED):
        return "its author asks for it", f"leave out its `{word}`."
    if forcing is None:
        ring = "the ring of junctions around it leaves no other strokes"
        return ring, f"put a small {parting} between `{name}` and the ring."
    other = f"`{forcing.name}` ({forcing.span.file_and_line})"
    if because not in CAUSES:
        return f"{other} has a `{word}` that stands against it", f"leave out the `{word}` of `{forcing.name}`."
    words = {
        "name": name, "other": other, "owner": forcing.name, "variable": "effort" if stored == "C" else "flow", "flow": FLOWS[stored],
        "parting": parting, "both": parting if forcing.kind.value == stored else "R",
        "way": "change the `prefer` of" if getattr(forcing, "prefer", None) is not None else "write `prefer = derivative` on",
    }  # fmt: skip
    why, advice = CAUSES[because]
    return why.format(**words), advice.format(**words)


# ---------------------------------------------------------------- loops


def _loops(causal: api.CausalGraph, system: api.EquationSystem) -> Iterator[LoopRow]:
    """Yield blocks of mutually dependent assignments, each with its shortest cycle."""
    inputs: list[list[int]] = [[] for _ in system.variables]
    assigned = {a.target: a for a in system.assignments}
    for target, assignment in assigned.items():
        inputs[target] = [a for a in assignment.arguments if not isinstance(a, float) and a != target]
        if target in assignment.arguments and not assignment.implicit:
            inputs[target].append(target)
    numbers = {node.name: number for number, node in enumerate(causal.graph.nodes)}
    for block in api.blocks(range(len(inputs)), inputs):
        first = assigned.get(block[0])
        if len(block) == 1 and block[0] not in inputs[block[0]]:
            if first is not None and first.implicit:
                name = system.variables[first.target].name
                yield LoopRow(
                    (first.owner,), ((name, first.owner, first.span.file_and_line),), 1, _implicit(first.owner, name)
                )
            continue
        cycle = _shortest_cycle(sorted(block), inputs)
        rows = tuple((system.variables[v].name, assigned[v].owner, assigned[v].span.file_and_line) for v in cycle)
        members = tuple(dict.fromkeys(owner for _, owner, _ in rows))
        yield LoopRow(members, rows, len(block), _loop_advice(_junctions(causal, numbers, members)))


def _implicit(owner: str, variable: str) -> str:
    return (
        f"nothing, if it is meant so: the law of `{owner}` cannot be solved for `{variable}`, which is found by iteration. To avoid it, "
        f"let `{owner}` decide the other variable (`prefer`), or write its law the other way."
    )


def _junctions(causal: api.CausalGraph, numbers: Mapping[str, int], members: Sequence[str]) -> list[Any]:
    """Return the junctions of a loop, including those that join two of its elements: variables shared by bonds have no equation."""
    graph = causal.graph
    inside = [numbers[m] for m in members if m in numbers]
    found = [n for n in inside if graph.nodes[n].kind.value in ("0", "1")]
    if not found:
        ends = [e.node for n in inside for b in graph.incident[n] for e in (graph.bonds[b].tail, graph.bonds[b].head)]
        joins = Counter(n for n in ends if graph.nodes[n].kind.value in ("0", "1"))
        found = sorted(n for n, count in joins.items() if count > 1)
    return [graph.nodes[n] for n in found]


def _shortest_cycle(block: Sequence[int], inputs: Sequence[Sequence[int]]) -> list[int]:
    """Return the variables of a shortest cycle, each computed from the one before it (and the first from the last)."""
    inside, best = set(block), list[int]()
    reads = nx.DiGraph((v, other) for v in block for other in inputs[v] if other in inside)
    for start in block[:LONGEST_SEARCH]:
        if len(best) == 1:
            break
        paths = nx.single_source_shortest_path(reads, start, cutoff=(len(best) or len(block) + 1) - 2)
        best = next((path[::-1] for path in paths.values() if reads.has_edge(path[-1], start)), best)
    return best


def _loop_advice(junctions: Sequence[Any]) -> str:
    solved = "nothing, if it belongs there: it is solved with the rest."
    if not junctions:
        return f"{solved} To break it, let one of its signals read what a storage or `integral` holds."
    ways = [
        f"a small C on the 0-junction `{j.name}`" if j.kind.value == "0" else f"a small I on the 1-junction `{j.name}`"
        for j in junctions[:3]
    ]
    return f"{solved} To break it, put {' or '.join(ways)}: what is stored there is known."
