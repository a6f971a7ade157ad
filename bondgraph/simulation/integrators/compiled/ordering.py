"""Order of rows and columns for sparse factors.

With all pivots on the diagonal it depends on the pattern alone, and is computed once for a program, by machine code (`least_degree.py`,
`eliminations.py`). Where the numbers of a run do not allow that, SuperLU computes one for these numbers. A run keeps its order while its pivots are
not small.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array, IntArray, Record, zeros_of

from ..linear_algebra.eliminations import Eliminations, plan_eliminations, put_rows
from ..linear_algebra.least_degree import Quotient, least_degree
from .code import POINTER, called
from .record_layout import RecordArray, RecordLayout

SYMMETRIC, ANY = "MMD_AT_PLUS_A", "COLAMD"  # orders; for an unsymmetric pattern the one with less fill is used
PRESENT = 1e-9  # relative to the largest entry of its row: value put in place of a zero that may become nonzero
DIAGONAL = 0.01  # relative to the largest entry of its column: larger diagonal entries are used as pivots
MOST = 6  # most rows per column of L for which an unsymmetric pattern is treated as symmetric

Columns = tuple[Any, Any]  # starts, and rows in rising order, without the diagonal


@dataclass(frozen=True, slots=True)
class EliminationPattern:
    """Places of rows and columns in an order, patterns of L and U, and for each column of L the number of adjacent columns with its pattern."""

    row_place: IntArray
    column_place: IntArray
    lower: Columns
    upper: Columns
    wide: IntArray


def on_diagonal(rows: IntArray, columns: IntArray, differential: int, count: int, compiled: bool = True) -> dict[str, Any] | None:  # fmt: skip
    """Return the fields of a `Pattern` for shift M - J, M = diag(1 … 1, 0 … 0), with all pivots on the diagonal.

    None if the diagonal has gaps, or if a good order depends on the numbers. `compiled`: by machine code or by its source.
    """
    present = np.arange(count) < differential
    present[rows[rows == columns]] = True
    if not present.all():
        return None
    start, neighbours, symmetric = _neighbours(rows, columns, count)
    elimination = _eliminated(start, neighbours, _least_degree(start, neighbours, compiled), compiled)
    if not symmetric and np.diff(elimination.lower[0]).max(initial=0) > MOST:
        return None
    return _fields(elimination, rows, columns, differential)


def _neighbours(rows: IntArray, columns: IntArray, count: int) -> tuple[Any, Any, bool]:
    """Return for each node its neighbours in (i, j) or (j, i), as starts and nodes, and True if the pattern is symmetric."""
    beside = rows != columns
    own = _distinct(rows[beside] * count + columns[beside])
    both = _distinct(np.concatenate([own, own % count * count + own // count]))
    return np.searchsorted(both, np.arange(count + 1) * count), both % count, len(both) == len(own)


def _distinct(numbers: IntArray) -> Any:
    """Return rising numbers without duplicates; numpy's own function would load its masked arrays."""
    rising = np.sort(numbers)
    first = np.ones(len(rising), dtype=bool)
    first[1:] = rising[1:] != rising[:-1]
    return rising[first]


def _least_degree(start: IntArray, neighbours: IntArray, compiled: bool) -> Any:
    """Return the nodes in an order with little fill."""
    count, room = len(start) - 1, len(neighbours) + len(start)
    fields = zeros_of(Quotient, n=count, room=room, free=len(neighbours))
    fields["lists"][: len(neighbours)] = neighbours
    _work(least_degree, Quotient, fields | {"start": start[:-1].copy(), "length": np.diff(start)}, compiled)
    return fields["order"]


def _eliminated(start: IntArray, neighbours: IntArray, order: IntArray, compiled: bool) -> EliminationPattern:
    fields = zeros_of(Eliminations, n=len(order)) | {"start": start, "neighbours": neighbours, "order": order}
    fields |= dict.fromkeys(("lower", "upper"), np.zeros(0, dtype=np.int64))
    _work(plan_eliminations, Eliminations, fields, compiled)
    starts = {name: np.concatenate([[0], np.cumsum(fields[name])]) for name in ("count", "number")}
    lower, upper = (np.zeros(result[-1], dtype=np.int64) for result in starts.values())
    fields |= {"lower": lower, "upper": upper} | {name: result[:-1].copy() for name, result in starts.items()}
    _work(put_rows, Eliminations, fields, compiled)
    place = fields["place"]
    return EliminationPattern(place, place, (starts["count"], lower), (starts["number"], upper), fields["wide"])


def _work(function: Callable[[Any], None], noun: type[Record], given: Mapping[str, Any], compiled: bool) -> None:
    """Run a function on a record with these fields."""
    if compiled:
        called(function.__name__, None, POINTER)(RecordArray(RecordLayout(noun, {}, {}), given).address)
    else:
        function(noun(**given))


