"""Work along a solution: integrals of powers, with an estimate of the quadrature error."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from compiler.api import Array, BoolArray

# Gauss-Kronrod quadrature on [0, 1] with 3 and 7 places (Piessens et al., QUADPACK, 1983): exact to degree 10.
_PLACES = np.array([0.4342437493468026, 0.7745966692414834, 0.9604912687080202])
_KRONROD = np.array([0.4013974147759622, 0.2684880898683334, 0.1046562260264672])
PLACES = 0.5 + 0.5 * np.concatenate([-_PLACES[::-1], [0.0], _PLACES])
KRONROD = 0.5 * np.concatenate([_KRONROD[::-1], [0.4509165386584741], _KRONROD])
GAUSS = 0.5 * np.array([0, 5 / 9, 0, 8 / 9, 0, 5 / 9, 0])
DEEPEST = 4  # most halvings of a step for its work


def work_of(powers: Callable[[Array], Array], start: float, stop: float, traffic: float, rtol: float) -> tuple[Array, float]:  # fmt: skip
    """Return the work from start to stop at each port, and the sum of its absolute values. `powers`: instants (k,) -> powers (k, ports).

    A part is halved where the two rules differ by more than the tolerance allows. `traffic`: the energy turnover before.
    """

    def over(a: float, b: float, depth: int) -> Array:
        values = powers(a + PLACES * (b - a))
        work = (b - a) * (KRONROD @ values)
        doubt = np.abs((b - a) * (GAUSS @ values) - work) / max(traffic + float(np.abs(work).sum()), 1e-300)
        if depth >= DEEPEST or not too_coarse(doubt, rtol).any():
            return work
        middle = 0.5 * (a + b)
        return over(a, middle, depth + 1) + over(middle, b, depth + 1)

    work = over(start, stop, 0)
    return work, float(np.abs(work).sum())


def too_coarse(doubt: Array, rtol: float) -> BoolArray:
    """Return True if the error of the finer rule is too large. `doubt`: the difference of the rules, relative to all work.

    The difference is the error of the coarser rule; that of the finer one is about (200 times it)^1.5, as in QUADPACK.
    """
    return (200 * doubt) ** 1.5 > 0.1 * rtol
