"""Factorisations of mu/h M - J by LAPACK and SuperLU, rows scaled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from compiler.api import Array, BoolArray, IntArray

DENSE = 100  # states up to which the linear algebra is dense


class Factorised(Protocol):
    """A factorised matrix."""

    def solve(self, right: Array) -> Any: ...


Shifted = Callable[[complex, Any], Factorised]


def is_large(states: int, entries: int) -> bool:
    """Return True if a Jacobian is better treated as sparse."""
    return states > DENSE and entries < 0.2 * states**2


@dataclass(frozen=True, slots=True)
class Dense:
    """Factors of a dense matrix."""

    factors: Any
    pivots: Any
    scale: Any
    back: Any

    def solve(self, right: Array) -> Any:
        solution, _ = self.back(self.factors, self.pivots, right * self.scale)
        return solution

    @property
    def negative(self) -> bool:
        """True if a real determinant is negative, from the signs of the pivots and the exchanges of rows."""
        exchanged = np.count_nonzero(self.pivots != np.arange(len(self.pivots)))
        return bool((np.count_nonzero(np.diagonal(self.factors) < 0) + exchanged) % 2)


@dataclass(frozen=True, slots=True)
class _Sparse:
    factors: Any
    scale: Any

    def solve(self, right: Array) -> Any:
        return self.factors.solve(right * self.scale)


def _row_scale(matrix: Array) -> Any:
    largest = np.abs(matrix).max(axis=1, initial=0.0)
    return np.divide(1.0, largest, out=np.ones(len(largest)), where=(largest > 0) & np.isfinite(largest))


def dense(matrix: Array) -> Dense | None:
    """Return the factors of a real or complex matrix; None if it is singular."""
    from scipy.linalg import lapack

    scale = _row_scale(matrix)
    factor, back = (lapack.zgetrf, lapack.zgetrs) if np.iscomplexobj(matrix) else (lapack.dgetrf, lapack.dgetrs)
    factors, pivots, info = factor(matrix * scale[:, None], overwrite_a=True)
    return None if info != 0 or not np.isfinite(factors).all() else Dense(factors, pivots, scale, back)


def sparse(rows: IntArray, columns: IntArray, differential: BoolArray) -> Shifted:
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
        scale = np.divide(1.0, largest, out=np.ones(count), where=(largest > 0) & np.isfinite(largest))
        matrix.data = matrix.data * scale[matrix.indices]
        return _Sparse(splu(matrix), scale)

    return shifted
