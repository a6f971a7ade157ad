"""Sparse factors on a fixed pattern: the order of rows and columns is chosen once (`ordering.py`), then only numbers change.

L and U lie column by column without the diagonal of L, the rows of a column of U rising; rows are scaled as in `factorise.sparse`. Where a
pivot has become small beside what it divides, the answer is that another order is needed.
"""

from __future__ import annotations

from math import isfinite, sqrt
from typing import TYPE_CHECKING

from ....door import Record

if TYPE_CHECKING:
    from ....door import Floats, Ints

SINGULAR, FINE, ANEW = 0, 1, 2


class Pattern(Record):
    """Where the numbers of a matrix of n rows and of its factors lie, and the numbers."""

    n: int
    ready: int  # whether an order has been chosen
    small: float  # share of the largest number that it divides below which a pivot asks for another order
    tolerant: int  # whether small pivots are taken as they are: this order is new
    start: Ints  # n + 1: of the columns of the matrix, in the chosen order
    row: Ints
    entry: Ints  # which entry of the Jacobian is subtracted there, -1: none
    shifted: Ints  # 1 where the shift stands
    l_start: Ints  # n + 1
    l_row: Ints
    u_start: Ints  # n + 1
    u_row: Ints
    row_place: Ints  # n: where a row goes
    column_place: Ints  # n: where a column goes
    lower: Floats
    upper: Floats
    diagonal: Floats  # n
    scale: Floats  # n
    lower_re: Floats
    lower_im: Floats
    upper_re: Floats
    upper_im: Floats
    diagonal_re: Floats  # n
    diagonal_im: Floats  # n
    scale_complex: Floats  # n
    x: Floats  # n: zero between two uses
    xi: Floats  # n: zero between two uses
    y: Floats  # n
    yi: Floats  # n


def real_factors(p: Pattern, shift: float, entries: Floats) -> int:
    """Factors of shift M - J."""
    if p.ready == 0:
        return ANEW
    for i in range(p.n):
        p.scale[i] = 0.0
    for k in range(p.start[p.n]):
        value = shift if p.shifted[k] != 0 else 0.0
        if p.entry[k] >= 0:
            value -= entries[p.entry[k]]
        p.scale[p.row[k]] = max(p.scale[p.row[k]], abs(value))
    for i in range(p.n):
        p.scale[i] = 1.0 / p.scale[i] if p.scale[i] > 0.0 and isfinite(p.scale[i]) else 1.0
    for j in range(p.n):
        for k in range(p.start[j], p.start[j + 1]):
            value = shift if p.shifted[k] != 0 else 0.0
            if p.entry[k] >= 0:
                value -= entries[p.entry[k]]
            p.x[p.row[k]] = value * p.scale[p.row[k]]
        for q in range(p.u_start[j], p.u_start[j + 1]):
            k = p.u_row[q]
            by = p.x[k]
            p.x[k] = 0.0
            p.upper[q] = by
            if by != 0.0:
                for r in range(p.l_start[k], p.l_start[k + 1]):
                    p.x[p.l_row[r]] -= p.lower[r] * by
        pivot = p.x[j]
        p.x[j] = 0.0
        largest = 0.0
        for r in range(p.l_start[j], p.l_start[j + 1]):
            largest = max(largest, abs(p.x[p.l_row[r]]))
            p.lower[r] = p.x[p.l_row[r]] / pivot if pivot != 0.0 else 0.0
            p.x[p.l_row[r]] = 0.0
        p.diagonal[j] = pivot
        if pivot == 0.0 or not isfinite(pivot) or not isfinite(largest):
            return SINGULAR if p.tolerant != 0 or pivot != 0.0 else ANEW
        if p.tolerant == 0 and abs(pivot) < p.small * largest:
            return ANEW
    return FINE


