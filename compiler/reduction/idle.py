"""Coordinates that move no inertia, not even through closing joints, found numerically at the start of a mechanism.

The matrix of multipliers and balances is eliminated, multipliers first. The remaining pivot of a coordinate with a fictitious inertia is
minus the share that the mechanism's own inertias have in its motion; if that is only rounding, nothing moves.
"""

from __future__ import annotations

from ..errors import CompilationFailed
from .slopes import slopes_at_start
from .state_space import StateSpace

DEPENDENT = 1e-9  # of its own diagonal: a pivot of a constraint that follows from others
NOTHING = 1e-13  # share of its own inertias in a coordinate's motion: rounding of some hundred products
LARGEST = 150  # multipliers and balances that are looked at; else a run shows it

Matrix = list[list[float]]


def refuse_idle_coordinates(space: StateSpace) -> None:
    """Raise `CompilationFailed` for balances that no inertia determines."""
    bound = [i.multiplier for i in space.invariants if i.multiplier is not None]
    places = [*bound, *(b.variable for b in space.balances)]
    if not space.balances or len(places) > LARGEST:
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
