"""Sparse factors on a fixed pattern: the order of rows and columns is chosen once (`ordering.py`), then only numbers change.

L and U are stored column by column without the diagonal of L, the rows of a column of U rising; rows are scaled as in `factorise.sparse`. Where a
pivot has become small relative to the numbers that it divides, the result is that another order is needed.
"""

from __future__ import annotations

from math import isfinite, sqrt

from compiler.api import Floats, Ints, Record, sized

SINGULAR, FINE, ANEW = 0, 1, 2


class Pattern(Record):
    """Pattern of a matrix of n rows and of its factors, and their numbers."""

    n: int
    ready: int  # 1 if an order has been chosen
    small: float  # ratio of a pivot to the largest number that it divides, below which another order is needed
    tolerant: int  # 1 if small pivots are accepted: this order is new
    start: Ints  # n + 1: starts of the columns of the matrix, in the chosen order
    row: Ints
    entry: Ints  # index of the entry of the Jacobian that is subtracted there, -1: none
    shifted: Ints  # 1 where the shift is added
    l_start: Ints  # n + 1
    l_row: Ints
    u_start: Ints  # n + 1
    u_row: Ints
    row_place: Ints  # n: new index of a row
    column_place: Ints  # n: new index of a column
    wide: Ints  # n: number of columns of L from there on with equal pattern, apart from their own rows
    lower: Floats
    upper: Floats
    diagonal: Floats = sized("n")
    scale: Floats = sized("n")
    lower_re: Floats
    lower_im: Floats
    upper_re: Floats
    upper_im: Floats
    diagonal_re: Floats = sized("n")
    diagonal_im: Floats = sized("n")
    scale_complex: Floats = sized("n")
    x: Floats = sized("n")  # zero between two uses
    xi: Floats = sized("n")  # zero between two uses
    y: Floats = sized("n")
    yi: Floats = sized("n")


def real_factors(p: Pattern, shift: float, entries: Floats) -> int:
    """Factorise shift M - J."""
    if p.ready == 0:
        return ANEW
    n = p.n
    x = p.x
    scale = p.scale
    lower = p.lower
    l_start = p.l_start
    l_row = p.l_row
    start = p.start
    for i in range(n):
        scale[i] = 0.0
    for k in range(start[n]):
        value = shift if p.shifted[k] != 0 else 0.0
        if p.entry[k] >= 0:
            value -= entries[p.entry[k]]
        scale[p.row[k]] = max(scale[p.row[k]], abs(value))
    for i in range(n):
        scale[i] = 1.0 / scale[i] if scale[i] > 0.0 and isfinite(scale[i]) else 1.0
    for j in range(n):
        for k in range(start[j], start[j + 1]):
            value = shift if p.shifted[k] != 0 else 0.0
            if p.entry[k] >= 0:
                value -= entries[p.entry[k]]
            x[p.row[k]] = value * scale[p.row[k]]
        q = p.u_start[j]
        end = p.u_start[j + 1]
        while q < end:
            k = p.u_row[q]
            if q + 3 < end and p.wide[k] >= 4 and p.u_row[q + 3] == k + 3:
                four_columns(x, lower, l_start, l_row, p.upper[q:], k)
                q += 4
            else:
                by = x[k]
                x[k] = 0.0
                p.upper[q] = by
                if by != 0.0:
                    for r in range(l_start[k], l_start[k + 1]):
                        x[l_row[r]] -= lower[r] * by
                q += 1
        pivot = x[j]
        x[j] = 0.0
        largest = 0.0
        for r in range(l_start[j], l_start[j + 1]):
            largest = max(largest, abs(x[l_row[r]]))
            lower[r] = x[l_row[r]] / pivot if pivot != 0.0 else 0.0
            x[l_row[r]] = 0.0
        p.diagonal[j] = pivot
        if pivot == 0.0 or not isfinite(pivot) or not isfinite(largest):
            return SINGULAR if p.tolerant != 0 or pivot != 0.0 else ANEW
        if p.tolerant == 0 and abs(pivot) < p.small * largest:
            return ANEW
    return FINE


