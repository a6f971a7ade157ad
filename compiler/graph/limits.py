"""Readings of efforts and flows by conditions and laws, and thresholds of conditions: `abs(end.e) > limit`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Set

from ..algebra.expression import Apply, Symbol, depends_on, operations
from ..algebra.formula import Bound, Formula
from ..fast_dataclass import dataclass
from .network import BondGraph, Element, Event, Junction, Quantity, Reading

COMPARISONS = ("less", "less_equal", "equal")


@dataclass(frozen=True, slots=True)
class Readers:
    """Groups of bonds whose effort (or flow) is read: by the conditions of events, each with these events, and by anything else that moves the model."""

    events: dict[int, list[Event]]
    others: frozenset[int]


class Readings:
    """Groups of bonds behind references. `group`: of each bond, those that share the variable, `e` or `f`."""

    def __init__(self, graph: BondGraph, variable: str, group: list[int]) -> None:
        self.graph, self.variable, self.group = graph, variable, group
        self.numbers = {n.name: i for i, n in enumerate(graph.nodes)}

    def readers(self, excluded: Set[tuple[str, int]]) -> Readers:
        """Return the groups that are read. `excluded`: events that do not count, by owner and place."""
        graph, events, others = self.graph, dict[int, list[Event]](), set[int]()
        for event in graph.events:
            if (event.name, event.span.start) in excluded:
                continue
            read = self.of(event.condition.arguments)
            for group in read:
                events.setdefault(group, []).append(event)
            others |= {g for action in event.actions for g in self.of(action.value.arguments)} - read
        bounds = [s.active for s in graph.switches] + [i.rate for i in graph.integrals.values()]
        for bound in (*bounds, *(d.value for d in graph.delays.values())):
            others |= self.of(bound.arguments)
        for node in graph.nodes:
            if isinstance(node, Element):
                others |= self.of(node.arguments)
        return Readers(events, frozenset(others))

    def limit(self, event: Event, group: int) -> Bound | None:
        """Return the threshold of a condition that holds where the absolute value of a group's variable is above it; None for any other condition."""
        formula, arguments = event.condition.formula, event.condition.arguments
        own = [Symbol(slot) for slot, a in enumerate(arguments) if group in self.of((a,))]
        compared = [
            x
            for x in operations(formula.expression)
            if x.operator in COMPARISONS and any(depends_on(x, symbol) for symbol in own)
        ]
        if len(own) != 1 or len(compared) != 1 or compared[0].operator == "equal":
            return None
        low, high = compared[0].operands
        if high != Apply("abs", (own[0],)) or depends_on(low, own[0]):
            return None
        return Bound(Formula(formula.arity, low), arguments)

    def of(self, arguments: Iterable[object]) -> set[int]:
        """Return the groups behind arguments of a formula, also through the definitions of signals."""
        behind, passed, waiting = set[int](), set[str](), list(arguments)
        while waiting:
            argument = waiting.pop()
            if isinstance(argument, Reading) and argument.variable == self.variable:
                behind.update(self.group[bond] for bond in self._bonds(argument))
            elif (
                isinstance(argument, Quantity)
                and argument.name not in passed
                and argument.name in self.graph.quantities
            ):
                passed.add(argument.name)
                definition = self.graph.quantities[argument.name].definition
                waiting += () if definition is None else definition.arguments
        return behind

    def _bonds(self, reading: Reading) -> Iterator[int]:
        graph = self.graph
        if (reading.node, reading.port) in graph.walls:
            yield graph.walls[reading.node, reading.port]
            return
        number = self.numbers.get(reading.node)
        if number is None:
            return
        node = graph.nodes[number]
        for bond in graph.incident[number]:
            for end in (graph.bonds[bond].tail, graph.bonds[bond].head):
                if end.node == number and (isinstance(node, Junction) or node.ports[end.port].name == reading.port):
                    yield bond
