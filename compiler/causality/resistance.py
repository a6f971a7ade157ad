"""Directions of linear resistors that avoid a flow as a difference of nearly equal efforts divided by a small resistance.

In series the largest resistance determines the flow, in parallel the smallest determines the effort: the others then give small
contributions. Resistances are compared after transformation to one side of the transformers and gyrators between them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from ..graph.elements import Kind
from ..graph.network import BondEnd, BondGraph, Element, Junction, PortVariable
from .laws import slopes, value_before

SAME = 1e-9  # logarithms that differ by less are equal


class CausalityPreference(NamedTuple):
    """Preference of a resistor, and its distance (of logarithms) from the middle of the resistors that it is compared with."""

    node: int
    effort: bool
    distance: float


class _Side(NamedTuple):
    """Side to which a node is transformed: log R there is `shift` + log R here, or - log R if a gyrator is between."""

    group: int
    shift: float
    turned: bool

    def seen(self, logarithm: float) -> float:
        return self.shift + (-logarithm if self.turned else logarithm)


def resistor_wishes(graph: BondGraph) -> list[CausalityPreference]:
    """Preferences of the linear one-port resistors with known values, the most extreme first."""
    known = []
    for number, node in enumerate(graph.nodes):
        if isinstance(node, Element) and node.kind is Kind.RESISTOR and len(node.ports) == 1 and node.prefer is None:
            resistance = resistance_of(graph, node)
            if resistance is not None:
                known.append((number, math.log(abs(resistance)) if resistance else -math.inf))
    if len(known) < 2:
        return []
    sides, groups = _sides(graph), dict[int, list[tuple[int, float]]]()
    for number, logarithm in known:
        groups.setdefault(sides[number].group, []).append((number, sides[number].seen(logarithm)))
    wishes = []
    for members in groups.values():
        finite = [x for _, x in members if math.isfinite(x)]
        middle = (min(finite) + max(finite)) / 2 if finite else 0.0
        for number, x in members:
            if abs(x - middle) > SAME:
                small = (x < middle) is not sides[number].turned
                wishes.append(CausalityPreference(number, small, abs(x - middle)))
    return sorted(wishes, key=lambda w: (-round(w.distance, 6), w.node))


def resistance_of(graph: BondGraph, node: Element) -> float | None:
    """Slope of e over f of a linear law, if it is known before the run; else None."""
    found = _slopes(graph, node, PortVariable(0, "e"), PortVariable(0, "f"))
    if found is None or not found[0]:
        return None
    resistance = -found[1] / found[0]
    return resistance if math.isfinite(resistance) else None


def _slopes(graph: BondGraph, node: Element, first: PortVariable, second: PortVariable) -> tuple[float, float] | None:
    """Values of the factors of two variables in an element's law; None if they are not known before the run."""
    found = slopes(node.law, first, second)
    if found is None:
        return None
    one, other = (value_before(graph, slope, node.arguments) for slope in found)
    return None if one is None or other is None else (one, other)


def _ratio(graph: BondGraph, node: Element) -> float | None:
    """Ratio n of e1 = n e2, f2 = n f1, or k of e1 = k f2, e2 = k f1; None if it is not known before the run."""
    first, second = ("e", "e") if node.kind is Kind.TRANSFORMER else ("e", "f")
    found = _slopes(graph, node, PortVariable(0, first), PortVariable(1, second))
    if found is not None and all(found):
        return -found[1] / found[0]
    first, second = ("f", "f") if node.kind is Kind.TRANSFORMER else ("f", "e")
    found = _slopes(graph, node, PortVariable(0, first), PortVariable(1, second))
    return None if found is None or not all(found) else -found[0] / found[1]


def _sides(graph: BondGraph) -> list[_Side]:
    """Side of each node. All nodes connected by junctions, transformers and gyrators are one group."""
    sides: list[_Side | None] = [None] * len(graph.nodes)
    bond_of = {end: number for number, bond in enumerate(graph.bonds) for end in (bond.tail, bond.head)}
    for start in range(len(graph.nodes)):
        if sides[start] is not None or not isinstance(graph.nodes[start], Junction):
            continue
        sides[start] = _Side(start, 0.0, False)
        work = [start]
        while work:
            number = work.pop()
            here = sides[number]
            assert here is not None
            for bond in graph.incident[number]:
                for reached, side in _across(graph, bond_of, bond, number, here):
                    if sides[reached] is None:
                        sides[reached] = side
                        if isinstance(graph.nodes[reached], Junction):
                            work.append(reached)
    return [side or _Side(number, 0.0, False) for number, side in enumerate(sides)]


def _across(
    graph: BondGraph, bond_of: dict[BondEnd, int], bond: int, number: int, side: _Side
) -> Iterator[tuple[int, _Side]]:
    """Node at the other end of a bond, through transformers and gyrators with known ratio."""
    ends = graph.bonds[bond]
    end = ends.head if ends.tail.node == number else ends.tail
    for _ in range(len(graph.nodes)):  # a ring of transformers ends too
        node = graph.nodes[end.node]
        if not (isinstance(node, Element) and node.kind in (Kind.TRANSFORMER, Kind.GYRATOR)):
            yield end.node, side
            return
        ratio = _ratio(graph, node)
        if not ratio or not math.isfinite(ratio):
            return
        side = _beyond(side, node.kind, 2 * math.log(abs(ratio)), end.port == 0)
        other = BondEnd(end.node, 1 - end.port)
        ends = graph.bonds[bond_of[other]]
        end = ends.head if ends.tail == other else ends.tail


def _beyond(side: _Side, kind: Kind, step: float, forward: bool) -> _Side:
    """Z1 = n^2 Z2 through a transformer, Z1 Z2 = k^2 through a gyrator."""
    if kind is Kind.GYRATOR:
        return _Side(side.group, side.shift - step if side.turned else side.shift + step, not side.turned)
    return _Side(side.group, side.shift + (step if forward is not side.turned else -step), side.turned)
