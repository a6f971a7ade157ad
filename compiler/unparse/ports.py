"""Readings of model ports in a flat text, which has no such ports: they become readings of a node at the bond."""

from __future__ import annotations

from ..graph.elements import Kind
from ..graph.network import BondGraph, Element, Junction, MechanismNode, Reading


def seen_at_a_node(graph: BondGraph, reading: Reading) -> Reading | None:
    """The same variable as a reading that a text can have; None if neither end of the bond shows it.

    An element shows both variables, a junction the one that its bonds share, a mechanism the flow (its effort has the sign of the part).
    """
    number = graph.walls.get((reading.node, reading.port))
    if number is None:
        return reading
    bond = graph.bonds[number]
    for end in (bond.tail, bond.head):
        node = graph.nodes[end.node]
        if isinstance(node, Element) or (isinstance(node, MechanismNode) and reading.variable == "f"):
            return Reading(node.name, node.ports[end.port].name, reading.variable)
        if isinstance(node, Junction) and reading.variable == ("e" if node.kind is Kind.ZERO else "f"):
            return Reading(node.name, "", reading.variable)
    return None
