"""A bond graph as one implicit system: each bond has an effort and a flow, each element its law, each junction its equalities and its sum.

x' = rates(t, x, w), 0 = residuals(t, x, w). In x: stored quantities, integrals, poses and velocities of bodies; in w: efforts and flows of
bonds, accelerations of bodies and multipliers of joints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from compiler.algebra.derivative import derivative
from compiler.algebra.expression import Expression, Number, Symbol, add, multiply, substitute, symbols
from compiler.algebra.formula import Bound
from compiler.graph.elements import Kind
from compiler.graph.network import BondGraph, Element, Event, Junction, MechanismNode, PortVariable, Quantity, Reading
from tests.second_opinion.linkage import Linkage
from tests.second_opinion.spatial_linkage import SpatialLinkage
from tests.second_opinion.writer import COMPLEX, REAL, NotHeld, Writer, function, slope

STATIC = frozenset({"parameter", "constant"})


class TearingVariable(NamedTuple):
    """A variable: of x, of w, of the modes m, or whether a junction is on."""

    kind: str
    number: int


class Time(NamedTuple):
    kind: str = "t"
    number: int = 0


TIME = Symbol(Time())


class Action(NamedTuple):
    """Assignment of an event: place in x or m, value, and for a storage the law that converts the value to the stored quantity."""

    kind: str
    number: int
    value: Expression
    law: Expression | None = None  # over Unknown("own", 0), what is stored, and Unknown("own", 1), the value


@dataclass
class Assembly:
    """The system of one graph, as expressions."""

    graph: BondGraph
    free: tuple[str, ...] = ()  # parameters that are arguments, in `p`
    p: list[float] = field(default_factory=list)
    fixed: set[str] = field(
        default_factory=set
    )  # of these, what was taken as a number: another value makes another system
    values: dict[Expression, Any] = field(default_factory=dict)  # functions of t and x
    rates: list[Expression] = field(default_factory=list)
    starts: list[Any] = field(default_factory=list)  # numbers, or a law (expression, value) to be solved for it
    residuals: list[tuple[Expression, int | None, Expression | None]] = field(default_factory=list)
    unknowns: int = 0
    stored: dict[tuple[str, int], int] = field(default_factory=dict)
    integrals: dict[str, int] = field(default_factory=dict)
    modes: dict[str, int] = field(default_factory=dict)
    linkages: dict[str, Linkage] = field(default_factory=dict)
    quantities: dict[str, Expression] = field(default_factory=dict)
    bond_at: dict[tuple[int, int], int] = field(default_factory=dict)
    shared: dict[tuple[int, str], tuple[int, str]] = field(default_factory=dict)
    variables: dict[tuple[int, str], Symbol] = field(default_factory=dict)

    def unknown(self) -> Symbol:
        self.unknowns += 1
        return Symbol(TearingVariable("w", self.unknowns - 1))

    def state(self, rate: Expression, start: Any) -> Symbol:
        self.rates.append(rate)
        self.starts.append(start)
        return Symbol(TearingVariable("x", len(self.rates) - 1))

    # ------------------------------------------------------------ references
    def effort(self, bond: int) -> Symbol:
        return self.variable(bond, "e")

    def flow(self, bond: int) -> Symbol:
        return self.variable(bond, "f")

    def variable(self, bond: int, letter: str) -> Symbol:
        """Unknown of a bond's effort or flow; bonds that share it at a junction have one."""
        while (bond, letter) in self.shared:
            bond, letter = self.shared[bond, letter]
        if (bond, letter) not in self.variables:
            self.variables[bond, letter] = self.unknown()
        return self.variables[bond, letter]

    def opened(self, bound: Bound) -> Expression:
        """The expression of a formula over the unknowns."""
        return substitute(bound.formula.expression, lambda s: self.reference(bound.arguments[s.key]))

    def reference(self, what: Any) -> Expression:
        if isinstance(what, int | float):
            return Number(float(what))
        if isinstance(what, Quantity):
            return self.quantity(what.name)
        assert isinstance(what, Reading)
        return self.reading(what)

    def quantity(self, name: str) -> Expression:
        graph = self.graph
        if name == "time":
            return TIME
        if name in self.free:
            return Symbol(TearingVariable("p", self.free.index(name)))
        if name in self.integrals:
            return Symbol(TearingVariable("x", self.integrals[name]))
        if name in self.modes:
            return Symbol(TearingVariable("m", self.modes[name]))
        if name in graph.delays:
            raise NotHeld("delay")
        if name not in self.quantities:
            named = graph.quantities.get(name) or graph.outputs[name]
            if named.value is not None and named.role in STATIC and not (self.free and named.definition):
                self.quantities[name] = Number(float(named.value))
            elif named.definition is None:
                if named.value is None:
                    raise NotHeld(f"{name} has no value")
                self.quantities[name] = Number(float(named.value))
            elif named.role in ("solve", "loop"):
                self.quantities[name] = own = self.unknown()
                opened = self.opened(named.definition)
                self.residuals.append((opened if named.role == "solve" else opened - own, None, None))
            else:
                opened = self.opened(named.definition)
                self.quantities[name] = self.rate(opened) if named.role == "rate" else opened
        return self.quantities[name]

    def rate(self, x: Expression) -> Expression:
        """The derivative by time of an expression of time and of what elements store. Raises `NotHeld` for any other."""
        homes = {number: home for home, number in self.stored.items()}
        terms = [derivative(x, TIME)]
        for symbol in symbols(x):
            if symbol == TIME or symbol.key.kind == "p":
                continue
            if symbol.key.kind != "x" or symbol.key.number not in homes:
                raise NotHeld("a rate of what no element stores")
            name, port = homes[symbol.key.number]
            number, node = next((i, n) for i, n in enumerate(self.graph.nodes) if n.name == name)
            assert isinstance(node, Element)
            own = PortVariable(port, "f" if node.stored[port] == "q" else "e")
            terms.append(multiply(derivative(x, symbol), self.own(number, node, own)))
        return add(*terms)

    def reading(self, what: Reading) -> Expression:
        graph = self.graph
        if (what.node, what.port) in graph.walls:
            return self.variable(graph.walls[what.node, what.port], what.variable)
        number, node = next((i, n) for i, n in enumerate(graph.nodes) if n.name == what.node)
        if isinstance(node, Junction):
            if not graph.incident[number]:
                return Number(0.0)
            return self.variable(graph.incident[number][0], what.variable)
        if isinstance(node, MechanismNode):
            return self.linkages[node.name].reading(what.port, what.variable)
        assert isinstance(node, Element)
        port = next(i for i, p in enumerate(node.ports) if p.name == what.port)
        return self.own(number, node, PortVariable(port, what.variable))

    def own(self, number: int, node: Element, own: PortVariable) -> Expression:
        if own.variable in "ef":
            if (number, own.port) not in self.bond_at:
                raise NotHeld("a port without bond")
            return self.variable(self.bond_at[number, own.port], own.variable)
        return Symbol(TearingVariable("x", self.stored[node.name, own.port]))

    def law(self, number: int, node: Element, x: Expression) -> Expression:
        def replaced(symbol: Symbol) -> Expression:
            key = symbol.key
            return self.own(number, node, key) if isinstance(key, PortVariable) else self.reference(node.arguments[key])

        return substitute(x, replaced)

    def function(self, arguments: str, lines: Sequence[str], result: str, space: dict[str, Any] = REAL) -> Any:
        return function("function", arguments, lines, result, {**space, "p": self.p})

    def number(self, x: Expression, t: float = 0.0, states: Sequence[float] = ()) -> float:
        """The value of an expression of time, states and parameters. Raises `NameError` where it reads anything else."""
        if x not in self.values:
            writer = Writer(lambda key: "t" if key.kind == "t" else f"{key.kind}[{key.number}]", frozen=False)
            value = writer.write(x)
            self.values[x] = self.function("t, x", writer.lines, value)
        return float(self.values[x](t, states))

    def equal_zero(self, x: Expression, switch: int | None = None, off: Expression | None = None) -> None:
        self.residuals.append((x, switch, off))


