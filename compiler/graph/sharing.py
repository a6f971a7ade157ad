"""Ideal switches whose currents or voltages the network leaves undetermined: they are shared equally.

A loop of closed switches alone leaves the division of a current undetermined; a part connected only through open switches has no
determined potential. Both follow in the limit of equal small resistances, and of equal small leakages: around such a loop the flows
of the switches add up to zero, with their signs, and so do the efforts across the switches that connect such a part. One switch of
each loop, and of each such cut, becomes a source with this condition; all others stay as they are. Loops and cuts are the null space
of the equations of the junctions (by Tellegen's theorem the rule is the dual of the freedom that the network leaves).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

from ..algebra.expression import ZERO, Expression, Number, Symbol, add, multiply
from .elements import Kind
from .network import BondGraph, Element, Junction, Law, Own, Port, Reading

Row = dict[int, Fraction]  # group of bonds -> coefficient


def shared(
    graph: BondGraph, valves: frozenset[str], closed: frozenset[str], holding: frozenset[str] = frozenset()
) -> BondGraph:
    """Return the graph with one source for each loop of closed switches and each part behind open ones, if a valve is among them.

    `closed`: junctions that have become sources of no effort. Open are the valves and switches that are still 0-junctions with one bond, and
    `holding`: sources of no flow in the place of 1-junctions. Several that hold one flow at zero share the effort as well.
    """
    if not valves and len(holding) < 2:
        return graph
    ends = {
        n.name: i
        for i, n in enumerate(graph.nodes)
        if n.name in closed and isinstance(n, Element) and n.kind is Kind.EFFORT_SOURCE
    }
    opened = {s.junction for s in graph.switches} - closed
    gaps = {
        n.name: i
        for i, n in enumerate(graph.nodes)
        if n.name in opened and isinstance(n, Junction) and n.kind is Kind.ZERO and len(graph.incident[i]) == 1
    }
    gaps |= {n.name: i for i, n in enumerate(graph.nodes) if n.name in holding}
    nodes = list(graph.nodes)
    for kind, among, own in ((Kind.FLOW_SOURCE, ends, valves), (Kind.EFFORT_SOURCE, gaps, valves | holding)):
        for name, others in _open(graph, among, kind, own).items():
            nodes[among[name]] = _source(graph, among[name], kind, others)
    return replace(graph, nodes=tuple(nodes))


def _open(
    graph: BondGraph, among: Mapping[str, int], kind: Kind, valves: frozenset[str]
) -> dict[str, dict[str, float]]:
    """For each switch that shares: the others of its loop, or of its cut, with their signs."""
    if not among.keys() & valves:
        return {}
    joins, sums = (Kind.ONE, Kind.ZERO) if kind is Kind.FLOW_SOURCE else (Kind.ZERO, Kind.ONE)
    group = groups(graph, joins, frozenset(among.values()))
    grounds = frozenset(i for i, n in enumerate(graph.nodes) if i not in among.values() and _is_ground(n, kind))
    still = {
        group[b]
        for i, n in enumerate(graph.nodes)
        if not isinstance(n, Junction) and i not in among.values() and i not in grounds
        for b in graph.incident[i]
    }
    rows = [
        row
        for i, n in enumerate(graph.nodes)
        if n.kind is sums and i not in among.values()
        if (row := _sum(graph, i, group, still))
    ]
    places = {name: group[graph.incident[i][0]] for name, i in among.items()}
    number = Counter(places.values())
    # Closed ones in a row carry the same: one shares for all. Open ones at one node leave it without an effort.
    own = {places[n]: n for n in sorted(places, key=valves.__contains__) if joins is Kind.ONE or number[places[n]] == 1}
    inner = sorted({g for row in rows for g in row} - own.keys())
    pivots = _eliminated(rows, [*inner, *sorted(own, key=lambda g: own[g] in valves)])
    found = {}
    for g in [g for g in own if g not in pivots and g not in still]:
        loop = {own[p]: -float(row[g] * number[p] / number[g]) for p, row in pivots.items() if g in row and p in own}
        if valves & {own[g], *loop}:
            found[own[g]] = loop
    return found


def _is_ground(node: object, kind: Kind) -> bool:
    """Return True if a node is a source of zero, through which a loop or a cut may go."""
    other = Kind.EFFORT_SOURCE if kind is Kind.FLOW_SOURCE else Kind.FLOW_SOURCE
    return (
        isinstance(node, Element) and node.kind is other and len(node.ports) == 1 and node.law.equations[0][1] == ZERO
    )


def groups(graph: BondGraph, joins: Kind, own: frozenset[int]) -> list[int]:
    """For each bond the first of those that share its variable through junctions."""
    leader = list(range(len(graph.bonds)))

    def root(b: int) -> int:
        while leader[b] != b:
            leader[b] = leader[leader[b]]
            b = leader[b]
        return b

    for i, node in enumerate(graph.nodes):
        if node.kind is joins and i not in own and graph.incident[i]:
            first, *others = graph.incident[i]
            for bond in others:
                leader[root(bond)] = root(first)
    return [root(b) for b in range(len(graph.bonds))]


def _sum(graph: BondGraph, number: int, group: Sequence[int], still: set[int]) -> Row:
    """Balance of a junction over groups of bonds, without those that carry nothing."""
    row: Row = {}
    for bond in graph.incident[number]:
        sign = 1 if graph.bonds[bond].head.node == number else -1
        if group[bond] not in still:
            row[group[bond]] = row.get(group[bond], Fraction(0)) + sign
    return {g: c for g, c in row.items() if c}


def _eliminated(rows: list[Row], order: Sequence[int]) -> dict[int, Row]:
    """Reduced rows of a homogeneous system, by their pivots. Pivots are searched for in this order."""
    pivots: dict[int, Row] = {}
    rest = list(rows)
    for g in order:
        place = next((i for i, row in enumerate(rest) if g in row), None)
        if place is None:
            continue
        pivot = rest.pop(place)
        pivot = {k: c / pivot[g] for k, c in pivot.items()}
        rest = [r for r in (_without(row, g, pivot) for row in rest) if r]
        pivots = {p: _without(row, g, pivot) for p, row in pivots.items()} | {g: pivot}
    return pivots


def _without(row: Row, g: int, pivot: Row) -> Row:
    factor = row.get(g)
    if factor is None:
        return row
    result = {k: row.get(k, Fraction(0)) - factor * pivot.get(k, Fraction(0)) for k in {*row, *pivot}}
    return {k: c for k, c in result.items() if c}


def _source(graph: BondGraph, number: int, kind: Kind, others: Mapping[str, float]) -> Element:
    """A switch as a source of the remainder of its loop or cut."""
    node = graph.nodes[number]
    variable = "f" if kind is Kind.FLOW_SOURCE else "e"
    domain = graph.bonds[graph.incident[number][0]].domain
    terms: list[Expression] = [multiply(Number(-sign), Symbol(i)) for i, sign in enumerate(others.values())]
    law = Law(((Symbol(Own(0, variable)), add(*terms) if terms else ZERO),), None, len(others))
    arguments = tuple(Reading(name, "", variable) for name in others)
    ports = (Port("", domain),)
    return Element(
        node.name, kind, bool(others), ports, law, arguments, (), {}, {}, None, None, node.definition, node.span
    )
