"""Solution of x' = r, r' = A r + c over any time, from tables of matrix exponentials of lengths that double.

A length is a sum of tabulated ones and a rest that is shorter than the shortest of them, which Taylor's series takes. The rates r are carried along
with the states: where a stiff matrix has lost the digits of slow motions, the rates from which a step begins still have them.
"""

from __future__ import annotations

from math import pow

from compiler.api import Floats, Ints, Record, sized

MATRICES = 4  # number of matrices whose tables are stored
LEVELS = 40  # most lengths of each
LARGEST = 32  # most states
SMALL = 2.0**-5  # norm of the matrix times the shortest length
SQUARED = 4  # times that a matrix is squared for a bound of its fastest mode
TERMS = 10  # of Taylor's series: the remainder is below 1e-19 at that norm
LEAST, MOST = 2.0**-200, 2.0**60  # bounds of the shortest length, s


class ExponentialTables(Record):
    """Tables for some matrices, each found by its entries."""

    n: int
    entry_count: int
    used: int  # the matrix in use
    newest: int  # the one stored last
    filled: Ints = sized(MATRICES)  # number of lengths so far
    unit: Floats = sized(MATRICES)  # the shortest length
    fastest: Floats = sized(MATRICES)  # bound of the rate of the fastest mode
    entries: Floats = sized(MATRICES, "entry_count")
    matrix: Floats = sized(MATRICES, "n", "n")
    growth: Floats = sized(MATRICES, LEVELS, "n", "n")  # exp(A h) - 1
    once: Floats = sized(MATRICES, LEVELS, "n", "n")  # integral of exp(A s) over [0, h]
    twice: Floats = sized(MATRICES, LEVELS, "n", "n")  # integral of (h - s) exp(A s)
    drift: Floats = sized("n")  # c
    drifts: int  # 0 if c is zero
    rate: Floats = sized("n")  # r
    by_rate: Floats = sized("n")  # work space
    by_drift: Floats = sized("n")  # the same


def use_matrix(t: ExponentialTables, rows: Ints, columns: Ints, entries: Floats) -> None:
    """Use the tables of the matrix with these entries; begin them if it is new."""
    m = t.entry_count
    for k in range(MATRICES):
        if t.filled[k] > 0 and has_entries(m, t.entries[k * m :], entries):
            t.used = k
            return
    t.newest = t.newest + 1 if t.newest + 1 < MATRICES else 0
    t.used = t.newest
    n = t.n
    own = t.entries[t.used * m :]
    matrix = t.matrix[t.used * n * n :]
    for i in range(n * n):
        matrix[i] = 0.0
    for k in range(m):
        own[k] = entries[k]
        matrix[rows[k] * n + columns[k]] = entries[k]
    put_shortest(t, matrix)


def has_entries(count: int, one: Floats, two: Floats) -> bool:
    """Return True if two arrays have equal numbers."""
    for i in range(count):
        if one[i] != two[i]:
            return False
    return True


def put_shortest(t: ExponentialTables, matrix: Floats) -> None:
    """Choose the shortest length, a power of two, and compute its tables by Taylor's series."""
    n = t.n
    norm = size_of(n, matrix)
    unit = 1.0
    while unit * norm > SMALL and unit > LEAST:
        unit *= 0.5
    while unit * norm <= 0.5 * SMALL and unit < MOST:
        unit *= 2.0
    first = t.used * LEVELS * n * n
    growth = t.growth[first:]
    once = t.once[first:]
    twice = t.twice[first:]
    t.fastest[t.used] = norm
    for i in range(n * n):
        once[i] = matrix[i] / norm if norm > 0.0 else 0.0
    exponent = 1.0
    for _ in range(SQUARED):  # the size of a power is at least that of the largest eigenvalue
        matrix_product(n, once, once, growth)
        exponent *= 0.5
        t.fastest[t.used] = min(t.fastest[t.used], norm * pow(size_of(n, growth), exponent))
        for i in range(n * n):
            once[i] = growth[i]
    for i in range(n * n):
        twice[i] = 0.0
    for i in range(n):
        twice[i * n + i] = 1.0
    for term in range(TERMS, 0, -1):  # Horner's scheme
        matrix_product(n, matrix, twice, growth)
        for i in range(n * n):
            twice[i] = growth[i] * unit / float(term + 2)
        for i in range(n):
            twice[i * n + i] += 1.0
    for i in range(n * n):
        twice[i] *= 0.5 * unit * unit
    matrix_product(n, matrix, twice, once)
    for i in range(n):
        once[i * n + i] += unit
    matrix_product(n, matrix, once, growth)
    t.unit[t.used] = unit
    t.filled[t.used] = 1


