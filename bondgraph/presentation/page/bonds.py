"""Columns that a run must report to give effort and flow of every bond, and the balances from which the others follow.

Ports of elements and mechanisms can be read by name. Bonds between junctions follow: they share an effort or a flow, and the other variable
follows from the balance. A junction that is off ends each of its bonds at a source of zero, which has no name of its own; one that may be off has no
balance.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import DOMAINS, BondGraph, Element, GraphNode, Junction, Kind, MechanismNode

MOST = 400  # most bonds: a page would carry more numbers than a reader uses
EFFORT, FLOW = "e", "f"


@dataclass(frozen=True, slots=True)
class SignedSum:
    """A column that is a signed sum of columns before it."""

    terms: tuple[tuple[float, int], ...]


@dataclass(frozen=True, slots=True)
class BondColumns:
    """Columns of a run.

    `columns`: names that a run reports, and balances. `places`: the columns of each bond's effort and flow, None if not known.
    """

    columns: tuple[str | SignedSum, ...]
    places: tuple[tuple[int | None, int | None], ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names that a run must report."""
        return tuple(c for c in self.columns if isinstance(c, str))

    def values(self, read: Mapping[str, Any], length: int) -> Any:
        """Return all columns, shape (columns, length), from the values of a run, by name."""
        kind = complex if any(np.iscomplexobj(read[n]) for n in self.names) else float
        found = np.zeros((len(self.columns), length), dtype=kind)
        for place, column in enumerate(self.columns):
            found[place] = read[column] if isinstance(column, str) else sum(s * found[c] for s, c in column.terms)
        return found


def bond_columns(graph: BondGraph, whole: BondGraph) -> BondColumns:
    """Return the columns for effort and flow of each bond; none for a graph with too many bonds. `whole`: the graph with all of its junctions on."""
    if len(graph.bonds) > MOST:
        return BondColumns((), ((None, None),) * len(graph.bonds))
    return _KnownColumns(graph, {n.name: n.kind for n in whole.nodes if isinstance(n, Junction)}).found()


class _KnownColumns:
    """Search state: the known columns of each bond's effort and flow."""

    def __init__(self, graph: BondGraph, junctions: Mapping[str, Kind]) -> None:
        self.graph, self.junctions = graph, junctions
        self.switched = {s.junction for s in graph.switches}
        self.columns: list[str | SignedSum] = []
        self.known: dict[tuple[int, str], int] = {}

    def found(self) -> BondColumns:
        bonds = range(len(self.graph.bonds))
        for bond in bonds:
            for variable in (EFFORT, FLOW):
                if (bond, variable) not in self.known:
                    self._read(bond, variable)
        while any(self._balance(number, node) for number, node in enumerate(self.graph.nodes)):
            pass
        return BondColumns(
            tuple(self.columns), tuple((self.known.get((b, EFFORT)), self.known.get((b, FLOW))) for b in bonds)
        )

    def _read(self, bond: int, variable: str) -> None:
        """Read a bond's variable by the name of one of its ends, if one has a name for it."""
        ends = self.graph.bonds[bond]
        for end in (ends.tail, ends.head):
            node = self.graph.nodes[end.node]
            name = self._name(node, end.port, variable)
            several = sum(end in (b.tail, b.head) for b in (self.graph.bonds[i] for i in self.graph.incident[end.node]))
            if not name or (isinstance(node, MechanismNode) and several > 1):
                continue
            if isinstance(node, MechanismNode) and variable == EFFORT and end == ends.tail:
                self.columns.append(name)  # a mechanism reports the effort on it, this bond has the opposite one
                self._learn(bond, variable, SignedSum(((-1.0, len(self.columns) - 1),)))
            else:
                self._learn(bond, variable, name)
            return

    def _name(self, node: GraphNode, port: int, variable: str) -> str:
        """Return the name of a port's variable in the language; empty if it has none."""
        if isinstance(node, Element):
            declared = node.name.partition(" (")[0]
            if not re.match(rf"{re.escape(declared.rpartition('.')[2].partition('[')[0])}\b", node.span.text):
                return ""  # no text declares it: a part of a lever of axes, the gap of a valve
            if declared in self.junctions:
                return f"{declared}.{variable}" if _shared(self.junctions[declared]) == variable else ""
            if len(node.ports) == 1:
                return f"{node.name}.{variable}"
            name = node.ports[port].name
            return f"{node.name}.{variable}{name}" if name.isdigit() else f"{node.name}.{name}.{variable}"
        if isinstance(node, MechanismNode):
            return f"{node.name}.{node.ports[port].name}.{variable}"
        return ""

    def _learn(self, bond: int, variable: str, column: str | SignedSum) -> None:
        """Add a column, also for all bonds that share the variable across junctions."""
        self.columns.append(column)
        waiting = [bond]
        while waiting:
            here = waiting.pop()
            self.known[here, variable] = len(self.columns) - 1
            for end in (self.graph.bonds[here].tail, self.graph.bonds[here].head):
                if _shared(self.graph.nodes[end.node].kind) == variable:
                    waiting += [b for b in self.graph.incident[end.node] if (b, variable) not in self.known]

    def _balance(self, number: int, node: GraphNode) -> bool:
        """Add the last unknown variable at a junction from its balance; return True if there was one."""
        if not isinstance(node, Junction) or node.name in self.switched:
            return False
        variable = FLOW if node.kind is Kind.ZERO else EFFORT
        around = self.graph.incident[number]
        missing = [b for b in around if (b, variable) not in self.known]
        if len(missing) != 1 or around.count(missing[0]) > 1:
            return False
        (bond,) = missing
        own = self._sign(bond, number)
        terms = ((-own * self._sign(b, number), self.known[b, variable]) for b in around if b != bond)
        self._learn(bond, variable, SignedSum(tuple(terms)))
        return True

    def _sign(self, bond: int, node: int) -> float:
        """Return 1 for a bond to a node, -1 for one away from it."""
        return 1.0 if self.graph.bonds[bond].head.node == node else -1.0


def _shared(kind: Kind) -> str:
    """Return the variable that all bonds of a junction share; empty for other nodes."""
    return {Kind.ZERO: EFFORT, Kind.ONE: FLOW}.get(kind, "")


def powers(graph: BondGraph) -> Iterator[tuple[str, str, tuple[tuple[int, float], ...]]]:
    """Yield the power received by each element and mechanism: name, letter, and its bonds with 1 if they bring power and -1 if they remove it.

    Bonds whose effort times flow is no power are left out.
    """
    for number, node in enumerate(graph.nodes):
        if not isinstance(node, Junction):
            balanced = (b for b in graph.incident[number] if DOMAINS[graph.bonds[b].domain].is_balanced)
            around = tuple((b, 1.0 if graph.bonds[b].head.node == number else -1.0) for b in balanced)
            yield node.name, str(node.kind.value), around
