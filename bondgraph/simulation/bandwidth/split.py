"""Where a run stands: which of its motions are faster than the bandwidth, and how a state splits into those and the others.

The fast motions are the invariant subspace of the eigenvalues beyond the circle of the bandwidth, of the Jacobian with the unknowns of
loops eliminated. Its projector needs the fast eigenvectors alone, right and left ones: what is slow may have Jordan blocks (rigid motion).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..loops.loops import Eliminated
from ..steps.exponential import balance

if TYPE_CHECKING:
    from ..stretch.integrate import Stepper

LARGEST = 200  # states up to which all eigenvectors are computed
TOLD_APART = 1e-8  # the least singular value of the products of left and right vectors of unit length
STEADY = 1e-8  # of its rate: what rounding may make a motion grow by
GROWN = 1.0  # powers of e by which a fast motion may grow in a run and still be left out


@dataclass(frozen=True, eq=False)
class Split:
    """n states over their magnitudes, m fast eigenvalues. `matrix` (n, n); `values` (m,) in 1/s; `right` (n, m), `dual` (m, n) with dual right = 1."""

    matrix: Any
    values: Any
    right: Any
    dual: Any
    slowest: float  # the rate of the fastest motion that is kept, 1/s

    @property
    def slow(self) -> Any:
        """The projector onto what is not fast."""
        return np.eye(len(self.matrix)) - (self.right @ self.dual).real

    def envelope(self, change: Any) -> Any:
        """The largest that each state gets by the fast part of a change, whatever the phases of its modes."""
        return np.abs(self.right) @ np.abs(self.dual @ change)

    @property
    def inverse(self) -> Any:
        """The inverse of the matrix on the fast motions, zero on the others."""
        return (self.right / self.values @ self.dual).real

    def grows(self, span: float) -> bool:
        """Whether a fast motion grows within so many seconds."""
        real = self.values.real
        return bool((real > np.maximum(GROWN / span, STEADY * np.abs(self.values))).any())


class Flow:
    """A program as rates of states over `magnitude` (n,), whatever unknowns its loops have. Magnitudes are found where it is looked at first."""

    def __init__(self, stepper: Stepper) -> None:
        self.stepper, self.program = stepper, stepper.program
        self.count = len(self.program.states.names)
        self.magnitude: Any = None
        self.fixed = (stepper.inputs, stepper.constants)
        self.eliminated = Eliminated(self.program)

    def whole(self, times: Any, scaled: Any, mode: Any, near: Any) -> Any:
        """States and unknowns in SI; `scaled` (k, n) at `times` (k,), `near` (k, …): states whose unknowns are a guess."""
        states = np.concatenate([scaled * self.magnitude, near[:, self.count :]], axis=1)
        return self.stepper.loops.solve_all(times, states, mode)

    def rates(self, times: Any, scaled: Any, mode: Any, near: Any) -> Any:
        """Shape (k, n), for states over their magnitudes."""
        found = self.program.derivative(times, self.whole(times, scaled, mode, near), *self.fixed, mode)
        return np.asarray(found)[:, : self.count] / self.magnitude

    def matrix(self, time: float, state: Any, mode: Any) -> Any:
        """The Jacobian (n, n) of the rates, unknowns following; None where it is not finite. `state`: in SI, with its unknowns."""
        size, n = len(state), self.count
        whole = np.zeros((size, size))
        whole[self.program.pattern] = self.eliminated.entries(time, state, *self.fixed, mode)
        if not np.isfinite(whole).all():
            return None
        found = whole[:n, :n]
        if size > n:
            rows = np.abs(whole[n:]).max(axis=1, keepdims=True)
            below = whole[n:] / np.where(rows > 0, rows, 1.0)
            try:
                found = found - whole[:n, n:] @ np.linalg.solve(below[:, n:], below[:, :n])
            except np.linalg.LinAlgError:
                return None
        if self.magnitude is None:
            self.magnitude = balance(found)
        return found * self.magnitude / self.magnitude[:, None]

    def split(self, time: float, state: Any, mode: Any, bandwidth: float) -> Split | str:
        """The motions faster than a bandwidth in Hz, at a state in SI; or why they are not told from the others."""
        if self.count > LARGEST:
            return f"it has {self.count} states, of which up to {LARGEST} are split into fast and slow ones"
        matrix = self.matrix(time, state, mode)
        return "its slopes are not finite" if matrix is None else split(matrix, 2 * np.pi * bandwidth)


def split(matrix: Any, rate: float) -> Split | str:
    """Split at a rate in 1/s; or why that is not possible."""
    try:
        values, right = np.linalg.eig(matrix)
        size = np.abs(values)
        chosen = np.flatnonzero(size > rate)
        slowest = float(size[size <= rate].max(initial=0.0))
        if not len(chosen):
            return Split(matrix, values[chosen], right[:, chosen], right[:, chosen].T, slowest)
        others, left = np.linalg.eig(matrix.T)
        left = left[:, np.argsort(-np.abs(others), kind="stable")[: len(chosen)]]
        right = right[:, chosen].astype(complex)
        products = left.T @ right
        if np.linalg.svd(products, compute_uv=False).min() < TOLD_APART:
            return "its fast motions hang together in one that has no modes"
        dual = np.linalg.solve(products, left.T)
    except np.linalg.LinAlgError:
        return "its modes are not found"
    return Split(matrix, values[chosen].astype(complex), right, dual, slowest)
