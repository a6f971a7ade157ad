"""Removal of elements that contribute nothing: a resistor with r = 0, a source that is off, a spring without stiffness.

It comes before causality, so that no stroke is spent on them. A parameter counts as zero only if this run cannot change it.
An element whose variables are read elsewhere stays, with the zero as its law: `p = 0*v` can only be solved in one direction.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from ..algebra.expression import ZERO, Expression, Symbol, substitute, symbols
from ..algebra.formula import Bound, over
from .elements import STORAGES, Kind
from .network import (
    Bond,
    BondEnd,
    BondGraph,
    Element,
    Junction,
    Law,
    MechanismNode,
    Named,
    Node,
    Port,
    PortVariable,
    Quantity,
    Reading,
)

Zeros = frozenset[str]


def known_zeros(graph: BondGraph, free: frozenset[str]) -> Zeros:
    """Quantities that are always zero in this run. `free` names those that must stay adjustable."""
    zeros: dict[str, bool] = {}

    def is_zero(name: str) -> bool:
        if name not in zeros:
            zeros[name] = False  # a cycle would have been reported before
            named = graph.quantities.get(name)
            if (
                named is not None
                and named.definition is not None
                and named.role not in ("mode", "solve")
                and name not in free
                and not ("*" in free and adjustable(named))
            ):
                zeros[name] = fold(named.definition, is_zero) == ZERO
        return zeros[name]

    return frozenset(name for name in graph.quantities if is_zero(name))


def adjustable(named: Named) -> bool:
    """Return True if a quantity is an argument of a program: a parameter or input without dependences."""
    return named.role in ("parameter", "input") and (named.definition is None or not named.definition.arguments)


def fold(bound: Bound, is_zero: object) -> Expression:
    """Expression of a bound formula with its known zeros put in."""
    assert callable(is_zero)

    def value(reference: object) -> Expression:
        return ZERO if isinstance(reference, Quantity) and is_zero(reference.name) else Symbol(reference)

    return over(bound.formula.expression, bound.arguments, value)


def prune(graph: BondGraph, zeros: Zeros) -> BondGraph:
    """The graph without elements that contribute nothing."""
    read = {name for r in _readings(graph) for name in _read_nodes(graph, r)}
    dropped: set[BondEnd] = set()
    changed: dict[int, Element] = {}
    neighbours = _neighbours(graph)
    for number, node in enumerate(graph.nodes):
        if not isinstance(node, Element):
            continue
        silent = _silent_ports(node, zeros)
        if not silent:
            continue
        if node.name in read:
            changed[number] = _with_zero(node, silent)
            continue
        removable = {
            p for p, variable in silent.items() if _absorbs(graph, neighbours.get(BondEnd(number, p)), variable)
        }
        if len(node.ports) == 1 and not removable:
            changed[number] = _silent_source(node, silent[0])
        elif removable and _independent(node, removable):
            dropped |= {BondEnd(number, p) for p in removable}
            if len(removable) < len(node.ports):
                changed[number] = _without_ports(node, removable)
    if not dropped and not changed:
        return graph
    return _rebuild(graph, dropped, changed)


def preferring(graph: BondGraph, wishes: Mapping[str, str | None]) -> BondGraph:
    """The graph with other preferences for the form of some storages."""
    if not wishes:
        return graph
    nodes = tuple(
        replace(n, prefer=wishes[n.name]) if isinstance(n, Element) and n.name in wishes else n for n in graph.nodes
    )
    return replace(graph, nodes=nodes)


def derivative_wishes(graph: BondGraph, but: frozenset[str] = frozenset()) -> tuple[str, ...]:
    """Storages that prefer the derivative form at some port, except the given ones."""
    return tuple(
        n.name
        for n in graph.nodes
        if isinstance(n, Element)
        and n.kind in STORAGES
        and n.name not in but
        and any(n.prefer in ("derivative", "flow" if stored == "q" else "effort") for stored in n.stored)
    )


def _readings(graph: BondGraph) -> Iterator[Reading]:
    """Readings of elements in quantities, outputs and laws."""
    for definition in graph.definitions():
        yield from (a for a in definition.arguments if isinstance(a, Reading))
    for event in graph.events:
        yield from (action.target for action in event.actions if isinstance(action.target, Reading))
    for node in graph.nodes:
        if isinstance(node, Element):
            yield from (a for a in node.arguments if isinstance(a, Reading))


def _read_nodes(graph: BondGraph, reading: Reading) -> tuple[str, ...]:
    """The node of a reading; for a port of a model both ends of the bond that passes through it."""
    number = graph.walls.get((reading.node, reading.port))
    if number is None:
        return (reading.node,)
    return tuple(graph.nodes[end.node].name for end in (graph.bonds[number].tail, graph.bonds[number].head))


def _neighbours(graph: BondGraph) -> Mapping[BondEnd, int]:
    """For each end of a bond the node at its other end."""
    result = {}
    for bond in graph.bonds:
        result[bond.tail], result[bond.head] = bond.head.node, bond.tail.node
    return result


def _silent_ports(node: Element, zeros: Zeros) -> dict[int, str]:
    """Map from port number to the variable, `e` or `f`, that is identically zero there."""
    if node.kind not in (Kind.RESISTOR, Kind.EFFORT_SOURCE, Kind.FLOW_SOURCE, Kind.CAPACITOR, Kind.INERTIA):
        return {}

    vanishing = {
        slot
        for slot, a in enumerate(node.arguments)
        if (a.name in zeros if isinstance(a, Quantity) else isinstance(a, float) and a == 0.0)
    }

    def value(symbol: Symbol) -> Expression:
        return ZERO if isinstance(symbol.key, int) and symbol.key in vanishing else symbol

    def put(x: Expression) -> Expression:
        return substitute(x, value) if vanishing else x

    if node.law.energy is not None:
        vanishes = node.kind is Kind.CAPACITOR and put(node.law.energy) == ZERO
        return dict.fromkeys(range(len(node.ports)), "e") if vanishes else {}
    silent: dict[int, str] = {}
    for left, right in node.law.equations:
        if isinstance(left, Symbol) and isinstance(left.key, PortVariable) and put(right) == ZERO:
            # p = 0*v stores nothing and gives no effort; q = 0*e likewise gives no flow
            variable = {"e": "e", "f": "f", "p": "e", "q": "f"}[left.key.variable]
            silent[left.key.port] = variable
    return silent


def _with_zero(node: Element, silent: dict[int, str]) -> Element:
    """A one-port with the law `variable = 0`, which determines the zero variable and nothing else."""
    if len(node.ports) > 1 or node.kind in (Kind.EFFORT_SOURCE, Kind.FLOW_SOURCE):
        return node
    ((left, _),) = node.law.equations or ((Symbol(PortVariable(0, silent[0])), ZERO),)
    require = node.require if node.require is not None else "effort" if silent[0] == "e" else "flow"
    return replace(node, law=Law(((left, ZERO),), None, 0), arguments=(), require=require)


def _absorbs(graph: BondGraph, other: int | None, variable: str) -> bool:
    """Return True if the other end only adds a zero to a sum."""
    if other is None:
        return False
    node = graph.nodes[other]
    if isinstance(node, Junction):
        return node.kind is (Kind.ONE if variable == "e" else Kind.ZERO)
    return isinstance(node, MechanismNode) and variable == "e"


def _independent(node: Element, removable: set[int]) -> bool:
    """Return True if the remaining ports do not depend on the removed ones."""
    if len(removable) == len(node.ports):
        return True
    if node.law.energy is not None:
        return False
    for left, right in node.law.equations:
        if isinstance(left, Symbol) and isinstance(left.key, PortVariable) and left.key.port in removable:
            continue
        if any(
            isinstance(s.key, PortVariable) and s.key.port in removable for side in (left, right) for s in symbols(side)
        ):
            return False
    return True


def _silent_source(node: Element, variable: str) -> Element:
    """A source of zero: it still shorts a 0-junction or blocks a 1-junction."""
    kind = Kind.EFFORT_SOURCE if variable == "e" else Kind.FLOW_SOURCE
    law = Law(((Symbol(PortVariable(0, variable)), ZERO),), None, 0)
    return replace(node, kind=kind, law=law, arguments=(), stored=(), starts={}, nominals={}, prefer=None, require=None)


def _without_ports(node: Element, removed: set[int]) -> Element:
    renumbered = {old: new for new, old in enumerate(p for p in range(len(node.ports)) if p not in removed)}

    def own(symbol: Symbol) -> Expression:
        if not isinstance(symbol.key, PortVariable):
            return symbol
        return Symbol(PortVariable(renumbered[symbol.key.port], symbol.key.variable))

    equations = tuple(
        (substitute(left, own), substitute(right, own))
        for left, right in node.law.equations
        if not (isinstance(left, Symbol) and isinstance(left.key, PortVariable) and left.key.port in removed)
    )
    ports = tuple(p for i, p in enumerate(node.ports) if i not in removed)
    stored = tuple(s for i, s in enumerate(node.stored) if i not in removed)
    starts = {renumbered[p]: s for p, s in node.starts.items() if p in renumbered}
    nominals = {renumbered[p]: s for p, s in node.nominals.items() if p in renumbered}
    return replace(
        node, ports=ports, law=Law(equations, None, node.law.arity), stored=stored, starts=starts, nominals=nominals
    )


def _rebuild(graph: BondGraph, dropped: set[BondEnd], changed: Mapping[int, Element]) -> BondGraph:
    kept_bonds = [n for n, b in enumerate(graph.bonds) if b.tail not in dropped and b.head not in dropped]
    bonds = [graph.bonds[n] for n in kept_bonds]
    place = {n: i for i, n in enumerate(kept_bonds)}
    walls = {wall: place[n] for wall, n in graph.walls.items() if n in place}
    gone = {end.node for end in dropped if end.node not in changed}
    numbers: dict[int, int] = {}
    nodes: list[Node] = []
    ports: dict[BondEnd, BondEnd] = {}
    for number, node in enumerate(graph.nodes):
        if number in gone:
            continue
        numbers[number] = len(nodes)
        node = changed.get(number, node)
        if isinstance(node, MechanismNode):
            node, moved = _mechanism_ports(node, number, bonds)
            ports.update(moved)
        elif number in changed:
            old = graph.nodes[number]
            assert isinstance(old, Element)
            kept = [p for p in range(len(old.ports)) if BondEnd(number, p) not in dropped]
            ports.update({BondEnd(number, p): BondEnd(number, i) for i, p in enumerate(kept)})
        nodes.append(node)

    def moved_end(end: BondEnd) -> BondEnd:
        end = ports.get(end, end)
        return BondEnd(numbers[end.node], end.port)

    moved_bonds = tuple(Bond(moved_end(b.tail), moved_end(b.head), b.domain, b.span) for b in bonds)
    return replace(graph, nodes=tuple(nodes), bonds=moved_bonds, walls=walls)


def _mechanism_ports(
    node: MechanismNode, number: int, bonds: list[Bond]
) -> tuple[MechanismNode, dict[BondEnd, BondEnd]]:
    """The mechanism with only the ports that still have a bond."""
    used = {e.port for b in bonds for e in (b.tail, b.head) if e.node == number}
    kept: list[Port] = []
    moved: dict[BondEnd, BondEnd] = {}
    for old, port in enumerate(node.ports):
        if old in used:
            moved[BondEnd(number, old)] = BondEnd(number, len(kept))
            kept.append(port)
    return replace(node, ports=tuple(kept)), moved
