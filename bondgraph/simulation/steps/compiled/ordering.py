"""The order of rows and columns for sparse factors: that of least degree where hardly anything fills, else SuperLU's pivots and fill-reducing
order for the numbers at hand; then kept."""

from __future__ import annotations

from typing import Any

import numpy as np

from .light import DIAGONAL, Columns, light_factors

SYMMETRIC, ANY = "MMD_AT_PLUS_A", "COLAMD"  # orders; for a pattern that is not symmetric that with less fill is taken
PRESENT = 1e-9  # of the largest number of its row: what stands for a zero that may not stay one


def ordered(
    rows: Any, columns: Any, differential: int, count: int, shift: float, entries: Any
) -> dict[str, Any] | None:
    """The fields of a `Pattern` for shift M - J, M = diag(1 … 1, 0 … 0); None if the matrix is singular."""
    diagonal = np.arange(differential)
    every_row, every_column = np.concatenate([rows, diagonal]), np.concatenate([columns, diagonal])
    values = np.concatenate([-np.asarray(entries), np.full(differential, shift)])
    light = light_factors(every_row, every_column, values, count)
    if light is not None:
        return _fields(light.place, light.place, light.lower, light.upper, rows, columns, differential, count)
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    matrix = csc_array((values, (every_row, every_column)), shape=(count, count))
    matrix.sum_duplicates()
    largest = np.zeros(count)
    np.maximum.at(largest, matrix.indices, np.abs(matrix.data))
    scale = np.divide(1.0, largest, out=np.ones(count), where=(largest > 0) & np.isfinite(largest))
    matrix.data = matrix.data * scale[matrix.indices]
    if not np.isfinite(matrix.data).all():
        return None
    matrix.data = np.where(matrix.data == 0, PRESENT, matrix.data)
    methods = (SYMMETRIC,) if _is_symmetric(matrix) else (ANY, SYMMETRIC)
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
    found = {
        "start": np.searchsorted(column[order], np.arange(count + 1)), "row": row[order], "entry": entry[order], "shifted": shifted[order],
        "l_start": lower[0], "l_row": lower[1], "u_start": upper[0], "u_row": upper[1], "row_place": row_place, "column_place": column_place,
        "wide": _wide(*lower),
    }  # fmt: skip
    below, above = len(lower[1]), len(upper[1])
    sizes = {"lower": below, "lower_re": below, "lower_im": below, "upper": above, "upper_re": above, "upper_im": above}
    return found | {name: np.zeros(size) for name, size in sizes.items()}


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
