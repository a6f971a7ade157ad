"""Companion network: a network over one short step of the implicit Euler method, with a port for each ideal valve.

Each one-port storage becomes a resistor in series with its content: a capacitor e = e_0 + h (de/dq) f, an inertia f = f_0 + h (df/dp) e.
Its content is a constant beside the network. Each valve, and each other two-terminal switch, becomes a matched source,
e = a + z f. So in every position of the valves no node floats and no loop is without a loss: the network has one solution for each
row of waves a. Its limit for h to zero determines which valves conduct just after an instant (the rational complementarity problem:
Heemels, Schumacher and Weiland, Linear complementarity systems, SIAM J. Appl. Math. 60, 2000) and the impulses that pass (h times the
terms that grow as 1/h).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..algebra.derivative import derivative
from ..algebra.expression import Expression, Number, Symbol, multiply, substitute
from ..algebra.formula import Bound, Formula
from ..graph.network import (
    Bond,
    BondGraph,
    Element,
    End,
    Junction,
    Kind,
    Law,
    Named,
    Node,
    Own,
    Port,
    Quantity,
    Reading,
)
from .laws import GIVEN, solved

STEP, IMPEDANCE = "step of the companion", "impedance of the valves"


def wave(port: str) -> str:
    """Name of the input for the wave into the network from a port."""
    return f"wave of {port}"


def companion_inputs(ports: Sequence[str]) -> tuple[str, ...]:
    """Inputs of the companion: step, impedance, and the waves."""
    return (STEP, IMPEDANCE, *map(wave, ports))


def companion(graph: BondGraph, ports: Sequence[str]) -> BondGraph:
    """Return the companion of a graph in which other switched junctions are off already.

    `ports`: its valves and other two-terminal switches. Outputs: effort, then flow of each port, then the rates of all integrals.
    """
    nodes, bonds = list(graph.nodes), list(graph.bonds)
    renamed: dict[str, str] = {}
    for number, node in enumerate(graph.nodes):
        if isinstance(node, Junction) and node.name in ports:
            nodes[number] = _port(node)
        elif isinstance(node, Element) and (made := _resistor(node)) is not None:
            nodes[number] = made
            renamed[node.name] = made.name
            _keep(node, nodes, bonds)
    known = [Named(n, "input", "1", _number(1e-6 if n == STEP else 1.0), None, graph.span) for n in (STEP, IMPEDANCE)]
    known += [Named(wave(p), "input", "1", _number(0.0), None, graph.span) for p in ports]
    sides = [(port, variable) for variable in "ef" for port in ports]
    outputs = {f"{j} {variable}": _reading(j, variable, graph) for j, variable in sides}
    outputs |= {
        f"rate of {n}": Named(f"rate of {n}", "output", "1", i.rate, None, i.span) for n, i in graph.integrals.items()
    }
    made_graph = replace(
        graph, nodes=tuple(nodes), bonds=tuple(bonds), outputs=outputs, requirements=(), events=(),
        quantities={**graph.quantities, **{n.name: n for n in known}},
    )  # fmt: skip
    return _reread(made_graph, renamed)


def _number(value: float) -> Bound:
    return Bound(Formula(0, Number(value)), ())


def _reading(node: str, variable: str, graph: BondGraph) -> Named:
    bound = Bound(Formula(1, Symbol(0)), (Reading(node, "", variable),))
    return Named(f"{node} {variable}", "output", "1", bound, None, graph.span)


def _port(node: Junction) -> Element:
    """A matched source in place of a two-terminal switch."""
    law = Law(((Symbol(Own(0, "e")), Symbol(0) + Symbol(1) * Symbol(Own(0, "f"))),), None, 2)
    arguments = (Quantity(wave(node.name)), Quantity(IMPEDANCE))
    ports = (Port("", node.domain),)
    return Element(
        node.name, Kind.RESISTOR, True, ports, law, arguments, (), {}, {}, None, None, node.definition, node.span
    )


def _resistor(node: Element) -> Element | None:
    """Resistor of a one-port storage over one step; None for any other node, or if its law has no integral form."""
    if len(node.ports) > 1 or node.kind not in (Kind.CAPACITOR, Kind.INERTIA):
        return None
    stored = node.stored[0]
    given = GIVEN[stored]
    found = solved(node.law, (Own(0, given),))
    if found is None:
        return None
    slope = derivative(found[0], Symbol(Own(0, stored)))
    first, arity = node.law.arity, node.law.arity
    before, held, step = Symbol(first), Symbol(first + 1), Symbol(first + 2)

    def put(symbol: Symbol) -> Expression:
        return held if symbol.key == Own(0, stored) else symbol

    other = Own(0, "f" if given == "e" else "e")
    right = before + multiply(multiply(substitute(slope, put), step), Symbol(other))
    law = Law(((Symbol(Own(0, given)), right),), None, arity + 3)
    arguments = (*node.arguments, Reading(node.name, "", given), Reading(node.name, "", stored), Quantity(STEP))
    return replace(
        node, name=f"{node.name} over one step", kind=Kind.RESISTOR, modulated=True, law=law, arguments=arguments, stored=(), starts={},
        nominals={}, prefer=None, require=None,
    )  # fmt: skip


def _keep(node: Element, nodes: list[Node], bonds: list[Bond]) -> None:
    """Keep the content of a storage as a constant beside the network."""
    given = GIVEN[node.stored[0]]
    kind, variable = (Kind.FLOW_SOURCE, "f") if given == "e" else (Kind.EFFORT_SOURCE, "e")
    law = Law(((Symbol(Own(0, variable)), Number(0.0)),), None, 0)
    rest = replace(
        node, name=f"{node.name} at rest", kind=kind, modulated=False, law=law, arguments=(), stored=(), starts={}, nominals={}, prefer=None,
        require=None,
    )  # fmt: skip
    nodes += [replace(node, prefer=None, require=None), rest]
    bonds.append(Bond(End(len(nodes) - 1, 0), End(len(nodes) - 2, 0), node.ports[0].domain, node.span))


def _reread(graph: BondGraph, renamed: Mapping[str, str]) -> BondGraph:
    """Return the graph with readings of storages redirected to their resistors. Readings inside the companion are left unchanged."""

    def moved(argument: object) -> object:
        if isinstance(argument, Reading) and argument.node in renamed and argument.variable in "ef":
            return argument._replace(node=renamed[argument.node])
        return argument

    def rebound(bound: Bound) -> Bound:
        return replace(bound, arguments=tuple(map(moved, bound.arguments)))

    def named(items: Mapping[str, Named]) -> dict[str, Named]:
        return {
            n: q if q.definition is None else replace(q, definition=rebound(q.definition)) for n, q in items.items()
        }

    fresh = set(renamed.values())
    nodes = tuple(
        replace(n, arguments=tuple(map(moved, n.arguments)))  # type: ignore[arg-type]
        if isinstance(n, Element) and n.name not in fresh
        else n
        for n in graph.nodes
    )
    integrals = {n: replace(i, rate=rebound(i.rate)) for n, i in graph.integrals.items()}
    switches = tuple(replace(s, active=rebound(s.active)) for s in graph.switches)
    delays = {n: replace(d, value=rebound(d.value)) for n, d in graph.delays.items()}
    return replace(
        graph, nodes=nodes, quantities=named(graph.quantities), outputs=named(graph.outputs), integrals=integrals, delays=delays, switches=switches,
    )  # fmt: skip
