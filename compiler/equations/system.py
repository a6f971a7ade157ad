"""Equation system: variables and assignments, each an application of a shared formula, never substituted into one another.

Variables of bonds and ports are named after the element at one end, in the letters of its domain.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from ..algebra.expression import Expression
from ..algebra.formula import Bound, Formula, over
from ..errors import Diagnostic
from ..fast_dataclass import dataclass
from ..graph.domains import DOMAINS
from ..graph.elements import OF_NODE, TRANSDUCERS, Kind
from ..graph.network import BondEnd, BondGraph, Element, MechanismNode
from ..source import Span

Argument = int | float  # a variable by number, or a number


@dataclass(frozen=True, slots=True)
class Variable:
    """One scalar of the model.

    role: parameter, input, time, state, unknown (of an algebraic loop), mode (set by events), delayed (value of another
    at an earlier time), or computed (by an assignment).
    """

    name: str
    role: str
    unit: str = ""
    # default of a parameter or input; of an unknown, a value near its solution, if the author gives one
    value: float | None = None


@dataclass(frozen=True, slots=True)
class Assignment:
    """`target := formula(arguments)`, with the line of the text that it comes from.

    An implicit one means `0 = formula(arguments)`, with the target among the arguments. `residual` is the implicit form, over variables, of
    an explicit assignment whose formula is not defined everywhere (a diode's voltage as a logarithm of its current): it replaces the explicit
    form inside a loop, where an iteration may lead anywhere. `guess`: a value near the solution of an implicit one, if the author gives one.
    """

    target: int
    formula: Formula
    arguments: tuple[Argument, ...]
    span: Span
    owner: str  # the element, junction or quantity that it belongs to
    implicit: bool = False
    residual: Bound | None = None
    guess: float | None = None

    @property
    def targets(self) -> tuple[int, ...]:
        """The variable that it computes."""
        return (self.target,)

    @property
    def read(self) -> tuple[int, ...]:
        """Variables among the arguments."""
        return tuple(a for a in self.arguments if not isinstance(a, float))

    @property
    def expression(self) -> Expression:
        """Right side over variable numbers."""
        return over(self.formula.expression, self.arguments)


@dataclass(frozen=True, slots=True)
class Derivative:
    """`target := d(of)/dt`: a storage in derivative form, or `der(x)` of the text."""

    target: int
    of: int
    span: Span
    owner: str
    quantity: (
        int | None
    )  # `of` by its own name and unit, also where it is the same number as another variable; None: no storage
    conjugate: int | None = None  # effort of a displacement's storage, flow of a momentum's


@dataclass(frozen=True, slots=True)
class State:
    """A state, the variable that is its rate, and the variables (if any) of its start and nominal magnitude."""

    variable: int
    rate: int
    start: Argument
    nominal: Argument | None
    span: Span
    given: bool = False  # True if the author gave the start
    conjugate: int | None = None  # of a storage, the effort for a displacement, the flow for a momentum
    drawn: Argument | None = None  # of a coordinate of a mechanism: its value in the drawing


@dataclass(frozen=True, slots=True)
class StateFollower:
    """Content of a storage or an `integral` that is `factor` times a state plus a constant of the run.

    `factor` is None if it depends on parameters; `start` is the content at the start.
    """

    variable: int
    state: int
    factor: float | None
    start: Argument


@dataclass(frozen=True, slots=True)
class Claim:
    """Start that the author gives to a variable computed from states: the states must start such that it holds."""

    variable: int
    start: Argument
    element: str
    span: Span
    on_pose: bool = False  # it binds coordinates of mechanisms and nothing else that may move


@dataclass(frozen=True, slots=True)
class Invariant:
    """Function of the state that a run must keep at zero: a constraint residual (and its rate), or the norm of a quaternion minus one.

    Rolling constrains velocities alone: there is a rate, and no residual of which it would be the rate.
    A constraint has a multiplier, which makes the acceleration of the residual zero, and a parameter that is 1 if it is active
    and 0 if it depends on others.
    """

    position: int | None
    velocity: int | None
    name: str
    span: Span
    multiplier: int | None = None
    part: int | None = None


@dataclass(frozen=True, slots=True)
class MomentumBalance:
    """An implicit unknown that is solved with the multipliers, after them: once they are eliminated, its residual has a slope from -1 to 0.

    It belongs to a coordinate of a mechanism that moves inertia only through closing joints. If it moves none even so, the slope is zero,
    and `told` is reported.
    """

    variable: int
    told: Diagnostic


@dataclass(frozen=True, slots=True)
class Momentum:
    """Momentum of a coordinate of a mechanism where junctions switch, and the coordinate's rate, to which it is conjugate."""

    variable: int
    quantity: int  # the same by its own name
    rate: int


@dataclass(frozen=True, slots=True)
class PowerPort:
    """Bond of an element's port: power into the element = sign * effort * flow, if that `is_balanced`, as it is not of temperature and heat."""

    element: str
    kind: str
    effort: int
    flow: int
    sign: int
    delayed: bool = False  # True if its law reads what was: what it takes is on its way
    is_balanced: bool = True

    @property
    def group(self) -> str:
        """Group of its element: "source", "storage", "loss" or "transducer"."""
        return OF_NODE[Kind(self.kind)].group


@dataclass(frozen=True, slots=True)
class Storage:
    """Data for the energy in a storage: stored quantities, and its energy or its law in integral form.

    `energy` or `laws` are over slots: first the stored quantities, then the `arguments`.
    """

    element: str
    kind: str
    stored: tuple[int, ...]
    arguments: tuple[Argument, ...]
    energy: Expression | None
    laws: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class Validity:
    """Requirement of an instance: a variable that is 1 if it holds, and the values to report with a violation."""

    owner: str  # the instance, "" for the model itself
    words: str  # the condition as written
    text: str
    condition: int
    values: tuple[tuple[str, Argument, str], ...]  # name, variable or number, SI unit
    span: Span
    stands: Span | None
    refuses: bool = False  # True for values with which the model has no meaning


@dataclass(frozen=True, slots=True)
class Discrete:
    """A variable that only events change, and its start."""

    variable: int
    start: Argument


@dataclass(frozen=True, slots=True)
class Delayed:
    """A variable with the value of another at an earlier time."""

    variable: int
    value: int
    lag: Argument
    span: Span


@dataclass(frozen=True, slots=True)
class EventAssignment:
    """Assignment of an event: its target (a state, a discrete variable, or one computed from states) and the variable of its new value."""

    target: int
    value: int
    words: str  # the target as written
    span: Span


@dataclass(frozen=True, slots=True)
class EventRow:
    """`when`: a variable that is 1 if the condition holds, and the assignments at the instant of its rise; or `every`."""

    condition: int
    settings: tuple[EventAssignment, ...]
    owner: str  # the instance, "" for the model itself
    words: str
    span: Span
    sampling: tuple[Argument, ...] = ()  # period, offset, delay (0 but for what sets late), jitter, seed
    stops: bool = False
    late: bool = False  # sets what the event before it has computed


@dataclass(frozen=True, slots=True)
class JunctionSwitch:
    """A junction that is on if a variable is 1."""

    junction: str
    condition: int
    span: Span


@dataclass(frozen=True, eq=False)
class Equations:
    """Subject of equations, in order or not: variables, states, outputs, energies, events.

    `outputs` are the author's; an energy balance reads `ports` and `stored`.
    """

    name: str
    variables: tuple[Variable, ...]
    states: tuple[State, ...]
    outputs: Mapping[str, int]
    quantities: Mapping[str, int]  # named quantities that occur
    ports: tuple[PowerPort, ...]
    storages: tuple[Storage, ...]
    stored: Mapping[str, int]  # node -> variable of its stored energy, for mechanisms
    claims: tuple[Claim, ...]
    limits: tuple[Validity, ...]
    invariants: tuple[Invariant, ...]
    balances: tuple[MomentumBalance, ...]
    discretes: tuple[Discrete, ...]
    events: tuple[EventRow, ...]
    switches: tuple[JunctionSwitch, ...]
    delays: tuple[Delayed, ...]
    # derivatives of others, and what is computed in pieces that join smoothly: conditions in them are no events
    pieced: frozenset[int]
    following: tuple[StateFollower, ...]


@dataclass(frozen=True, eq=False)
class EquationSystem(Equations):
    """All equations of a model, with causality but not yet in order."""

    assignments: tuple[Assignment, ...]
    derivatives: tuple[Derivative, ...]
    momenta: tuple[Momentum, ...]


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
