"""The search for rest in a large model: the same steps as in `rest.py`, by sparse factors.

Where rates hang together (what every motion keeps) and where nothing brings back (directions in which no rate changes) are the two null
spaces of the Jacobian. They are found by inverse iteration with a matrix that is moved off its singularity at random, a few columns at
once, border the Jacobian, which is regular then (Govaerts, Numerical Methods for Bifurcations, 2000, chapter 3), and are made exact by
it. Where there are more than a few, all goes the dense way.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...errors import RunFailed
from .rest import CLOSE, SINGULAR, Search
from .steady import unread_states

OFF = 1e-10  # of the largest entries: how far the matrix is moved off its singularity
COLUMNS = (4, 16, 64)  # that are looked at, more where all of the first are null
ROUNDS = 2  # of inverse iteration
FOUND = 10 * OFF  # what the moved matrix leaves of a null vector
NOTHING = 1e-12  # of a vector of length 1: what rounding puts where nothing is
POWERS = 32  # of the matrix, for its largest eigenvalue


class SparseSearch(Search):
    """Jacobians are sparse here, by columns."""

    def at(self, full: Any) -> tuple[Any, Any, Any]:
        """As `Search.at`."""
        from scipy.sparse import csc_array

        full = self.loops.solve(self.time, full, self.mode)
        if self.unread is None:
            self.unread = unread_states(self.program, self.time, full, *self.fixed)
        slope = self.rates(full)
        entries = np.asarray(self.program.jacobian_entries(self.time, full, *self.fixed), dtype=float)
        whole = csc_array((entries, self.program.pattern), shape=(len(full), len(full)))
        self.loop_terms = np.abs(whole[: self.count, self.count :]) @ np.abs(full[self.count :])
        self.largest = np.maximum(self.largest, np.abs(full[: self.count]))
        jacobian = self._reduced(whole)
        return full, slope, _scaled(jacobian, np.where(self.unread, 0.0, 1.0), 1) if self.unread.any() else jacobian

    def _reduced(self, whole: Any) -> Any:
        """By the states alone: unknowns of loops follow them. Raises `RunFailed`."""
        from scipy.sparse import csc_array

        n = self.count
        if whole.shape[0] == n:
            return whole
        followed = self._factors(whole[n:, n:].tocsc()).solve(whole[n:, :n].toarray())
        return (whole[:n, :n] - whole[:n, n:] @ csc_array(followed)).tocsc()

    @staticmethod
    def _factors(matrix: Any) -> Any:
        """LU of a sparse matrix. Raises `RunFailed` if it is singular, or no matrix of numbers."""
        from scipy.sparse.linalg import splu

        if not np.isfinite(matrix.data).all():
            raise RunFailed("the Jacobian has no numbers there")
        try:
            return splu(matrix)
        except RuntimeError as singular:
            raise RunFailed(f"the Jacobian is singular there ({singular})") from singular

    def fastest(self, jacobian: Any) -> float:
        """At least the largest eigenvalue: that of the magnitudes, by powers, which no choice of units changes."""
        size, power, grown = np.abs(jacobian), self.scale(np.zeros(self.count)), 0.0
        for _ in range(POWERS):
            power = size @ power
            total = float(power.sum())
            if not 0 < total < np.inf:
                return 0.0
            power, grown = power / total, grown + np.log(total)
        return float(np.exp(grown / POWERS))

    def euler(self, slope: Any, jacobian: Any, size: float) -> Any:
        """As `Search.euler`."""
        from scipy.sparse import eye_array

        return self._factors((eye_array(self.count) / size - jacobian).tocsc()).solve(slope)

    def _least(self, slope: Any, jacobian: Any, noise: Any) -> Any:
        """As `Search._least`; what no change of the states can cancel, and what stays as it is, by the two null spaces."""
        rows = _largest(jacobian, 1)
        if not (np.isfinite(rows).all() and np.isfinite(slope).all()):
            return np.full(len(slope), np.inf)
        rows = np.where(rows > 0, rows, 1.0)
        matrix = _scaled(jacobian, 1 / rows, 1)
        columns = _largest(matrix, 0)
        columns = np.where(columns > 0, columns, 1.0)
        matrix = _scaled(matrix, 1 / columns, 0)
        needed = -slope / rows
        try:
            spaces = self._null_spaces(matrix)
            if spaces is None:
                return super()._least(slope, jacobian.toarray(), noise)
            left, right = spaces
            weights = np.where(np.abs(left) > NOTHING, np.abs(left), 0.0).T
            allowed = CLOSE * (weights @ np.abs(needed)) + weights @ (noise / rows)
            if (np.abs(left.T @ needed) > allowed).any():
                return np.full(len(slope), np.inf)
            change = self._bordered(matrix, left, right).solve(_padded(needed, left.shape[1]))[: len(slope)]
        except RunFailed:
            return np.full(len(slope), np.inf)
        if not left.shape[1]:
            return change / columns
        kept = left.T / rows / columns  # what every motion keeps (w with w J = 0) stays as it is
        kept = kept / np.linalg.norm(kept, axis=1, keepdims=True)
        back, *_ = np.linalg.lstsq(kept @ right, kept @ change, rcond=CLOSE)
        return (change - right @ back) / columns

    def _null_spaces(self, matrix: Any) -> tuple[Any, Any] | None:
        """Orthonormal columns that the matrix, whose largest entries are 1, takes to nothing, from the left and from the right; None
        if there are more than a few, or not as many on both sides. Raises `RunFailed`."""
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

    def _bordered(self, matrix: Any, left: Any, right: Any) -> Any:
        """Factors of the matrix with its null spaces beside and below it: what they solve moves along none of them. Raises `RunFailed`."""
        from scipy.sparse import block_array, csc_array

        if not left.shape[1]:
            return self._factors(matrix)
        return self._factors(block_array([[matrix, csc_array(left)], [csc_array(right.T), None]], format="csc"))


def _near(factors: Any, matrix: Any, way: str, norm: float, random: Any) -> Any:
    """The null space of one side, as near as the matrix moved off it tells; None if it is too large."""
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


def _exact(matrix: Any, vectors: Any, norm: float) -> Any:
    """Of the span of some vectors what the matrix takes to nothing, up to rounding; orthonormal."""
    vectors, _ = np.linalg.qr(vectors)
    _, sizes, turned = np.linalg.svd(matrix @ vectors, full_matrices=False)
    return vectors @ turned[sizes <= SINGULAR * norm].T


def _padded(right: Any, count: int) -> Any:
    """A right side with zeros for the border."""
    return np.concatenate([right, np.zeros((count, *right.shape[1:]))])


def _largest(matrix: Any, axis: int) -> Any:
    """The largest magnitude of each row (axis 1) or column (0)."""
    return np.asarray(np.abs(matrix).max(axis=axis).toarray()).ravel()


def _largest_sum(matrix: Any, axis: int) -> float:
    return float(np.abs(matrix).sum(axis=axis).max())


def _scaled(matrix: Any, by: Any, axis: int) -> Any:
    """With its rows (axis 1) or columns (0) multiplied."""
    from scipy.sparse import dia_array

    diagonal = dia_array((by[None], [0]), shape=(len(by), len(by)))
    return (diagonal @ matrix if axis == 1 else matrix @ diagonal).tocsc()