def assembled(graph: BondGraph, free: Mapping[str, float]) -> Assembly:
    """All equations of a graph; `free` parameters with their values are arguments. Raises `NotHeld`."""
    a = Assembly(graph, tuple(free), list(free.values()))
    if graph.delays:
        raise NotHeld("delay")
    for number, bond in enumerate(graph.bonds):
        a.bond_at[bond.tail] = a.bond_at[bond.head] = number
    for name, named in graph.quantities.items():
        if named.role == "mode":
            a.modes[name] = len(a.modes)
    switches = {s.junction: i for i, s in enumerate(graph.switches)}
    for number, node in enumerate(graph.nodes):
        if isinstance(node, Junction) and node.name not in switches:
            _share(a, graph.incident[number], "e" if node.kind is Kind.ZERO else "f")
    for number in range(len(graph.bonds)):
        a.effort(number)
        a.flow(number)
    _declare_states(a)
    for number, node in enumerate(graph.nodes):
        if isinstance(node, Junction):
            _junction(a, number, node, switches.get(node.name))
        elif isinstance(node, Element):
            _element(a, number, node)
        else:
            _mechanism(a, number, node)
    for (name, port), place in a.stored.items():
        node_number = next(i for i, n in enumerate(graph.nodes) if n.name == name)
        node = graph.nodes[node_number]
        assert isinstance(node, Element)
        a.rates[place] = a.own(node_number, node, PortVariable(port, "f" if node.stored[port] == "q" else "e"))
    for name, integral in graph.integrals.items():
        a.rates[a.integrals[name]] = a.opened(integral.rate)
        a.starts[a.integrals[name]] = a.opened(integral.start)
    return a


