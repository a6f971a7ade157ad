"""Bond graph, the data structure in the middle of the compiler: elements, junctions and a mechanism's ports, joined by bonds.

It is flat: instances are expanded, multibonds are several bonds, model ports and splitters are removed. Each part still
has its definition, its instance path and its line.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import field
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

from ..algebra.expression import Expression, Symbol, add, divide, multiply, symbols
from ..algebra.formula import Bound, leaf, over
from ..fast_dataclass import dataclass
from ..source import Span
from .elements import Kind
from .mechanism import Mechanism

if TYPE_CHECKING:
    import networkx


class Quantity(NamedTuple):
    """A reference to a named parameter, constant, input or signal by its full name, or to `time`."""

    name: str


class Reading(NamedTuple):
    """A reference to `e`, `f`, `q` or `p` at a port of a node (for a junction: the variable that its bonds share), or of a model."""

    node: str
    port: str
    variable: str


class PortVariable(NamedTuple):
    """Own variable in an element's law: `e`, `f`, `q` or `p` of the port with this number."""

    port: int
    variable: str


TIME = Quantity("time")
Reference = Quantity | Reading | float


@dataclass(frozen=True, slots=True)
class Law:
    """Law of an element, over `PortVariable` variables and numbered slots; equal laws are one object.

    Either equations `left = right`, or the stored energy.
    """

    equations: tuple[tuple[Expression, Expression], ...]
    energy: Expression | None
    arity: int


@dataclass(frozen=True, slots=True)
class Port:
    """A scalar power port. `name` is empty for the one port of a one-port; 1 and 2 for the sides of TF and GY."""

    name: str
    domain: str


@dataclass(frozen=True, slots=True)
class Element:
    """A node with a law: source, storage, dissipation, transformer or gyrator."""

    name: str
    kind: Kind
    modulated: bool
    ports: tuple[Port, ...]
    law: Law
    arguments: tuple[Reference, ...]
    stored: tuple[str, ...]  # of a storage, port by port: "q" or "p"; else empty
    starts: Mapping[int, tuple[str, Bound]]  # port number -> a variable of it and its value at the start
    nominals: Mapping[int, tuple[str, Bound]]
    prefer: str | None  # "integral", "derivative", "effort" or "flow"
    require: str | None
    definition: str  # declaration: Model.name
    span: Span
    bundle: str = ""  # the transducer of multibonds that it is a part of, in drawings

    @property
    def gives_heat(self) -> bool:
        """Return True if the last port gives the power that the others lose, as in an RS."""
        last = len(self.ports) - 1
        if not last:
            return False
        power = add(*(multiply(Symbol(PortVariable(p, "e")), Symbol(PortVariable(p, "f"))) for p in range(last)))
        heat = (Symbol(PortVariable(last, "f")), divide(power, Symbol(PortVariable(last, "e"))))
        return self.law.equations[-1:] == (heat,)


SHOWN = 60  # bonds in a notebook


@dataclass(frozen=True, slots=True)
class Junction:
    """A 0- or 1-junction."""

    name: str
    kind: Kind
    domain: str
    definition: str
    span: Span
    bundle: str = ""  # the junction of multibonds, or the transducer of them, that it is a part of, in drawings


@dataclass(frozen=True, slots=True)
class MechanismNode:
    """A mechanism as a node of the graph: one multiport with efforts as inputs and flows as outputs."""

    name: str
    kind: Kind
    ports: tuple[Port, ...]  # only those that carry a bond: `guide[1].x`, `platform.phi`
    mechanism: Mechanism
    definition: str
    span: Span


Node = Element | Junction | MechanismNode


class BondEnd(NamedTuple):
    """End of a bond: a node and one of its ports (0 for a junction), by number."""

    node: int
    port: int


@dataclass(frozen=True, slots=True)
class Bond:
    """A half arrow from `tail` to `head`, the direction in which power counts as positive."""

    tail: BondEnd
    head: BondEnd
    domain: str
    span: Span


