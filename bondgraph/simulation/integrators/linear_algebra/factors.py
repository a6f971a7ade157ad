"""Factors of a small matrix, real or complex: rows scaled, partial pivoting, nonzeros listed, because most entries of a Jacobian are zero.

Matrices are stored row by row, real and imaginary parts in two arrays.
"""

from __future__ import annotations

from math import isfinite

from compiler.api import Floats, Ints, Record, sized


class Factors(Record):
    """A matrix of n rows, and the list of its factors: for each pivot its row of U, then its column of L, in the row order at that time."""

    n: int
    matrix: Floats = sized("n", "n")
    scale: Floats = sized("n")  # scales of the rows
    pivots: Ints = sized("n")  # the later row with which each is exchanged
    inverse: Floats = sized("n")  # inverses of the pivots
    first: Ints = sized(2, "n", plus=1)  # starts of these rows and columns in the list
    where: Ints = sized("n", "n")  # the column, or the row, of each listed item
    item: Floats = sized("n", "n")


class ComplexFactors(Record):
    """The same as `Factors` for complex numbers."""

    n: int
    re: Floats = sized("n", "n")
    im: Floats = sized("n", "n")
    scale: Floats = sized("n")
    pivots: Ints = sized("n")
    inverse_re: Floats = sized("n")
    inverse_im: Floats = sized("n")
    first: Ints = sized(2, "n", plus=1)
    where: Ints = sized("n", "n")
    item_re: Floats = sized("n", "n")
    item_im: Floats = sized("n", "n")


def eliminate(f: Factors) -> bool:
    """Factorise the matrix, which is overwritten; return False if it is singular."""
    n = f.n
    a = f.matrix
    for i in range(n):
        largest = 0.0
        for j in range(n):
            largest = max(largest, abs(a[i * n + j]))
        f.scale[i] = 1.0 / largest if largest > 0.0 and isfinite(largest) else 1.0
        for j in range(n):
            a[i * n + j] *= f.scale[i]
    place = 0
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(a[i * n + k]) > abs(a[best * n + k]):
                best = i
        f.pivots[k] = best
        if best != k:
            swap(a[k * n + k :], a[best * n + k :], n - k)
        pivot = a[k * n + k]
        if pivot == 0.0 or not isfinite(pivot):
            return False
        f.inverse[k] = 1.0 / pivot
        row = place
        f.first[2 * k] = row
        for j in range(k + 1, n):
            value = a[k * n + j]
            if value != 0.0:
                if not isfinite(value):
                    return False
                f.where[place] = j
                f.item[place] = value
                place += 1
        column = place
        f.first[2 * k + 1] = column
        for i in range(k + 1, n):
            if a[i * n + k] != 0.0:
                by = a[i * n + k] / pivot
                if not isfinite(by):
                    return False
                f.where[place] = i
                f.item[place] = by
                place += 1
                if 2 * (column - row) < n - k:
                    for q in range(row, column):
                        a[i * n + f.where[q]] -= by * f.item[q]
                else:
                    for j in range(k + 1, n):
                        a[i * n + j] -= by * a[k * n + j]
    f.first[2 * n] = place
    return True


def back(f: Factors, x: Floats) -> None:
    """Replace the right-hand side by the solution."""
    n = f.n
    for i in range(n):
        x[i] *= f.scale[i]
    for k in range(n):
        best = f.pivots[k]
        value = x[best]
        x[best] = x[k]
        x[k] = value
        if value != 0.0:
            for q in range(f.first[2 * k + 1], f.first[2 * k + 2]):
                x[f.where[q]] -= f.item[q] * value
    for k in range(n - 1, -1, -1):
        value = x[k]
        for q in range(f.first[2 * k], f.first[2 * k + 1]):
            value -= f.item[q] * x[f.where[q]]
        x[k] = value * f.inverse[k]