def _declare_states(a: Assembly) -> None:
    for number, node in enumerate(a.graph.nodes):
        if isinstance(node, MechanismNode):
            a.linkages[node.name] = (Linkage if node.mechanism.planar else SpatialLinkage)(a, node)
        if isinstance(node, Element) and node.stored:
            for port in range(len(node.ports)):
                a.stored[node.name, port] = len(a.rates)
                a.state(Number(0.0), ("stored", number, port))
    for name in a.graph.integrals:
        a.integrals[name] = len(a.rates)
        a.state(Number(0.0), None)


def _share(a: Assembly, bonds: Sequence[int], letter: str) -> None:
    """Give one name to the variable that the bonds of a junction share."""

    def last(bond: int) -> tuple[int, str]:
        name = (bond, letter)
        while name in a.shared:
            name = a.shared[name]
        return name

    for bond in bonds[1:]:
        if last(bond) != last(bonds[0]):
            a.shared[last(bond)] = last(bonds[0])
        else:  # said twice
            a.equal_zero(Number(0.0))


def _junction(a: Assembly, number: int, node: Junction, switch: int | None) -> None:
    """Equalities and the sum; when it is off, the variable that its bonds share is zero."""
    shared, split = ("e", "f") if node.kind is Kind.ZERO else ("f", "e")
    bonds = a.graph.incident[number]
    if not bonds:
        return
    signs = [1.0 if a.graph.bonds[b].head.node == number else -1.0 for b in bonds]
    total = add(*(multiply(Number(s), a.variable(b, split)) for s, b in zip(signs, bonds, strict=True)))
    a.equal_zero(total, switch, a.variable(bonds[0], shared))
    if switch is not None:
        for bond in bonds[1:]:
            a.equal_zero(a.variable(bond, shared) - a.variable(bonds[0], shared), switch, a.variable(bond, shared))


