"""Indicators of conditions on a part of a step: Chebyshev interpolants, and information on their zeros.

The places are Chebyshev points with both ends (Trefethen, Approximation Theory and Approximation Practice, 2013, chapter 2). A polynomial whose
last coefficients are small beside all others has converged: an oscillation that is too fast for the places, or a kink, leaves them large.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from compiler.api import Array

PLACES = 12  # number of places of a part of a step, with both ends
NODES = np.cos(np.pi * np.arange(PLACES - 1, -1, -1) / (PLACES - 1))
SHARES = 0.5 + 0.5 * NODES  # the places as fractions of a part
DEGREES = np.arange(PLACES)
COEFFICIENTS = np.linalg.inv(np.cos(np.arccos(NODES)[:, None] * DEGREES))  # maps values to coefficients
GRID = 48  # intervals of the finer grid on which a polynomial is evaluated
FINER = 0.5 - 0.5 * np.cos(np.pi * np.arange(GRID + 1) / GRID)
ON_GRID = np.cos(np.arccos(2 * FINER - 1)[:, None] * DEGREES)
LAST = 3  # number of last coefficients that estimate the error
CONVERGED = 1e-3  # largest error, relative to the variation, of a polynomial that is valid between its places
SURE = 4.0  # in units of the error: a larger distance from zero is certain
# Depth of a minimum below the lowest place of the grid, in units of the height of the higher place beside it: a parabola has 9/16 beside an end, where an
# interval is three times the one before it, and 1/8 where they are equal.
DEPTH = 0.75
LEFT = 64.0  # in units of the rounding of an indicator: as far from its zero it may be where a step begins with one
EXACT = 1e-9  # relative to the variation: a smaller part does not reduce this error


@dataclass(frozen=True, slots=True)
class Interpolants:
    """Polynomials through numbers at the places: coefficients (PLACES, …), error and variation of each."""

    coefficients: Array
    error: Array
    variation: Array

    @classmethod
    def through(cls, values: Array) -> Interpolants:
        """Return the polynomials through the values at the places; shape (PLACES, …)."""
        coefficients = COEFFICIENTS @ np.where(np.isfinite(values), values, 0.0)
        size = np.abs(coefficients)
        return cls(coefficients, size[-LAST:].sum(axis=0), size[1:].sum(axis=0))
