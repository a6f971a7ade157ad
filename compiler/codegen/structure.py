"""Structure of a program: the states and inputs that each rate and output reads, and how; for tools that take models apart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ..algebra.expression import ZERO, Apply, Expression, Number, Symbol
from ..algebra.operators import OPERATORS
from ..fast_dataclass import dataclass
from .dependence import EVENT, MODE, PARAMETER
from .functions import ProgramFunction
from .limits import Leaf
from .lowered import Lowered
from .multipliers import solved_for
from .order import operations_in_order

CONSTANT, BY_PARAMETERS, CHANGING = "constant", "tunable", "dependent"  # kinds of slopes, in the words of FMI
# Operators without a row of their own in the table, through which slopes pass smoothly.
_SMOOTH = frozenset(("add", "multiply", "divide", "power", "item", "solve", "banded"))

_AT_EVENTS = EVENT | MODE | PARAMETER  # what changes at events alone depends on nothing else

_SLOPES = ProgramFunction(
    "slopes",
    "Slopes of the rates, residuals of unknowns, outputs and invariants by the states, unknowns and inputs.",
    lambda lowered: None,
)


_COMPLETED = ProgramFunction("completed", "The state with its multipliers.", lambda lowered: None)


@dataclass(frozen=True, slots=True)
class Dependency:
    """Reading of a state or an input by a rate or an output, also through unknowns. Rows count rates, then outputs; columns states, then inputs."""

    row: int
    column: int
    kind: str


@dataclass(frozen=True, slots=True)
class ProgramStructure:
    """Dependencies by rows, the parameters (by number) that rates, outputs, events or limits read (others decide starts alone), the outputs
    that change at events only, and for each located condition the columns that its root reads."""

    dependencies: tuple[Dependency, ...]
    read: frozenset[int]
    discrete: frozenset[str]
    conditions: tuple[tuple[int, ...], ...]


def _row_variables(lowered: Lowered) -> list[int]:
    """Return the variables behind the rows: rates, then outputs."""
    return [*(s.rate for s in lowered.space.states), *lowered.space.outputs.values()]


def _slope_rows(lowered: Lowered) -> list[int]:
    """Return the variables behind the rows of the slopes: rates, residuals of unknowns, outputs, invariants."""
    space = lowered.space
    positions = [i.position for i in space.invariants if i.position is not None]
    invariants = [*positions, *(i.velocity for i in space.invariants if i.velocity is not None)]
    rates = [*(s.rate for s in space.states), *(u.residual for u in space.unknowns)]
    return [*rates, *space.outputs.values(), *invariants]


def _column_numbers(lowered: Lowered) -> list[int]:
    """Return for each column of the lowered slopes (states, unknowns, then variables by which is differentiated) its number: the inputs come last."""
    count = len(lowered.space.states) + len(lowered.space.unknowns)
    inputs = {variable: count + place for place, variable in enumerate(lowered.inputs)}
    return [*range(count), *(inputs[variable] for variable in lowered.by)]


def more_of(lowered: Lowered) -> list[tuple[ProgramFunction, list[Expression]]]:
    """Return the functions that a library has beside those of a program, with their results: slopes, and states with the multipliers that belong to them."""
    if lowered.solved is None:
        return [_slopes_of(lowered)]
    count = len(lowered.space.states) + len(lowered.space.unknowns)
    full: list[Expression] = [Symbol(Leaf("state", place)) for place in range(count)]
    places = {u.variable: place for place, u in enumerate(lowered.space.unknowns, len(lowered.space.states))}
    for variable, value in zip(solved_for(lowered.space), lowered.solved.multipliers, strict=True):
        full[places[variable]] = value
    return [_slopes_of(lowered), (_COMPLETED, full)]


def _slopes_of(lowered: Lowered) -> tuple[ProgramFunction, list[Expression]]:
    """Return the function of a program that computes these slopes, with its results."""
    return _SLOPES, [entry for _, entry in _slopes(lowered)]


def slope_places(lowered: Lowered) -> list[tuple[int, int]]:
    """Return row and column of each of these slopes."""
    return [place for place, _ in _slopes(lowered)]


def _slopes(lowered: Lowered) -> list[tuple[tuple[int, int], Expression]]:
    """Return the slopes that are not zero, by row and column."""
    columns = _column_numbers(lowered)
    entries = [
        ((row, columns[column]), entry)
        for row, variable in enumerate(_slope_rows(lowered))
        for column, entry in lowered.slopes.get(variable, {}).items()
        if entry != ZERO
    ]
    return sorted(entries, key=lambda item: item[0])


def structure_of(lowered: Lowered) -> ProgramStructure:
    """Return the structure of a program."""
    rows = _row_variables(lowered)
    roots = [lowered.values[variable] for variable in rows]
    residuals = lowered.rates[len(lowered.space.states) :]
    others = [*(limit.condition for limit in lowered.limits), *lowered.switches, *lowered.instants, *lowered.periods]
    others += [*lowered.events.roots(), *lowered.events.sampling, *residuals, *lowered.invariants]
    reads = _Reads(lowered, [*roots, *others])
    read = 0
    for root in [*roots, *others]:
        read |= reads.parameters(root)
    parameters = frozenset(i for i in range(len(lowered.parameters)) if read >> i & 1)
    discrete = [
        n
        for n, x in lowered.outputs.items()
        if lowered.dependence(x) & EVENT and not lowered.dependence(x) & ~_AT_EVENTS
    ]
    behind = (reads.columns(condition.root) for condition in lowered.events.located)
    conditions = tuple(tuple(reads.numbers(c | reads.held if c & reads.held else c)) for c in behind)
    return ProgramStructure(
        tuple(_dependencies(lowered, rows, roots, reads)), parameters, frozenset(discrete), conditions
    )


def _dependencies(lowered: Lowered, rows: Sequence[int], roots: Sequence[Expression], reads: _Reads) -> Iterator[Dependency]:  # fmt: skip
    numbers = _column_numbers(lowered)
    for row, (variable, root) in enumerate(zip(rows, roots, strict=True)):
        slopes = {numbers[c]: s for c, s in lowered.slopes.get(variable, {}).items() if s != ZERO}
        whole = reads.columns(root) | sum(1 << column for column in slopes)
        through = reads.held if whole & reads.held else 0
        bent = reads.bent(root) | through
        for place in reads.numbers(whole | through):
            column = reads.places[place]
            yield Dependency(row, place, _kind(lowered, None if bent >> column & 1 else slopes.get(column)))


def _kind(lowered: Lowered, slope: Expression | None) -> str:
    if slope is None or lowered.dependence(slope) & ~1:  # of more than parameters
        return CHANGING
    return CONSTANT if isinstance(slope, Number) else BY_PARAMETERS


class _Reads:
    """Leaves behind expressions, as bits: parameters, and columns, of which those behind a jump or a kink are told apart."""

    def __init__(self, lowered: Lowered, roots: Sequence[Expression]) -> None:
        states, unknowns = len(lowered.space.states), len(lowered.space.unknowns)
        self.places = [*range(states), *range(states + unknowns, states + unknowns + len(lowered.inputs))]
        self._first = {"state": 0, "input": states + unknowns}
        self._known: dict[Expression, tuple[int, int, int]] = {}
        # What events read, a discrete variable and a condition jump with. A mode that they read themselves adds nothing to it.
        self._behind_mode = (0, 0, 0)
        if lowered.events.present:
            behind = self.of(lowered.events.roots())
            self._known.clear()
            self._behind_mode = 0, behind, behind
        self.of(roots)
        # Unknowns depend on all that their equations read; states on constraints are read where all of them are on these.
        self.held = self.of([*lowered.rates[states:], *lowered.invariants])

    def numbers(self, columns: int) -> list[int]:
        """Return the places of states and inputs among both, from columns as bits."""
        return [place for place, column in enumerate(self.places) if columns >> column & 1]

    def of(self, roots: Sequence[Expression]) -> int:
        """Read some expressions; return the states and inputs behind any of them."""
        columns = 0
        for node in operations_in_order(roots, {}):
            self._known[node] = self._joined(node)
        for root in roots:
            columns |= self.columns(root)
        return columns

    def parameters(self, node: Expression) -> int:
        """Return the parameters that an expression reads."""
        return self._of(node)[0]

    def columns(self, node: Expression) -> int:
        """Return the states and inputs that an expression reads."""
        return self._of(node)[1]

    def bent(self, node: Expression) -> int:
        """Return those of which it is not a smooth function."""
        return self._of(node)[2]

    def _of(self, node: Expression) -> tuple[int, int, int]:
        if isinstance(node, Symbol) and isinstance(node.key, Leaf):
            if node.key.role == "parameter":
                return 1 << node.key.position, 0, 0
            if node.key.role == "mode":
                return self._behind_mode
            if node.key.role in self._first:
                return 0, 1 << self._first[node.key.role] + node.key.position, 0
        return self._known.get(node, (0, 0, 0))

    def _joined(self, node: Apply) -> tuple[int, int, int]:
        parameters = columns = bent = 0
        for operand in node.operands:
            p, c, b = self._of(operand)
            parameters, columns, bent = parameters | p, columns | c, bent | b
        row = OPERATORS.get(node.operator)
        smooth = node.operator in _SMOOTH if row is None else row.smooth and row.kind == "function"
        return parameters, columns, bent if smooth else bent | columns
