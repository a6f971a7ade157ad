"""Factors of a matrix that hardly fills: ladders, trees, stars. Nodes of least degree are eliminated first, one after the other, in Python:
that is done before a library for larger factors is even loaded."""

from __future__ import annotations

from heapq import heapify, heappop, heappush
from typing import Any, NamedTuple

import numpy as np

ENTRIES = 4.5  # in a row, on the average: a tree has 3, its diagonal counted twice 4; beyond, eliminating only finds out that it fills
MOST = 6  # neighbours of a node when its turn comes; beyond that a library is quicker
DIAGONAL = 0.01  # of the largest number of its column: a pivot of the diagonal that is larger is taken

Columns = tuple[Any, Any]  # starts, and rows in rising order, without the diagonal


class Factors(NamedTuple):
    """Where rows (and columns) go, and where L and U have entries."""

    place: Any
    lower: Columns
    upper: Columns


def light_factors(rows: Any, columns: Any, values: Any, count: int) -> Factors | None:
    """The factors of the matrix with these entries, which are added where they fall together, with all pivots on its diagonal; None if
    it fills, or has a pivot that is small beside its column."""
    if len(rows) > ENTRIES * count:
        return None
    matrix = _scaled(rows, columns, values, count)
    if matrix is None:
        return None
    waiting = [(len(row), i) for i, row in enumerate(matrix)]
    heapify(waiting)
    place = np.full(count, -1)
    below: list[list[int]] = []  # of each pivot, in the order of elimination
    while waiting:
        degree, i = heappop(waiting)
        if place[i] >= 0 or degree != len(matrix[i]):
            continue
        if degree > MOST + 1:
            return None
        place[i] = len(below)
        others = _eliminated(matrix, i)
        if others is None:
            return None
        below.append(others)
        for j in others:
            heappush(waiting, (len(matrix[j]), j))
    return _factors(place, below)


def _scaled(rows: Any, columns: Any, values: Any, count: int) -> list[dict[int, float]] | None:
    """Rows of largest number 1, with as many places above the diagonal as below it; None if one has nothing."""
    matrix: list[dict[int, float]] = [{i: 0.0} for i in range(count)]
    for i, j, value in zip(rows.tolist(), columns.tolist(), values.tolist(), strict=True):
        matrix[i][j] = matrix[i].get(j, 0.0) + value
        matrix[j].setdefault(i, 0.0)
    for row in matrix:
        largest = max(map(abs, row.values()))
        if not 0.0 < largest < np.inf:
            return None
        for j in row:
            row[j] /= largest
    return matrix


def _eliminated(matrix: list[dict[int, float]], i: int) -> list[int] | None:
    """The rows that a pivot is taken from; None if it is too small for that."""
    row = matrix[i]
    pivot = row.pop(i)
    column = [(j, matrix[j].pop(i)) for j in row]
    if not abs(pivot) >= DIAGONAL * max([abs(x) for _, x in column], default=0.0) or pivot == 0.0:
        return None
    for j, value in column:
        factor, other = value / pivot, matrix[j]
        for k, x in row.items():
            other[k] = other.get(k, 0.0) - factor * x
    return list(row)


def _factors(place: Any, below: list[list[int]]) -> Factors:
    lengths = np.array([len(others) for others in below], dtype=np.int64)
    own = np.repeat(np.arange(len(below)), lengths)
    others = place[np.array([j for row in below for j in row], dtype=np.int64)]
    return Factors(place, _by_columns(own, others, len(below)), _by_columns(others, own, len(below)))


def _by_columns(columns: Any, rows: Any, count: int) -> Columns:
    order = np.lexsort((rows, columns))
    return np.searchsorted(columns[order], np.arange(count + 1)), rows[order]
