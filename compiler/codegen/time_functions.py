"""Functions of time as plain data, for the search for instants beside a program.

The functions whose zeros are instants, their derivatives by time, the possibly narrow parts of the signals and the indicators of located
conditions that may be narrow form one list of operations, which is stored with a program of any target; `ranges.py` evaluates it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from ..algebra.derivative import NotDifferentiable, derivative
from ..algebra.expression import Apply, Expression, Number, Symbol, operations, symbols
from ..algebra.operators import OPERATORS
from ..algebra.systems import SYSTEMS
from .dependence import MODE, STATE, TIME
from .limits import Leaf
from .lowered import Lowered
from .program import NarrowCondition, TimeFunction, TimeFunctions
from .tape import operands_first

# Other operations leave functions of time moving everywhere as fast as they ever do, or at places that are instants: sums and products of
# those have no narrow peaks that a look at many places could miss.
NARROWING = frozenset(row.name for row in OPERATORS.values() if not row.broad)
FLAT = frozenset({"sqrt", "root", "asin", "acos", "asinh"})  # of these, a polynomial sees a dip as it sees a kink


def time_roots(crossings: Sequence[Expression]) -> tuple[Expression, ...]:
    """Functions of time whose zeros are instants, each followed by its derivative, or by itself if it has none."""
    time = Symbol(Leaf("time", 0))
    roots: list[Expression] = []
    for root in crossings:
        try:
            slope = derivative(root, time)
        except NotDifferentiable:
            slope = root
        roots += root, slope
    return tuple(roots)


def narrow_operations(signals: Iterable[Expression], moves: Callable[[Expression], bool]) -> tuple[Expression, ...]:
    """Operations behind signals that may have narrow peaks. `moves` returns True for an expression that changes with time.

    Besides operations that are narrow themselves these are all that join a narrow one with another, or fold it: `1 - tanh(u)^2` and
    `tanh(u) - tanh(u - 4)` are peaks between places at which each tanh shows its whole range.
    """
    result: dict[Expression, None] = {}
    narrow: set[Expression] = set()  # these, and what follows them in proportion
    for node in operands_first(tuple(signals), {}):
        if not isinstance(node, Apply) or not moves(node):
            continue
        joins = any(operand in narrow for operand in node.operands)
        if is_narrow(node) or joins:
            narrow.add(node)
        follows = node.operator in ("add", "multiply", "divide") and sum(map(moves, node.operands)) == 1
        if is_narrow(node) or (joins and not follows):
            result[node] = None
    return tuple(result)


def is_narrow(node: Apply) -> bool:
    """Return True for an operation that may move much faster than its operands."""
    return node.operator in NARROWING and not _is_broad(node)


def _is_broad(node: Apply) -> bool:
    """Return True for a power of low degree, or a quotient by a number of the run."""
    if node.operator == "power":
        n = node.operands[1]
        return isinstance(n, Number) and n.value in (2.0, 3.0, 4.0)
    return node.operator == "divide" and all(s.key.role == "parameter" for s in symbols(node.operands[1]))


def narrow_conditions(lowered: Lowered) -> tuple[tuple[int, Expression, tuple[Expression, ...]], ...]:
    """Located conditions that may have narrow peaks: number, indicator and narrow operations, which are none where there is no range."""

    def moves(x: Expression) -> bool:
        return bool(lowered.dependence(x) & (STATE | TIME))

    def may_be_narrow(x: Apply) -> bool:
        return is_narrow(x) and moves(x) and x.operator not in FLAT and (x.operator != "divide" or moves(x.operands[1]))

    found = []
    for number, item in enumerate(lowered.events.located):
        narrow = tuple(dict.fromkeys(filter(may_be_narrow, operations(item.root))))
        if narrow:
            ranged = not any(x.operator in SYSTEMS or x.operator == "item" for x in operations(item.root))
            delayed = any(s.key.role == "input" and lowered.dependence(s) & STATE for s in symbols(item.root))
            found.append((number, item.root, narrow if ranged and not delayed else ()))
    return tuple(found)


def time_functions_of(lowered: Lowered, constants: Sequence[Expression]) -> TimeFunctions | None:
    """Functions of time of a program whose constants are these expressions; None if it has none."""
    conditions = narrow_conditions(lowered)
    indicators = [item.root for item in lowered.events.located]
    ranged = [x for _, root, narrow in conditions if narrow for x in (root, *narrow)]
    roots = (*lowered.time_roots, *ranged, *indicators)
    if not roots:
        return None
    leaves: dict[Expression, int] = {node: number for number, node in enumerate(constants)}
    places: dict[Expression, int] = {}
    nodes: list[tuple[str, tuple[Any, ...]]] = []

    def put(operator: str, operands: tuple[Any, ...]) -> int:
        nodes.append((operator, operands))
        return len(nodes) - 1

    for node in operands_first(roots, leaves):
        places[node] = _put(node, leaves, places, put)
    for node in roots:
        if node not in places:
            places[node] = put("constant", (leaves[node],))
    count = 2 * len(lowered.crossings)
    functions = []
    pairs = zip(lowered.time_roots[:count:2], lowered.time_roots[1:count:2], strict=True)
    for (root, slope), (owner, span, condition) in zip(pairs, lowered.crossing_places, strict=True):
        moded = bool((lowered.dependence(root) | lowered.dependence(slope)) & MODE)
        functions.append(
            TimeFunction(places[root], places[slope] if slope is not root else -1, moded, condition, owner, span)
        )
    narrow_ones = tuple(
        NarrowCondition(number, places[root] if narrow else -1, tuple(places[x] for x in narrow))
        for number, root, narrow in conditions
    )
    narrow = lowered.time_roots[count:]
    names = _names_of(narrow, lowered) if narrow else ()
    return TimeFunctions(
        tuple(nodes), tuple(functions), tuple(places[n] for n in narrow), narrow_ones, names, tuple(places[x] for x in indicators)
    )  # fmt: skip


def constants_of_signals(lowered: Lowered, constants: Sequence[Expression]) -> tuple[int, ...]:
    """Positions of the constants that the signals of a program read; with equal ones the signals are equal."""
    places = {node: number for number, node in enumerate(constants)}
    nodes = operands_first(lowered.signals, places)
    operands = (o for node in nodes if isinstance(node, Apply) for o in node.operands)
    return tuple(sorted({places[o] for o in (*lowered.signals, *operands) if o in places}))


def _names_of(narrow: Sequence[Expression], lowered: Lowered) -> tuple[str, ...]:
    """Name, for each operation, of the innermost named quantity among the signals that it is part of."""
    names: dict[Expression, str] = {}
    stack = [(signal, "a signal of time") for signal in lowered.signals]
    while stack:
        node, name = stack.pop()
        if node in names or not isinstance(node, Apply):
            continue
        label = lowered.labels.get(node)
        names[node] = name = name if label is None else f"`{label.name}`"
        stack += ((operand, name) for operand in node.operands)
    return tuple(names.get(node, "a signal of time") for node in narrow)


def _put(
    node: Expression,
    leaves: Mapping[Expression, int],
    places: dict[Expression, int],
    put: Callable[[str, tuple[float, ...]], int],
) -> int:
    if isinstance(node, Number):
        return int(put("number", (node.value,)))
    if isinstance(node, Symbol):
        return int(put(node.key.role, () if node.key.role == "time" else (node.key.position,)))
    assert isinstance(node, Apply)
    for operand in node.operands:
        if operand in leaves and operand not in places:
            places[operand] = put("constant", (leaves[operand],))
    return int(put(node.operator, tuple(places[o] for o in node.operands)))
