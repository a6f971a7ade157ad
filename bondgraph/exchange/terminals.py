"""Terminals of a unit: the variables of each open port, which importers connect together; and its icon."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from compiler.api import DOMAINS

if TYPE_CHECKING:
    from compiler.api import Compilation


@dataclass(frozen=True, slots=True)
class UnitTerminal:
    """Open port: its domain, the names of its effort and flow, and True if power that is positive comes in."""

    name: str
    domain: str
    effort: str
    flow: str
    inward: bool


@dataclass(frozen=True, slots=True)
class UnitIcon:
    """Picture of a unit, in both formats, and its size."""

    png: bytes
    svg: bytes
    width: float
    height: float


def terminals_of(compilation: Compilation, ports: Iterable[str]) -> tuple[UnitTerminal, ...]:
    """Return the terminals of ports that have sources in their place."""
    graph = compilation.whole_graph
    plain = compilation.tree.models[graph.name].plain
    places = {node.name: number for number, node in enumerate(graph.nodes)}
    terminals = []
    for port in ports:
        bond = next(b for b in graph.bonds if places[port] in (b.tail.node, b.head.node))
        effort, flow = (f"{port}_{v if plain else DOMAINS[bond.domain].letter(v)}" for v in ("e", "f"))
        terminals.append(UnitTerminal(port, bond.domain, effort, flow, bond.tail.node == places[port]))
    return tuple(terminals)
