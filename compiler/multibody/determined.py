"""Numerical check that every coordinate moves some inertia, in one pose, with the values of this scene.

It compares the articulated inertia along a coordinate (with all joints further outwards free) to the inertia with these joints fixed.
If the first is only rounding, other coordinates make the same motion: two hinges in line with nothing between, a body without inertia
about its axis of rotation. Zeros that fold are found earlier (`recursion.py`).

Within a closed loop this is no error: such a coordinate moves inertia through the closing joint. It then gets a fictitious inertia, which
an unknown effort cancels (`massless.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..algebra.expression import Expression
from ..fast_dataclass import dataclass
from .assignment_emitter import AssignmentEmitter
from .fictitious_inertia import FictitiousInertia
from .kinematics import Kinematics
from .link_state import LinkState
from .recursion import PLACES, Recursion
from .values import SampleValues
from .vectors import UNIT

NOTHING = 1e-13  # relative to the inertia with the joints outwards fixed: rounding of some hundred products
Square = list[list[float]]
Place = tuple[int, int]  # a link, and the number of one of its coordinates


@dataclass(frozen=True, slots=True)
class Survey:
    """Coordinates with a fictitious inertia, its value, and the first coordinate that moves no inertia."""

    lent: Mapping[Place, float]
    lost: tuple[LinkState, int] | None


def survey(kinematics: Kinematics, recursion: Recursion, around: Mapping[int, FictitiousInertia]) -> Survey:
    """Check the inertia along all coordinates. `around`: for each link within a closed loop, its fictitious inertias."""
    values = SampleValues(kinematics.script, kinematics.length)
    count = len(kinematics.moving)
    free = [[[values.of(x) for x in row] for row in recursion.own_matrix(m)] for m in kinematics.moving]  # fmt: skip
    held = [[list(row) for row in rows] for rows in free]
    own = [[list(row) for row in rows] for rows in free]
    lent: dict[Place, float] = {}
    for index in reversed(range(count)):
        moving = kinematics.moving[index]
        matrix, whole = free[index], held[index]
        for number, pair in enumerate(moving.columns):
            coordinate = moving.coordinates[number] if number < len(moving.coordinates) else None
            if coordinate is not None and (coordinate.driven or coordinate.target is None):
                continue
            column = [values.of(x) for x in (*pair[0], *pair[1])]
            push = _times(matrix, column)
            inertia, scale = _along(column, push), _along(column, _times(whole, column))
            if index in around:
                itself = _along(column, _times(own[index], column)) if moving.link.bodies else scale
                if min(itself, inertia) <= NOTHING * scale:
                    lent[index, number] = around[index].of(any(column[:3]))
                    inertia += lent[index, number]
            if inertia <= NOTHING * scale:
                return Survey(lent, (moving, number))
            for r in PLACES:
                for c in PLACES:
                    matrix[r][c] -= push[r] * push[c] / inertia
        if moving.parent is not None:
            carried = _carried(values, moving)
            for rows, to in ((matrix, free[moving.parent]), (whole, held[moving.parent])):
                _add(to, rows, carried)
    return Survey(lent, None)


def _along(column: Sequence[float], push: Sequence[float]) -> float:
    return sum(a * b for a, b in zip(column, push, strict=True))


def _times(rows: Square, v: Sequence[float]) -> list[float]:
    return [sum(a * b for a, b in zip(row, v, strict=True)) for row in rows]


def _carried(values: SampleValues, moving: LinkState) -> Square:
    """Motion of a link for each of the six motions of its parent; columns."""
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


class _Unwritten(AssignmentEmitter):
    """Expressions without names: they are not part of the equations."""

    def __init__(self, script: AssignmentEmitter) -> None:
        self.builder, self.owner, self.span = script.builder, script.owner, script.span

    def let(self, name: str, expression: Expression, unit: str = "") -> Expression:
        return expression
