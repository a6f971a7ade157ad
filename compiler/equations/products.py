"""Factors of efforts and flows in the integrals of a model.

An impulse is a current or force of no duration. What integrates it jumps by the impulse times its coefficient, if that has one value at the instant;
a coefficient that jumps there too (the voltage across what is charged) leaves the jump undetermined.
"""

from __future__ import annotations

from collections.abc import Mapping

from ..algebra.derivative import derivative
from ..algebra.expression import Expression, symbols
from ..algebra.formula import Bound, leaf, over
from ..fast_dataclass import dataclass
from ..graph.elements import OF_NODE, SOURCES
from ..graph.network import BondGraph, Element, PortVariable, Quantity, Reading
from .system import port_name

GIVEN = {kind: OF_NODE[kind].given for kind in SOURCES}


@dataclass(frozen=True, slots=True)
class Factor:
    """An effort or flow that is multiplied. `moving`: by another effort or flow; `coefficients`: by what is stored, and by integrals."""

    reading: Reading
    moving: bool
    coefficients: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Integrand:
    """Rate of a signal with memory. `reads`: "e" and "f", as far as it reads any."""

    name: str
    factors: tuple[Factor, ...]
    reads: str


def integrands(graph: BondGraph) -> tuple[Integrand, ...]:
    """Return the integrands of a graph with switched junctions, in order; none for other graphs."""
    return tuple(_integrand(graph, name) for name in graph.integrals) if graph.switches else ()


def _integrand(graph: BondGraph, name: str) -> Integrand:
    nodes = {n.name: n for n in graph.nodes if isinstance(n, Element)}

    def opened(bound: Bound) -> Expression:
        return over(bound.formula.expression, bound.arguments, read)

    def read(argument: object) -> Expression:
        if isinstance(argument, Quantity) and argument.name not in graph.integrals:
            named = graph.quantities.get(argument.name)
            if (
                named is not None
                and named.value is None
                and named.role in ("signal", "output")
                and named.definition is not None
            ):
                return opened(named.definition)
        if isinstance(argument, Reading) and (node := nodes.get(argument.node)) is not None:
            right = node.law.equations[0][1] if GIVEN.get(node.kind) == argument.variable else None
            if right is not None and not any(isinstance(s.key, PortVariable) for s in symbols(right)):
                return over(right, node.arguments, read)
        return leaf(argument)

    rate = opened(graph.integrals[name].rate)
    moving = [s for s in symbols(rate) if isinstance(s.key, Reading) and s.key.variable in "ef"]
    reads = "".join(sorted({s.key.variable for s in moving}))
    factors = []
    for s in moving:
        others = set(symbols(derivative(rate, s))) - {s}
        stored = [_name(nodes, t.key) for t in others if isinstance(t.key, Reading) and t not in moving]
        stored += [t.key.name for t in others if isinstance(t.key, Quantity) and t.key.name in graph.integrals]
        if others.intersection(moving) or stored:
            factors.append(Factor(s.key, bool(others.intersection(moving)), tuple(sorted(stored))))
    return Integrand(name, tuple(factors), reads)


def _name(nodes: Mapping[str, Element], reading: Reading) -> str:
    """Return the name of a stored quantity."""
    node = nodes.get(reading.node)
    if node is None:
        return f"{reading.node}.{reading.port or reading.variable}"
    return port_name(node, [p.name for p in node.ports].index(reading.port), reading.variable)
