"""Lowered state space: expressions of parameters, time, inputs and states, as back-ends print them."""

from __future__ import annotations

from dataclasses import field

from ..algebra.expression import ZERO, Expression, Symbol, operations, symbols
from ..algebra.table import is_table
from ..errors import ValuesNeeded
from ..fast_dataclass import dataclass
from ..reduction import StateSpace
from ..source import Span
from .dependence import EVENT, INPUT, MODE, STATE, dependence_of
from .events import LoweredEvents
from .limits import Leaf, Limit


@dataclass(frozen=True, slots=True)
class Solved:
    """Rates of the states and residuals of the other unknowns (zero for multipliers), then the multipliers. No multiplier is read."""

    rates: tuple[Expression, ...]
    multipliers: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class Label:
    """The author's name of a node, and its origin."""

    name: str
    span: Span | None = None
    owner: str = ""


@dataclass(eq=False)
class Lowered:
    """All data that a back-end prints. Expressions are over `Leaf` symbols."""

    space: StateSpace
    parameters: tuple[int, ...] = ()  # variables
    inputs: tuple[int, ...] = ()
    values: dict[int, Expression] = field(default_factory=dict)  # variable -> its expression
    labels: dict[Expression, Label] = field(default_factory=dict)
    rates: tuple[Expression, ...] = ()  # of the states, then the residuals of the unknowns
    jacobian: dict[tuple[int, int], Expression] = field(default_factory=dict)  # (row, column) -> nonzero entry
    starts: tuple[Expression, ...] = ()
    # residuals of the starts of computed variables; `moved` minus the drawing; claims on poses
    claims: tuple[Expression, ...] = ()
    forced: tuple[Expression, ...] = ()  # signals of time that must not jump
    invariants: tuple[Expression, ...] = ()  # gaps (and norms), then the rates of gaps: all zero along a run
    # (invariant, state); of rates only by states that no residual depends on
    invariant_slopes: dict[tuple[int, int], Expression] = field(default_factory=dict)
    dependents: tuple[Expression, ...] = ()  # contents of storages in derivative form
    # (dependent, state) -> changing slope
    sensitivities: dict[tuple[int, int], Expression] = field(default_factory=dict)
    nominals: tuple[Expression | None, ...] = ()
    outputs: dict[str, Expression] = field(default_factory=dict)
    switches: list[Expression] = field(default_factory=list)  # conditions on time alone, in the order of the mode
    instants: list[Expression] = field(default_factory=list)  # known instants of kinks and jumps, of parameters
    # values at time 0 and slopes of functions linear in time whose integer values are such instants
    recurring: list[tuple[Expression, Expression]] = field(default_factory=list)
    crossings: list[Expression] = field(default_factory=list)  # other functions of time whose zeros are such instants
    events: LoweredEvents = field(default_factory=LoweredEvents)
    # owner and place of each of these, and the condition that changes there
    crossing_places: list[tuple[str, Span, str]] = field(default_factory=list)
    # each of these functions and its derivative by time, then what may be narrow of the signals
    time_roots: tuple[Expression, ...] = ()
    periods: list[Expression] = field(default_factory=list)  # no step may be longer than any of these, of parameters
    limits: list[Limit] = field(default_factory=list)  # validity limits of the run
    lags: tuple[Expression, ...] = ()  # of delayed signals, of parameters
    delayed: tuple[Expression, ...] = ()  # their undelayed values
    # zero where a law of states bends: steps end there if it shows
    bends: list[Expression] = field(default_factory=list)
    # functions that turn where a law of states may have a narrow peak, then what may be narrow there
    peaks: tuple[Expression, ...] = ()
    signals: tuple[Expression, ...] = ()  # signals of time alone: a step must not pass over their extrema
    solved: Solved | None = None  # with the multipliers of closing joints solved for
    energy: tuple[Expression, ...] = ()  # stored energy, then its gradient by the states, on request
    differentiated: int = 0  # formulas whose partial derivatives were formed
    whole: bool = True  # with the slopes
    by: tuple[int, ...] = ()  # variables by which all is differentiated beside states and unknowns
    # variable -> column (states, unknowns, then `by`) -> nonzero slope
    slopes: dict[int, dict[int, Expression]] = field(default_factory=dict)

    def event_symbol(self, position: int) -> Symbol:
        """Symbol of an item of the mode that does not depend on time alone."""
        symbol = Symbol(Leaf("mode", position))
        self._bits[symbol] = MODE | EVENT
        return symbol

    def delayed_symbol(self, position: int) -> Symbol:
        """Symbol of a delayed signal: an input of the program that changes like a state."""
        symbol = Symbol(Leaf("input", position))
        self._bits[symbol] = INPUT | STATE
        return symbol

    def dependence(self, x: Expression) -> int:
        """Dependence of an expression, as bits."""
        return dependence_of(x, self._bits)

    def moves(self, x: Expression) -> bool:
        """Return True for an expression that depends on states or unknowns."""
        return bool(self.dependence(x) & STATE)

    def parameter_values(self, leaf: Leaf) -> float:
        """Default value of a parameter. Raises `ValueError` for a leaf that is no parameter, `ValuesNeeded` if it has no value."""
        if leaf.role != "parameter":
            raise ValueError(leaf.role)
        variable = self.space.variables[self.parameters[leaf.position]]
        if variable.value is None:
            raise ValuesNeeded({variable.name: f"the range of a table, which reads `{variable.name}`"})
        return variable.value

    def moving_rows(self) -> list[int]:
        """Variables whose slopes the run's sensitivity needs: rates, residuals, invariants, outputs."""
        space = self.space
        invariants = (*(i.position for i in space.invariants), *(i.velocity for i in space.invariants))
        rates = *(s.rate for s in space.states), *(u.residual for u in space.unknowns)
        return [*rates, *(v for v in invariants if v is not None), *space.outputs.values()]

    def moving_slopes(self) -> list[tuple[tuple[int, int], Expression]]:
        """Nonzero slopes of these (rows) by states, unknowns and `by` (columns)."""
        rows = ((row, self.slopes.get(v, {})) for row, v in enumerate(self.moving_rows()))
        return [((row, column), slope) for row, slopes in rows for column, slope in slopes.items() if slope != ZERO]

    def curves_in_modes(self) -> set[Symbol]:
        """Symbols in the points of curves whose derivatives are items of the mode."""
        tables = [node for item in self.switches for node in operations(item) if is_table(node)]
        return {symbol for node in tables for point in node.operands[2:] for symbol in symbols(point)}

    _bits: dict[Expression, int] = field(default_factory=dict)
