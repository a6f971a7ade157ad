"""Zero of a function of one number between two places (Chandrupatla, Advances in Engineering Software 28, 1997)."""

from __future__ import annotations

from collections.abc import Callable

MOST = 200  # evaluations; bisection alone needs about a hundred for any two doubles

Place = tuple[float, float]  # a place and the value there


def crossing(function: Callable[[float], float], low: float, high: float, tolerance: float) -> float:
    """Return a zero between two places with different signs, to `tolerance`."""
    low, high = float(low), float(high)
    (a, at_a), (b, at_b) = narrowed(function, (low, function(low)), (high, function(high)), tolerance)
    return a if abs(at_a) < abs(at_b) else b


def narrowed(function: Callable[[float], float], low: Place, high: Place, tolerance: float) -> tuple[Place, Place]:
    """Return two places with different signs, closer than twice the tolerance; by inverse quadratic interpolation where it is safe, else bisection.

    Both are the same place where the function is zero at one of them.
    """
    (b, fb), (a, fa) = low, high
    c, fc, share = a, fa, 0.5
    for _ in range(MOST):
        x = a + share * (b - a)
        fx = function(x)
        if (fx > 0) == (fa > 0):
            c, fc = a, fa
        else:
            c, b, fc, fb = b, a, fb, fa
        a, fa = x, fx
        least = tolerance / abs(b - a) if b != a else 1.0
        if least > 0.5 or fa == 0 or fb == 0:
            break
        xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
        share = 0.5
        if phi * phi < xi and (1 - phi) * (1 - phi) < 1 - xi:  # a power would raise where it overflows
            share = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
        share = min(1 - least, max(least, share))
    return (a, fa), (b, fb)
