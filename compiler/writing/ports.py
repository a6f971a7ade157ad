"""Ports of models in a flat text: there are none, so what is read of one is read of a node at its bond."""

from __future__ import annotations

from ..graph.network import BondGraph, Element, Junction, Kind, MechanismNode, Reading


def seen_at_a_node(graph: BondGraph, reading: Reading) -> Reading | None:
    """The same variable as a text can read it; None if neither end of the bond shows it.

    An element shows both, a junction what its bonds share, a mechanism the flow (its effort has the sign of the part).
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