def _element(a: Assembly, number: int, node: Element) -> None:
    law = node.law
    if law.energy is not None:
        for port, letter in enumerate(node.stored):
            other = "e" if letter == "q" else "f"
            by = a.own(number, node, PortVariable(port, letter))
            assert isinstance(by, Symbol)
            a.equal_zero(a.own(number, node, PortVariable(port, other)) - slope(a.law(number, node, law.energy), by))
        return
    for left, right in law.equations:
        a.equal_zero(a.law(number, node, left - right))
    if node.kind in (Kind.TRANSFORMER, Kind.GYRATOR):
        _power(a, number, node)


def _power(a: Assembly, number: int, node: Element) -> None:
    """a v1 + b w2 = 0 and equal powers give a conj(w2) + b conj(v1) = 0."""
    ((left, right),) = node.law.equations
    other = {"e": "f", "f": "e"}
    rest = left - right
    terms: list[Expression] = []
    for port in (0, 1):
        for letter in "ef":
            coefficient = slope(rest, Symbol(PortVariable(port, letter)))
            if coefficient != Number(0.0):
                # the conjugate of the *other* port's variable, which has the other letter in a gyrator
                partner = letter if node.kind is Kind.TRANSFORMER else other[letter]
                terms.append(multiply(coefficient, Symbol(PortVariable(1 - port, other[partner]))))
    a.equal_zero(a.law(number, node, add(*terms)))


def _mechanism(a: Assembly, number: int, node: MechanismNode) -> None:
    linkage = a.linkages[node.name]
    for port, item in enumerate(node.ports):
        for bond_number, bond in enumerate(a.graph.bonds):
            for end, sign in ((bond.tail, -1.0), (bond.head, 1.0)):
                if end == (number, port):
                    a.equal_zero(a.flow(bond_number) - linkage.flow(item.name))
                    linkage.push(item.name, multiply(Number(sign), a.effort(bond_number)))
    linkage.close()


# ---------------------------------------------------------------- the system as functions
@dataclass
class System:
    """Functions of (t, x, w, m, b): m the modes and after them whether switched junctions are on, b the branches of atoms."""

    assembly: Assembly
    derivative: Any  # -> rates, residuals; numbers
    complex_derivative: Any
    watch: Any  # -> branches that atoms have now, and their indicators
    conditions: Any  # -> truth of events, whether junctions are on; with branches b
    look: Any  # -> the outputs
    actions: list[list[Action]]
    action_values: list[Any]
    outputs: tuple[str, ...]
    atoms: int
    timed: list[Any]  # of atoms on time alone: the branch as a function of t
    operators: tuple[str, ...]  # of atoms


def _namer(modes: int) -> Any:
    def name(key: Any) -> str:
        if isinstance(key, Time):
            return "t"
        if key.kind == "on":
            return f"m[{modes + key.number}]"
        return f"{key.kind}[{key.number}]"

    return name


ARGUMENTS = "t, x, w, m, b"


