"""How far a free linear motion from a state goes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

LARGEST = 200  # states up to which the modes are computed
WELL_TOLD = 1e6  # condition of their shapes up to which they are told apart


def balance(matrix: Any, compiled: bool) -> tuple[Any, Any]:
    """A matrix balanced, and the powers of two that do it; by machine code or by its source."""
    from ..steps.compiled.balancing import balance

    count = len(matrix)
    if not compiled:
        entries, scale = matrix.ravel().tolist(), [1.0] * count
        balance(count, entries, scale)
        return np.array(entries).reshape(count, count), np.array(scale)
    from ...door import address_of
    from ..steps.compiled.code import POINTER, WHOLE, called

    a, powers = np.array(matrix, dtype=float), np.ones(count)
    called("balance", None, WHOLE, POINTER, POINTER)(count, address_of(a), address_of(powers))
    return a, powers


@dataclass(frozen=True, slots=True)
class FreeMotion:
    """The modes of a linear motion: each state reaches at most the sum of their amplitudes. Arrays (n, n), (n, n), (n,)."""

    amplitudes: Any
    inverse: Any
    scale: Any
    fastest: float  # of its rates, 1/s
    matrix: Any  # in units of the scale

    def __call__(self, x: Any) -> Any:
        return self.amplitudes @ np.abs(self.inverse @ (x / self.scale)) * self.scale

    def rest(self, rates: Any) -> Any | None:
        """How far away, by the Jacobian, lies what has no rates; None where nothing holds it."""
        try:
            away = -np.linalg.solve(self.matrix, rates / self.scale) * self.scale
        except np.linalg.LinAlgError:
            return None
        return away if np.isfinite(away).all() else None

    def is_slower_than(self, rate: float, jacobians: Any) -> bool:
        """Whether all modes of other Jacobians, shape (…, n, n), are; those with numbers that are not finite count for nothing."""
        finite = jacobians[np.isfinite(jacobians).all(axis=(-2, -1))]
        sums = np.abs(finite * self.scale / self.scale[:, None]).sum(axis=-1)
        if sums.max(initial=0.0) <= rate:  # a bound
            return True
        return bool(np.abs(np.linalg.eigvals(finite)).max(initial=0.0) <= rate)


def along(reach: FreeMotion, basis: Any | None, size: int) -> Callable[[Any], Any]:
    """The same for all of a state whose motions lie along the columns of a basis."""
    if basis is None:
        return reach
    count = len(basis)
    return lambda x: np.concatenate([np.abs(basis) @ reach(basis.T @ x[:count]), np.zeros(size - count)])


def free_motion(jacobian: Any, compiled: bool) -> FreeMotion | None:
    """The free linear motion of a state; None where its modes are too many, or too close to each other to tell their amplitudes apart.

    `compiled`: whether there is machine code for it.
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
