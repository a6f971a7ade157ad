"""How far a free linear motion from a state goes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

LARGEST = 200  # states up to which the modes are computed


def balance(matrix: Any) -> Any:
    """Powers of two by which columns, and rows divided, come to like norms (Parlett and Reinsch 1969, as LAPACK's gebal does it)."""
    a, scale, again = np.array(matrix, dtype=float), np.ones(len(matrix)), True
    while again:
        again = False
        for i in range(len(a)):
            column, row = math.sqrt(a[:, i] @ a[:, i]), math.sqrt(a[i] @ a[i])
            if not (0 < column < np.inf and 0 < row < np.inf):
                continue
            # The power of two next to the root of their ratio.
            factor = 2.0 ** round(0.5 * (np.log2(row) - np.log2(column)))
            if column * factor + row / factor < 0.95 * (column + row):
                again = True
                scale[i] *= factor
                a[i] /= factor
                a[:, i] *= factor
    return scale


@dataclass(frozen=True, slots=True)
class FreeMotion:
    """The modes of a linear motion: each state reaches at most the sum of their amplitudes. Arrays (n, n), (n, n), (n,)."""

    amplitudes: Any
    inverse: Any
    scale: Any

    def __call__(self, x: Any) -> Any:
        return self.amplitudes @ np.abs(self.inverse @ (x / self.scale)) * self.scale

    def rest(self, jacobian: Any, rates: Any) -> Any | None:
        """How far away, by the Jacobian, lies what has no rates; None where nothing holds it."""
        try:
            away = -np.linalg.solve(jacobian * self.scale / self.scale[:, None], rates / self.scale) * self.scale
        except np.linalg.LinAlgError:
            return None
        return away if np.isfinite(away).all() else None


def along(reach: FreeMotion, basis: Any | None, size: int) -> Callable[[Any], Any]:
    """The same for all of a state whose motions lie along the columns of a basis."""
    if basis is None:
        return reach
    count = len(basis)
    return lambda x: np.concatenate([np.abs(basis) @ reach(basis.T @ x[:count]), np.zeros(size - count)])


def free_motion(jacobian: Any) -> FreeMotion | None:
    """The free linear motion of a state; None where its modes are too many, or too close to each other to tell their amplitudes apart."""
    if not 0 < len(jacobian) <= LARGEST or not np.isfinite(jacobian).all():
        return None
    scale = balance(jacobian)
    try:
        _, shapes = np.linalg.eig(jacobian * scale / scale[:, None])
        inverse = np.linalg.inv(shapes)
    except np.linalg.LinAlgError:
        return None
    if np.linalg.cond(shapes) > 1e6:
        return None
    return FreeMotion(np.abs(shapes), inverse, scale)
