"""The sequential causality assignment procedure (Karnopp, Margolis and Rosenberg, System Dynamics, chapter 5), made exact.

Mandatory causality comes first, then one choice after the other, each with its consequences. The sets of junctions that storages
and resistors can determine together are the sets of vertices that matchings cover, a delta-matroid. There a greedy choice gives the
best of all assignments, in any order among equals, if a choice is refused exactly when the strokes could not be completed
(A. Bouchet, Greedy algorithm and symmetric matroids, Mathematical Programming 38 (1987)). A choice with an immediate contradiction
is refused with proof. A choice that cannot be completed shows only later, in rings; then all choices are repeated, each checked by a
perfect matching.
"""

from __future__ import annotations

from collections.abc import Iterator

from ..errors import CompilationFailed
from ..fast_dataclass import dataclass
from ..graph.elements import STORAGES, Kind
from ..graph.groups import Groups
from ..graph.network import BondEnd, BondGraph, Element, Junction, MechanismNode, Port
from ..multibody.tree import drivable
from .conflict import bond_to_itself, conflict_of, no_strokes
from .errors import StrokeConflict
from .laws import has_start, is_linear, wants_effort, written_effort, written_stored
from .matching import Matching
from .resistance import resistor_wishes
from .strokes import TAIL, Contradiction, Stroke, StrokeOrigin, StrokeReason, Strokes


@dataclass(frozen=True, eq=False)
class CausalGraph:
    """A bond graph with a causal stroke on every bond."""

    graph: BondGraph
    effort_from: tuple[int, ...]  # per bond: TAIL or HEAD, the end that decides the effort
    reasons: tuple[StrokeOrigin, ...]
    derivative: tuple[BondEnd, ...]  # storage ports in derivative form

    def decides_effort(self, bond: int, node: int) -> bool:
        """Return True if the node determines the effort of one of its bonds."""
        ends = self.graph.bonds[bond]
        end = ends.tail if self.effort_from[bond] == TAIL else ends.head
        return end.node == node


def assign_causality(graph: BondGraph) -> CausalGraph:
    """Put a stroke on every bond. Raises `CompilationFailed` if two demands contradict each other."""
    strokes = Strokes(graph)
    conflicts = list(_demand(strokes))
    if conflicts:
        raise CompilationFailed(conflicts)
    choices = [*_choices(strokes)]
    mark = len(strokes.trail)
    if not _choose(strokes, choices):
        _choose_by_matching(strokes, choices, mark)
    done = tuple(s for s in strokes.effort_from if s is not None)
    reasons = tuple(r for r in strokes.reasons if r is not None)
    return CausalGraph(graph, done, reasons, tuple(_derivative_ports(strokes)))


def _choose(strokes: Strokes, choices: list[Stroke]) -> bool:
    """Make each choice, or the opposite one if it contradicts. Returns False if both do, so that an earlier choice was wrong."""
    return all(
        strokes.effort_from[choice.bond] is not None or _try(strokes, choice) or _try(strokes, _opposite(choice))
        for choice in choices
    )


def _choose_by_matching(strokes: Strokes, choices: list[Stroke], mark: int) -> None:
    """Undo all choices and repeat them, each only if the strokes can be completed after it."""
    matching = Matching(strokes)
    matching.remember(strokes.trail[mark:])
    strokes.undo(mark)
    if matching.complete() is not None:
        raise CompilationFailed([no_strokes(strokes, matching.tree)])
    for choice in choices:
        if strokes.effort_from[choice.bond] is not None:
            continue
        mark = len(strokes.trail)
        if _try(strokes, choice):
            if matching.follow(strokes.trail[mark:]):
                continue
            strokes.undo(mark)
        strokes.put(_opposite(choice))
        matching.follow(strokes.trail[mark:])


def _try(strokes: Strokes, stroke: Stroke) -> bool:
    """Put a stroke. On a contradiction, undo it and return False."""
    mark = len(strokes.trail)
    try:
        strokes.put(stroke)
    except Contradiction:
        strokes.undo(mark)
        return False
    return True


