"""Loops that have strokes but no solution with the values of this run: a gain of exactly 1, storages whose sum is zero.

Values fixed by the scene are used as they are; values that a run may change are sampled at random several times: only a loop that is
singular for all samples is refused. Each number has a bound of its rounding errors (a running error analysis, Wilkinson 1986), to
distinguish cancellation from small values.

Refused are also coordinates that move no inertia, not even through closing joints, found numerically at the start of a mechanism. The matrix of
multipliers and balances is eliminated, multipliers first. The remaining pivot of a coordinate with a fictitious inertia is minus the share that the
mechanism's own inertias have in its motion; if that is only rounding, nothing moves.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import field, replace
from typing import NamedTuple

from ..algebra.expression import Apply, Expression, Number, Symbol
from ..algebra.operators import value_of
from ..equations.system import Assignment, EquationSystem
from ..errors import CompilationFailed
from ..fast_dataclass import dataclass
from .errors import SingularField, SingularLoop
from .slopes import slopes_at_start
from .state_space import Entry, LinearLoop, StateSpace

ROUNDING = 5e-15  # remainder of terms that cancel
LARGEST = 60  # unknowns of a loop that is looked at; a larger one shows at the start of its run
SAMPLES = 6  # a loop that is singular in all of them is taken to be so always
DECADES = (-6.0, 3.0)

Operation = float | tuple[str, tuple[int, ...]]
DEPENDENT = 1e-9  # of its own diagonal: a pivot of a constraint that follows from others
NOTHING = 1e-13  # share of its own inertias in a coordinate's motion: rounding of some hundred products
MOST_BALANCES = 150  # multipliers and balances that are looked at; else a run shows it

Matrix = list[list[float]]


class Sized(NamedTuple):
    """A value, and a measure of its rounding errors in units of the last place of 1: the size of the terms of a sum."""

    value: float
    size: float

    @property
    def is_zero(self) -> bool:
        return math.isfinite(self.size) and abs(self.value) <= ROUNDING * self.size


@dataclass(frozen=True, slots=True, eq=False)
class LinearLoops:
    """Linear loops of a reduced system, and the operations behind their matrices, in order, equal ones once.

    An operation is a number, or an operator and the places of its operands before it; one without an operator is a variable that no assignment gives.
    """

    space: StateSpace
    loops: tuple[LinearLoop, ...]
    operations: tuple[Operation, ...]
    places: Mapping[int, int]  # of variables among the operations
    explicit: frozenset[int]  # targets of explicit assignments
    free: frozenset[str]  # parameters that may take other values ("*": all may)
    # of a sample: values of the operations that settings do not move, and the places of the others
    kept: dict[object, tuple[list[Sized | None], list[int]]] = field(default_factory=dict)


def linear_loops(space: StateSpace, system: EquationSystem, free: frozenset[str]) -> LinearLoops:
    """Return the loops of `space`, the reduced `system`, that are looked at. `free` parameters may take other values ("*": all may)."""
    loops = tuple(s for s in space.steps if isinstance(s, LinearLoop) and len(s.targets) <= LARGEST)
    explicit = frozenset(a.target for a in system.assignments if not a.implicit) if loops else frozenset()
    return LinearLoops(space, loops, *_behind(space, loops), explicit, free)


def refuse_singular_loops(linear: LinearLoops, values: Mapping[str, float] | None = None) -> None:
    """Raise `CompilationFailed` for loops without a unique solution. `values`: of quantities set when a run begins, by name."""
    loops, singular, space = [*linear.loops], set(), linear.space
    for sample in range(SAMPLES if loops else 0):
        known = _evaluated(linear, sample, values or {})
        for loop in [*loops]:
            matrix = _matrix(loop, known, linear.explicit)
            if matrix is not None and not _is_singular(matrix):
                loops.remove(loop)
                singular.discard(loop)
            elif matrix is not None:
                singular.add(loop)
        if not loops:
            return
    if singular:
        if values:
            space = replace(
                space, variables=tuple(replace(v, value=values.get(v.name, v.value)) for v in space.variables)
            )
        kinds = {x: SingularField if space.is_field(x.members) else SingularLoop for x in loops}
        raise CompilationFailed([kinds[x](x.span, _members(space, x)) for x in loops if x in singular])


def _behind(space: StateSpace, loops: Sequence[LinearLoop]) -> tuple[tuple[Operation, ...], Mapping[int, int]]:
    """Operations needed for the matrices of the loops, and the places of variables. Solutions of loops count as variables that no assignment gives."""
    wanted = {e for loop in loops for e in loop.gains}
    steps = []
    for step in reversed(space.steps) if loops else ():
        if isinstance(step, Assignment) and step.target in wanted:
            steps.append(step)
            wanted.remove(step.target)
            wanted |= {a for a in step.arguments if not isinstance(a, float)}
    operations: dict[Operation, int] = {}

    def place(operation: Operation) -> int:
        return operations.setdefault(operation, len(operations))

    def place_of(x: Expression, arguments: Sequence[int]) -> int:
        if isinstance(x, Number):
            return place(x.value)
        if isinstance(x, Symbol):
            assert isinstance(x.key, int)
            return arguments[x.key]
        assert isinstance(x, Apply)
        return place((x.operator, tuple(place_of(o, arguments) for o in x.operands)))

    places = {variable: place(("", (variable,))) for variable in sorted(wanted)}
    for step in reversed(steps):
        arguments = [place(a) if isinstance(a, float) else places[a] for a in step.arguments]
        places[step.target] = place_of(step.formula.expression, arguments)
    return tuple(operations), places


def _guess(sample: int, variable: int) -> Sized:
    """Random value for a quantity that a run may change (time, states, inputs), different in each sample."""
    source = random.Random(f"{sample} {variable}")
    value = source.choice((-1, 1)) * 10 ** source.uniform(*DECADES)
    return Sized(value, abs(value))


def _evaluated(linear: LinearLoops, sample: int, values: Mapping[str, float]) -> Mapping[int, Sized | None]:
    """Values of variables in a sample. Only what settings move is computed anew for others."""
    key = sample, *values
    if key not in linear.kept:
        linear.kept[key] = _without(linear, sample, values)
    kept, moved = linear.kept[key]
    known = kept.copy()
    for place in moved:
        operation = linear.operations[place]
        if isinstance(operation, tuple) and not operation[0]:
            value = values[linear.space.variables[operation[1][0]].name]
            known[place] = Sized(value, abs(value))
        else:
            known[place] = _value(operation, known)
    return {variable: known[place] for variable, place in linear.places.items()}


def _without(linear: LinearLoops, sample: int, values: Mapping[str, float]) -> tuple[list[Sized | None], list[int]]:
    """Values of the operations that settings of these names do not move, and the places of the others."""
    known: list[Sized | None] = []
    moved: dict[int, None] = {}
    for place, operation in enumerate(linear.operations):
        sized = None
        if isinstance(operation, tuple) and not operation[0]:
            number = operation[1][0]
            variable = linear.space.variables[number]
            fixed = variable.role == "parameter" and not {variable.name, "*"} & linear.free
            if fixed and variable.name in values:
                moved[place] = None
            elif fixed and variable.value is not None:
                sized = Sized(variable.value, abs(variable.value))
            else:
                sized = _guess(sample, number)
        elif isinstance(operation, tuple) and any(o in moved for o in operation[1]):
            moved[place] = None
        else:
            sized = _value(operation, known)
        known.append(sized)
    return known, [*moved]


def behind_loops(space: StateSpace) -> frozenset[str]:
    """Parameters that the matrices of linear loops depend on."""
    read = _sources(space, (e for step in space.steps if isinstance(step, LinearLoop) for e in step.gains))
    return frozenset(space.variables[v].name for v in read if space.variables[v].role == "parameter")


def _sources(space: StateSpace, variables: Iterable[int]) -> list[int]:
    """Some variables, and those that they are computed from by assignments alone."""
    steps = {s.target: s for s in space.steps if not isinstance(s, LinearLoop)}
    waiting = list(variables)
    reached = set(waiting)
    for number in waiting:  # grows
        for argument in steps[number].arguments if number in steps else ():
            if not isinstance(argument, float) and argument not in reached:
                reached.add(argument)
                waiting.append(argument)
    return waiting


def _members(space: StateSpace, loop: LinearLoop) -> str:
    """Elements of a loop, and the parameters that its matrix depends on."""
    values = []
    for number in _sources(space, loop.gains):
        variable = space.variables[number]
        if variable.role == "parameter" and variable.value is not None:
            unit = "" if variable.unit in ("", "1") else f" [{variable.unit}]"
            values.append(f"`{variable.name} = {variable.value:g}{unit}`")
    named = ", ".join(f"`{m}`" for m in loop.members[:8]) + ("…" if len(loop.members) > 8 else "")
    return f"{named} (at {', '.join(values[:4])})" if values else named


def _matrix(loop: LinearLoop, known: Mapping[int, Sized | None], explicit: Set[int]) -> list[list[Sized]] | None:
    """Numbers of a loop's matrix; None if one is unknown. The diagonal has 1 minus a gain, perhaps folded to one number."""
    matrix: list[list[Sized]] = []
    for i, row in enumerate(loop.matrix):
        matrix.append([])
        for j, entry in enumerate(row):
            found = _entry(entry, known)
            if found is None:
                return None
            size = 1 + abs(1 - found.value) if i == j and loop.targets[i] in explicit else 0.0
            matrix[i].append(Sized(found.value, max(size, found.size)))
    return matrix


