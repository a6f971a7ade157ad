"""The noun of this room: variables and assignments, each an application of a shared formula, never substituted into one another."""

from __future__ import annotations

from collections.abc import Mapping

from ..algebra.expression import Expression, Number, Symbol, substitute
from ..algebra.formula import Bound, Formula
from ..errors import Diagnostic
from ..nouns import dataclass
from ..source import Span

Argument = int | float  # a variable by number, or a number


@dataclass(frozen=True, slots=True)
class Variable:
    """One scalar of the model.

    role: parameter, input, time, state, unknown (of an algebraic loop), mode (events set it), delayed (what another
    was), or computed (by an assignment).
    """

    name: str
    role: str
    unit: str = ""
    value: float | None = None  # default of a parameter or input


@dataclass(frozen=True, slots=True)
class Assignment:
    """`target := formula(arguments)`, because of a line of the text.

    An implicit one says `0 = formula(arguments)`, and the target, which is among the arguments, is what makes it so. `residual` is the
    implicit form of an explicit one whose formula has no value everywhere (a diode's voltage as a logarithm of its current), over
    variables: inside of a loop, where an iteration may lead anywhere, it stands for the explicit one.
    """

    target: int
    formula: Formula
    arguments: tuple[Argument, ...]
    span: Span
    owner: str  # the element, junction or quantity that it belongs to
    implicit: bool = False
    residual: Bound | None = None

    @property
    def expression(self) -> Expression:
        """The right side over variable numbers."""

        def put(symbol: Symbol) -> Expression:
            argument = self.arguments[symbol.key]
            return Number(argument) if isinstance(argument, float) else Symbol(argument)

        return substitute(self.formula.expression, put)


@dataclass(frozen=True, slots=True)
class Derivative:
    """`target := d(of)/dt`: a storage in derivative form."""

    target: int
    of: int
    span: Span
    owner: str
    conjugate: int | None = None  # the effort of what holds a displacement, the flow of what holds a momentum


@dataclass(frozen=True, slots=True)
class State:
    """A state, the variable that is its rate, and the variables (if any) of its start and nominal magnitude."""

    variable: int
    rate: int
    start: Argument
    nominal: Argument | None
    span: Span
    given: bool = False  # whether the author said the start
    conjugate: int | None = None  # of a storage, the effort for a displacement, the flow for a momentum
    drawn: Argument | None = None  # of a coordinate of a mechanism: its value in the drawing


@dataclass(frozen=True, slots=True)
class Following:
    """What a storage or an `integral` holds that is `factor` times a state plus a constant of the run.

    `factor` is None where parameters decide it; `start` is what it holds at the start.
    """

    variable: int
    state: int
    factor: float | None
    start: Argument


@dataclass(frozen=True, slots=True)
class Claim:
    """A start that the author gives to what is computed from states: they must start so that it holds."""

    variable: int
    start: Argument
    element: str
    span: Span
    on_pose: bool = False  # it binds coordinates of mechanisms and nothing else that may move


@dataclass(frozen=True, slots=True)
class Invariant:
    """What every state of a run must keep at zero: a constraint's gap (and its rate), or the norm of a quaternion less one.

    A constraint has a multiplier, which the vanishing acceleration of the gap decides, and a parameter that is 1 where it takes
    part and 0 where it follows from others.
    """

    position: int
    velocity: int | None
    name: str
    span: Span
    multiplier: int | None = None
    part: int | None = None


@dataclass(frozen=True, slots=True)
class Balance:
    """An implicit unknown that is solved with the multipliers, after these: with them gone, its residual falls by up to 1 where it rises by 1.

    It stands for a coordinate of a mechanism that moves no inertia but through closing joints; where it does not even so, the residual
    does not change: that is told.
    """

    variable: int
    told: Diagnostic


@dataclass(frozen=True, slots=True)
class PowerPort:
    """The bond of an element's port: power into the element = sign * effort * flow."""

    element: str
    kind: str
    effort: int
    flow: int
    sign: int


@dataclass(frozen=True, slots=True)
class Storage:
    """What is needed to know the energy in a storage: stored quantities, and its energy or its law in integral form.

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
    """What an instance requires: a variable that is 1 where it holds, and the values that it is told with."""

    owner: str  # the instance, "" for the model itself
    words: str  # the condition as written
    text: str
    condition: int
    values: tuple[tuple[str, Argument, str], ...]  # name, variable or number, SI unit
    span: Span
    stands: Span | None


@dataclass(frozen=True, slots=True)
class Discrete:
    """A variable that only events change, and its start."""

    variable: int
    start: Argument


@dataclass(frozen=True, slots=True)
class Delayed:
    """A variable that is what another was some time ago."""

    variable: int
    value: int
    lag: Argument
    span: Span


@dataclass(frozen=True, slots=True)
class Setting:
    """What an event sets: a state, a discrete variable or what is computed from states, and the variable of its new value."""

    target: int
    value: int
    words: str  # the target as written
    span: Span


@dataclass(frozen=True, slots=True)
class EventRow:
    """`when`: a variable that is 1 where the condition holds, and what is set at the instant it becomes so; or `every`."""

    condition: int
    settings: tuple[Setting, ...]
    owner: str  # the instance, "" for the model itself
    words: str
    span: Span
    period: Argument | None = None  # of a sampled one


@dataclass(frozen=True, slots=True)
class Switch:
    """A junction that is on where a variable is 1."""

    junction: str
    condition: int
    span: Span


@dataclass(frozen=True, eq=False)
class EquationSystem:
    """All equations of a model, causal but not yet ordered."""

    name: str
    variables: tuple[Variable, ...]
    assignments: tuple[Assignment, ...]
    derivatives: tuple[Derivative, ...]
    states: tuple[State, ...]
    outputs: Mapping[str, int]
    quantities: Mapping[str, int]  # named quantities that occur
    ports: tuple[PowerPort, ...]
    storages: tuple[Storage, ...]
    stored: Mapping[str, int]  # node -> variable of its stored energy, for mechanisms
    claims: tuple[Claim, ...]
    limits: tuple[Validity, ...] = ()
    invariants: tuple[Invariant, ...] = ()
    balances: tuple[Balance, ...] = ()
    discretes: tuple[Discrete, ...] = ()
    events: tuple[EventRow, ...] = ()
    switches: tuple[Switch, ...] = ()
    delays: tuple[Delayed, ...] = ()
    pieced: frozenset[int] = frozenset()  # computed in pieces that join smoothly: conditions in them are no events
    following: tuple[Following, ...] = ()
