"""Newton homotopy: from a guess to a solution along the curve F(z) = (1 - share) F(guess), from share 0 to 1.

The curve is followed by its length (pseudo-arclength: Keller, in Applications of Bifurcation Theory, 1977; Allgower and Georg, Introduction to
Numerical Continuation Methods, chapters 4 and 6), not by the share: a law that rises and falls turns it back, and the solution lies behind the
turning point. Steps are measured in the sizes of the unknowns, the equations in the derivatives at the guess.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from compiler.api import Array

STEPS = 200  # most steps in each direction
CORRECTIONS = 6
FIRST = 0.1  # length of the first step, in sizes of the unknowns and units of the share
SMALLEST = 1e-9
CLOSE = 1e-6  # distance from the curve, in the same measure
GROWTH = 2.0
STRAIGHT = 0.7  # least cosine between two tangents: at a sharper bend it may have jumped to another branch

Function = Callable[[Array], Array]


def follow(residual: Function, matrix: Function, guess: Array, magnitude: Array) -> Array | None:
    """Return a point near a solution, shape (n,), from which Newton's method converges; None if the curve does not reach one."""
    rest = residual(guess)
    slopes = matrix(guess)
    if not (np.isfinite(rest).all() and np.isfinite(slopes).all()):
        return None
    rows = np.maximum(np.abs(slopes * magnitude).max(axis=1), np.abs(rest))
    curve = _Curve(residual, matrix, guess, rest, np.where(rows > 0, rows, 1.0), magnitude)
    start = np.append(np.zeros(len(guess)), 0.0)
    way = curve.tangent(start, np.append(np.zeros(len(guess)), 1.0))
    if way is None:
        return None
    onwards = _walk(curve, start, way)
    # a residual that rises at first may fall behind its maximum
    return _walk(curve, start, -way) if onwards is None else onwards


def _walk(curve: _Curve, point: Array, way: Array) -> Array | None:
    """Follow the curve from a point until the share is 1; return None if it does not get there."""
    step = FIRST
    for _ in range(STEPS):
        if step < SMALLEST:
            return None
        length = step * max(1.0, float(np.abs(point[:-1]).max(initial=0.0)))  # far away the steps are larger
        found = curve.corrected(point + length * way, way)
        onwards = None if found is None else curve.tangent(found, way)
        if found is None or onwards is None or not onwards @ way > STRAIGHT:
            step *= 0.5
            continue
        if found[-1] >= 1:
            return curve.unknowns(point + (1 - point[-1]) / (found[-1] - point[-1]) * (found - point))
        point, way, step = found, onwards, step * GROWTH
    return None


class _Curve:
    """Points (y, share): z = guess + magnitude y, with F(z) = (1 - share) F(guess)."""

    def __init__(
        self, residual: Function, matrix: Function, guess: Array, rest: Array, rows: Array, magnitude: Array
    ) -> None:  # fmt: skip
        self.residual, self.matrix, self.guess = residual, matrix, guess
        self.rest, self.rows, self.magnitude = rest, rows, magnitude

    def unknowns(self, point: Array) -> Array:
        return self.guess + self.magnitude * point[:-1]

    def distance(self, point: Array) -> Array:
        return np.asarray((self.residual(self.unknowns(point)) - (1 - point[-1]) * self.rest) / self.rows)

    def slopes(self, point: Array) -> Array:
        """Return the Jacobian of the curve's equations, shape (n, n + 1)."""
        inner = self.matrix(self.unknowns(point)) * self.magnitude
        return np.column_stack([inner, self.rest]) / self.rows[:, None]

    def tangent(self, point: Array, before: Array) -> Array | None:
        """Return the unit tangent of the curve in the direction of the one before; None if there is none."""
        slopes = self.slopes(point)
        return self._solved(slopes, before, np.append(np.zeros(len(slopes)), 1.0), True)

    def corrected(self, point: Array, way: Array) -> Array | None:
        """Return the point of the curve near a predicted one, perpendicular to the direction; None if Newton's method fails."""
        last = np.inf
        for _ in range(CORRECTIONS):
            value = self.distance(point)
            slopes = self.slopes(point)
            step = self._solved(slopes, way, np.append(-value, 0.0), False)
            if step is None:
                return None
            size = float(np.abs(step).max()) / max(1.0, float(np.abs(point[:-1]).max(initial=0.0)))
            if size > 0.5 * last:
                return None
            point, last = point + step, size
            if size < CLOSE:
                return point
        return None

    @staticmethod
    def _solved(slopes: Array, way: Array, right: Array, unit: bool) -> Array | None:
        whole = np.vstack([slopes, way])
        sizes = np.abs(whole).max(axis=1)
        if not (np.isfinite(whole).all() and np.isfinite(right).all() and (sizes > 0).all()):
            return None
        try:
            found = np.linalg.solve(whole / sizes[:, None], right / sizes)
        except np.linalg.LinAlgError:
            return None
        length = float(np.linalg.norm(found))
        if not np.isfinite(length):
            return None
        return found / length if unit else found
