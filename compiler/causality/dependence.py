"""Reason for a storage in derivative form: the shortest chain of bonds to the element that prevents the integral form.

With the storage in integral form, all strokes along the chain would be at the other end, up to a source that determines the
other variable or a storage that is in derivative form instead.
"""

from __future__ import annotations

from collections.abc import Iterable

from ..fast_dataclass import dataclass
from ..graph.elements import STORAGES, Kind
from ..graph.network import BondEnd, Element, Junction
from .assign import CausalGraph
from .strokes import DEMANDS, StrokeReason


@dataclass(frozen=True, slots=True)
class Dependence:
    """A storage port in derivative form, and the node that forces it.

    `bonds` lead from the storage to `forced_by` (a node; None if a ring of junctions or the author forces it).
    """

    port: BondEnd
    forced_by: int | None
    because: StrokeReason
    bonds: tuple[int, ...]


def dependences(causal: CausalGraph) -> tuple[Dependence, ...]:
    """Reason for each storage port in derivative form."""
    bond_of = {end: number for number, bond in enumerate(causal.graph.bonds) for end in (bond.tail, bond.head)}
    return tuple(_dependence(causal, bond_of, port) for port in causal.derivative)


def _dependence(causal: CausalGraph, bond_of: dict[BondEnd, int], port: BondEnd) -> Dependence:
    start = bond_of[port]
    own = causal.reasons[start]
    if own.node == port.node and own.because in (StrokeReason.REQUIRED, StrokeReason.WISHED):
        return Dependence(port, None, own.because, (start,))
    before: dict[tuple[int, int], tuple[int, int] | None] = {(start, port.node): None}  # bond, the node it is left from
    queue = [(start, port.node)]
    for step in queue:
        reached = _other(causal, *step)
        because = _stands(causal, reached.node, step[0])
        if because is not None:
            return Dependence(port, reached.node, because, _path(before, step))
        for bond in _gives_way(causal, bond_of, step[0], reached):
            following = (bond, reached.node)
            if following not in before:
                before[following] = step
                queue.append(following)
    return Dependence(port, None, StrokeReason.FOLLOWS, (start,))


def _other(causal: CausalGraph, bond: int, node: int) -> BondEnd:
    ends = causal.graph.bonds[bond]
    return ends.head if ends.tail.node == node else ends.tail


def _stands(causal: CausalGraph, node: int, bond: int) -> StrokeReason | None:
    """Reason why the stroke on a bond cannot be turned at the node; None if it can."""
    here = causal.graph.nodes[node]
    reason = causal.reasons[bond]
    if reason.node == node and reason.because in DEMANDS:
        return reason.because
    if isinstance(here, Junction):
        return StrokeReason.FREE_END if len(causal.graph.incident[node]) == 1 else None
    if isinstance(here, Element) and here.kind in (Kind.EFFORT_SOURCE, Kind.FLOW_SOURCE):
        return StrokeReason.SOURCE
    if isinstance(here, Element):
        if here.require is not None:
            return StrokeReason.REQUIRED
        if here.kind in STORAGES and BondEnd(node, _port(causal, bond, node)) not in causal.derivative:
            return StrokeReason.INTEGRAL
        return None if here.prefer is None else StrokeReason.WISHED
    return StrokeReason.MECHANISM


def _port(causal: CausalGraph, bond: int, node: int) -> int:
    ends = causal.graph.bonds[bond]
    return ends.tail.port if ends.tail.node == node else ends.head.port


def _gives_way(causal: CausalGraph, bond_of: dict[BondEnd, int], bond: int, reached: BondEnd) -> Iterable[int]:
    """Strokes that could turn to compensate for a turned one: any other, or the one that determines the junction."""
    node = causal.graph.nodes[reached.node]
    if isinstance(node, Junction):
        decides = causal.decides_effort(bond, reached.node) is (node.kind is Kind.ONE)
        others = [b for b in causal.graph.incident[reached.node] if b != bond]
        if decides:
            return others
        return [b for b in others if causal.decides_effort(b, reached.node) is (node.kind is Kind.ONE)]
    if isinstance(node, Element) and node.kind in (Kind.TRANSFORMER, Kind.GYRATOR):
        return (bond_of[BondEnd(reached.node, 1 - reached.port)],)
    return ()


def _path(before: dict[tuple[int, int], tuple[int, int] | None], step: tuple[int, int]) -> tuple[int, ...]:
    path, here = [], step
    while True:
        path.append(here[0])
        earlier = before[here]
        if earlier is None:
            return tuple(reversed(path))
        here = earlier
