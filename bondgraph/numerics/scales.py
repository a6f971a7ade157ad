"""Sizes by which numbers of different units are compared: of the rows and columns of a matrix, and of quantities of one unit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from compiler.api import Array, IntArray

EPS = float(np.finfo(float).eps)
CLEAN = 1e-11  # relative to the largest component of a scaled null vector: rounding
NULL_ENTRIES = 64.0  # units in the last place of the terms that cancel in a row


def nonzero(sizes: Array) -> Any:
    """Return sizes with 1 in the place of zeros."""
    return np.where(sizes > 0, sizes, 1.0)


def equilibrated(matrix: Array) -> tuple[Any, Any, Any]:
    """Return a matrix with its rows, then its columns, over their largest entries; and these, (rows,) and (columns,), 1 in the place of zeros."""
    rows = nonzero(np.abs(matrix).max(axis=1, initial=0.0))
    matrix = matrix / rows[:, None]
    columns = nonzero(np.abs(matrix).max(axis=0, initial=0.0))
    return matrix / columns, rows, columns


def null_basis(matrix: Array, terms: Array, vectors: Array, error: float = 0.0) -> tuple[Any, Any]:
    """Return another basis (n, k) of the span of singular vectors (k, n), with an identity in k of its rows, and which of its columns are null vectors of
    the matrix up to the rounding of its entries, whose terms have the sizes `terms`. `error`: of the components of the vectors. A small component is
    rounding, unless the column is a null vector with it alone: beside a state that is all but at zero it is the change of that state."""
    from scipy.linalg import qr

    basis = vectors.T
    if not basis.shape[1]:
        return basis, np.zeros(0, dtype=bool)
    _, _, order = qr(vectors, pivoting=True, mode="economic")
    chosen = order[: len(vectors)]
    basis = np.linalg.solve(basis[chosen].T, vectors).T
    basis[chosen] = np.eye(len(chosen))

    def null(columns: Array) -> Any:
        allowed = NULL_ENTRIES * matrix.shape[0] * EPS * (terms @ (np.abs(columns) + error))
        return (np.abs(matrix @ columns) <= allowed).all(axis=0)

    clean = np.where(np.abs(basis) > CLEAN, basis, 0.0)
    rounded = null(clean)
    return np.where(rounded | ~null(basis), clean, basis), rounded | null(basis)


def group_numbers(groups: Sequence[object]) -> Any:
    """Return the number of the group of each item, in the order of first use; shape (items,)."""
    numbers = {group: number for number, group in enumerate(dict.fromkeys(groups))}
    return np.array([numbers[group] for group in groups], dtype=int)


def largest_of_group(sizes: Array, numbers: IntArray) -> Any:
    """Return for each item the largest of the sizes, which are not negative, in its group; shape (…, items)."""
    most = np.zeros((*sizes.shape[:-1], int(numbers.max(initial=-1)) + 1))
    np.maximum.at(most.T, numbers, sizes.T)
    return most[..., numbers]
