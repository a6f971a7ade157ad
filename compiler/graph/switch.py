"""Junctions that are off: a 1-junction without flow, a 0-junction without effort.

Each of its bonds ends at a source of zero instead, so all later passes (pruning, causality, equations) work as for any
graph: an open switch between two nodes vanishes, a shorted capacitor is in derivative form, an isolated part keeps its content.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from ..algebra.expression import ZERO, Symbol, evaluate
from .elements import Kind
from .network import TIME, Bond, BondEnd, BondGraph, Element, Junction, Law, Node, Port, PortVariable, Quantity
from .prune import adjustable
from .sharing import ValveEvents, shared

NONE: ValveEvents = {}


def switch_off(
    graph: BondGraph, names: Iterable[str], valves: ValveEvents = NONE, ports: frozenset[str] = frozenset()
) -> BondGraph:
    """The graph with these junctions off. `valves`: the ideal ones, which share undetermined currents and voltages, with their events; `ports`: of a
    companion."""
    off = frozenset(names)
    if not off:
        return shared(graph, valves, off, ports=ports)
    nodes: list[Node] = list(graph.nodes)
    ends: dict[tuple[int, int], int] = {}  # node and bond -> the node where the bond ends instead
    sources: dict[Kind, list[str]] = {Kind.ZERO: [], Kind.ONE: []}  # in the place of junctions of each kind
    for number, node in enumerate(graph.nodes):
        if not isinstance(node, Junction) or node.name not in off:
            continue
        for count, bond in enumerate(graph.incident[number]):
            ends[number, bond] = number if not count else len(nodes)
            source = _nothing(node, node.name if not count else f"{node.name} ({count + 1})")
            sources[node.kind].append(source.name)
            if count:
                nodes.append(source)
            else:
                nodes[number] = source

    def moved(end: BondEnd, bond: int) -> BondEnd:
        return BondEnd(ends.get((end.node, bond), end.node), end.port)

    bonds = tuple(Bond(moved(b.tail, n), moved(b.head, n), b.domain, b.span) for n, b in enumerate(graph.bonds))
    closed, holding = (frozenset(sources[kind]) for kind in (Kind.ZERO, Kind.ONE))
    return shared(replace(graph, nodes=tuple(nodes), bonds=bonds), valves, off | closed, holding, ports)


def decided(graph: BondGraph, settable: frozenset[str]) -> BondGraph:
    """The graph in which junctions whose condition reads constants alone are on or off for the whole run. `settable`: quantities that a run may set."""

    def is_constant(reference: object) -> bool:
        if not isinstance(reference, Quantity):
            return isinstance(reference, float)
        named = graph.quantities.get(reference.name)
        if named is None or named.role not in ("parameter", "constant") or named.value is None:
            return False
        if named.name in settable or ("*" in settable and adjustable(named)):
            return False
        return named.definition is None or all(map(is_constant, named.definition.arguments))

    def value(reference: object) -> float:
        number = graph.quantities[reference.name].value if isinstance(reference, Quantity) else reference
        assert isinstance(number, float)
        return number

    left, off = [], []
    for switch in graph.switches:
        condition = switch.active
        if not all(map(is_constant, condition.arguments)):
            left.append(switch)
        elif evaluate(condition.formula.expression, lambda slot, b=condition: value(b.arguments[slot])) != 1.0:  # type: ignore[misc]
            off.append(switch.junction)
    return graph if len(left) == len(graph.switches) else replace(switch_off(graph, off), switches=tuple(left))


def off_at_the_start(graph: BondGraph, time: float) -> tuple[str, ...]:
    """Junctions whose condition is false with the start values of the modes. If a condition reads varying quantities, its junction is on."""

    def value(name: str) -> float:
        if name == TIME.name and name not in graph.quantities:
            return time
        named = graph.quantities[name]
        if named.value is not None:
            return named.value
        if (
            named.role not in ("mode", "signal", "output", "input")
            or named.definition is None
            or name in graph.integrals
        ):
            raise ValueError(name)
        bound = named.definition
        return evaluate(bound.formula.expression, lambda slot: reference(bound.arguments[slot]))

    def reference(argument: object) -> float:
        if isinstance(argument, float):
            return argument
        if isinstance(argument, Quantity):
            return value(argument.name)
        raise ValueError(argument)

    off = []
    for switch in graph.switches:
        condition = switch.active
        try:
            on = evaluate(condition.formula.expression, lambda slot, b=condition: reference(b.arguments[slot]))  # type: ignore[misc]
        except (ArithmeticError, ValueError, KeyError):
            continue
        if on != 1.0:
            off.append(switch.junction)
    return tuple(off)


def _nothing(node: Junction, name: str) -> Element:
    """A source of no flow, or of no effort."""
    kind, variable = (Kind.FLOW_SOURCE, "f") if node.kind is Kind.ONE else (Kind.EFFORT_SOURCE, "e")
    law = Law(((Symbol(PortVariable(0, variable)), ZERO),), None, 0)
    ports = (Port("", node.domain),)
    return Element(name, kind, False, ports, law, (), (), {}, {}, None, None, node.definition, node.span)
