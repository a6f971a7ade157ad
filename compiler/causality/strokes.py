"""Strokes put on bonds one by one, each with its consequences, and a trail to undo them.

The rules: a 0-junction takes its effort from one bond, a 1-junction its flow from one bond; a transformer determines the effort on
one side and the flow on the other, a gyrator the same on both sides.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum

from ..fast_dataclass import dataclass
from ..graph.elements import Kind
from ..graph.network import BondEnd, BondGraph, Element, Junction

TAIL, HEAD = 0, 1


class StrokeReason(Enum):
    """Reason for a stroke."""

    SOURCE = "a source decides it"
    REQUIRED = "the element requires it"
    MECHANISM = "a mechanism takes efforts and gives flows"
    FREE_END = "a free end has no effort, a blocked one no flow"
    CANCELS = "bonds to and fro between two junctions cancel, so they cannot decide anything"
    WISHED = "the element prefers it"
    INTEGRAL = "storage in integral form"
    PREFERRED = "the direction in which the law is written"
    CONDITIONED = "by its size among the linear resistors around it"
    FOLLOWS = "it follows from other strokes"
    REFUSED = "the other way would leave no strokes for the rest"
    FREE = "free choice"


DEMANDS = frozenset(
    {StrokeReason.SOURCE, StrokeReason.REQUIRED, StrokeReason.MECHANISM, StrokeReason.FREE_END, StrokeReason.CANCELS}
)


@dataclass(frozen=True, slots=True)
class StrokeOrigin:
    """The rule, the node that applied it and the bond from which it follows."""

    because: StrokeReason
    node: int
    bond: int | None = None


@dataclass(frozen=True, slots=True)
class Stroke:
    """A stroke to be put: True if the node at that end determines the effort of the bond, and the reason."""

    bond: int
    end: BondEnd
    effort: bool
    reason: StrokeOrigin

    @property
    def node(self) -> int:
        return self.end.node


class Contradiction(Exception):
    """A stroke that cannot be put: its bond has the opposite stroke, or a junction would get two determining bonds or none."""

    def __init__(self, stroke: Stroke, node: int | None) -> None:
        self.stroke, self.node = stroke, node


class Strokes:
    """Strokes put so far."""

    def __init__(self, graph: BondGraph) -> None:
        self.graph = graph
        self.effort_from: list[int | None] = [None] * len(graph.bonds)
        self.reasons: list[StrokeOrigin | None] = [None] * len(graph.bonds)
        self.trail: list[int] = []
        self.bond_of = {end: number for number, bond in enumerate(graph.bonds) for end in (bond.tail, bond.head)}
        # Junctions by counts, so that a junction of thousands of bonds costs its size once.
        self.open = [len(b) for b in graph.incident]
        self.decided: list[int | None] = [None] * len(graph.nodes)  # the bond that decides a junction

    def decides_effort(self, bond: int, node: int) -> bool | None:
        """Return True if a node determines the effort of one of its bonds; None if there is no stroke yet."""
        if self.effort_from[bond] is None:
            return None
        return self.effort_from[bond] == self.side(bond, node)

    def side(self, bond: int, node: int) -> int:
        """TAIL or HEAD: the end of a bond at which a node is."""
        return TAIL if self.graph.bonds[bond].tail.node == node else HEAD

    def put(self, stroke: Stroke) -> None:
        """Put a stroke and all its consequences. Raises `Contradiction`; strokes put before it stay on the trail."""
        work = [stroke]
        while work:
            stroke = work.pop()
            bond, ends = stroke.bond, self.graph.bonds[stroke.bond]
            here = TAIL if ends.tail == stroke.end else HEAD
            decider = here if stroke.effort else 1 - here
            if self.effort_from[bond] is not None:
                if self.effort_from[bond] != decider:
                    raise Contradiction(stroke, None)
                continue
            self.effort_from[bond], self.reasons[bond] = decider, stroke.reason
            self.trail.append(bond)
            for end in (ends.tail, ends.head):
                self.open[end.node] -= 1
            for end, side in ((ends.tail, TAIL), (ends.head, HEAD)):
                work += self._consequences(end, stroke, decider == side)

    def undo(self, mark: int) -> None:
        """Undo the strokes put since the trail had that length."""
        while len(self.trail) > mark:
            bond = self.trail.pop()
            self.effort_from[bond] = self.reasons[bond] = None
            for end in (self.graph.bonds[bond].tail, self.graph.bonds[bond].head):
                self.open[end.node] += 1
                if self.decided[end.node] == bond:
                    self.decided[end.node] = None

    def _consequences(self, end: BondEnd, stroke: Stroke, decides_effort: bool) -> Iterable[Stroke]:
        """Strokes that follow from a new stroke at the other bonds of a node."""
        node = self.graph.nodes[end.node]
        reason = StrokeOrigin(StrokeReason.FOLLOWS, end.node, stroke.bond)
        if isinstance(node, Junction):
            return self._at_junction(end, node, stroke, decides_effort, reason)
        if isinstance(node, Element) and node.kind in (Kind.TRANSFORMER, Kind.GYRATOR):
            other = BondEnd(end.node, 1 - end.port)
            effort = decides_effort is (node.kind is Kind.GYRATOR)
            return (Stroke(self.bond_of[other], other, effort, reason),)
        return ()

    def _at_junction(
        self, end: BondEnd, node: Junction, stroke: Stroke, decides_effort: bool, reason: StrokeOrigin
    ) -> Iterable[Stroke]:
        # At a 0 one bond brings the effort in; at a 1 one bond brings the flow in, so the junction decides its effort.
        bond, number = stroke.bond, end.node
        others = self.graph.incident[number]
        default = node.kind is Kind.ZERO  # True if the junction determines the effort of its ordinary bonds
        if decides_effort is not default:
            if self.decided[number] is not None:
                raise Contradiction(stroke, number)
            self.decided[number] = bond
            return [Stroke(b, end, default, reason) for b in others if b != bond and self.effort_from[b] is None]
        if self.decided[number] is None:
            if self.open[number] == 0:
                raise Contradiction(stroke, number)
            if self.open[number] == 1:
                last = next(b for b in others if self.effort_from[b] is None)
                return [Stroke(last, end, not default, reason)]
        return ()
