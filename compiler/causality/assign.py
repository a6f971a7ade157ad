"""The sequential causality assignment procedure (Karnopp, Margolis and Rosenberg, System Dynamics, chapter 5).

A stroke says which end of a bond decides its effort; the other end decides its flow. Sources and what an element requires
come first, then storage in integral form, then resistors in the direction in which their law is written, then whatever is
left; after each choice everything that follows from it is assigned before the next choice is made. Every stroke remembers
why it stands where it stands.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

from ..algebra.affine import affine_parts
from ..algebra.expression import ZERO, Symbol, depends_on
from ..errors import CompilationFailed
from ..graph.network import STORAGES, BondGraph, Element, End, Junction, Kind, MechanismNode, Own
from ..source import Span
from .errors import StrokeConflict

TAIL, HEAD = 0, 1


class Because(Enum):
    """Why a stroke stands where it stands."""

    SOURCE = "a source decides it"
    REQUIRED = "the element requires it"
    MECHANISM = "a mechanism takes efforts and gives flows"
    INTEGRAL = "storage in integral form"
    PREFERRED = "the direction in which the law is written"
    FOLLOWS = "it follows from other strokes"
    FREE = "free choice"


@dataclass(frozen=True, slots=True)
class Reason:
    """The rule, the node that applied it and the bond it follows from."""

    because: Because
    node: int
    bond: int | None = None


@dataclass(frozen=True, eq=False)
class CausalGraph:
    """A bond graph with a stroke on every bond."""

    graph: BondGraph
    effort_from: tuple[int, ...]  # per bond: TAIL or HEAD, the end that decides the effort
    reasons: tuple[Reason, ...]
    derivative: tuple[End, ...]  # storage ports in derivative form

    def decides_effort(self, bond: int, node: int) -> bool:
        """Whether the node decides the effort of one of its bonds."""
        ends = self.graph.bonds[bond]
        end = ends.tail if self.effort_from[bond] == TAIL else ends.head
        return end.node == node


class _Conflict(Exception):
    def __init__(self, bond: int, node: int, reason: Reason) -> None:
        self.bond, self.node, self.reason = bond, node, reason


Choice = tuple[int, int, bool, Because]  # bond, node, whether the node decides its effort, why
MAXIMUM_TRIES = 1000  # choices taken back before a contradiction is believed


def assign_causality(graph: BondGraph) -> CausalGraph:
    """Put a stroke on every bond. Raises `CompilationFailed` where two demands cannot both hold."""
    return _Assignment(graph).run()


class _Assignment:
    """The strokes so far, with a trail to take a trial back."""

    def __init__(self, graph: BondGraph) -> None:
        self.graph = graph
        self.effort_from: list[int | None] = [None] * len(graph.bonds)
        self.reasons: list[Reason | None] = [None] * len(graph.bonds)
        self.trail: list[int] = []
        self.bond_of: dict[End, int] = {}
        for number, bond in enumerate(graph.bonds):
            for end in (bond.tail, bond.head):
                self.bond_of[end] = number
        self.conflicts: list[StrokeConflict] = []
        # Junctions by counts, so that a junction of thousands of bonds costs its size once.
        self.open = [len(b) for b in graph.incident]
        self.decided: list[int | None] = [None] * len(graph.nodes)  # the bond that decides a junction

    def run(self) -> CausalGraph:
        self._demands()
        if self.conflicts:
            raise CompilationFailed(self.conflicts)
        phases = (self._storages(True), self._storages(False), self._resistors(), self._rest())
        self._choose([choice for phase in phases for choice in phase])
        derivative = tuple(self._derivative_ports())
        strokes = tuple(s for s in self.effort_from if s is not None)
        reasons = tuple(r for r in self.reasons if r is not None)
        return CausalGraph(self.graph, strokes, reasons, derivative)

    def _choose(self, choices: list[Choice]) -> None:
        """One choice after the other, each with what follows from it.

        A choice that contradicts is made the other way; if that contradicts too, the last choice before it that could still
        go the other way is taken back (rings of transformers and gyrators need this).
        """
        made: list[tuple[int, int, bool]] = []  # which choice, the trail before it, whether it went the other way
        position = tries = 0
        while position < len(choices):
            if self.effort_from[choices[position][0]] is not None:
                position += 1
                continue
            mark = len(self.trail)
            first = self._attempt(choices[position], False)
            second = self._attempt(choices[position], True) if first is not None else None
            if first is None or second is None:
                made.append((position, mark, first is not None))
                position += 1
                continue
            conflict = first
            while made:
                earlier, mark, other_way = made.pop()
                self._undo(mark)
                tries += 1
                if not other_way and tries < MAXIMUM_TRIES and self._attempt(choices[earlier], True) is None:
                    made.append((earlier, mark, True))
                    position = earlier + 1
                    break
            else:
                bond, node, effort, _ = choices[position]
                raise CompilationFailed([self._explain(conflict, bond, node, effort)])

    def _attempt(self, choice: Choice, other_way: bool) -> _Conflict | None:
        """Make a choice, or the opposite one; a contradiction leaves nothing behind and comes back."""
        bond, node, effort, because = choice
        mark = len(self.trail)
        try:
            reason = Reason(Because.FOLLOWS if other_way else because, node)
            self._assign(bond, node, effort != other_way, reason)
        except _Conflict as conflict:
            self._undo(mark)
            return conflict
        return None

    # ------------------------------------------------------------ the phases
    def _demands(self) -> None:
        """Sources, mechanisms, `require`, and laws that hold in one direction only."""
        for number, node in enumerate(self.graph.nodes):
            demands: list[tuple[int, bool, Because]] = []
            bonds = self.graph.incident[number]
            if isinstance(node, Junction) and len(bonds) == 1:  # a free end has no effort, a blocked one no flow
                self._demand(bonds[0], number, node.kind is Kind.ONE, Because.FOLLOWS)
            if isinstance(node, MechanismNode):
                demands = [(p, False, Because.MECHANISM) for p in range(len(node.ports))]
            elif isinstance(node, Element):
                if node.kind in (Kind.EFFORT_SOURCE, Kind.FLOW_SOURCE):
                    demands = [(p, node.kind is Kind.EFFORT_SOURCE, Because.SOURCE) for p in range(len(node.ports))]
                elif node.require is not None:
                    demands = [
                        (p, _wants_effort(node, p, node.require), Because.REQUIRED) for p in range(len(node.ports))
                    ]
            for port, effort, because in demands:
                self._demand(self.bond_of[End(number, port)], number, effort, because)

    def _demand(self, bond: int, node: int, effort: bool, because: Because) -> None:
        """What must hold whatever else is chosen."""
        mark = len(self.trail)
        try:
            self._assign(bond, node, effort, Reason(because, node))
        except _Conflict as conflict:
            self._undo(mark)
            self.conflicts.append(self._explain(conflict, bond, node, effort))

    def _storages(self, first: bool) -> Iterator[Choice]:
        """Storages in integral form; those that prefer the derivative come last, and in derivative form."""
        for number, node in enumerate(self.graph.nodes):
            if not (isinstance(node, Element) and node.kind in STORAGES):
                continue
            for port, stored in enumerate(node.stored):
                integral = stored == "q"  # a displacement gives the effort, a momentum the flow
                wanted = integral if node.prefer is None else _wants_effort(node, port, node.prefer)
                if (wanted == integral) is first:
                    yield self.bond_of[End(number, port)], number, wanted, Because.INTEGRAL

    def _resistors(self) -> Iterator[Choice]:
        """Nonlinear laws first: they may not be invertible, a linear one always is."""
        resistors = [
            (n, node)
            for n, node in enumerate(self.graph.nodes)
            if isinstance(node, Element) and node.kind is Kind.RESISTOR
        ]
        for wanted in (False, True):
            for number, node in resistors:
                linear = _is_linear(node)
                if linear is not wanted:
                    continue
                for port in range(len(node.ports)):
                    effort = _wants_effort(node, port, node.prefer) if node.prefer else _written_effort(node, port)
                    yield self.bond_of[End(number, port)], number, effort, Because.PREFERRED

    def _rest(self) -> Iterator[Choice]:
        for number, bond in enumerate(self.graph.bonds):
            yield number, bond.tail.node, True, Because.FREE

    # ------------------------------------------------------------ propagation
    def _assign(self, bond: int, node: int, effort: bool, reason: Reason) -> None:
        """The node decides (or does not decide) the effort of the bond; then everything that follows."""
        work = [(bond, node, effort, reason)]
        while work:
            bond, node, effort, reason = work.pop()
            ends = self.graph.bonds[bond]
            here = TAIL if ends.tail.node == node else HEAD
            decider = here if effort else 1 - here
            if self.effort_from[bond] is not None:
                if self.effort_from[bond] != decider:
                    raise _Conflict(bond, node, reason)
                continue
            self.effort_from[bond], self.reasons[bond] = decider, reason
            self.trail.append(bond)
            for end in (ends.tail, ends.head):
                self.open[end.node] -= 1
            for end, side in ((ends.tail, TAIL), (ends.head, HEAD)):
                work += self._consequences(end, bond, decider == side)

    def _consequences(self, end: End, bond: int, decides_effort: bool) -> list[tuple[int, int, bool, Reason]]:
        """What a new stroke means for the other bonds of a node."""
        number = end.node
        node = self.graph.nodes[number]
        reason = Reason(Because.FOLLOWS, number, bond)
        if isinstance(node, Junction):
            return self._at_junction(number, node, bond, decides_effort, reason)
        if isinstance(node, Element) and node.kind in (Kind.TRANSFORMER, Kind.GYRATOR):
            other = self.bond_of[End(number, 1 - end.port)]
            effort = not decides_effort if node.kind is Kind.TRANSFORMER else decides_effort
            return [(other, number, effort, reason)]
        return []

    def _at_junction(
        self, number: int, node: Junction, bond: int, decides_effort: bool, reason: Reason
    ) -> list[tuple[int, int, bool, Reason]]:
        # At a 0 one bond brings the effort in; at a 1 one bond brings the flow in, so the junction decides its effort.
        brings = decides_effort is (node.kind is Kind.ONE)
        others = self.graph.incident[number]
        default = node.kind is Kind.ZERO  # whether the junction decides the effort of its ordinary bonds
        if brings:
            if self.decided[number] is not None:
                raise _Conflict(bond, number, Reason(Because.FOLLOWS, number, self.decided[number]))
            self.decided[number] = bond
            return [(b, number, default, reason) for b in others if b != bond and self.effort_from[b] is None]
        if self.decided[number] is None:
            if self.open[number] == 0:
                raise _Conflict(
                    bond, number, Reason(Because.FOLLOWS, number, next((b for b in others if b != bond), None))
                )
            if self.open[number] == 1:
                last = next(b for b in others if self.effort_from[b] is None)
                return [(last, number, not default, reason)]
        return []

    def _undo(self, mark: int) -> None:
        while len(self.trail) > mark:
            bond = self.trail.pop()
            self.effort_from[bond] = self.reasons[bond] = None
            for end in (self.graph.bonds[bond].tail, self.graph.bonds[bond].head):
                self.open[end.node] += 1
                if self.decided[end.node] == bond:
                    self.decided[end.node] = None

    # ------------------------------------------------------------ results and reasons
    def _derivative_ports(self) -> Iterator[End]:
        for number, node in enumerate(self.graph.nodes):
            if isinstance(node, Element) and node.kind in STORAGES:
                for port, stored in enumerate(node.stored):
                    bond = self.bond_of[End(number, port)]
                    ends = self.graph.bonds[bond]
                    decider = ends.tail if self.effort_from[bond] == TAIL else ends.head
                    if (decider.node == number) is not (stored == "q"):
                        yield End(number, port)

    def _explain(self, conflict: _Conflict, bond: int, node: int, effort: bool) -> StrokeConflict:
        """The demand that failed, and the chain of strokes from the one that it met."""
        name = self.graph.nodes[node].name
        decides = "effort" if effort else "flow"
        chain: list[tuple[Span, str]] = []
        here = self.graph.nodes[conflict.node]
        meeting = f" at `{here.name}`" if conflict.node != node else ""
        for start in (conflict.bond, conflict.reason.bond):
            current: int | None = start
            for _ in range(12):
                if current is None or self.reasons[current] is None:
                    break
                reason = self.reasons[current]
                assert reason is not None
                if reason.because is not Because.FOLLOWS:
                    who = self.graph.nodes[reason.node]
                    if reason.node != node and (who.span, f"`{who.name}`: {reason.because.value}") not in chain:
                        chain.append((who.span, f"`{who.name}`: {reason.because.value}"))
                    break
                current = reason.bond
        other = f" it meets {chain[0][1].split(':')[0]}" if chain else ""
        what = f"`{name}` must decide the {decides} of its bond, but that is already decided{meeting}" + (
            f":{other}" if other else ""
        )
        hint = (
            "A 0-junction takes its effort from one bond, a 1-junction its flow from one bond. Put a resistor or storage "
            "between the two, or make one of them the other kind of source."
        )
        return StrokeConflict(self.graph.nodes[node].span, what, hint, tuple(chain))


def _wants_effort(node: Element, port: int, word: str) -> bool:
    """Whether a wish means that the element decides the effort of a port."""
    if word in ("effort", "flow"):
        return word == "effort"
    return (word == "integral") is (node.stored[port] == "q")


def _written_effort(node: Element, port: int) -> bool:
    """Whether the law is written for the effort of a port, as in F = r*v."""
    for left, right in node.law.equations:
        for side, other in ((left, right), (right, left)):
            if (
                isinstance(side, Symbol)
                and isinstance(side.key, Own)
                and side.key.port == port
                and not depends_on(other, side)
            ):
                return side.key.variable == "e"
    return True


def _is_linear(node: Element) -> bool:
    """Whether a one-port's law is linear, so that it holds in both directions."""
    if len(node.ports) != 1 or not node.law.equations:
        return False
    ((left, right),) = node.law.equations
    rest = left - right
    for variable in "ef":
        parts = affine_parts(rest, Symbol(Own(0, variable)))
        if parts is None or parts[0] == ZERO:
            return False
        rest = parts[1]
    return True
