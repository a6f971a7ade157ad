"""Ports and junctions with no bond, and ports with too many."""

from __future__ import annotations

from ...errors import Diagnostic
from ...graph.elements import TRANSDUCERS
from ...graph.network import BondEnd, BondGraph, Junction, MechanismNode
from ...source import Span
from ..names.errors import WrongConnection
from .transducers import has_many_ports


def unconnected(graph: BondGraph) -> list[Diagnostic]:
    """Check that every port of an element has exactly one bond and every junction at least one."""
    bonds: dict[BondEnd, list[Span]] = {}
    for bond in graph.bonds:
        for end in (bond.tail, bond.head):
            bonds.setdefault(end, []).append(bond.span)
    result: list[Diagnostic] = []
    for number, node in enumerate(graph.nodes):
        if isinstance(node, Junction):
            if BondEnd(number, 0) not in bonds:
                what = f"No bond reaches the junction `{node.name}`"
                result.append(WrongConnection(node.span, what, "Connect it, or leave it out."))
            continue
        if isinstance(node, MechanismNode):
            continue
        for port_number, port in enumerate(node.ports):
            spans = bonds.get(BondEnd(number, port_number), [])
            named = port.name and (node.kind not in TRANSDUCERS or has_many_ports(node))
            name = f"{node.name}.{port.name}" if named else node.name
            if len(spans) > 1:
                hint = "Every port has one bond; put a 0- or 1-junction between."
                result.append(
                    WrongConnection(spans[1], f"`{name}` has {len(spans)} bonds", hint, ((spans[0], "one of them"),))
                )
            elif not spans:
                side = {"1": "into side 1", "2": "out of side 2"}.get(port.name, "")
                what = f"No bond goes {side} of `{name}`" if side else f"No bond reaches `{name}`"
                result.append(WrongConnection(node.span, what, "Connect it, or leave it out."))
    return result