def _entry(entry: Entry, known: Mapping[int, Sized | None]) -> Sized | None:
    return Sized(entry, abs(entry)) if isinstance(entry, float) else known.get(entry)


def _value(operation: Operation, known: Sequence[Sized | None]) -> Sized | None:
    """Value of an operation; None if an operand is unknown, or if there is no value."""
    if isinstance(operation, float):
        return Sized(operation, abs(operation))
    operator, operands = operation
    parts = [part for o in operands if (part := known[o]) is not None]
    if operator == "select":  # the branch not taken may have no value
        condition = known[operands[0]]
        taken = None if condition is None else known[operands[1] if condition.value else operands[2]]
        return None if taken is None else Sized(taken.value, abs(taken.value))
    if len(parts) < len(operands):
        return None
    try:
        value = value_of(operator, [p.value for p in parts])
        return Sized(value, _SIZES.get(operator, _size_of_value)(parts, value))
    except (ArithmeticError, ValueError):
        return None


def _size_of_sum(parts: list[Sized], value: float) -> float:
    return sum(p.size for p in parts)


def _size_of_product(parts: list[Sized], value: float) -> float:
    """Error of a product. Relative errors add up; a factor of zero leaves its error times the others."""
    total = abs(value)
    for i, part in enumerate(parts):
        total += part.size * math.prod(abs(p.value) for j, p in enumerate(parts) if j != i)
    return total


