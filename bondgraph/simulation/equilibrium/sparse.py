"""Equilibrium search for a large model: the same steps as in `dense.py`, with sparse factors.

Conserved quantities (dependent rates) and directions without restoring force (in which no rate changes) are the two null spaces of the
Jacobian. They are found by inverse iteration with a matrix perturbed at random, a few columns at once; they border the Jacobian, which is then
regular (Govaerts, Numerical Methods for Bifurcations, 2000, chapter 3), and are refined with it. If there are more than a few, the dense
search is used.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from compiler.api import Array

from ...errors import RunFailed
from ...numerics.scales import nonzero, null_basis
from .dense import CLOSE, SINGULAR, VECTORS, EquilibriumSearch

OFF = 1e-10  # relative to the largest entries: size of the perturbation
COLUMNS = (4, 16, 64)  # numbers of columns; more are used where all of the first are null vectors
ROUNDS = 2  # inverse iterations
FOUND = 10 * OFF  # largest product of the perturbed matrix with a null vector
POWERS = 32  # power iterations for the largest eigenvalue


class SparseSearch(EquilibriumSearch):
    """Search with sparse Jacobians, stored by columns."""

    def at(self, full: Array) -> tuple[Any, Any, Any]:
        """Return the same as `EquilibriumSearch.at`."""
        from scipy.sparse import csc_array, diags_array

        full = self.loops.solve(self.time, full, self.mode)
        self.leave_unread(full)
        slope = self.rates(full)
        entries = np.asarray(self.program.jacobian_entries(self.time, full, *self.fixed), dtype=float)
        whole = csc_array((entries, self.program.pattern), shape=(len(full), len(full)))
        self.loop_terms = np.abs(whole[: self.count, self.count :]) @ np.abs(full[self.count :])
        self.largest = np.maximum(self.largest, np.abs(full[: self.count]))
        jacobian = (self._reduced(whole) - diags_array(self.drag)).tocsc() if self.drag.any() else self._reduced(whole)
        return full, slope, _scaled(jacobian, np.where(self.unread, 0.0, 1.0), 1) if self.unread.any() else jacobian

    def _reduced(self, whole: Any) -> Any:
        """Return the derivatives by the states alone, with the unknowns of loops eliminated. Raises `RunFailed`."""
        from scipy.sparse import csc_array

        n = self.count
        if whole.shape[0] == n:
            return whole
        followed = self._factors(whole[n:, n:].tocsc()).solve(whole[n:, :n].toarray())
        return (whole[:n, :n] - whole[:n, n:] @ csc_array(followed)).tocsc()

    @staticmethod
    def _factors(matrix: Any) -> Any:
        """Return the LU factors of a sparse matrix. Raises `RunFailed` if it is singular or not finite."""
        from scipy.sparse.linalg import splu

        if not np.isfinite(matrix.data).all():
            raise RunFailed("BR751", "the Jacobian has no numbers there")
        try:
            return splu(matrix)
        except RuntimeError as singular:
            raise RunFailed("BR752", f"the Jacobian is singular there ({singular})") from singular

    def fastest(self, jacobian: Any) -> float:
        """Return at least the largest eigenvalue: that of the matrix of absolute values, by power iteration, which is independent of units."""
        size, power, grown = np.abs(jacobian), self.scale(np.zeros(self.count)), 0.0
        for _ in range(POWERS):
            power = size @ power
            total = float(power.sum())
            if not 0 < total < np.inf:
                return 0.0
            power, grown = power / total, grown + np.log(total)
        return float(np.exp(grown / POWERS))

    def euler(self, slope: Array, jacobian: Any, size: float) -> Any:
        """Return the same as `EquilibriumSearch.euler`."""
        from scipy.sparse import eye_array

        factors = self._factors((eye_array(self.count) / size - jacobian).tocsc())
        return self.with_sums(factors.solve(np.column_stack([slope, self.sums.T])))

    def _least(self, slope: Array, jacobian: Any, noise: Array, size: Array, terms: Any) -> Any:
        """Return the same as `EquilibriumSearch._least`; rates that no change can cancel, and conserved quantities, come from the two null spaces."""
        matrix = _scaled(jacobian, size, 0)
        rows = _largest(matrix, 1)
        if not (np.isfinite(rows).all() and np.isfinite(slope).all()):
            return np.full(len(slope), np.inf)
        rows = nonzero(rows)
        matrix = _scaled(matrix, 1 / rows, 1)
        columns = nonzero(_largest(matrix, 0))
        matrix = _scaled(matrix, 1 / columns, 0)
        columns = columns / size
        needed = -slope / rows
        try:
            spaces = self._null_spaces(matrix)
            if spaces is None:
                return super()._least(slope, jacobian.toarray(), noise, size, None)
            left, right = spaces
            weights = np.where(np.abs(left) > SINGULAR, np.abs(left), 0.0).T  # smaller entries are rounding
            allowed = CLOSE * (weights @ np.abs(needed)) + weights @ (noise / rows)
            if (np.abs(left.T @ needed) > allowed).any():
                return np.full(len(slope), np.inf)
            change = self._bordered(matrix, left, right).solve(_padded(needed, left.shape[1]))[: len(slope)]
        except RunFailed:
            return np.full(len(slope), np.inf)
        if not left.shape[1]:
            return change / columns
        kept = left.T / rows / columns  # conserved quantities (w with w J = 0) stay unchanged
        kept = kept / np.linalg.norm(kept, axis=1, keepdims=True)
        back, *_ = np.linalg.lstsq(kept @ right, kept @ change, rcond=CLOSE)
        return (change - right @ back) / columns

    def _null_spaces(self, matrix: Any) -> tuple[Any, Any] | None:
        """Return orthonormal bases (columns) of the left and right null spaces of a matrix whose largest entries are 1.

        None if there are more than a few vectors, or not equally many on both sides. Raises `RunFailed`.
        """
        from scipy.sparse import dia_array

        n = self.count
        random = np.random.default_rng(0)
        off = dia_array((OFF * random.uniform(0.5, 1.5, n)[None], [0]), shape=(n, n))
        factors = self._factors((matrix + off).tocsc())
        norm = float(np.sqrt(_largest_sum(matrix, 0) * _largest_sum(matrix, 1)))
        left, right = _near(factors, matrix.T, "T", norm, random), _near(factors, matrix, "N", norm, random)
        if left is None or right is None or left.shape[1] != right.shape[1]:
            return None
        if not left.shape[1]:
            return left, right
        border, k = self._bordered(matrix, left, right), left.shape[1]
        right = right - border.solve(_padded(matrix @ right, k))[:n]
        left = left - border.solve(_padded(matrix.T @ left, k), "T")[:n]
        left, right = _exact(matrix.T, left, norm), _exact(matrix, right, norm)
        return (left, right) if left.shape[1] == right.shape[1] else None

    def _bordered(self, matrix: Any, left: Array, right: Array) -> Any:
        """Return factors of the matrix bordered by its null spaces: its solutions have no component along them. Raises `RunFailed`."""
        from scipy.sparse import block_array, csc_array

        if not left.shape[1]:
            return self._factors(matrix)
        return self._factors(block_array([[matrix, csc_array(left)], [csc_array(right.T), None]], format="csc"))


def _near(factors: Any, matrix: Any, way: str, norm: float, random: Any) -> Any:
    """Return the null space of one side, as accurate as the perturbed matrix gives it; None if it is too large."""
    n = matrix.shape[0]
    for count in COLUMNS:
        trial = random.normal(size=(n, min(count, n)))
        for _ in range(ROUNDS):
            trial, _ = np.linalg.qr(factors.solve(trial, way))
        _, sizes, turned = np.linalg.svd(matrix @ trial, full_matrices=False)
        null = sizes <= FOUND * norm
        if not null.all():
            return trial @ turned[null].T
    return None


def _exact(matrix: Any, vectors: Array, norm: float) -> Any:
    """Return an orthonormal basis of the part of the span of some vectors that the matrix maps to zero, up to the rounding of its entries."""
    vectors, _ = np.linalg.qr(vectors)
    _, sizes, turned = np.linalg.svd(matrix @ vectors, full_matrices=False)
    null, size = turned[sizes <= SINGULAR * norm] @ vectors.T, np.abs(matrix)
    while not null_basis(matrix, size, null, VECTORS)[1].all():
        null = null[1:]
    return null.T


def _padded(right: Array, count: int) -> Any:
    """Return a right-hand side with zeros for the border."""
    return np.concatenate([right, np.zeros((count, *right.shape[1:]))])


def _largest(matrix: Any, axis: int) -> Any:
    """Return the largest absolute value of each row (axis 1) or column (0)."""
    return np.asarray(np.abs(matrix).max(axis=axis).toarray()).ravel()


def _largest_sum(matrix: Any, axis: int) -> float:
    return float(np.abs(matrix).sum(axis=axis).max())


def _scaled(matrix: Any, by: Array, axis: int) -> Any:
    """Return the matrix with its rows (axis 1) or columns (0) multiplied."""
    from scipy.sparse import dia_array

    diagonal = dia_array((by[None], [0]), shape=(len(by), len(by)))
    return (diagonal @ matrix if axis == 1 else matrix @ diagonal).tocsc()
