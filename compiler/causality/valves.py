"""Start modes of ideal valves with which the strokes fit: all that block beside a source of flow, or all that conduct beside one of effort, contradict it.

A run decides at its start which valves conduct, whatever their modes say; only the structure from which it asks has to have strokes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from ..algebra.expression import Number, Symbol
from ..algebra.formula import Bound, Formula
from ..errors import CompilationFailed
from ..graph.elements import Kind
from ..graph.network import BondGraph, Element, Junction, Law, Port, PortVariable
from ..graph.valves import Valve
from .assign import assign_causality

OHMIC = Law(((Symbol(PortVariable(0, "e")), Symbol(PortVariable(0, "f"))),), None, 0)


def with_fitting_modes(
    graph: BondGraph, valves: Sequence[Valve], off: Sequence[str], switched: Callable[[BondGraph, Sequence[str]], BondGraph]
) -> BondGraph:  # fmt: skip
    """Return the graph with other start modes of valves where those as written contradict other demands: as many as can be stay.

    `off`: the junctions that are off at the start as written; `switched`: the graph with junctions off, as a run has it.
    """
    try:
        assign_causality(switched(graph, off))
        return graph
    except CompilationFailed:
        pass
    own = {v.junction: v.junction in off for v in valves}  # True: conducts as written
    free = switched(graph, [name for name in off if name not in own])
    nodes = tuple(_undecided(n, own[n.name]) if isinstance(n, Junction) and n.name in own else n for n in free.nodes)
    try:
        causal = assign_causality(replace(free, nodes=nodes))
    except CompilationFailed:
        return graph
    decided = {n.name: causal.decides_effort(free.incident[i][0], i) for i, n in enumerate(nodes) if n.name in own}
    quantities = dict(graph.quantities)
    for valve in valves:
        value = valve.conducting if decided.get(valve.junction, own[valve.junction]) else 1.0 - valve.conducting
        start = Bound(Formula(0, Number(value)), ())
        quantities[valve.mode] = replace(quantities[valve.mode], value=value, definition=start)
    return replace(graph, quantities=quantities)


def _undecided(node: Junction, conducts: bool) -> Element:
    """A resistor in place of the gap of a valve, which prefers to decide what the valve decides as written."""
    prefer = "effort" if conducts else "flow"
    return Element(
        node.name, Kind.RESISTOR, False, (Port("", node.domain),), OHMIC, (), (), {}, {}, prefer, None, node.definition, node.span
    )  # fmt: skip
