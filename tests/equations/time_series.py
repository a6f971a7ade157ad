"""Truncated Taylor series in time: a residual evaluated on them gives its own derivatives in time, to round-off.

Only the functions in the laws of the random graphs: sums, products, quotients, sin, cos, sinh, cosh, tanh, exp. The recurrences are those
of Griewank and Walther, Evaluating Derivatives, chapter 13.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Array = Any


class Series:
    """Coefficients c[k] of t^k, each an array of any shape; longer products are cut."""

    __array_ufunc__ = None  # numpy leaves sums and products with arrays to this class
    __slots__ = ("c",)

    def __init__(self, coefficients: Array) -> None:
        self.c = coefficients

    def _other(self, other: Any) -> Array:
        if isinstance(other, Series):
            return other.c
        constant = np.zeros_like(self.c)
        constant[0] = other
        return constant

    def __add__(self, other: Any) -> Series:
        return Series(self.c + self._other(other))

    __radd__ = __add__

    def __neg__(self) -> Series:
        return Series(-self.c)

    def __sub__(self, other: Any) -> Series:
        return Series(self.c - self._other(other))

    def __rsub__(self, other: Any) -> Series:
        return Series(self._other(other) - self.c)

    def __mul__(self, other: Any) -> Series:
        if not isinstance(other, Series):
            return Series(self.c * other)
        a, b = self.c, other.c
        return Series(np.array([sum(a[i] * b[k - i] for i in range(k + 1)) for k in range(len(a))]))

    __rmul__ = __mul__


def _paired(x: Series, first: Any, second: Any, sign: float) -> tuple[Series, Series]:
    """u' = v x', v' = sign u x': sine with cosine, sinh with cosh."""
    a = x.c
    u, v = np.zeros_like(a), np.zeros_like(a)
    u[0], v[0] = first(a[0]), second(a[0])
    for k in range(1, len(a)):
        u[k] = sum(i * a[i] * v[k - i] for i in range(1, k + 1)) / k
        v[k] = sign * sum(i * a[i] * u[k - i] for i in range(1, k + 1)) / k
    return Series(u), Series(v)


def sin(x: Any) -> Any:
    return _paired(x, np.sin, np.cos, -1.0)[0] if isinstance(x, Series) else np.sin(x)


def sinh(x: Any) -> Any:
    return _paired(x, np.sinh, np.cosh, 1.0)[0] if isinstance(x, Series) else np.sinh(x)


def exp(x: Any) -> Any:
    if not isinstance(x, Series):
        return np.exp(x)
    a, u = x.c, np.zeros_like(x.c)
    u[0] = np.exp(a[0])
    for k in range(1, len(a)):
        u[k] = sum(i * a[i] * u[k - i] for i in range(1, k + 1)) / k
    return Series(u)
