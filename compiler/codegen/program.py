"""Program: pure functions over arrays, with the author's names. Every target makes this shape."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from functools import cached_property
from typing import Any, TypeAlias

from ..arrays import Array, IntArray
from ..fast_dataclass import dataclass
from ..source import Span

# (time, state, inputs, constants, mode) -> array, index last; all may have leading axes
StateFunction: TypeAlias = "Callable[[Array | float, Array, Array, Array, Array], Array]"


@dataclass(frozen=True, slots=True)
class NameTable:
    """Names and SI units of one kind of thing, in the order of its array."""

    names: tuple[str, ...]
    units: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class LimitNote:
    """Report of a validity limit: leaving the range of a `table` ends the run, a violated `require` is a warning, and a `start` is refused."""

    kind: str  # "table", "require" or "start"
    owner: str  # the element or quantity with the table; the instance that requires, "" for the model itself
    words: str  # the kind of table; the condition as written
    text: str  # the author's
    span: Span
    stands: Span | None  # declaration of the instance
    values: tuple[tuple[str, str], ...]  # names and SI units of its quantities
    fixed: bool = False  # True if it reads parameters alone, so that a run checks it once


@dataclass(frozen=True, slots=True)
class ConditionNote:
    """A located condition: its place in the mode, and its origin.

    It holds if its root is negative, or (not `strict`) zero. If `steers` is False, only events read it, not rates or delayed signals.
    """

    position: int
    strict: bool
    steers: bool
    owner: str
    span: Span


@dataclass(frozen=True, slots=True)
class TimeFunction:
    """A function of time alone among `TimeFunctions.nodes`, its derivative by time (-1: none), and its origin."""

    place: int
    slope: int
    moded: bool  # True if either of them reads the mode
    condition: str  # the operator of the condition that changes at its zeros; "": something bends
    owner: str
    span: Span


# operators of `TimeFunctions` without operands
LEAVES = frozenset({"number", "time", "constant", "input", "mode", "state"})


@dataclass(frozen=True, slots=True)
class NarrowCondition:
    """A located condition whose indicator may have narrow peaks between two places of a step."""

    number: int  # among `Hybrid.conditions`
    place: int  # of its indicator among the operations; -1 where there is no range for it
    narrow: tuple[int, ...]  # places of the operations that may be narrow


@dataclass(frozen=True, slots=True)
class TimeFunctions:
    """Functions of time, and indicators of narrow conditions on states, as operations, operands first.

    A node is an operator with the places of its operands, or a leaf (`number`, `time`, `constant`, `input`, `mode`, `state`) with its number.
    """

    nodes: tuple[tuple[str, tuple[Any, ...]], ...]
    crossings: tuple[TimeFunction, ...]  # as `Program.crossings`
    narrow: tuple[int, ...]  # operations behind `Program.signals` that may move a lot within a short time
    conditions: tuple[NarrowCondition, ...] = ()
    narrow_names: tuple[str, ...] = ()  # of the quantities that the operations `narrow` are part of
    indicators: tuple[int, ...] = ()  # operations of all located conditions, as `Hybrid.conditions`

    def needed(self, roots: Sequence[int]) -> list[int]:
        """Return the operations that some roots need, operands first: they stand in that order already."""
        needed, stack = set(roots), list(roots)
        while stack:
            operator, operands = self.nodes[stack.pop()]
            if operator not in LEAVES:
                more = set(operands) - needed
                needed |= more
                stack += more
        return sorted(needed)

    def constants_of(self, roots: Sequence[int]) -> list[int]:
        """Return the positions of the constants that some roots read."""
        nodes = (self.nodes[i] for i in self.needed(roots))
        return [operands[0] for operator, operands in nodes if operator == "constant"]


@dataclass(frozen=True, slots=True)
class SettingNote:
    """Assignment of an event: its target, by place, is an item of the mode, a state, or a variable computed from states."""

    kind: str  # "mode", "state" or "computed"
    position: int
    words: str  # as written
    span: Span


@dataclass(frozen=True, slots=True)
class EventNote:
    """`when` or `every`: its text for reports, and its assignments."""

    owner: str  # the instance, "" for the model itself
    words: str
    span: Span
    settings: tuple[SettingNote, ...]
    sampled: bool = False
    stops: bool = False  # the run ends there
    late: bool = False  # sets what the event before it has computed, when the delay of `Hybrid.sampling` is over

    def __str__(self) -> str:
        return f"{'every' if self.sampled else 'stop when' if self.stops else 'when'} {self.words}"


@dataclass(frozen=True, eq=False)
class Delays:
    """Delayed signals: the last items of the inputs, which the run fills in."""

    count: int
    lags: Callable[[Array], Array]  # constants -> by how much they are late
    values: StateFunction  # as Program.output -> what they will be


@dataclass(frozen=True)
class HybridNote:
    """All of a `Hybrid` except its functions: plain data."""

    size: int
    modes: NameTable  # of discrete variables
    timed: tuple[int, ...]
    counted: tuple[int, ...]  # places in the mode of whole numbers of states
    conditions: tuple[ConditionNote, ...]
    events: tuple[EventNote, ...]
    junctions: tuple[tuple[str, Span], ...]
    switches_signals: bool  # True if `Program.signals` change at events that depend on states
    jumping: tuple[int, ...]  # places of the states that an impulse changes: stored quantities, and rates of mechanisms
    poses: tuple[int, ...]  # places of the coordinates of mechanisms
    momenta: int  # number of the last dependents that are momenta of coordinates
    affine: bool  # True if in each mode the rates are affine in the states, with slopes that do not depend on time


@dataclass(frozen=True, eq=False)
class Hybrid(HybridNote):
    """Events of a program that depend on its states.

    The mode (…, size) holds the discrete variables first, then the truth values of conditions, and whole numbers of states (`counted`).
    Conditions on time alone are at the places `timed`, in the order of `Program.switches`. The others are located, each at the zero
    crossings of its root.
    """

    start: Callable[[Array], Array]  # constants -> discrete variables at the start
    roots: StateFunction  # as Program.output -> left less right of each condition
    counts: StateFunction  # the same -> the whole numbers at the places `counted`, from the conditions in the mode
    triggers: StateFunction  # the same -> 1 or 0 for each event
    values: StateFunction  # the same -> what the settings of all events set
    targets: StateFunction  # the same -> what is computed and set, as it is
    sampling: Callable[[Array], Array]  # constants -> (5 n,): of each sampled event period, offset, delay, jitter, seed
    actives: StateFunction  # the same -> 1 or 0 for each switched junction
    # the same, where junctions switch -> of states and dependents, efforts for displacements and flows for momenta; 0 for what stores nothing
    conjugates: StateFunction
    # time, state, inputs, constants -> mode with modes as they start
    mode_at: Callable[[Array | float, Array, Array, Array], Array]


# names of its functions in a program, where `start` is that of the states
HYBRID = ("mode_start", *(name for name in Hybrid.__annotations__ if name != "start"))


@dataclass(frozen=True, eq=False)
class Native:
    """Machine code of a program's functions: `void name(double time, state, inputs, constants, mode, out)` over arrays of doubles.

    They are pure and may be called from many threads. `code` keeps them in memory.
    """

    addresses: Mapping[str, int]
    code: object


@dataclass(frozen=True, eq=False)
class Program:
    """A model that can be run.

    Arrays have their index last and may have leading axes (batches): parameters (…, P), constants (…, K), inputs (…, U),
    state (…, n). The state holds the n - m states and then the m unknowns of the algebraic loops: the program is M x' = f
    with M = diag(1 … 1, 0 … 0), an explicit system if m = 0, else semi-explicit of index 1. `mode` holds the truth values of the
    conditions on time (`switches`), constant between two instants; with events it holds more, see `Hybrid`.
    """

    name: str
    source: str  # the text of the module
    states: NameTable
    unknowns: NameTable  # of the algebraic loops that the run solves
    outputs: NameTable
    inputs: NameTable
    parameters: NameTable
    defaults: tuple[float, ...]  # of the parameters
    input_defaults: tuple[float, ...]
    constants: Callable[[Array], Array]  # parameters -> all that depends on parameters alone
    start: Callable[[Array], Array]  # constants -> state
    nominal: Callable[[Array], Array]  # constants -> nominal magnitudes given by the author (0: none)
    # time, state, inputs, constants, mode -> (…, n): rates of the states, then what must vanish
    derivative: StateFunction
    pattern: tuple[IntArray, IntArray]  # rows and columns of the Jacobian's entries
    jacobian_entries: StateFunction  # the same -> (…, entries)
    jacobian: StateFunction  # the same -> (…, n, n), dense
    output: StateFunction  # the same -> (…, m)
    claims: StateFunction  # the same -> residuals of given starts
    dependents: NameTable  # contents of storages in derivative form
    dependent: StateFunction  # the same -> those
    # dependents and states, where the slope of one by the other changes in a run
    sensitivity_pattern: tuple[IntArray, IntArray]
    sensitivities: StateFunction  # the same -> these slopes
    jumping: NameTable  # what is differentiated and may jump
    forced: StateFunction  # the same -> its values, which must not jump
    # time, inputs, constants, mode -> what rates read of time alone
    signals: Callable[[Array | float, Array, Array, Array], Array]
    # the same -> power into each port, then stored energies
    powers: StateFunction
    instants: Callable[[Array], Array]  # constants -> instants of kinks and jumps
    # time, constants, mode -> functions of time whose zeros are such instants
    crossings: Callable[[Array | float, Array, Array], Array]
    switches: Callable[[Array | float, Array], Array]  # time, constants -> mode
    periods: Callable[[Array], Array]  # constants -> times that no step may be longer than
    limits: tuple[LimitNote, ...]
    holds: StateFunction  # as output -> 1 or 0 for each limit
    limit_values: StateFunction  # as output -> the values of all limits in a row
    invariants: NameTable  # kept at zero by a run: constraint residuals (and norms), then their rates
    invariant: StateFunction  # as output -> those
    invariant_pattern: tuple[IntArray, IntArray]  # invariants and states; rates only by states on which no gap depends
    invariant_slopes: StateFunction  # as output -> the slopes there
    # for each constraint that has a multiplier, its place among the unknowns, else -1: those with gaps, then those of rates alone
    multipliers: tuple[int, ...]
    rates: tuple[int, ...]  # for each constraint the row of its rate among the invariants, else -1
    # for each constraint the parameter that says whether it takes part (1) or follows from others (0), else -1
    parts: tuple[int, ...]
    # the unknowns that `solved` solves for, in its order: multipliers, and balances of massless bodies
    eliminated: tuple[int, ...]
    solved: StateFunction | None
    # as derivative, for any multipliers in the state: zero in their rows, and then the multipliers; None if there are none
    operations: int = 0  # of the derivative
    differentiated: int = 0  # laws whose derivative was formed
    native: Native | None = None  # addresses of the functions in machine code
    hybrid: Hybrid | None = None  # None: only time makes anything jump
    bends: StateFunction | None = None
    # as output -> zero where a law of states bends but does not jump; None if none does
    peaks: StateFunction | None = None
    # as output -> what turns where a law of states may have a narrow peak, then what may be narrow there; None if none may
    poles: StateFunction | None = None
    # as output -> what the equations of loops divide by, in a model without states; None if there is nothing
    delays: Delays | None = None
    recurring: Callable[[Array], Array] | None = None
    # constants -> value at time 0 and slope of functions linear in time that jump at their integer values; None if none does
    stored_energy: StateFunction | None = None
    # as output -> all energy that is stored, then its slopes by the states; None if the scene does not ask for it
    time_functions: TimeFunctions | None = None  # None: none has to be looked at
    signal_constants: tuple[int, ...] = ()  # places of the constants that `signals` read
    # all that it has, by name (see `functions.py`)
    functions: Mapping[str, Callable[..., Array]] = field(default_factory=dict)
    kept: dict[object, Any] = field(init=False, default_factory=dict, repr=False)
    # results of runs that depend on the program alone, computed once; never those that depend on a run's values

    @cached_property
    def watched(self) -> bool:
        """True if a run has limits to check along its way, not at its start alone."""
        return not all(note.fixed for note in self.limits)

    @cached_property
    def variables(self) -> NameTable:
        """States, then unknowns of loops."""
        return NameTable((*self.states.names, *self.unknowns.names), (*self.states.units, *self.unknowns.units))

    def mode_at(self, time: Array | float, state: Array, inputs: Array, constants: Array) -> Array:
        """Mode at a state, with discrete variables at their start."""
        hybrid = self.hybrid
        return self.switches(time, constants) if hybrid is None else hybrid.mode_at(time, state, inputs, constants)