@dataclass(frozen=True, slots=True)
class Named:
    """A parameter, constant, input, signal, mode or output, the rate of an expression, `der(x)`, or a "loop", a signal that depends on itself.

    `definition` computes it (None: it comes from outside; for a mode it is the start; of a rate it is the integral, x; of the unknown of a `solve` it
    is zero). `value` is known if it is constant during a run; `guess`: a value near the solution of a `solve`.
    """

    name: str
    role: str
    unit: str  # SI, as a person would write it
    definition: Bound | None
    value: float | None
    span: Span
    description: str = ""
    guess: float | None = None
    counted: str = ""  # the author's unit, if a number without it is another one though both fit: deg, %, dB, zero degC

    @property
    def kind(self) -> str:
        """The unit by which a number from outside is read."""
        return self.counted or self.unit

    @property
    def together(self) -> tuple[str, ...]:
        """Unknowns of a `solve`, which are the last arguments of each one's definition, beyond those in its expression."""
        assert self.definition is not None
        used = len(set(symbols(self.definition.formula.expression)))
        return tuple(a.name for a in self.definition.arguments[used:] if isinstance(a, Quantity))


@dataclass(frozen=True, slots=True)
class Integral:
    """A signal with memory: `integral(rate, start)`."""

    name: str
    rate: Bound
    start: Bound
    span: Span


@dataclass(frozen=True, slots=True)
class Delay:
    """A signal at an earlier time: `delay(x, 1 ms)`. Before the run it has the value of the start."""

    name: str
    value: Bound
    lag: Bound
    span: Span


@dataclass(frozen=True, slots=True)
class Requirement:
    """A validity limit: `require CONDITION "text"`. The condition is 1 if it holds."""

    name: str  # the instance that requires, "" for the model itself
    condition: Bound
    words: str  # as written
    text: str
    readings: tuple[tuple[str, Reference, str], ...]  # quantities in it: words, reference, SI unit
    span: Span
    stands: Span | None  # declaration of the instance
    refuses: bool = False  # True for values with which the model has no meaning: nothing begins with them


@dataclass(frozen=True, slots=True)
class Action:
    """Assignment of an event: target and value. For a storage the variable as written, `p` or `f` of an inertia."""

    target: Quantity | Reading
    value: Bound
    words: str  # the target as written
    span: Span


@dataclass(frozen=True, slots=True)
class Sampling:
    """Instants of an `every`: tick k at k*period + offset + jitter*u, u of the numbers of a seed in [0, 1); all known before the run.

    With a `delay` what is set takes effect so much later.
    """

    period: Bound
    offset: Bound | None = None
    delay: Bound | None = None
    jitter: Bound | None = None
    seed: Bound | None = None

    def values(self) -> tuple[Bound | None, ...]:
        """All five, in the order of `Sampling`."""
        return self.period, self.offset, self.delay, self.jitter, self.seed


@dataclass(frozen=True, slots=True)
class Event:
    """`when CONDITION { … }` or `every PERIOD { … }`. The condition is 1 if it holds.

    A `when` reads all values before it sets any; the actions of an `every` are a program's lines.
    """

    name: str  # its instance, "" for the main model
    condition: Bound  # of a sampled one it never holds
    words: str
    actions: tuple[Action, ...]
    span: Span
    sampling: Sampling | None = None
    stops: bool = False  # True for `stop when CONDITION` of an experiment
    late: bool = False  # sets what the event before it, of the same block, has computed


@dataclass(frozen=True, slots=True)
class Switch:
    """A junction that is on if a condition is 1. When it is off, a 1-junction has no flow and a 0-junction no effort."""

    junction: str
    active: Bound
    span: Span


