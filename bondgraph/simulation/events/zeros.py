"""Where a function of one number crosses zero between two places (Chandrupatla, Advances in Engineering Software 28, 1997)."""

from __future__ import annotations

from collections.abc import Callable

MOST = 200  # evaluations; bisection alone needs some hundred for any two doubles


def crossing(function: Callable[[float], float], low: float, high: float, tolerance: float) -> float:
    """A zero between two places at which the signs differ, to `tolerance`; inverse quadratic interpolation where it is safe, else halving."""
    b, a = float(low), float(high)
    fb, fa = function(b), function(a)
    c, fc, share = a, fa, 0.5
    for _ in range(MOST):
        x = a + share * (b - a)
        fx = function(x)
        if (fx > 0) == (fa > 0):
            c, fc = a, fa
        else:
            c, b, fc, fb = b, a, fb, fa
        a, fa = x, fx
        best = a if abs(fa) < abs(fb) else b
        least = tolerance / abs(b - a) if b != a else 1.0
        if least > 0.5 or fa == 0 or fb == 0:
            return best
        xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
        share = 0.5
        if phi**2 < xi and (1 - phi) ** 2 < 1 - xi:
            share = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
        share = min(1 - least, max(least, share))
    return best
