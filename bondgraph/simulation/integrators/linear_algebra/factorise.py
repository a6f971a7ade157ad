"""Factorisations of mu/h M - J by LAPACK and SuperLU, rows scaled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array, BoolArray, IntArray

DENSE = 100  # states up to which the linear algebra is dense


@dataclass(frozen=True, slots=True)
class Factorised:
    """A factorised matrix: the function from right-hand sides to solutions; `negative`: a real matrix has a negative determinant."""

    solve: Callable[[Array], Any]
    negative: bool = False


def is_large(states: int, entries: int) -> bool:
    """Return True if a Jacobian is better treated as sparse."""
    return states > DENSE and entries < 0.2 * states**2


def _inverse(largest: Array) -> Any:
    """Return factors that scale rows by their largest entries; 1 where there is none."""
    return np.divide(1.0, largest, out=np.ones(len(largest)), where=(largest > 0) & np.isfinite(largest))


def dense(matrix: Array) -> Factorised | None:
    """Return the factors of a real or complex matrix; None if it is singular."""
    from scipy.linalg import lapack

    scale, real = _inverse(np.abs(matrix).max(axis=1, initial=0.0)), not np.iscomplexobj(matrix)
    factor, back = (lapack.dgetrf, lapack.dgetrs) if real else (lapack.zgetrf, lapack.zgetrs)
    factors, pivots, info = factor(matrix * scale[:, None], overwrite_a=True)
    if info != 0 or not np.isfinite(factors).all():
        return None
    # the sign of the determinant: pivots and exchanges of rows
    exchanged = np.count_nonzero(pivots != np.arange(len(pivots)))
    negative = real and bool((np.count_nonzero(np.diagonal(factors) < 0) + exchanged) % 2)
    return Factorised(lambda right: back(factors, pivots, right * scale)[0], negative)


def sparse(rows: IntArray, columns: IntArray, differential: BoolArray) -> Callable[[complex, Array], Factorised]:
    """Return a function from shift and entries to the factors of a large matrix with few entries. It raises RuntimeError if the matrix is singular."""
    count = len(differential)
    numbers = np.flatnonzero(differential)
    all_rows, all_columns = np.concatenate([rows, numbers]), np.concatenate([columns, numbers])

    def shifted(shift: complex, entries: Array) -> Factorised:
        from scipy.sparse import csc_array
        from scipy.sparse.linalg import splu

        values = np.concatenate([-entries, np.full(len(numbers), shift)])
        matrix = csc_array((values, (all_rows, all_columns)), shape=(count, count))
        matrix.sum_duplicates()
        largest = np.zeros(count)
        np.maximum.at(largest, matrix.indices, np.abs(matrix.data))
        scale = _inverse(largest)
        matrix.data = matrix.data * scale[matrix.indices]
        factors = splu(matrix)
        return Factorised(lambda right: factors.solve(right * scale))

    return shifted
