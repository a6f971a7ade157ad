"""Indicators of conditions on a part of a step: Chebyshev interpolants, and information on their zeros.

The places are Chebyshev points with both ends (Trefethen, Approximation Theory and Approximation Practice, 2013, chapter 2). A polynomial whose
last coefficients are small beside all others has converged: an oscillation that is too fast for the places, or a kink, leaves them large.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from compiler.api import Array, BoolArray

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
LEFT = 64.0  # in units of the rounding of an indicator: as far from its zero it may be where a step begins with one
EXACT = 1e-9  # relative to the variation: a smaller part does not reduce this error


@dataclass(frozen=True, slots=True)
class Interpolants:
    """Polynomials of all indicators on a part of a step: coefficients (PLACES, conditions), error and variation of each (conditions,).

    `finite`: mask of the values; `converged`: of the polynomials that are accurate between their places.
    """

    values: Array
    finite: BoolArray
    coefficients: Array
    error: Array
    variation: Array
    converged: BoolArray

    @classmethod
    def through(cls, values: Array) -> Interpolants:
        """Return the polynomials through the values at the places; shape (PLACES, conditions)."""
        finite = np.isfinite(values)
        coefficients = COEFFICIENTS @ np.where(finite, values, 0.0)
        size = np.abs(coefficients)
        error, variation = size[-LAST:].sum(axis=0), size[1:].sum(axis=0)
        return cls(
            values, finite, coefficients, error, variation, (error <= CONVERGED * variation) & finite.all(axis=0)
        )

    def far(self, floor: Array) -> BoolArray:
        """Return a mask of the indicators without a zero: the mean exceeds all variation, all values are below rounding, or no value is finite."""
        middle = np.abs(self.coefficients[0])
        around = np.where(self.converged, self.variation + SURE * self.error, 2 * self.variation)
        still = (np.abs(self.values) < floor).all(axis=0)
        return np.asarray(((middle > around) & self.finite.all(axis=0)) | still | ~self.finite.any(axis=0))

    def dips(self, values: Array, left: BoolArray) -> BoolArray:
        """Return a mask of the grid places near which a polynomial, with these values there, may touch or cross zero; shape as the values.

        `left`: mask of the indicators that begin at zero, as after an event: that zero is none of these.
        """
        distance = np.abs(values)
        here, beside = distance[1:-1], np.maximum(distance[:-2], distance[2:])
        least = (here <= distance[:-2]) & (here <= distance[2:])
        near = here - 0.5 * (beside - here) < SURE * self.error
        found = np.zeros(values.shape, dtype=bool)
        found[1:-1] = least & near & (here < beside)
        found[-1] = distance[-1] < SURE * self.error
        found[0] = (distance[0] < SURE * self.error) & ~left
        return found
