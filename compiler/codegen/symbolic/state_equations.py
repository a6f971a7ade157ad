"""State equations in sympy: single assignments in the order of computation, with the author's names and lines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ...fast_dataclass import dataclass
from ...source import Span

if TYPE_CHECKING:
    from sympy import Basic, Symbol


@dataclass(frozen=True, slots=True)
class NamedSymbol:
    """A named scalar: its symbol, the author's name, SI unit, default value, and description."""

    symbol: Symbol
    name: str
    unit: str
    value: float | None = None
    description: str = ""


@dataclass(frozen=True, slots=True)
class SolvedEquation:
    """`target = right`, and the line of the text that caused it."""

    target: Symbol
    right: Basic
    span: Span | None
    owner: str


@dataclass(frozen=True, slots=True)
class LinearSystem:
    """`matrix * targets = right`: a linear algebraic loop, the matrix by rows."""

    targets: tuple[Symbol, ...]
    matrix: tuple[tuple[Basic, ...], ...]
    right: tuple[Basic, ...]
    span: Span | None
    owner: str


Line = SolvedEquation | LinearSystem


@dataclass(frozen=True, slots=True)
class ResetEquation:
    """`target := value` of an event; the target is a state, a discrete variable, or computed from states."""

    target: Symbol
    value: Basic
    words: str


@dataclass(frozen=True, slots=True)
class EventEquations:
    """`when condition`, or `every` with its period, offset, delay, jitter and seed; with its resets."""

    words: str
    condition: Basic
    resets: tuple[ResetEquation, ...]
    sampling: tuple[Basic, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class Indicator:
    """Left side less right side of a condition: a zero crossing is an event."""

    value: Basic
    owner: str
    span: Span


@dataclass(frozen=True, slots=True)
class Entry:
    """A named scalar expression of a result, and the line that caused it."""

    name: str
    value: Basic
    unit: str = ""
    span: Span | None = None


@dataclass(frozen=True, slots=True)
class Partials:
    """Nonzero partial derivatives by (row, column), and the lines that compute what several of them share."""

    entries: Mapping[tuple[int, int], Basic]
    lines: tuple[Line, ...]


@dataclass(frozen=True, eq=False)
class StateEquations:
    """x' = f(t, x, z, p, u, m), 0 = g(t, x, z, p, u, m), y = h(t, x, z, p, u, m).

    x states, z unknowns of nonlinear algebraic loops, p parameters, u inputs (delayed signals last), m discrete variables.
    """

    name: str
    time: Symbol
    parameters: tuple[NamedSymbol, ...]
    inputs: tuple[NamedSymbol, ...]
    states: tuple[NamedSymbol, ...]
    unknowns: tuple[NamedSymbol, ...]
    discretes: tuple[NamedSymbol, ...]
    lines: tuple[Line, ...]
    constant: frozenset[Symbol]  # targets of lines that depend on parameters alone
    rates: tuple[Entry, ...]
    residuals: tuple[Entry, ...]
    outputs: tuple[Entry, ...]
    starts: tuple[Entry, ...]
    initial: tuple[Entry, ...]  # residuals of starts given to computed quantities
    discrete_starts: tuple[Entry, ...]
    constraints: tuple[Entry, ...]  # zero along a run: positions, then velocities
    requirements: tuple[Entry, ...]  # conditions of validity
    indicators: tuple[Indicator, ...]
    events: tuple[EventEquations, ...]
    switches: tuple[Entry, ...]  # conditions under which switched junctions are on
    delays: tuple[tuple[Entry, Basic], ...]  # undelayed signal and lag of each delayed input
    partials: Partials  # of rates and residuals by states and unknowns
    reset_partials: Partials  # of computed targets of events, in their order, by states
    reset_targets: tuple[Symbol, ...]  # computed targets of events