def four_columns(x: Floats, lower: Floats, l_start: Ints, l_row: Ints, upper: Floats, k: int) -> None:
    """Subtract four columns of equal pattern, from k on, from x, with the same result as one after the other."""
    r0 = l_start[k]
    r1 = l_start[k + 1]
    r2 = l_start[k + 2]
    r3 = l_start[k + 3]
    a = x[k]
    b = x[k + 1] - lower[r0] * a
    c = x[k + 2] - lower[r0 + 1] * a - lower[r1] * b
    d = x[k + 3] - lower[r0 + 2] * a - lower[r1 + 1] * b - lower[r2] * c
    upper[0] = a
    upper[1] = b
    upper[2] = c
    upper[3] = d
    for i in range(4):
        x[k + i] = 0.0
    count = l_start[k + 4] - r3
    if count == 0:
        return
    la = lower[r0 + 3 :]
    lb = lower[r1 + 2 :]
    lc = lower[r2 + 1 :]
    ld = lower[r3:]
    first = l_row[r3]
    if l_row[r3 + count - 1] - first == count - 1:  # a full column needs no list of rows
        y = x[first:]
        for i in range(count):
            y[i] = y[i] - la[i] * a - lb[i] * b - lc[i] * c - ld[i] * d
    else:
        rows = l_row[r3:]
        for i in range(count):
            x[rows[i]] = x[rows[i]] - la[i] * a - lb[i] * b - lc[i] * c - ld[i] * d


def complex_factors(p: Pattern, re: float, im: float, entries: Floats) -> int:
    """Factorise (re + i im) M - J."""
    n = p.n
    x = p.x
    xi = p.xi
    scale = p.scale_complex
    for i in range(n):
        scale[i] = 0.0
    for k in range(p.start[n]):
        a = complex_part(p, k, re, entries)
        b = im if p.shifted[k] != 0 else 0.0
        scale[p.row[k]] = max(scale[p.row[k]], sqrt(a * a + b * b))
    for i in range(n):
        size = scale[i]
        scale[i] = 1.0 / size if size > 0.0 and isfinite(size) else 1.0
    for j in range(n):
        for k in range(p.start[j], p.start[j + 1]):
            row = p.row[k]
            x[row] = complex_part(p, k, re, entries) * scale[row]
            xi[row] = (im if p.shifted[k] != 0 else 0.0) * scale[row]
        take_columns(p, j)
        answer = close_column(p, j)
        if answer != FINE:
            return answer
    return FINE


def complex_part(p: Pattern, k: int, re: float, entries: Floats) -> float:
    """Return the real part of the matrix at a place of its pattern."""
    value = re if p.shifted[k] != 0 else 0.0
    if p.entry[k] >= 0:
        value -= entries[p.entry[k]]
    return value


def take_columns(p: Pattern, j: int) -> None:
    """Subtract the earlier columns of L from a column; the remainder above the diagonal belongs to U."""
    x = p.x
    xi = p.xi
    lr = p.lower_re
    li = p.lower_im
    l_start = p.l_start
    l_row = p.l_row
    q = p.u_start[j]
    end = p.u_start[j + 1]
    while q < end:
        k = p.u_row[q]
        if q + 1 < end and p.wide[k] >= 2 and p.u_row[q + 1] == k + 1:
            two_columns(p, k, q)
            q += 2
        else:
            a = x[k]
            b = xi[k]
            x[k] = 0.0
            xi[k] = 0.0
            p.upper_re[q] = a
            p.upper_im[q] = b
            if a != 0.0 or b != 0.0:
                for r in range(l_start[k], l_start[k + 1]):
                    i = l_row[r]
                    x[i] -= lr[r] * a - li[r] * b
                    xi[i] -= lr[r] * b + li[r] * a
            q += 1


def close_column(p: Pattern, j: int) -> int:
    """Divide the remainder of a column by its pivot, which gives L; return `FINE` or the reason why the pivot is not usable."""
    x = p.x
    xi = p.xi
    pr = x[j]
    pi = xi[j]
    x[j] = 0.0
    xi[j] = 0.0
    size = pr * pr + pi * pi
    largest = 0.0
    for r in range(p.l_start[j], p.l_start[j + 1]):
        i = p.l_row[r]
        a = x[i]
        b = xi[i]
        largest = max(largest, a * a + b * b)
        p.lower_re[r] = (a * pr + b * pi) / size if size != 0.0 else 0.0
        p.lower_im[r] = (b * pr - a * pi) / size if size != 0.0 else 0.0
        x[i] = 0.0
        xi[i] = 0.0
    p.diagonal_re[j] = pr
    p.diagonal_im[j] = pi
    if size == 0.0 or not isfinite(size) or not isfinite(largest):
        return SINGULAR if p.tolerant != 0 or size != 0.0 else ANEW
    if p.tolerant == 0 and size < p.small * p.small * largest:
        return ANEW
    return FINE


