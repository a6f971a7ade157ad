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
from .order import operations_in_order

CONSTANT, BY_PARAMETERS, CHANGING = "constant", "tunable", "dependent"  # kinds of slopes, in the words of FMI
# Operators without a row of their own in the table, through which slopes pass smoothly.
_SMOOTH = frozenset(("add", "multiply", "divide", "power", "item", "solve", "banded"))

_AT_EVENTS = EVENT | MODE | PARAMETER  # what changes at events alone depends on nothing else

_SLOPES = ProgramFunction(
    "slopes", "Slopes of the rates, then the outputs, by the states, then the inputs.", lambda lowered: None
)


@dataclass(frozen=True, slots=True)
class Dependency:
    """Reading of a state or an input by a rate or an output. Rows count rates, then outputs; columns states, then inputs."""

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


def row_variables(lowered: Lowered) -> list[int]:
    """Return the variables behind the rows: rates, then outputs."""
    return [*(s.rate for s in lowered.space.states), *lowered.space.outputs.values()]


def column_numbers(lowered: Lowered) -> list[int]:
    """Return for each column of the lowered slopes (states, then variables by which is differentiated) its number: states, then inputs."""
    count = len(lowered.space.states)
    inputs = {variable: count + place for place, variable in enumerate(lowered.inputs)}
    return [*range(count), *(inputs[variable] for variable in lowered.by)]


def slopes_of(lowered: Lowered) -> tuple[ProgramFunction, list[Expression]]:
    """Return the function of a program that computes the slopes of rates and outputs, with its results."""
    return _SLOPES, [entry for _, entry in _slopes(lowered)]


def slope_places(lowered: Lowered) -> list[tuple[int, int]]:
    """Return row and column of each of these slopes."""
    return [place for place, _ in _slopes(lowered)]


def _slopes(lowered: Lowered) -> list[tuple[tuple[int, int], Expression]]:
    """Return the slopes that are not zero, by row and column."""
    columns = column_numbers(lowered)
    entries = [
        ((row, columns[column]), entry)
        for row, variable in enumerate(row_variables(lowered))
        for column, entry in lowered.slopes.get(variable, {}).items()
        if entry != ZERO
    ]
    return sorted(entries, key=lambda item: item[0])


def structure_of(lowered: Lowered) -> ProgramStructure:
    """Return the structure of a program."""
    rows = row_variables(lowered)
    roots = [lowered.values[variable] for variable in rows]
    others = [*(limit.condition for limit in lowered.limits), *lowered.switches, *lowered.instants, *lowered.periods]
    others += [*lowered.events.roots(), *lowered.events.sampling]
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
    conditions = tuple(tuple(c for c in range(reads.count) if columns >> c & 1) for columns in behind)
    return ProgramStructure(
        tuple(_dependencies(lowered, rows, roots, reads)), parameters, frozenset(discrete), conditions
    )


def _dependencies(lowered: Lowered, rows: Sequence[int], roots: Sequence[Expression], reads: _Reads) -> Iterator[Dependency]:  # fmt: skip
    numbers = column_numbers(lowered)
    for row, (variable, root) in enumerate(zip(rows, roots, strict=True)):
        slopes = {numbers[c]: s for c, s in lowered.slopes.get(variable, {}).items() if s != ZERO}
        whole, bent = reads.columns(root), reads.bent(root)
        for column in range(reads.count):
            if whole >> column & 1 or column in slopes:
                slope = None if bent >> column & 1 else slopes.get(column)
                yield Dependency(row, column, _kind(lowered, slope))


def _kind(lowered: Lowered, slope: Expression | None) -> str:
    if slope is None or lowered.dependence(slope) & ~1:  # of more than parameters
        return CHANGING
    return CONSTANT if isinstance(slope, Number) else BY_PARAMETERS


class _Reads:
    """Leaves behind expressions, as bits: parameters, and columns, of which those behind a jump or a kink are told apart."""

    def __init__(self, lowered: Lowered, roots: Sequence[Expression]) -> None:
        states = len(lowered.space.states)
        self.count = states + len(lowered.inputs)
        self._first = {"state": 0, "input": states}
        self._known: dict[Expression, tuple[int, int, int]] = {}
        # What events read, a discrete variable and a condition jump with. A mode that they read themselves adds nothing to it.
        self._behind_mode = (0, 0, 0)
        if lowered.events.present:
            behind = self.of(lowered.events.roots())
            self._known.clear()
            self._behind_mode = 0, behind, behind
        self.of(roots)

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
