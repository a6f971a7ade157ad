"""Loops that have strokes but no solution at the values of this run: a gain of exactly 1, storages that sum to nothing.

Only what is known before the run is looked at: loops whose matrix depends on parameters that this scene fixes. Each number is
carried with the size of what it was summed from, so that what cancels is told from what is small.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence, Set
from typing import NamedTuple

from ..algebra.expression import Apply, Expression, Number, Symbol, evaluate, value_of
from ..equations.system import EquationSystem
from ..errors import CompilationFailed
from .errors import SingularLoop
from .state_space import Entry, LinearLoop, StateSpace

ROUNDING = 5e-15  # what is left of terms that cancel
LARGEST = 60  # unknowns of a loop that is looked at; a larger one shows at the start of its run


class Sized(NamedTuple):
    """A value, and the size of the terms that it was summed from."""

    value: float
    size: float

    @property
    def is_zero(self) -> bool:
        return math.isfinite(self.size) and abs(self.value) <= ROUNDING * self.size


def refuse_singular_loops(space: StateSpace, system: EquationSystem, free: frozenset[str]) -> None:
    """Raises `CompilationFailed` for loops of `space` (what `system` was reduced to) without a unique solution.

    `free` parameters may take other values ("*": all may).
    """
    if not any(isinstance(step, LinearLoop) for step in space.steps):
        return
    found = []
    explicit = {a.target for a in system.assignments if not a.implicit}
    known: dict[int, Sized] = {}
    for number, variable in enumerate(space.variables):
        if variable.role == "parameter" and variable.value is not None and not {variable.name, "*"} & free:
            known[number] = Sized(variable.value, abs(variable.value))
    for step in space.steps:
        if not isinstance(step, LinearLoop):
            arguments = [_entry(a, known) for a in step.arguments]
            value = _value(step.formula.expression, arguments)
            if value is not None:
                known[step.target] = value
        elif len(step.targets) <= LARGEST:
            matrix = _matrix(step, known, explicit)
            if matrix is not None and _is_singular(matrix):
                found.append(SingularLoop(step.span, _members(space, step)))
    if found:
        raise CompilationFailed(found)


def behind_loops(space: StateSpace) -> frozenset[str]:
    """The parameters that the matrices of linear loops depend on."""
    steps = {s.target: s for s in space.steps if not isinstance(s, LinearLoop)}
    loops = [s for s in space.steps if isinstance(s, LinearLoop)]
    work = [e for loop in loops for row in loop.matrix for e in row if not isinstance(e, float)]
    seen = set(work)
    for number in work:  # grows
        for argument in steps[number].arguments if number in steps else ():
            if not isinstance(argument, float) and argument not in seen:
                seen.add(argument)
                work.append(argument)
    return frozenset(space.variables[v].name for v in seen if space.variables[v].role == "parameter")


def _members(space: StateSpace, loop: LinearLoop) -> str:
    """The elements of a loop, and the parameters that its matrix depends on."""
    steps = {s.target: s for s in space.steps if not isinstance(s, LinearLoop)}
    work = [e for row in loop.matrix for e in row if not isinstance(e, float)]
    seen, values = set(work), []
    for number in work:  # grows
        variable = space.variables[number]
        if variable.role == "parameter" and variable.value is not None:
            unit = "" if variable.unit in ("", "1") else f" [{variable.unit}]"
            values.append(f"`{variable.name} = {variable.value:g}{unit}`")
        for argument in steps[number].arguments if number in steps else ():
            if not isinstance(argument, float) and argument not in seen:
                seen.add(argument)
                work.append(argument)
    named = ", ".join(f"`{m}`" for m in loop.members[:8]) + ("…" if len(loop.members) > 8 else "")
    return f"{named} (at {', '.join(values[:4])})" if values else named


def _matrix(loop: LinearLoop, known: Mapping[int, Sized], explicit: Set[int]) -> list[list[Sized]] | None:
    """The numbers of a loop; None if one is not known. On the diagonal stands 1 less a gain, perhaps folded to one number."""
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


def _entry(entry: Entry, known: Mapping[int, Sized]) -> Sized | None:
    return Sized(entry, abs(entry)) if isinstance(entry, float) else known.get(entry)


def _value(expression: Expression, arguments: Sequence[Sized | None]) -> Sized | None:
    """The value of a formula for its arguments; None if one is not known, or if there is no value."""
    known = [a for a in arguments if a is not None]
    if len(known) < len(arguments):
        return None
    try:
        return _sized(expression, known)
    except (ArithmeticError, ValueError):
        return None


def _sized(x: Expression, known: Sequence[Sized]) -> Sized:
    if isinstance(x, Number):
        return Sized(x.value, abs(x.value))
    if isinstance(x, Symbol):
        assert isinstance(x.key, int)
        return known[x.key]
    assert isinstance(x, Apply)
    if x.operator == "select":
        value = evaluate(x, lambda key: known[key].value)
        return Sized(value, abs(value))
    parts = [_sized(o, known) for o in x.operands]
    value = value_of(x.operator, [p.value for p in parts])
    return Sized(value, _SIZES[x.operator](parts) if x.operator in _SIZES else abs(value))


def _product(parts: list[Sized]) -> float:
    size = 1.0
    for part in parts:
        size *= part.size
    return size


_SIZES: Mapping[str, Callable[[list[Sized]], float]] = {
    "add": lambda parts: sum(p.size for p in parts),
    "multiply": _product,
    "divide": lambda parts: parts[0].size * parts[1].size / parts[1].value ** 2,
}


def _is_singular(rows: list[list[Sized]]) -> bool:
    """Whether elimination, with the best pivot of each row, comes to a row of nothing."""
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
            factor = row[column].value / pivot.value
            size = row[column].size * pivot.size / pivot.value**2
            rest.append(
                [
                    Sized(x.value - factor * y.value, x.size + size * y.size)
                    for j, (x, y) in enumerate(zip(row, best, strict=True))
                    if j != column
                ]
            )
        rows = rest
    return False


def _pivot_of(row: list[Sized]) -> float:
    """How large the largest entry of a row is, as a share of what the row was summed from."""
    size = max((x.size for x in row), default=0.0)
    return max((abs(x.value) / size for x in row if not x.is_zero), default=0.0) if size else 0.0
