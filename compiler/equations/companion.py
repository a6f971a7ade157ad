"""Companion network: a network over one short step of the implicit Euler method, with a port for each ideal valve.

Each storage becomes a resistor in line with what it holds: a capacitor e = e_0 + h (de/dq) f, an inertia f = f_0 + h (df/dp) e, one with several ports
all of these. What it stores stands beside it and does not move. A curved law is a straight line about what is stored after an impulse, for which the jump
is an input: e = e_1 + (de/dq)(h f - jump), exact where h f is the jump. Each valve, and each other two-terminal switch, becomes a matched source,
e = a + z f, so that no node floats and no loop is without
a loss, whatever the valves do: the network then has one solution for each row of waves a. From it follow, as h goes to zero, which valves
conduct just after an instant (the rational complementarity problem: Heemels, Schumacher and Weiland, Linear complementarity systems, SIAM
J. Appl. Math. 60, 2000) and the impulses that pass (h times what grows as 1/h).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..algebra.derivative import derivative
from ..algebra.expression import ONE, Expression, Number, Symbol, add, depends_on, multiply, substitute
from ..algebra.formula import Bound, Formula
from ..graph.elements import Kind
from ..graph.network import (
    Bond,
    BondEnd,
    BondGraph,
    Element,
    Junction,
    Law,
    Named,
    Node,
    Port,
    PortVariable,
    Quantity,
    Reading,
)
from .laws import GIVEN, solved
from .products import integrands
from .system import port_name

STEP, IMPEDANCE = "step of the companion", "impedance of the valves"
JUMP, PASSED = "jump of ", "rate of what passes to "  # of what a storage stores: an input and an output


def wave(port: str) -> str:
    """Name of the input for the wave into the network from a port."""
    return f"wave of {port}"


def companion_inputs(graph: BondGraph, ports: Sequence[str]) -> tuple[str, ...]:
    """Inputs of the companion of a graph in which other switched junctions are off already: step, impedance, the waves, and the jumps of storages with
    nonlinear laws."""
    return (
        STEP,
        IMPEDANCE,
        *map(wave, _ports(graph, ports).values()),
        *(JUMP + n for s in _storages(graph) if is_curved(s) for n in _states(s)),
    )


def _storages(graph: BondGraph) -> list[Element]:
    return [n for n in graph.nodes if isinstance(n, Element) and n.stored]


def _ports(graph: BondGraph, ports: Sequence[str]) -> dict[str, str]:
    """Return the labels of all ports by junction: these, and those with one bond that are off and share with them (`graph/sharing.py`), with their state."""
    ends = [n for i, n in enumerate(graph.nodes) if isinstance(n, Junction) and len(graph.incident[i]) == 1]
    states = {n.name: "blocks" if n.kind is Kind.ZERO else "conducts" for n in ends if n.name not in ports}
    return {**{port: port for port in ports}, **{name: f"{name}, which {state}" for name, state in states.items()}}


def companion(graph: BondGraph, ports: Sequence[str]) -> BondGraph:
    """Return the companion of a graph in which other switched junctions are off already. `ports`: its valves and other two-terminal switches; those
    that share with them become ports too. Outputs: effort, then flow of each port, then the rates of all integrals, what these multiply, and what passes
    to storages."""
    nodes, bonds = list(graph.nodes), list(graph.bonds)
    renamed: dict[str, str] = {}
    signs: dict[str, Number] = {}
    labels = _ports(graph, ports)
    for number, node in enumerate(graph.nodes):
        if isinstance(node, Junction) and node.name in labels:
            into = graph.bonds[graph.incident[number][0]].head.node == number
            nodes[number] = _port(
                node, wave(labels[node.name]), signs.setdefault(node.name, Number(1.0 if into else -1.0))
            )
        elif isinstance(node, Element) and (made := _resistor(node)) is not None:
            nodes[number] = made
            renamed[node.name] = made.name
            _keep(node, nodes, bonds)
    known = [Named(n, "input", "1", _number(1e-6 if n == STEP else 1.0), None, graph.span) for n in (STEP, IMPEDANCE)]
    zero = companion_inputs(graph, ports)[2:]
    known += [Named(n, "input", "1", _number(0.0), None, graph.span) for n in zero]
    outputs = {f"{label} e": _reading(port, "e", graph) for port, label in labels.items()}
    outputs |= {f"{label} f": _reading(port, "f", graph, sign=signs.get(port, ONE)) for port, label in labels.items()}
    outputs |= {
        f"rate of {n}": Named(f"rate of {n}", "output", "1", i.rate, None, i.span) for n, i in graph.integrals.items()
    }
    for name, k, factor in ((i.name, k, f) for i in integrands(graph) for k, f in enumerate(i.factors)):
        reading = factor.reading
        outputs[f"factor {k} of {name}"] = _reading(
            reading.node, reading.variable, graph, f"factor {k} of {name}", reading.port
        )
    for storage in _storages(graph):
        if storage.name in renamed and (graph.integrals or is_curved(storage)):
            for port, stored, name in zip(storage.ports, storage.stored, _states(storage), strict=True):
                outputs[PASSED + name] = _reading(
                    renamed[storage.name], _other(GIVEN[stored]), graph, PASSED + name, port.name
                )
    made_graph = replace(
        graph, nodes=tuple(nodes), bonds=tuple(bonds), outputs=outputs, requirements=(), events=(), switches=(),
        quantities={**graph.quantities, **{n.name: n for n in known}},
    )  # fmt: skip
    return _reread(made_graph, renamed)


def _number(value: float) -> Bound:
    return Bound(Formula(0, Number(value)), ())


def _reading(node: str, variable: str, graph: BondGraph, name: str = "", port: str = "", sign: Number = ONE) -> Named:
    bound = Bound(Formula(1, multiply(sign, Symbol(0))), (Reading(node, port, variable),))
    return Named(name or f"{node} {variable}", "output", "1", bound, None, graph.span)


def _port(node: Junction, incident: str, sign: Number) -> Element:
    """A matched source in place of a two-terminal switch. `incident`: the name of its wave; `sign`: -1 where the arrow points out of it."""
    flow = multiply(sign, Symbol(PortVariable(0, "f")))
    law = Law(((Symbol(PortVariable(0, "e")), Symbol(0) + Symbol(1) * flow),), None, 2)
    arguments = (Quantity(incident), Quantity(IMPEDANCE))
    ports = (Port("", node.domain),)
    return Element(
        node.name, Kind.RESISTOR, True, ports, law, arguments, (), {}, {}, None, None, node.definition, node.span
    )


def _resistor(node: Element) -> Element | None:
    """Resistor of a storage over one step; None for any other node, or if its law has no integral form."""
    if not node.stored:
        return None
    given = tuple(GIVEN[s] for s in node.stored)
    laws = solved(node.law, tuple(PortVariable(k, v) for k, v in enumerate(given)))
    if laws is None:
        return None
    ports, first = range(len(given)), node.law.arity
    held = {PortVariable(k, s): Symbol(first + len(ports) + k) for k, s in enumerate(node.stored)}
    step, jumps = Symbol(first + 2 * len(ports)), [Symbol(first + 2 * len(ports) + 1 + k) for k in ports]
    curved = is_curved(node)

    def row(k: int) -> Expression:
        terms: list[Expression] = [Symbol(first + k)]
        for j, stored in enumerate(node.stored):
            slope = substitute(derivative(laws[k], Symbol(PortVariable(j, stored))), lambda s: held.get(s.key, s))
            moved = multiply(step, Symbol(PortVariable(j, _other(given[j]))))
            terms.append(multiply(slope, moved - jumps[j] if curved else moved))
        return add(*terms)

    law = Law(
        tuple((Symbol(PortVariable(k, v)), row(k)) for k, v in enumerate(given)),
        None,
        first + (3 if curved else 2) * len(ports) + 1,
    )
    names = [p.name for p in node.ports]
    arguments = (
        *node.arguments, *(Reading(node.name, n, v) for n, v in zip(names, given, strict=True)),
        *(Reading(node.name, n, v) for n, v in zip(names, node.stored, strict=True)), Quantity(STEP),
        *(Quantity(JUMP + n) for n in (_states(node) if curved else ())),
    )  # fmt: skip
    return replace(
        node, name=f"{node.name} over one step", kind=Kind.RESISTOR, modulated=True, law=law, arguments=arguments, stored=(), starts={},
        nominals={}, prefer=None, require=None,
    )  # fmt: skip


def is_curved(node: Element) -> bool:
    """Return True for a storage with a nonlinear law."""
    laws = solved(node.law, tuple(PortVariable(k, GIVEN[s]) for k, s in enumerate(node.stored))) or ()
    stored = [Symbol(PortVariable(k, s)) for k, s in enumerate(node.stored)]
    return any(depends_on(derivative(law, s), t) for law in laws for s in stored for t in stored)


def _states(node: Element) -> tuple[str, ...]:
    """Return the names of the stored quantities, port by port."""
    return tuple(port_name(node, k, s) for k, s in enumerate(node.stored))


def _other(variable: str) -> str:
    return "f" if variable == "e" else "e"


def _keep(node: Element, nodes: list[Node], bonds: list[Bond]) -> None:
    """Keep the content of a storage as a constant beside the network."""
    nodes.append(replace(node, prefer=None, require=None))
    kept = len(nodes) - 1
    for k, stored in enumerate(node.stored):
        given = GIVEN[stored]
        kind = Kind.FLOW_SOURCE if given == "e" else Kind.EFFORT_SOURCE
        law = Law(((Symbol(PortVariable(0, _other(given))), Number(0.0)),), None, 0)
        rest = replace(
            node, name=f"{node.name} at rest" + (f" {k + 1}" if k else ""), kind=kind, modulated=False, ports=(Port("", node.ports[k].domain),),
            law=law, arguments=(), stored=(), starts={}, nominals={}, prefer=None, require=None,
        )  # fmt: skip
        nodes.append(rest)
        bonds.append(Bond(BondEnd(len(nodes) - 1, 0), BondEnd(kept, k), node.ports[k].domain, node.span))


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
    delays = {n: replace(d, value=rebound(d.value)) for n, d in graph.delays.items()}
    return replace(
        graph, nodes=nodes, quantities=named(graph.quantities), outputs=named(graph.outputs), integrals=integrals, delays=delays,
    )  # fmt: skip