def system(graph: BondGraph, free: Mapping[str, float]) -> System:
    """The functions of a graph; `free` parameters have their values in `assembly.p`. Raises `NotHeld`."""
    a = assembled(graph, free)
    name = _namer(len(a.modes))
    writer = Writer(name, frozen=True)
    rates = [writer.write(r) for r in a.rates]
    residuals = []
    for x, switch, off in a.residuals:
        on = writer.write(x)
        if switch is None:
            residuals.append(on)
        else:
            assert off is not None
            residuals.append(f"({on} if m[{len(a.modes) + switch}] else {writer.write(off)})")
    result = f"[{', '.join(rates)}], [{', '.join(residuals)}]"
    lines = list(writer.lines)
    conditions = [writer.write(a.opened(e.condition)) for e in graph.events]
    switched = [writer.write(a.opened(s.active)) for s in graph.switches]
    branches = [f"_{o}({', '.join(v)})" for o, v, _ in writer.atoms]
    gaps = [f"real({v[0]})" if len(v) == 1 else f"real({v[0]}) - real({v[1]})" for o, v, _ in writer.atoms]
    watch = f"[{', '.join(branches)}], [{', '.join(gaps)}]"
    truth = f"[{', '.join(conditions)}], [{', '.join(switched)}]"
    plain = Writer(name, frozen=False)
    outputs = [
        plain.write(a.quantity(n) if o.definition is None else a.opened(o.definition)) for n, o in graph.outputs.items()
    ]
    actions = [_actions(a, e) for e in graph.events]
    return System(
        a,
        a.function(ARGUMENTS, lines, result),
        a.function(ARGUMENTS, lines, result, COMPLEX),
        a.function(ARGUMENTS, writer.lines, watch),
        a.function(ARGUMENTS, writer.lines, truth),
        a.function("t, x, w, m", plain.lines, f"[{', '.join(outputs)}]"),
        actions,
        [_values(a, name, [item.value for item in group]) for group in actions],
        tuple(graph.outputs),
        len(writer.atoms),
        [_timed(a, name, o, x) for o, _, x in writer.atoms],
        tuple(o for o, _, _ in writer.atoms),
    )


def _values(a: Assembly, name: Any, values: Sequence[Expression]) -> Any:
    writer = Writer(name, frozen=False)
    names = [writer.write(v) for v in values]
    return a.function("t, x, w, m", writer.lines, f"[{', '.join(names)}]")


def _timed(a: Assembly, name: Any, operator: str, x: Any) -> Any:
    """The branch of an atom on time alone as a function of t; None for others."""
    if any(s.key.kind not in "tp" for s in symbols(x)):
        return None
    writer = Writer(name, frozen=False)
    v = [writer.write(o) for o in x.operands]
    return a.function("t", writer.lines, f"_{operator}({', '.join(v)})")


def _actions(a: Assembly, event: Event) -> list[Action]:
    found = []
    for action in event.actions:
        value = a.opened(action.value)
        target = action.target
        if isinstance(target, Quantity):
            kind, table = ("m", a.modes) if target.name in a.modes else ("x", a.integrals)
            found.append(Action(kind, table[target.name], value))
            continue
        number, node = next((i, n) for i, n in enumerate(a.graph.nodes) if n.name == target.node)
        if not isinstance(node, Element):
            raise NotHeld("an event that sets a coordinate or rate of a mechanism")
        port = next(i for i, p in enumerate(node.ports) if p.name == target.port)
        place = a.stored[node.name, port]
        if target.variable == node.stored[port]:
            found.append(Action("x", place, value))
        else:
            found.append(Action("x", place, value, stored_law(a, number, node, port, target.variable)))
    return found


def stored_law(a: Assembly, number: int, node: Element, port: int, letter: str) -> Expression:
    """Residual that is zero if the stored quantity, Unknown("own", 0), fits the value of effort or flow, Unknown("own", 1)."""
    if len(node.ports) > 1 and node.law.energy is None:
        raise NotHeld("the start of a field by an effort")
    stored, value = PortVariable(port, node.stored[port]), PortVariable(port, letter)

    def replaced(symbol: Symbol) -> Expression:
        key = symbol.key
        if key == stored:
            return Symbol(TearingVariable("own", 0))
        if key == value:
            return Symbol(TearingVariable("own", 1))
        if isinstance(key, PortVariable):
            raise NotHeld("the start of a field by an effort")
        return a.reference(node.arguments[key])

    if node.law.energy is not None:
        energy = substitute(node.law.energy, replaced)
        return Symbol(TearingVariable("own", 1)) - slope(energy, Symbol(TearingVariable("own", 0)))
    ((left, right),) = node.law.equations
    return substitute(left - right, replaced)
