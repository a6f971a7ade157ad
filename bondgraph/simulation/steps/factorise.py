"""Factorisations of mu/h M - J for the solver: rows scaled, dense by LAPACK, sparse by SuperLU."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .radau import Factorised

Shifted = Callable[[complex, Any], Factorised]


DENSE = 100  # states up to which the linear algebra is dense


def is_large(states: int, entries: int) -> bool:
    """Return True if a Jacobian is better treated as sparse."""
    return states > DENSE and entries < 0.2 * states**2


@dataclass(frozen=True, slots=True)
class _Dense:
    factors: Any
    pivots: Any
    scale: Any
    back: Any
    negative: bool = False  # True if a real determinant is negative

    def solve(self, right: Any) -> Any:
        solution, _ = self.back(self.factors, self.pivots, right * self.scale)
        return solution


@dataclass(frozen=True, slots=True)
class _Sparse:
    factors: Any
    scale: Any
    negative: bool = False

    def solve(self, right: Any) -> Any:
        return self.factors.solve(right * self.scale)


@dataclass(frozen=True, slots=True)
class _Once:
    matrix: Any
    scale: Any
    negative: bool = False

    def solve(self, right: Any) -> Any:
        return np.linalg.solve(self.matrix, right * self.scale)


def once(rows: Any, columns: Any, differential: Any) -> Shifted:
    """Return a factorisation as `dense`, for a matrix that is used once, by numpy alone. Raises LinAlgError at its use, if it is singular."""
    diagonal = np.diag(differential.astype(float))

    def shifted(shift: complex, entries: Any) -> Factorised:
        matrix = diagonal * shift
        matrix[rows, columns] -= entries
        scale = _row_scale(matrix)
        return _Once(matrix * scale[:, None], scale)

    return shifted


def _row_scale(matrix: Any) -> Any:
    largest = np.abs(matrix).max(axis=1, initial=0.0)
    return np.divide(1.0, largest, out=np.ones(len(largest)), where=(largest > 0) & np.isfinite(largest))


def dense(rows: Any, columns: Any, differential: Any) -> Shifted:
    """Return a function from shift and entries of a Jacobian at (rows, columns) to a factorised dense matrix.

    That function raises LinAlgError if the matrix is singular.
    """
    from scipy.linalg import lapack

    diagonal = np.diag(differential.astype(float))

    def shifted(shift: complex, entries: Any) -> Factorised:
        matrix = diagonal * shift
        matrix[rows, columns] -= entries
        scale = _row_scale(matrix)
        complex_valued = isinstance(shift, complex)
        factor, back = (lapack.zgetrf, lapack.zgetrs) if complex_valued else (lapack.dgetrf, lapack.dgetrs)
        factors, pivots, info = factor(matrix * scale[:, None], overwrite_a=True)
        if info != 0 or not np.isfinite(factors).all():
            raise np.linalg.LinAlgError("singular")
        return _Dense(factors, pivots, scale, back, not complex_valued and _is_negative(factors, pivots))

    return shifted


def _is_negative(factors: Any, pivots: Any) -> bool:
    """Return True if a determinant is negative, from the signs of the pivots and the exchanges of rows."""
    exchanged = np.count_nonzero(pivots != np.arange(len(pivots)))
    return bool((np.count_nonzero(np.diagonal(factors) < 0) + exchanged) % 2)


def sparse(rows: Any, columns: Any, differential: Any) -> Shifted:
    """Return the same for large systems with few entries. The function raises RuntimeError if the matrix is singular."""
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    count = len(differential)
    numbers = np.flatnonzero(differential)
    all_rows, all_columns = np.concatenate([rows, numbers]), np.concatenate([columns, numbers])

    def shifted(shift: complex, entries: Any) -> Factorised:
        values = np.concatenate([-entries, np.full(len(numbers), shift)])
        matrix = csc_array((values, (all_rows, all_columns)), shape=(count, count))
        matrix.sum_duplicates()
        largest = np.zeros(count)
        np.maximum.at(largest, matrix.indices, np.abs(matrix.data))
        scale = np.divide(1.0, largest, out=np.ones(count), where=(largest > 0) & np.isfinite(largest))
        matrix.data = matrix.data * scale[matrix.indices]
        return _Sparse(splu(matrix), scale)

    return shifted
