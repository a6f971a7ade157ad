"""How many motions closing joints leave a mechanism, told where it was drawn, before anything is run.

The slopes of the gaps by the states are numbers there (`slopes.py`); elimination with the best pivot of all that is
left gives their rank, and the rows that bring nothing new.
"""

from __future__ import annotations

from .slopes import Slopes, slopes_at_start
from .state_space import StateSpace

SMALL = 1e-9  # share of the largest slope of its unit: what is left of rows that follow from others
LARGEST = 200  # gaps that are looked at


def redundant_constraints(space: StateSpace) -> tuple[str, ...] | None:
    """The constraints that follow from others where the mechanism was drawn; None if that cannot be told before a run."""
    bound = [i for i in space.invariants if i.multiplier is not None]
    if not 0 < len(bound) <= LARGEST:
        return () if not bound else None
    rows = slopes_at_start(space, [i.position for i in bound], space.states)
    if rows is None:
        return None
    units = [space.variables[i.position].unit for i in bound]
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
    """The rows that elimination leaves nothing of."""
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
