"""Mobility: number of motions that closing joints leave to a mechanism, in the position of the drawing, before a run.

The Jacobian of the constraint residuals by the states is numeric there (`slopes.py`). Elimination with full pivoting
gives its rank, and the dependent rows.
"""

from __future__ import annotations

from .slopes import Slopes, slopes_at_start
from .state_space import StateSpace

SMALL = 1e-9  # share of the largest slope of its unit: remainder of dependent rows
LARGEST = 200  # gaps that are looked at


def redundant_constraints(space: StateSpace) -> tuple[str, ...] | None:
    """Constraints that depend on others in the position of the drawing; None if that cannot be computed before a run."""
    bound = [i for i in space.invariants if i.multiplier is not None]
    places = [i.position for i in bound if i.position is not None]  # rows of rates alone come last
    if not 0 < len(bound) <= LARGEST:
        return () if not bound else None
    rows = slopes_at_start(space, places, space.states)
    if rows is None:
        return None
    units = [space.variables[p].unit for p in places]
    for unit in set(units):
        largest = max(
            (abs(x) for row, u in zip(rows, units, strict=True) if u == unit for x in row.values()), default=0.0
        )
        for row, u in zip(rows, units, strict=True):
            if u == unit and largest > 0:
                for state in row:
                    row[state] /= largest
    return tuple(bound[i].name for i in sorted(_dependent(rows)))


def _dependent(rows: list[Slopes]) -> set[int]:
    """Rows that elimination reduces to zero."""
    left = {i: dict(row) for i, row in enumerate(rows)}
    while left:
        best = max(left, key=lambda i: max(map(abs, left[i].values()), default=0.0))
        row = left[best]
        column = max(row, key=lambda c: abs(row[c]), default=-1)
        if column < 0 or abs(row[column]) <= SMALL:
            break
        del left[best]
        for other in left.values():
            if column in other:
                factor = other.pop(column) / row[column]
                for c, x in row.items():
                    if c != column:
                        other[c] = other.get(c, 0.0) - factor * x
    return set(left)
