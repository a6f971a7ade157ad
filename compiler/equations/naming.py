"""Names of the variables of bonds and ports: after the element at one end, in the letters of its domain."""

from __future__ import annotations

from functools import cache

from ..graph.domains import DOMAINS
from ..graph.elements import TRANSDUCERS
from ..graph.network import BondEnd, BondGraph, Element, MechanismNode


def bond_names(graph: BondGraph, number: int) -> tuple[str, str, str, str]:
    """Names and units of a bond's effort and flow, after the element at one of its ends."""
    bond = graph.bonds[number]
    effort, flow = unit_of(bond.domain, "e"), unit_of(bond.domain, "f")
    ends = sorted((bond.head, bond.tail), key=lambda end: _rank(graph, end))
    node = graph.nodes[ends[0].node]
    if isinstance(node, Element):
        return port_name(node, ends[0].port, "e"), port_name(node, ends[0].port, "f"), effort, flow
    tail, head = graph.nodes[bond.tail.node].name, graph.nodes[bond.head.node].name
    return (
        f"({tail} -> {head}).{letter_of(bond.domain, 'e')}",
        f"({tail} -> {head}).{letter_of(bond.domain, 'f')}",
        effort,
        flow,
    )


def _rank(graph: BondGraph, end: BondEnd) -> int:
    node = graph.nodes[end.node]
    if isinstance(node, Element):
        return 1 if node.kind in TRANSDUCERS else 0
    return 2


def port_name(node: Element | MechanismNode, port: int, variable: str) -> str:
    """Name of a variable of a port: `mass.p`, `gear.omega1`, `spring.phi`, `spring.x.F`."""
    name, domain = node.ports[port].name, node.ports[port].domain
    letter = letter_of(domain, variable)
    if isinstance(node, Element) and node.kind in TRANSDUCERS:
        return f"{node.name}.{letter}{name}"
    if not name:
        return f"{node.name}.{letter}"
    return f"{node.name}.{name}" if variable in "qp" else f"{node.name}.{name}.{letter}"


def letter_of(domain: str, variable: str) -> str:
    """Letter of a domain for `e`, `f`, `q` or `p`."""
    return DOMAINS[domain].letter(variable)


@cache
def unit_of(domain: str, variable: str) -> str:
    """SI unit of `e`, `f`, `q` or `p` in a domain."""
    return str(DOMAINS[domain].dimension(variable))