def two_columns(p: Pattern, k: int, q: int) -> None:
    """Subtract two columns of complex numbers from `k` on, as `four_columns`; their entries of U are at `q`."""
    x = p.x
    xi = p.xi
    lr = p.lower_re
    li = p.lower_im
    l_start = p.l_start
    l_row = p.l_row
    ur = p.upper_re[q:]
    ui = p.upper_im[q:]
    r0 = l_start[k]
    r1 = l_start[k + 1]
    a = x[k]
    b = xi[k]
    c = x[k + 1] - (lr[r0] * a - li[r0] * b)
    d = xi[k + 1] - (lr[r0] * b + li[r0] * a)
    ur[0] = a
    ui[0] = b
    ur[1] = c
    ui[1] = d
    for i in range(2):
        x[k + i] = 0.0
        xi[k + i] = 0.0
    count = l_start[k + 2] - r1
    if count == 0:
        return
    ar = lr[r0 + 1 :]
    ai = li[r0 + 1 :]
    br = lr[r1:]
    bi = li[r1:]
    first = l_row[r1]
    if l_row[r1 + count - 1] - first == count - 1:
        y = x[first:]
        yi = xi[first:]
        for i in range(count):
            y[i] = y[i] - (ar[i] * a - ai[i] * b) - (br[i] * c - bi[i] * d)
            yi[i] = yi[i] - (ar[i] * b + ai[i] * a) - (br[i] * d + bi[i] * c)
    else:
        rows = l_row[r1:]
        for i in range(count):
            r = rows[i]
            x[r] = x[r] - (ar[i] * a - ai[i] * b) - (br[i] * c - bi[i] * d)
            xi[r] = xi[r] - (ar[i] * b + ai[i] * a) - (br[i] * d + bi[i] * c)


def real_back(p: Pattern, x: Floats) -> None:
    """Replace the right-hand side by the solution."""
    n = p.n
    y = p.y
    lower = p.lower
    upper = p.upper
    l_row = p.l_row
    u_row = p.u_row
    for i in range(n):
        y[p.row_place[i]] = x[i] * p.scale[p.row_place[i]]
    for j in range(n):
        by = y[j]
        if by != 0.0:
            for r in range(p.l_start[j], p.l_start[j + 1]):
                y[l_row[r]] -= lower[r] * by
    for j in range(n - 1, -1, -1):
        by = y[j] / p.diagonal[j]
        y[j] = by
        for q in range(p.u_start[j], p.u_start[j + 1]):
            y[u_row[q]] -= upper[q] * by
    for i in range(n):
        x[i] = y[p.column_place[i]]


def complex_back(p: Pattern, xr: Floats, xi: Floats) -> None:
    """Replace the right-hand side by the solution."""
    n = p.n
    y = p.y
    yi = p.yi
    lr = p.lower_re
    li = p.lower_im
    ur = p.upper_re
    ui = p.upper_im
    l_row = p.l_row
    u_row = p.u_row
    for i in range(n):
        place = p.row_place[i]
        y[place] = xr[i] * p.scale_complex[place]
        yi[place] = xi[i] * p.scale_complex[place]
    for j in range(n):
        a = y[j]
        b = yi[j]
        for r in range(p.l_start[j], p.l_start[j + 1]):
            i = l_row[r]
            y[i] -= lr[r] * a - li[r] * b
            yi[i] -= lr[r] * b + li[r] * a
    for j in range(n - 1, -1, -1):
        pr = p.diagonal_re[j]
        pi = p.diagonal_im[j]
        size = pr * pr + pi * pi
        a = (y[j] * pr + yi[j] * pi) / size
        b = (yi[j] * pr - y[j] * pi) / size
        y[j] = a
        yi[j] = b
        for q in range(p.u_start[j], p.u_start[j + 1]):
            i = u_row[q]
            y[i] -= ur[q] * a - ui[q] * b
            yi[i] -= ur[q] * b + ui[q] * a
    for i in range(n):
        xr[i] = y[p.column_place[i]]
        xi[i] = yi[p.column_place[i]]
