"""The order of rows and columns for sparse factors: that of least degree where hardly anything fills, else SuperLU's fill-reducing one.

With all pivots on the diagonal it depends on the pattern alone, and is found once for a program; where the numbers of a run do not allow
for that, it is made for the numbers at hand, with SuperLU's pivots. A run goes on with what it has while its pivots are not small.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .light import DIAGONAL, Columns, light_factors

SYMMETRIC, ANY = "MMD_AT_PLUS_A", "COLAMD"  # orders; for a pattern that is not symmetric that with less fill is taken
PRESENT = 1e-9  # of the largest number of its row: what stands for a zero that may not stay one


def on_diagonal(rows: Any, columns: Any, differential: int, count: int) -> dict[str, Any] | None:
    """The fields of a `Pattern` for shift M - J, M = diag(1 … 1, 0 … 0), with all pivots on the diagonal; None if that has gaps, or nothing but numbers
    can tell a good order."""
    present = np.arange(count) < differential
    present[rows[rows == columns]] = True
    if not present.all():
        return None
    every_row, every_column = _places(rows, columns, differential)
    values = np.where(every_row == every_column, count + 1.0, -1.0)  # on which a diagonal is to be preferred
    light = light_factors(every_row, every_column, values, count)
    if light is not None:
        return _fields(light.place, light.place, light.lower, light.upper, rows, columns, differential, count)
    matrix = _matrix(every_row, every_column, values, count)
    return _by_library(matrix, rows, columns, differential, (SYMMETRIC,)) if _is_symmetric(matrix) else None


def ordered(
    rows: Any, columns: Any, differential: int, count: int, shift: float, entries: Any
) -> dict[str, Any] | None:
    """The same for these numbers, with pivots that are not small; None if the matrix is singular."""
    every_row, every_column = _places(rows, columns, differential)
    values = np.concatenate([-np.asarray(entries), np.full(differential, shift)])
    light = light_factors(every_row, every_column, values, count)
    if light is not None:
        return _fields(light.place, light.place, light.lower, light.upper, rows, columns, differential, count)
    matrix = _matrix(every_row, every_column, values, count)
    largest = np.zeros(count)
    np.maximum.at(largest, matrix.indices, np.abs(matrix.data))
    scale = np.divide(1.0, largest, out=np.ones(count), where=(largest > 0) & np.isfinite(largest))
    matrix.data = matrix.data * scale[matrix.indices]
    if not np.isfinite(matrix.data).all():
        return None
    matrix.data = np.where(matrix.data == 0, PRESENT, matrix.data)
    methods = (SYMMETRIC,) if _is_symmetric(matrix) else (ANY, SYMMETRIC)
    return _by_library(matrix, rows, columns, differential, methods)


def _places(rows: Any, columns: Any, differential: int) -> tuple[Any, Any]:
    """Where shift M - J has entries; those that fall together are added."""
    diagonal = np.arange(differential)
    return np.concatenate([rows, diagonal]), np.concatenate([columns, diagonal])


def _matrix(rows: Any, columns: Any, values: Any, count: int) -> Any:
    from scipy.sparse import csc_array

    matrix = csc_array((values, (rows, columns)), shape=(count, count))
    matrix.sum_duplicates()
    return matrix


def _by_library(matrix: Any, rows: Any, columns: Any, differential: int, methods: Sequence[str]) -> dict[str, Any] | None:  # fmt: skip
    from scipy.sparse.linalg import splu

    count = matrix.shape[0]
    try:
        factors = min((splu(matrix, permc_spec=m, diag_pivot_thresh=DIAGONAL) for m in methods), key=lambda f: f.nnz)
    except RuntimeError:
        return None
    places = np.asarray(factors.perm_r), np.asarray(factors.perm_c)
    lower, upper = _without_diagonal(factors.L, count), _without_diagonal(factors.U, count)
    return _fields(*places, lower, upper, rows, columns, differential, count)


def _is_symmetric(matrix: Any) -> bool:
    """Whether there is something in (i, j) wherever there is in (j, i)."""
    turned = matrix.T.tocsc()
    matrix.sort_indices()
    turned.sort_indices()
    return np.array_equal(matrix.indptr, turned.indptr) and np.array_equal(matrix.indices, turned.indices)


def _fields(
    row_place: Any, column_place: Any, lower: Columns, upper: Columns, rows: Any, columns: Any, differential: int, count: int
) -> dict[str, Any]:  # fmt: skip
    # One slot for each place of the matrix: an entry of the Jacobian, the shift, or both.
    slots = np.full(count, -1)
    entry_rows, entry_columns = row_place[rows], column_place[columns]
    of_diagonal = np.flatnonzero((rows == columns) & (rows < differential))
    slots[rows[of_diagonal]] = of_diagonal
    alone = np.flatnonzero(slots[:differential] < 0)
    shifted = np.zeros(len(rows) + len(alone), dtype=np.int64)
    shifted[of_diagonal] = 1
    shifted[len(rows) :] = 1
    entry = np.concatenate([np.arange(len(rows)), np.full(len(alone), -1)])
    row = np.concatenate([entry_rows, row_place[alone]])
    column = np.concatenate([entry_columns, column_place[alone]])
    order = np.argsort(column, kind="stable")
    found: dict[str, Any] = {
        "start": np.searchsorted(column[order], np.arange(count + 1)), "row": row[order], "entry": entry[order], "shifted": shifted[order],
        "l_start": lower[0], "l_row": lower[1], "u_start": upper[0], "u_row": upper[1], "row_place": row_place, "column_place": column_place,
        "wide": _wide(*lower),
    }  # fmt: skip
    return {name: np.ascontiguousarray(array, dtype=np.int64) for name, array in found.items()} | room_in(found)


def room_in(found: Mapping[str, Any]) -> dict[str, Any]:
    """For the factors of one matrix in this order."""
    names = {"l_row": ("lower", "lower_re", "lower_im"), "u_row": ("upper", "upper_re", "upper_im")}
    return {name: np.zeros(len(found[rows])) for rows, those in names.items() for name in those}


def _without_diagonal(factor: Any, count: int) -> tuple[Any, Any]:
    """Starts of columns, and rows in rising order."""
    factor = factor.tocsc()
    factor.sort_indices()
    columns = np.repeat(np.arange(count), np.diff(factor.indptr))
    kept = factor.indices != columns
    return np.searchsorted(columns[kept], np.arange(count + 1)), factor.indices[kept]


def _wide(starts: Any, rows: Any) -> Any:
    """For each column, how many from there on have one pattern, but for their own rows: these are subtracted together."""
    count = len(starts) - 1
    lengths = np.diff(starts)
    wide = np.ones(count, dtype=np.int64)
    below = np.flatnonzero((lengths[:-1] == lengths[1:] + 1) & (lengths[:-1] > 0))
    for k in below[::-1].tolist():
        own = rows[starts[k] : starts[k + 1]]
        if own[0] == k + 1 and np.array_equal(own[1:], rows[starts[k + 1] : starts[k + 2]]):
            wide[k] = wide[k + 1] + 1
    return wide