def _opposite(choice: Stroke) -> Stroke:
    return Stroke(choice.bond, choice.end, not choice.effort, StrokeOrigin(StrokeReason.REFUSED, choice.node))


# ---------------------------------------------------------------- demands


def _demand(strokes: Strokes) -> Iterator[StrokeConflict]:
    """Put the mandatory strokes, and yield their conflicts."""
    to_itself = [n for n, bond in enumerate(strokes.graph.bonds) if bond.tail == bond.head]
    if to_itself:
        yield from (bond_to_itself(strokes, bond) for bond in to_itself)
        return
    for stroke in demands(strokes):
        mark = len(strokes.trail)
        try:
            strokes.put(stroke)
        except Contradiction as contradiction:
            yield conflict_of(strokes, stroke, contradiction)
            strokes.undo(mark)


def demands(strokes: Strokes) -> Iterator[Stroke]:
    """Strokes of sources, mechanisms, `require`, junctions with a single bond, and bonds that cancel."""
    graph = strokes.graph
    yield from _cancelling(graph)
    for number, node in enumerate(graph.nodes):
        match node:
            case Junction():
                if len(graph.incident[number]) == 1:
                    reason = StrokeOrigin(StrokeReason.FREE_END, number)
                    yield Stroke(graph.incident[number][0], BondEnd(number, 0), node.kind is Kind.ONE, reason)
            case MechanismNode():
                may = drivable(node.mechanism, [p.name for p in node.ports])
                yield from (s for s, p in _of_mechanism(strokes, number, node) if p.name not in may)
            case Element(kind=Kind.EFFORT_SOURCE | Kind.FLOW_SOURCE):
                effort = node.kind is Kind.EFFORT_SOURCE
                yield from _of_ports(strokes, number, [effort] * len(node.ports), StrokeReason.SOURCE)
            case Element() if node.require is not None:
                wanted = [wants_effort(node, port, node.require) for port in range(len(node.ports))]
                yield from _of_ports(strokes, number, wanted, StrokeReason.REQUIRED)


def _cancelling(graph: BondGraph) -> Iterator[Stroke]:
    """Bonds between a 0 and a 1, equally many in both directions.

    The effort of the 0 and the flow of the 1 drop out of each other's sums, so other bonds have to determine both; a stroke among the
    cancelling ones would close a loop of gain 1. Junctions of one kind that are joined by bonds count as one.
    """
    home = _joined(graph)
    # a 0 and a 1 -> bonds, each with its own 0 and 1 or -1
    between: dict[tuple[int, int], list[tuple[int, int, int]]] = {}
    for number, bond in enumerate(graph.bonds):
        tail, head = bond.tail.node, bond.head.node
        kinds = graph.nodes[tail].kind, graph.nodes[head].kind
        if kinds == (Kind.ZERO, Kind.ONE):
            between.setdefault((home[tail], home[head]), []).append((number, tail, 1))
        elif kinds == (Kind.ONE, Kind.ZERO):
            between.setdefault((home[head], home[tail]), []).append((number, head, -1))
    for bonds in between.values():
        if sum(sign for *_, sign in bonds) == 0:
            for number, zero, sign in bonds:
                end = graph.bonds[number].tail if sign > 0 else graph.bonds[number].head
                yield Stroke(number, end, True, StrokeOrigin(StrokeReason.CANCELS, zero))


def _joined(graph: BondGraph) -> dict[int, int]:
    """For each junction, the representative of its group: junctions of one kind that are joined by bonds."""
    home = Groups((n, n) for n, node in enumerate(graph.nodes) if isinstance(node, Junction))
    for bond in graph.bonds:
        tail, head = bond.tail.node, bond.head.node
        if tail in home and head in home and graph.nodes[tail].kind is graph.nodes[head].kind:
            home.join(tail, head)
    return {n: home.of(n) for n in home}


def _of_ports(strokes: Strokes, node: int, efforts: list[bool], because: StrokeReason) -> Iterator[Stroke]:
    for port, effort in enumerate(efforts):
        end = BondEnd(node, port)
        yield Stroke(strokes.bond_of[end], end, effort, StrokeOrigin(because, node))