def ordered(
    rows: IntArray, columns: IntArray, differential: int, count: int, shift: float, entries: Array
) -> dict[str, Any] | None:
    """Return the same fields for given numbers, with pivots that are not small; None if the matrix is singular."""
    every_row, every_column = _places(rows, columns, differential)
    matrix = _matrix(
        every_row, every_column, np.concatenate([-np.asarray(entries), np.full(differential, shift)]), count
    )
    largest = np.zeros(count)
    np.maximum.at(largest, matrix.indices, np.abs(matrix.data))
    scale = np.divide(1.0, largest, out=np.ones(count), where=(largest > 0) & np.isfinite(largest))
    matrix.data = matrix.data * scale[matrix.indices]
    if not np.isfinite(matrix.data).all():
        return None
    matrix.data = np.where(matrix.data == 0, PRESENT, matrix.data)
    methods = (SYMMETRIC,) if _is_symmetric(matrix) else (ANY, SYMMETRIC)
    return _by_library(matrix, rows, columns, differential, methods)


def _places(rows: IntArray, columns: IntArray, differential: int) -> tuple[Any, Any]:
    """Return the rows and columns of the entries of shift M - J; entries at the same place are added."""
    diagonal = np.arange(differential)
    return np.concatenate([rows, diagonal]), np.concatenate([columns, diagonal])


def _matrix(rows: IntArray, columns: IntArray, values: Array, count: int) -> Any:
    from scipy.sparse import csc_array

    matrix = csc_array((values, (rows, columns)), shape=(count, count))
    matrix.sum_duplicates()
    return matrix


def _by_library(matrix: Any, rows: IntArray, columns: IntArray, differential: int, methods: Sequence[str]) -> dict[str, Any] | None:  # fmt: skip
    from scipy.sparse.linalg import splu

    count = matrix.shape[0]
    try:
        factors = min((splu(matrix, permc_spec=m, diag_pivot_thresh=DIAGONAL) for m in methods), key=lambda f: f.nnz)
    except RuntimeError:
        return None
    places = np.asarray(factors.perm_r), np.asarray(factors.perm_c)
    lower, upper = _without_diagonal(factors.L, count), _without_diagonal(factors.U, count)
    return _fields(EliminationPattern(*places, lower, upper, _wide(*lower)), rows, columns, differential)


def _is_symmetric(matrix: Any) -> bool:
    """Return True if the pattern has an entry at (j, i) for each one at (i, j)."""
    turned = matrix.T.tocsc()
    matrix.sort_indices()
    turned.sort_indices()
    return np.array_equal(matrix.indptr, turned.indptr) and np.array_equal(matrix.indices, turned.indices)


def _fields(elimination: EliminationPattern, rows: IntArray, columns: IntArray, differential: int) -> dict[str, Any]:
    row_place, column_place, count = elimination.row_place, elimination.column_place, len(elimination.row_place)
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
    fields: dict[str, Any] = {
        "start": np.searchsorted(column[order], np.arange(count + 1)), "row": row[order], "entry": entry[order], "shifted": shifted[order],
        "l_start": elimination.lower[0], "l_row": elimination.lower[1], "u_start": elimination.upper[0], "u_row": elimination.upper[1],
        "row_place": row_place, "column_place": column_place, "wide": elimination.wide,
    }  # fmt: skip
    return {name: np.ascontiguousarray(array, dtype=np.int64) for name, array in fields.items()} | room_in(fields)


def room_in(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arrays for the factors of one matrix in this order."""
    names = {"l_row": ("lower", "lower_re", "lower_im"), "u_row": ("upper", "upper_re", "upper_im")}
    return {name: np.zeros(len(found[rows])) for rows, those in names.items() for name in those}


def _without_diagonal(factor: Any, count: int) -> tuple[Any, Any]:
    """Return starts of columns, and rows in rising order, without the diagonal."""
    factor = factor.tocsc()
    factor.sort_indices()
    columns = np.repeat(np.arange(count), np.diff(factor.indptr))
    beside = factor.indices != columns
    return np.searchsorted(columns[beside], np.arange(count + 1)), factor.indices[beside]


def _wide(starts: IntArray, rows: IntArray) -> Any:
    """Return for each column the number of columns from there on with equal pattern, apart from their own rows: they are subtracted together."""
    count = len(starts) - 1
    lengths = np.diff(starts)
    wide = np.ones(count, dtype=np.int64)
    below = np.flatnonzero((lengths[:-1] == lengths[1:] + 1) & (lengths[:-1] > 0))
    for k in below[::-1].tolist():
        own = rows[starts[k] : starts[k + 1]]
        if own[0] == k + 1 and np.array_equal(own[1:], rows[starts[k + 1] : starts[k + 2]]):
            wide[k] = wide[k + 1] + 1
    return wide
