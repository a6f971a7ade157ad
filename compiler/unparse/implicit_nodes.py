"""Implicit nodes: parts that the compiler adds to a graph, and that a text therefore leaves out."""

from __future__ import annotations

from ..algebra.expression import Symbol, add, divide, multiply
from ..graph.elements import Kind
from ..graph.network import BondEnd, BondGraph, Element, Junction, MechanismNode, PortVariable


def shared_ports(graph: BondGraph) -> dict[str, BondEnd]:
    """Map from the junctions that the compiler adds at a mechanism's port with several bonds to that port."""
    found = {}
    for bond in graph.bonds:
        node, other = graph.nodes[bond.tail.node], graph.nodes[bond.head.node]
        if not (isinstance(node, Junction) and isinstance(other, MechanismNode)):
            continue
        if node.name == f"{other.name}.{other.ports[bond.head.port].name}":
            found[node.name] = bond.head
    return found


def heating_resistors(graph: BondGraph) -> set[str]:
    """Resistors whose last port has an outgoing bond and gives the heat: in text an `RS`, without that equation."""
    found = set()
    for bond in graph.bonds:
        node = graph.nodes[bond.tail.node]
        if isinstance(node, Element) and node.kind is Kind.RESISTOR and bond.tail.port == len(node.ports) - 1 > 0:
            last = len(node.ports) - 1
            power = add(*(multiply(Symbol(PortVariable(p, "e")), Symbol(PortVariable(p, "f"))) for p in range(last)))
            if node.law.equations[-1:] == (
                (Symbol(PortVariable(last, "f")), divide(power, Symbol(PortVariable(last, "e")))),
            ):
                found.add(node.name)
    return found