def _size_of_quotient(parts: list[Sized], value: float) -> float:
    above, below = parts
    return abs(value) + (above.size + abs(value) * below.size) / abs(below.value)


def _size_of_value(parts: list[Sized], value: float) -> float:
    """Error of a function that is nowhere steep."""
    return abs(value) * (1 + sum(p.size / abs(p.value) for p in parts if p.value))


_SIZES: Mapping[str, Callable[[list[Sized], float], float]] = {
    "add": _size_of_sum, "multiply": _size_of_product, "divide": _size_of_quotient,
}  # fmt: skip


def _is_singular(rows: list[list[Sized]]) -> bool:
    """Return True if elimination, with the best pivot of each row, gives a row of zeros."""
    rows = [list(row) for row in rows]
    while rows:
        best = max(rows, key=_pivot_of)
        column = max(range(len(best)), key=lambda j: 0.0 if best[j].is_zero else abs(best[j].value))
        pivot = best[column]
        if pivot.is_zero:
            return True
        rest = []
        for row in rows:
            if row is best:
                continue
            value = row[column].value / pivot.value
            factor = Sized(-value, _size_of_quotient([row[column], pivot], value))
            pairs = [pair for j, pair in enumerate(zip(row, best, strict=True)) if j != column]
            rest.append([_less(x, factor, y) for x, y in pairs])
        rows = rest
    return False


def _less(x: Sized, factor: Sized, y: Sized) -> Sized:
    """x + factor*y."""
    product = factor.value * y.value
    return Sized(x.value + product, x.size + _size_of_product([factor, y], product))


def _pivot_of(row: list[Sized]) -> float:
    """Size of the largest entry of a row, relative to the terms from which the row was summed."""
    size = max((x.size for x in row), default=0.0)
    return max((abs(x.value) / size for x in row if not x.is_zero), default=0.0) if size else 0.0


def refuse_idle_coordinates(space: StateSpace) -> None:
    """Raise `CompilationFailed` for balances that no inertia determines."""
    bound = [i.multiplier for i in space.invariants if i.multiplier is not None]
    places = [*bound, *(b.variable for b in space.balances)]
    if not space.balances or len(places) > MOST_BALANCES:
        return
    unknowns = {u.variable: u for u in space.unknowns}
    chosen = [unknowns[v] for v in places]
    rows = slopes_at_start(space, [u.residual for u in chosen], chosen)
    if rows is None:
        return
    matrix = [[row.get(v, 0.0) for v in places] for row in rows]
    multipliers = list(range(len(bound)))
    own = [matrix[i][i] or 1.0 for i in multipliers]
    while multipliers:
        best = max(multipliers, key=lambda i: matrix[i][i] / own[i])
        if matrix[best][best] <= DEPENDENT * own[best]:
            break
        _eliminate(matrix, best)
        multipliers.remove(best)
    left = list(range(len(bound), len(places)))
    while left:
        best = min(left, key=lambda i: matrix[i][i])
        if matrix[best][best] >= -NOTHING:
            raise CompilationFailed([space.balances[min(left) - len(bound)].told])
        _eliminate(matrix, best)
        left.remove(best)


def _eliminate(matrix: Matrix, k: int) -> None:
    pivot = matrix[k]
    for i, row in enumerate(matrix):
        factor = row[k] / pivot[k]
        if i != k and factor:
            for j, x in enumerate(pivot):
                row[j] -= factor * x
            row[k] = 0.0