def complex_factors(p: Pattern, re: float, im: float, entries: Floats) -> int:
    """Factors of (re + i im) M - J."""
    for i in range(p.n):
        p.scale_complex[i] = 0.0
    for k in range(p.start[p.n]):
        a = re if p.shifted[k] != 0 else 0.0
        b = im if p.shifted[k] != 0 else 0.0
        if p.entry[k] >= 0:
            a -= entries[p.entry[k]]
        p.scale_complex[p.row[k]] = max(p.scale_complex[p.row[k]], sqrt(a * a + b * b))
    for i in range(p.n):
        size = p.scale_complex[i]
        p.scale_complex[i] = 1.0 / size if size > 0.0 and isfinite(size) else 1.0
    for j in range(p.n):
        for k in range(p.start[j], p.start[j + 1]):
            a = re if p.shifted[k] != 0 else 0.0
            b = im if p.shifted[k] != 0 else 0.0
            if p.entry[k] >= 0:
                a -= entries[p.entry[k]]
            p.x[p.row[k]] = a * p.scale_complex[p.row[k]]
            p.xi[p.row[k]] = b * p.scale_complex[p.row[k]]
        for q in range(p.u_start[j], p.u_start[j + 1]):
            k = p.u_row[q]
            a = p.x[k]
            b = p.xi[k]
            p.x[k] = 0.0
            p.xi[k] = 0.0
            p.upper_re[q] = a
            p.upper_im[q] = b
            if a != 0.0 or b != 0.0:
                for r in range(p.l_start[k], p.l_start[k + 1]):
                    i = p.l_row[r]
                    p.x[i] -= p.lower_re[r] * a - p.lower_im[r] * b
                    p.xi[i] -= p.lower_re[r] * b + p.lower_im[r] * a
        pr = p.x[j]
        pi = p.xi[j]
        p.x[j] = 0.0
        p.xi[j] = 0.0
        size = pr * pr + pi * pi
        largest = 0.0
        for r in range(p.l_start[j], p.l_start[j + 1]):
            i = p.l_row[r]
            a = p.x[i]
            b = p.xi[i]
            largest = max(largest, a * a + b * b)
            p.lower_re[r] = (a * pr + b * pi) / size if size != 0.0 else 0.0
            p.lower_im[r] = (b * pr - a * pi) / size if size != 0.0 else 0.0
            p.x[i] = 0.0
            p.xi[i] = 0.0
        p.diagonal_re[j] = pr
        p.diagonal_im[j] = pi
        if size == 0.0 or not isfinite(size) or not isfinite(largest):
            return SINGULAR if p.tolerant != 0 or size != 0.0 else ANEW
        if p.tolerant == 0 and size < p.small * p.small * largest:
            return ANEW
    return FINE


def real_back(p: Pattern, x: Floats) -> None:
    """The solution in the place of the right side."""
    n = p.n
    for i in range(n):
        p.y[p.row_place[i]] = x[i] * p.scale[p.row_place[i]]
    for j in range(n):
        by = p.y[j]
        if by != 0.0:
            for r in range(p.l_start[j], p.l_start[j + 1]):
                p.y[p.l_row[r]] -= p.lower[r] * by
    for j in range(n - 1, -1, -1):
        by = p.y[j] / p.diagonal[j]
        p.y[j] = by
        for q in range(p.u_start[j], p.u_start[j + 1]):
            p.y[p.u_row[q]] -= p.upper[q] * by
    for i in range(n):
        x[i] = p.y[p.column_place[i]]


def complex_back(p: Pattern, xr: Floats, xi: Floats) -> None:
    """The solution in the place of the right side."""
    n = p.n
    for i in range(n):
        place = p.row_place[i]
        p.y[place] = xr[i] * p.scale_complex[place]
        p.yi[place] = xi[i] * p.scale_complex[place]
    for j in range(n):
        a = p.y[j]
        b = p.yi[j]
        for r in range(p.l_start[j], p.l_start[j + 1]):
            i = p.l_row[r]
            p.y[i] -= p.lower_re[r] * a - p.lower_im[r] * b
            p.yi[i] -= p.lower_re[r] * b + p.lower_im[r] * a
    for j in range(n - 1, -1, -1):
        pr = p.diagonal_re[j]
        pi = p.diagonal_im[j]
        size = pr * pr + pi * pi
        a = (p.y[j] * pr + p.yi[j] * pi) / size
        b = (p.yi[j] * pr - p.y[j] * pi) / size
        p.y[j] = a
        p.yi[j] = b
        for q in range(p.u_start[j], p.u_start[j + 1]):
            i = p.u_row[q]
            p.y[i] -= p.upper_re[q] * a - p.upper_im[q] * b
            p.yi[i] -= p.upper_re[q] * b + p.upper_im[q] * a
    for i in range(n):
        xr[i] = p.y[p.column_place[i]]
        xi[i] = p.yi[p.column_place[i]]
