"""Balancing of a matrix, in the subset that becomes machine code: see `start.motion.balance`."""

from __future__ import annotations

from math import isfinite, sqrt

from compiler.api import Floats

LESS = 0.95  # largest ratio of the sums of the norms for which a factor is applied
ROOT = sqrt(2.0)
MOST = 100  # most passes over all rows


def balance(n: int, a: Floats, scale: Floats) -> None:
    """Balance a matrix by powers of two on columns, and inversely on rows (Parlett and Reinsch 1969, as LAPACK's gebal).

    `a`, n n row by row, becomes the balanced matrix; `scale`, n, must be ones at first.
    """
    for _ in range(MOST):
        changed = 0
        for i in range(n):
            column = 0.0
            row = 0.0
            for j in range(n):
                column += a[j * n + i] * a[j * n + i]
                row += a[i * n + j] * a[i * n + j]
            column = sqrt(column)
            row = sqrt(row)
            factor = power_of_two(sqrt(row) / sqrt(column)) if column > 0.0 and row > 0.0 else 1.0
            if isfinite(column + row) and column * factor + row / factor < LESS * (column + row):
                changed += 1
                scale[i] *= factor
                for j in range(n):
                    a[i * n + j] /= factor
                for j in range(n):
                    a[j * n + i] *= factor
        if changed == 0:
            return


def power_of_two(x: float) -> float:
    """Return the power of two nearest to x, by ratio; 1 if x is not finite."""
    found = 1.0
    if not isfinite(x) or x <= 0.0:
        return found
    while found * ROOT < x:
        found *= 2.0
    while found > x * ROOT:
        found *= 0.5
    return found