def is_negative(f: Factors) -> int:
    """Return the sign of a determinant: that of the pivots and of the exchanges of rows."""
    count = 0
    for k in range(f.n):
        if f.inverse[k] < 0.0:
            count += 1
        if f.pivots[k] != k:
            count += 1
    return count % 2


def eliminate_complex(f: ComplexFactors) -> bool:
    """Factorise a complex matrix as `eliminate`."""
    n = f.n
    re = f.re
    im = f.im
    for i in range(n):
        largest = 0.0
        for j in range(n):
            largest = max(largest, abs(re[i * n + j]) + abs(im[i * n + j]))
        f.scale[i] = 1.0 / largest if largest > 0.0 and isfinite(largest) else 1.0
        for j in range(n):
            re[i * n + j] *= f.scale[i]
            im[i * n + j] *= f.scale[i]
    place = 0
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(re[i * n + k]) + abs(im[i * n + k]) > abs(re[best * n + k]) + abs(im[best * n + k]):
                best = i
        f.pivots[k] = best
        if best != k:
            swap(re[k * n + k :], re[best * n + k :], n - k)
            swap(im[k * n + k :], im[best * n + k :], n - k)
        pr = re[k * n + k]
        pi = im[k * n + k]
        size = pr * pr + pi * pi
        if size == 0.0 or not isfinite(size):
            return False
        pr = pr / size
        pi = -pi / size
        f.inverse_re[k] = pr
        f.inverse_im[k] = pi
        row = place
        f.first[2 * k] = row
        for j in range(k + 1, n):
            br = re[k * n + j]
            bi = im[k * n + j]
            if br != 0.0 or bi != 0.0:
                if not isfinite(br) or not isfinite(bi):
                    return False
                f.where[place] = j
                f.item_re[place] = br
                f.item_im[place] = bi
                place += 1
        column = place
        f.first[2 * k + 1] = column
        for i in range(k + 1, n):
            ar = re[i * n + k]
            ai = im[i * n + k]
            if ar != 0.0 or ai != 0.0:
                br = ar * pr - ai * pi
                bi = ar * pi + ai * pr
                if not isfinite(br) or not isfinite(bi):
                    return False
                f.where[place] = i
                f.item_re[place] = br
                f.item_im[place] = bi
                place += 1
                for q in range(row, column):
                    j = i * n + f.where[q]
                    re[j] -= br * f.item_re[q] - bi * f.item_im[q]
                    im[j] -= br * f.item_im[q] + bi * f.item_re[q]
    f.first[2 * n] = place
    return True


def back_complex(f: ComplexFactors, xr: Floats, xi: Floats) -> None:
    """Replace a complex right-hand side as `back`."""
    n = f.n
    for i in range(n):
        xr[i] *= f.scale[i]
        xi[i] *= f.scale[i]
    for k in range(n):
        best = f.pivots[k]
        a = xr[best]
        b = xi[best]
        xr[best] = xr[k]
        xi[best] = xi[k]
        xr[k] = a
        xi[k] = b
        for q in range(f.first[2 * k + 1], f.first[2 * k + 2]):
            i = f.where[q]
            xr[i] -= f.item_re[q] * a - f.item_im[q] * b
            xi[i] -= f.item_re[q] * b + f.item_im[q] * a
    for k in range(n - 1, -1, -1):
        a = xr[k]
        b = xi[k]
        for q in range(f.first[2 * k], f.first[2 * k + 1]):
            j = f.where[q]
            a -= f.item_re[q] * xr[j] - f.item_im[q] * xi[j]
            b -= f.item_re[q] * xi[j] + f.item_im[q] * xr[j]
        xr[k] = a * f.inverse_re[k] - b * f.inverse_im[k]
        xi[k] = a * f.inverse_im[k] + b * f.inverse_re[k]


def swap(a: Floats, b: Floats, n: int) -> None:
    """Exchange two rows."""
    for j in range(n):
        kept = a[j]
        a[j] = b[j]
        b[j] = kept