# ---------------------------------------------------------------- choices


def _choices(strokes: Strokes) -> Iterator[Stroke]:
    """All choices, the most important first.

    Joints of mechanisms, preferences of storages, storages, preferences of others, nonlinear laws, linear resistors, the rest. The
    preference of a resistor does not take the integral form from a storage, which might leave a junction undetermined.
    """
    graph = strokes.graph
    for number, node in enumerate(graph.nodes):
        if isinstance(node, MechanismNode):
            yield from (stroke for stroke, _ in _of_mechanism(strokes, number, node))
    elements = [(n, node) for n, node in enumerate(graph.nodes) if isinstance(node, Element)]
    storages = [(n, node) for n, node in elements if node.kind in STORAGES]
    yield from _wishes(strokes, sorted(storages, key=lambda item: _against(item[1])))
    for number, node in sorted(storages, key=lambda item: _hardness(graph, item[1])):
        integral = [stored == "q" for stored in node.stored]  # a displacement gives the effort, a momentum the flow
        yield from _of_ports(strokes, number, integral, StrokeReason.INTEGRAL)
    yield from _wishes(strokes, [(n, node) for n, node in elements if node.kind not in STORAGES])
    resistors = [(n, node) for n, node in elements if node.kind is Kind.RESISTOR]
    yield from (s for n, node in resistors if not is_linear(node) for s in _as_written(strokes, n, node))
    for wish in resistor_wishes(graph):
        yield from _of_ports(strokes, wish.node, [wish.effort], StrokeReason.CONDITIONED)
    yield from (s for n, node in resistors if is_linear(node) for s in _as_written(strokes, n, node))
    for number, bond in enumerate(graph.bonds):
        yield Stroke(number, bond.tail, True, StrokeOrigin(StrokeReason.FREE, bond.tail.node))


def _of_mechanism(strokes: Strokes, number: int, node: MechanismNode) -> Iterator[tuple[Stroke, Port]]:
    """Strokes of a mechanism: efforts in, flows out. Only efforts of its joints may be determined by it, where nothing else is possible."""
    strokes_of_ports = _of_ports(strokes, number, [False] * len(node.ports), StrokeReason.MECHANISM)
    return zip(strokes_of_ports, node.ports, strict=True)


def _wishes(strokes: Strokes, elements: list[tuple[int, Element]]) -> Iterator[Stroke]:
    for number, node in elements:
        if node.prefer is not None:
            wanted = [wants_effort(node, port, node.prefer) for port in range(len(node.ports))]
            yield from _of_ports(strokes, number, wanted, StrokeReason.WISHED)


def _against(node: Element) -> int:
    """Preferences for integral form have more weight than those for derivative form, so that these cost as few as possible."""
    if node.prefer is None or node.kind not in STORAGES:
        return 1
    integral = [wants_effort(node, port, node.prefer) is (stored == "q") for port, stored in enumerate(node.stored)]
    return 0 if all(integral) else 2


def _hardness(graph: BondGraph, node: Element) -> int:
    """Rank among storages of which only some can be in integral form: the less it can do with the derivative form, the earlier it chooses."""
    if not is_linear(node) and written_stored(node):
        return 4  # q = f(u): the integral form needs the inverse, which may be steep or undefined
    if len(node.ports) > 1:
        return 0  # a field has no derivative form
    if has_start(graph, node):
        return 1  # a start says nothing on a dependent storage
    return 3 if is_linear(node) else 2


def _as_written(strokes: Strokes, number: int, node: Element) -> Iterator[Stroke]:
    efforts = [written_effort(node, port) for port in range(len(node.ports))]
    return _of_ports(strokes, number, efforts, StrokeReason.PREFERRED)


def _derivative_ports(strokes: Strokes) -> Iterator[BondEnd]:
    for number, node in enumerate(strokes.graph.nodes):
        if isinstance(node, Element) and node.kind in STORAGES:
            for port, stored in enumerate(node.stored):
                end = BondEnd(number, port)
                if strokes.decides_effort(strokes.bond_of[end], number) is not (stored == "q"):
                    yield end