def size_of(n: int, matrix: Floats) -> float:
    """Return the largest column sum of absolute values."""
    largest = 0.0
    for j in range(n):
        total = 0.0
        for i in range(n):
            total += abs(matrix[i * n + j])
        largest = max(largest, total)
    return largest


def matrix_product(n: int, a: Floats, b: Floats, out: Floats) -> None:
    """Put the product of two matrices into a third."""
    for i in range(n):
        row = out[i * n :]
        for j in range(n):
            row[j] = 0.0
        for k in range(n):
            factor = a[i * n + k]
            if factor != 0.0:
                other = b[k * n :]
                for j in range(n):
                    row[j] += factor * other[j]


def put_next(t: ExponentialTables) -> None:
    """Compute the tables of twice the longest length so far."""
    n = t.n
    level = t.filled[t.used]
    length = t.unit[t.used]
    for _ in range(level - 1):
        length *= 2.0
    last = (t.used * LEVELS + level - 1) * n * n
    here = last + n * n
    growth = t.growth[last:]
    for part in range(3):
        old = t.twice[last:]
        new = t.twice[here:]
        if part == 1:
            old = t.once[last:]
            new = t.once[here:]
        if part == 2:
            old = growth
            new = t.growth[here:]
        matrix_product(n, growth, old, new)
        for i in range(n * n):
            new[i] += 2.0 * old[i]
    for i in range(n * n):
        t.twice[here + i] += length * t.once[last + i]
    t.filled[t.used] = level + 1


def propagate(t: ExponentialTables, rows: Ints, columns: Ints, span: float, x: Floats) -> None:
    """Carry the state x, and the rates in `rate`, over a time."""
    length = t.unit[t.used]
    level = 0
    while level + 1 < LEVELS and 2.0 * length <= span:
        length *= 2.0
        level += 1
        if t.filled[t.used] <= level:
            put_next(t)
    left = span
    while level >= 0:
        while left >= length:
            carry(t, (t.used * LEVELS + level) * t.n * t.n, x)
            left -= length
        length *= 0.5
        level -= 1
    if left != 0.0:
        carry_by_series(t, rows, columns, left, x)


def carry(t: ExponentialTables, at: int, x: Floats) -> None:
    """Carry state and rates over a tabulated length; `at`: place of its matrices."""
    n = t.n
    growth = t.growth[at:]
    once = t.once[at:]
    twice = t.twice[at:]
    for i in range(n):
        total = 0.0
        change = 0.0
        for j in range(n):
            total += once[i * n + j] * t.rate[j]
            change += growth[i * n + j] * t.rate[j]
        if t.drifts != 0:
            for j in range(n):
                total += twice[i * n + j] * t.drift[j]
                change += once[i * n + j] * t.drift[j]
        x[i] += total
        t.by_rate[i] = change
    for i in range(n):
        t.rate[i] += t.by_rate[i]


def carry_by_series(t: ExponentialTables, rows: Ints, columns: Ints, span: float, x: Floats) -> None:
    """Carry state and rates over a time shorter than the shortest length, by Taylor's series."""
    n = t.n
    entries = t.entries[t.used * t.entry_count :]
    for i in range(n):
        t.by_rate[i] = t.rate[i]
        x[i] += span * t.rate[i]
    factor = 1.0  # span^order / order!
    for order in range(1, TERMS):
        factor *= span / float(order)
        for i in range(n):
            t.by_drift[i] = t.drift[i] if order == 1 else 0.0
        for k in range(t.entry_count):
            t.by_drift[rows[k]] += entries[k] * t.by_rate[columns[k]]
        for i in range(n):
            t.by_rate[i] = t.by_drift[i]
            t.rate[i] += factor * t.by_rate[i]
            x[i] += factor * span / float(order + 1) * t.by_rate[i]
