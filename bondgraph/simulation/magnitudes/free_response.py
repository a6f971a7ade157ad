"""Free response: reach of a free linear motion from a state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array, address_of

from ..integrators.compiled.code import POINTER, WHOLE, called
from ..integrators.linear_algebra import balancing

LARGEST = 200  # most states for which the modes are computed
WELL_TOLD = 1e6  # largest condition number of the eigenvectors with which the modes are separable


def balance(matrix: Array, compiled: bool) -> tuple[Any, Any]:
    """Return a matrix balanced, and the powers of two used; by machine code or by its source."""
    count = len(matrix)
    if not compiled:
        entries, scale = matrix.ravel().tolist(), [1.0] * count
        balancing.balance(count, entries, scale)
        return np.array(entries).reshape(count, count), np.array(scale)
    a, powers = np.array(matrix, dtype=float), np.ones(count)
    called("balance", None, WHOLE, POINTER, POINTER)(count, address_of(a), address_of(powers))
    return a, powers


@dataclass(frozen=True, slots=True)
class FreeMotion:
    """Modes of a linear motion: each state reaches at most the sum of their amplitudes. Arrays (n, n), (n, n), (n,)."""

    amplitudes: Any
    inverse: Any
    scale: Any
    fastest: float  # largest of its rates, 1/s
    matrix: Any  # in units of the scale

    def __call__(self, x: Array) -> Any:
        return self.amplitudes @ np.abs(self.inverse @ (x / self.scale)) * self.scale

    def rest(self, rates: Array) -> Any | None:
        """Return the displacement to the point of zero rates according to the Jacobian; None where there is no restoring force."""
        try:
            away = -np.linalg.solve(self.matrix, rates / self.scale) * self.scale
        except np.linalg.LinAlgError:
            return None
        return away if np.isfinite(away).all() else None

    def is_slower_than(self, rate: float, jacobians: Array) -> bool:
        """Return True if all modes of other Jacobians, shape (…, n, n), are slower; Jacobians that are not finite are ignored."""
        finite = jacobians[np.isfinite(jacobians).all(axis=(-2, -1))]
        sums = np.abs(finite * self.scale / self.scale[:, None]).sum(axis=-1)
        if sums.max(initial=0.0) <= rate:  # an upper bound
            return True
        return bool(np.abs(np.linalg.eigvals(finite)).max(initial=0.0) <= rate)


def along(reach: FreeMotion, basis: Any | None, size: int) -> Callable[[Any], Any]:
    """Return the reach for the whole state, whose motions lie along the columns of a basis."""
    if basis is None:
        return reach
    count = len(basis)
    return lambda x: np.concatenate([np.abs(basis) @ reach(basis.T @ x[:count]), np.zeros(size - count)])


def free_motion(jacobian: Array, compiled: bool) -> FreeMotion | None:
    """Return the free linear motion of a state; None if its modes are too many, or too close to each other to separate their amplitudes.

    `compiled`: there is machine code for it.
    """
    if not 0 < len(jacobian) <= LARGEST or not np.isfinite(jacobian).all():
        return None
    balanced, scale = balance(jacobian, compiled)
    try:
        rates, shapes = np.linalg.eig(balanced)
        inverse = np.linalg.inv(shapes)
    except np.linalg.LinAlgError:
        return None
    bound = np.vdot(shapes, shapes).real * np.vdot(inverse, inverse).real
    if not bound <= WELL_TOLD**2 and not np.linalg.cond(shapes) <= WELL_TOLD:
        return None
    return FreeMotion(np.abs(shapes), inverse, scale, float(np.abs(rates).max()), balanced)
