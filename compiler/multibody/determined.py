"""Whether something with mass moves along every coordinate: by numbers, in some pose, with the values of this scene.

The articulated inertia along a coordinate (all that hangs on it free) against that with all joints outside of it held. Where the
first is nothing but rounding, the motion is made up by others: two hinges in line with nothing between, a body without inertia about
the axis that it turns about. Zeros that fold show earlier (`recursion.py`).
"""

from __future__ import annotations

from collections.abc import Sequence

from ..algebra.expression import Expression, Number, evaluate, symbols
from .kinematics import Kinematics
from .moving import Moving
from .recursion import PLACES, Recursion
from .script import Script
from .vectors import UNIT

NOTHING = 1e-13  # of the inertia with the rest held
Square = list[list[float]]


class Values:
    """Numbers for expressions: parameters as they are in this scene, states anywhere."""

    def __init__(self, script: Script) -> None:
        self.script = script
        self.known: dict[int, float] = {}

    def of(self, x: Expression) -> float:
        """The value of an expression."""
        if isinstance(x, Number):
            return x.value
        self._find([s.key for s in symbols(x)])
        return evaluate(x, self.known.__getitem__)

    def _find(self, wanted: list[int]) -> None:
        while wanted:  # not by recursion: angles of a long chain are sums of sums
            variable = wanted[-1]
            if variable not in self.known:
                definition = self.script.builder.definition(variable)
                missing: list[int] = []
                if isinstance(definition, Expression):
                    missing = [s.key for s in symbols(definition) if s.key not in self.known]
                    if not missing:
                        self.known[variable] = evaluate(definition, self.known.__getitem__)
                else:  # a state: some number that no other has
                    anything = 0.2 + 0.6180339887498949 * (variable + 1) % 1.0
                    self.known[variable] = anything if definition is None else definition
                if missing:
                    wanted += missing
                    continue
            wanted.pop()


def undetermined(kinematics: Kinematics, recursion: Recursion) -> tuple[Moving, int] | None:
    """A link and the number of a coordinate along which nothing moves, if there is one."""
    values = Values(kinematics.script)
    count = len(kinematics.moving)
    free = [[[values.of(x) for x in row] for row in recursion.inertias[i].matrix(m.branch.active)] for i, m in enumerate(kinematics.moving)]  # fmt: skip
    held = [[list(row) for row in rows] for rows in free]
    for index in reversed(range(count)):
        moving = kinematics.moving[index]
        matrix, whole = free[index], held[index]
        for number, pair in enumerate(moving.columns):
            coordinate = moving.coordinates[number] if number < len(moving.coordinates) else None
            if coordinate is not None and (coordinate.driven or coordinate.target is None):
                continue
            column = [values.of(x) for x in (*pair[0], *pair[1])]
            push = _times(matrix, column)
            inertia = sum(a * b for a, b in zip(column, push, strict=True))
            scale = sum(a * b for a, b in zip(column, _times(whole, column), strict=True))
            if inertia <= NOTHING * scale:
                return moving, number
            for r in PLACES:
                for c in PLACES:
                    matrix[r][c] -= push[r] * push[c] / inertia
        if moving.parent is not None:
            carried = _carried(values, moving)
            for rows, to in ((matrix, free[moving.parent]), (whole, held[moving.parent])):
                _add(to, rows, carried)
    return None


def _times(rows: Square, v: Sequence[float]) -> list[float]:
    return [sum(a * b for a, b in zip(row, v, strict=True)) for row in rows]


def _carried(values: Values, moving: Moving) -> Square:
    """The motion of a link that each of its parent's six motions gives it; columns."""
    script = _Unwritten(values.script)
    arm = [values.of(x) for x in moving.shift]
    back = [[values.of(x) for x in moving.back(script, axis, "")] for axis in UNIT]  # the parent's axes, in own ones
    columns: Square = []
    for k in range(3):
        swept = [0.0, 0.0, 0.0]  # axis x arm
        swept[(k + 1) % 3], swept[(k + 2) % 3] = -arm[(k + 2) % 3], arm[(k + 1) % 3]
        columns.append([*back[k], *(sum(swept[j] * back[j][i] for j in range(3)) for i in range(3))])
    return [*columns, *([0.0, 0.0, 0.0, *back[k]] for k in range(3))]


def _add(to: Square, rows: Square, columns: Square) -> None:
    half = [_times(rows, column) for column in columns]
    for r in PLACES:
        for c in PLACES:
            to[r][c] += sum(a * b for a, b in zip(columns[r], half[c], strict=True))


class _Unwritten(Script):
    """Expressions without names: nothing of this comes into the equations."""

    def __init__(self, script: Script) -> None:
        self.builder, self.owner, self.span = script.builder, script.owner, script.span

    def let(self, name: str, expression: Expression, unit: str = "") -> Expression:
        return expression