@dataclass(frozen=True, eq=False)
class BondGraph:
    """The whole model: nodes, bonds and the named quantities."""

    name: str
    nodes: tuple[Node, ...]
    bonds: tuple[Bond, ...]
    quantities: Mapping[str, Named]
    outputs: Mapping[str, Named]
    integrals: Mapping[str, Integral]
    span: Span
    requirements: tuple[Requirement, ...] = ()
    stands: Mapping[str, Span] = field(default_factory=dict)  # instance -> where it is declared
    walls: Mapping[tuple[str, str], int] = field(default_factory=dict)  # port of a model, component -> its bond
    events: tuple[Event, ...] = ()
    switches: tuple[Switch, ...] = ()
    delays: Mapping[str, Delay] = field(default_factory=dict)
    undetermined: tuple[str, ...] = ()  # notes on shares of switches that conditions or laws read

    def _repr_html_(self) -> str:
        """HTML for notebooks: the first bonds, each with its domain and its line in the text. Pictures are drawn elsewhere."""
        from html import escape

        from ..errors import printable

        def cell(words: str) -> str:
            return f"<td>{escape(printable(words))}</td>"

        def end(end: BondEnd) -> str:
            node = self.nodes[end.node]
            return f"{node.kind.value} {node.name}"

        rows = [
            f"<tr>{cell(end(b.tail))}<td>&#8640;</td>{cell(end(b.head))}{cell(b.domain)}{cell(f'line {b.span.line}')}</tr>"
            for b in self.bonds[:SHOWN]
        ]
        more = f"<p>and {len(self.bonds) - SHOWN} more</p>" if len(self.bonds) > SHOWN else ""
        head = f"<strong>{escape(printable(self.name))}</strong>: {len(self.nodes)} nodes, {len(self.bonds)} bonds"
        return f"<div>{head}<table>{''.join(rows)}</table>{more}</div>"

    def definitions(self) -> Iterator[Bound]:
        """All definitions of signals, parameters and outputs."""
        for named in (*self.quantities.values(), *self.outputs.values()):
            if named.definition is not None:
                yield named.definition
        for integral in self.integrals.values():
            yield integral.rate
            yield integral.start
        for requirement in self.requirements:
            yield requirement.condition
        for event in self.events:
            yield event.condition
            if event.sampling is not None:
                yield from (value for value in event.sampling.values() if value is not None)
            yield from (action.value for action in event.actions)
        for switch in self.switches:
            yield switch.active
        for delay in self.delays.values():
            yield delay.value
            yield delay.lag

    @cached_property
    def incident(self) -> tuple[tuple[int, ...], ...]:
        """Numbers of the bonds of each node, in order of declaration."""
        lists: list[list[int]] = [[] for _ in self.nodes]
        for number, bond in enumerate(self.bonds):
            lists[bond.tail.node].append(number)
            lists[bond.head.node].append(number)
        return tuple(map(tuple, lists))

    @cached_property
    def network(self) -> networkx.MultiDiGraph:
        """The graph in networkx: nodes have their names of the text, `node=` and `bond=` carry the typed payloads."""
        import networkx

        graph = networkx.MultiDiGraph(name=self.name)
        for node in self.nodes:
            graph.add_node(node.name, node=node)
        for number, bond in enumerate(self.bonds):
            tail, head = self.nodes[bond.tail.node].name, self.nodes[bond.head.node].name
            graph.add_edge(tail, head, key=number, bond=bond)
        return graph


def behind(names: Iterable[str], quantities: Mapping[str, Named]) -> frozenset[str]:
    """Some quantities, and all that their definitions read, directly or not."""
    found, waiting = set[str](), list(names)
    while waiting:
        name = waiting.pop()
        if name in found or name not in quantities:
            continue
        found.add(name)
        definition = quantities[name].definition
        if definition is not None:
            waiting += quantities_in(definition)
    return frozenset(found)


def quantities_in(bound: Bound) -> set[str]:
    """Names of the quantities that a formula reads itself."""
    return {a.name for a in bound.arguments if isinstance(a, Quantity)}


def over_arguments(bound: Bound, quantities: Mapping[str, Named]) -> Expression:
    """Expression with all definitions put in: its symbols are the names of quantities without definition."""
    known: dict[str, Expression] = {}

    def value(reference: object) -> Expression:
        return known[reference.name] if isinstance(reference, Quantity) else leaf(reference)

    def read(definition: Bound) -> list[str]:
        return [a.name for a in definition.arguments if isinstance(a, Quantity) and a.name not in known]

    rows: list[tuple[str, Bound]] = [("", bound)]
    while rows:  # not by recursion: a row of quantities may be longer than Python nests calls
        name, definition = rows[-1]
        missing = read(definition)
        if missing:
            inner = quantities[missing[0]].definition
            if inner is None:
                known[missing[0]] = Symbol(missing[0])
            else:
                rows.append((missing[0], inner))
            continue
        rows.pop()
        known[name] = over(definition.formula.expression, definition.arguments, value)
    return known[""]
