"""Eigenvalues of a real matrix with error bounds, correct next to eigenvalues 1e12 times as large, and their vectors.

Each eigenvalue has a first-order bound |w|'(|r| + c eps |A| |v|) / |w'v| with its left and right vectors w, v and its residual r, entry by
entry, so that it is independent of the scaling of states (Higham and Higham, SIAM J. Matrix Anal. Appl. 20, 1998). Slow eigenvalues hidden by the
rounding of fast ones are computed again from the pencil (R A C) y = lambda (R C) y, whose rows and columns are scaled to entries of at most
one and in which the fast states have hardly any part of the right-hand side: the fast part is eliminated as by a singular perturbation.

Eigenvalues whose bounds overlap (a Jordan block, which rounding splits by its root) are one cluster. With the bases V, W of its invariant subspaces, W'V = 1,
its mean tr(W'AV)/k is as well conditioned as a single eigenvalue, and takes the place of its members. All lie around it within the Perron root of
|T - mean| + |W|'(|r| + c eps |A| |V|), T the Schur form of W'AV: no eigenvalue of a matrix exceeds that of a larger one without signs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array, ComplexArray

EPS = float(np.finfo(float).eps)
ENTRIES = 8.0  # units in the last place: error of the entries of A
TRUSTED = 1e-4  # relative to an eigenvalue: a smaller bound needs no second computation
ROUNDS = 8  # rounds with smaller and smaller scales
EXTENDED = 300  # most states for which residuals are computed in extended precision
ROUNDED = 64 * EPS  # rounding of the scaled entries of a lossless model
SOUND = 64 * EPS  # relative, per state: a smaller bound is that of an eigenvalue of its own
NEAR = 4.0  # bounds, which are of first order only: distance of two eigenvalues if they may be one
APART = 2.0  # radii of a cluster: distance of the next eigenvalue; a circle between is clear of both
SWEEPS = 12  # inverse iterations with the vectors of a cluster
SHIFT = 0.0137  # of the distance of the next eigenvalue: the shift of these, so that each gains two digits
TRIES = 16  # clusters looked for
SEED = 20
PARALLEL = 1e-3  # least singular value of unit vectors of one Jordan block, which rounding of its root keeps apart


@dataclass(frozen=True, eq=False)
class Eigenvalues:
    """Eigenvalues `values` (n,) in 1/s, with error bounds `bounds` (n,); `undamped` (n,): mask of those on the imaginary axis by structure.

    `shapes`: right vectors (n, n), column by column; a cluster with fewer vectors than members repeats its first.
    """

    values: Any
    bounds: Any
    undamped: Any
    shapes: Any

    @property
    def growing(self) -> int:
        """Number of eigenvalues that certainly grow."""
        return int((self.values.real > self.bounds).sum())

    @property
    def undecided(self) -> tuple[complex, ...]:
        """Eigenvalues whose real part may be zero; of a pair the one with the positive imaginary part."""
        unsure = self.values[(np.abs(self.values.real) <= self.bounds) & ~self.undamped]
        return tuple(complex(v) for v in unsure if v.imag >= 0)


def bounded_eigenvalues(A: Array, sizes: Array | None = None, lossless: bool = False) -> Eigenvalues:
    """Return the eigenvalues of a real matrix (n, n), each with a bound.

    `sizes` (n, n): sizes of the terms of the entries; None: the entries. `lossless`: of a model without losses, in which entries of the size of rounding
    count as zero.
    """
    from scipy.linalg import eig, matrix_balance

    if not len(A):
        return Eigenvalues(np.zeros(0, dtype=complex), np.zeros(0), np.zeros(0, dtype=bool), np.zeros((0, 0)))
    with np.errstate(invalid="ignore"):  # scipy makes integers of permutations that are not asked for
        balanced, (scale, _) = matrix_balance(A, permute=False, separate=True)
    terms = np.abs(A) if sizes is None else sizes
    terms = terms * scale[None, :] / scale[:, None]
    values, left, right = eig(balanced, left=True, right=True)
    shapes = right.astype(complex)
    bounds = _bounds(balanced, terms, values, left, right)
    for _ in range(ROUNDS):
        unsure = (bounds > TRUSTED * np.abs(values)) | (
            (np.abs(values.real) <= bounds) & (bounds > 64 * len(A) * EPS * np.abs(values))
        )
        if not unsure.any():
            break
        scale_of = float(np.abs(values[unsure]).max())
        if scale_of < 1e-290:
            break
        again = np.flatnonzero(np.abs(values) <= 1.01 * scale_of)
        if len(again) == len(values) and _ > 0:
            break
        new_values, new_bounds, new_shapes = _of_pencil(balanced, terms, scale_of, len(again))
        before = float(np.sort(bounds[again])[::-1].sum())
        if not np.isfinite(new_bounds).all() or not new_bounds.sum() < 0.5 * before:
            break
        values[again], bounds[again], shapes[:, again] = new_values, new_bounds, new_shapes
    vectors = shapes / np.linalg.norm(shapes, axis=0)
    if len(A) <= EXTENDED:
        _gather(balanced, terms, values, bounds, shapes)
    undamped = (np.abs(values.real) <= bounds) & (np.abs(values.imag) > bounds)
    if lossless and undamped.any():
        rows, columns = equilibrated(balanced, float(np.abs(values[undamped]).min()))
        balanced = np.where(np.abs(balanced) > ROUNDED * rows[:, None] * columns, balanced, 0.0)
    undamped &= bool(undamped.any()) and two_sided(balanced)
    undamped[undamped] = ~_defective(values, bounds, vectors, undamped)
    return Eigenvalues(np.where(undamped, 1j * values.imag, values), bounds, undamped, shapes * scale[:, None])


def two_sided(A: Array) -> bool:
    """Return True if states fall into two kinds and each rate reads only the other kind: then -lambda is an eigenvalue with lambda."""
    from scipy.sparse import block_array, csr_array
    from scipy.sparse.csgraph import connected_components

    joined = csr_array(((A != 0) | (A.T != 0)).astype(float))
    # a part with two kinds falls apart where each state and its opposite are nodes of their own
    doubled = block_array([[None, joined], [joined, None]])
    return bool(connected_components(doubled)[0] == 2 * connected_components(joined)[0])


def _of_pencil(A: Array, terms: Array, scale: float, count: int) -> tuple[Any, Any, Any]:
    """Return the smallest eigenvalues, their bounds and right vectors from the matrix pencil in which every state is at most as fast as `scale` (1/s)."""
    from scipy.linalg import eig

    rows, columns = equilibrated(A, scale)
    values, left, right = eig(A / rows[:, None] / columns, np.diag(scale / (rows * columns)), left=True, right=True)
    with np.errstate(invalid="ignore"):
        values = np.where(np.isfinite(values), values * scale, np.inf)
    chosen = np.argsort(np.abs(values), kind="stable")[:count]
    v, w = right[:, chosen] / columns[:, None], left[:, chosen] / rows[:, None]
    return values[chosen], _bounds(A, terms, values[chosen], w, v), v / np.linalg.norm(v, axis=0)


def equilibrated(A: Array, least: float) -> tuple[Any, Any]:
    """Return factors r (n,) and c (n,) with |a_ij| <= r_i c_j, each product r_i c_i at least `least` (by Ruiz's iteration, upwards only)."""
    size = np.abs(A)
    rows = columns = np.full(len(A), np.sqrt(least))
    for _ in range(20):
        scaled = size / rows[:, None] / columns
        up, across = np.maximum(scaled.max(axis=1), 1.0), np.maximum(scaled.max(axis=0), 1.0)
        rows, columns = rows * np.sqrt(up), columns * np.sqrt(across)
        if max(up.max(), across.max()) < 2.0:
            break
    return rows, columns


def _bounds(A: Array, terms: Array, values: ComplexArray, left: Array | ComplexArray, right: Array | ComplexArray) -> Any:  # fmt: skip
    """Return first-order bounds (k,) on the errors of eigenvalues with vectors `left` and `right` (n, k)."""
    if len(A) <= EXTENDED:
        long = A.astype(np.longdouble)
        real, imaginary = right.real.astype(np.longdouble), right.imag.astype(np.longdouble)
        moved = long @ real + 1j * (long @ imaginary)
        with np.errstate(invalid="ignore"):
            residual = np.abs(moved - values * (real + 1j * imaginary)).astype(float)
    else:
        residual = np.abs(A @ right - values * right) + len(A) * EPS * (np.abs(A) @ np.abs(right))
    lengths = np.abs(np.einsum("ij,ij->j", left.conj(), right))
    above = np.einsum("ij,ij->j", np.abs(left), residual + ENTRIES * EPS * (terms @ np.abs(right)))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = above / lengths
    return np.where(np.isfinite(ratios), ratios, np.inf)


# ---------------------------------------------------------------- clusters


def _gather(A: Array, terms: Array, values: ComplexArray, bounds: Array, shapes: ComplexArray) -> None:
    """Give eigenvalues that rounding alone keeps apart the mean of their cluster, its radius as bound, and the vectors that it has."""
    overlap = np.abs(values[:, None] - values) <= NEAR * (bounds[:, None] + bounds)
    np.fill_diagonal(overlap, False)
    poor = overlap.any(axis=1) & (bounds > SOUND * len(A) * np.abs(values)) & (values.imag >= 0)
    for _ in range(TRIES if poor.any() else 0):
        first = int(np.argmax(np.where(poor, bounds, -1.0)))
        poor[first] = False
        cluster = _cluster_around(A, terms, values, bounds, first)
        if cluster is not None:
            members, mean, radius, basis = cluster
            mirrored = [int(np.argmin(np.abs(values - values[i].conjugate()))) for i in members]
            kinds = np.minimum(np.arange(len(members)), basis.shape[1] - 1)
            values[mirrored], bounds[mirrored], shapes[:, mirrored] = mean.conjugate(), radius, basis.conj()[:, kinds]
            values[members], bounds[members], shapes[:, members] = mean, radius, basis[:, kinds]
            poor[members] = poor[mirrored] = False
        if not poor.any():
            break


def _cluster_around(A: Array, terms: Array, values: ComplexArray, bounds: Array, first: int) -> tuple[Any, complex, float, Any] | None:  # fmt: skip
    """Return the cluster of an eigenvalue: its members, mean, radius and vectors; None if its mean is no better known than the members."""
    away = np.abs(values - values[first])
    order = np.argsort(away, kind="stable")
    for count in range(2, len(A) + 1):
        members, others = order[:count], order[count:]
        last = order[count - 1]
        if away[last] > NEAR * (bounds[first] + bounds[last]):
            return None
        mean = complex(values[members].mean())
        gap = float(np.abs(values[others] - mean).min(initial=np.inf))
        if gap <= APART * float(np.abs(values[members] - mean).max()):
            continue
        try:
            mean, error, radius, basis = _invariant(A, terms, mean, count, gap)
        except np.linalg.LinAlgError:
            continue
        if radius * APART < gap:
            least = np.maximum(bounds[members], SOUND * len(A) * np.abs(values[members]))
            one = (np.abs(values[members] - mean) <= NEAR * least).all()
            gain = one and error < float(bounds[members].max())
            return (members, mean if abs(mean) > error else 0j, radius, basis) if gain else None
    return None


def _defective(values: ComplexArray, bounds: Array, vectors: ComplexArray, chosen: Array) -> Any:
    """Return the mask of chosen eigenvalues with fewer unit vectors than members within their bounds: a Jordan block, whose motion grows with time."""
    within = [np.abs(values - values[i]) <= 2 * NEAR * bounds[i] for i in np.flatnonzero(chosen)]
    return np.array([np.linalg.svd(vectors[:, w], compute_uv=False)[-1] < PARALLEL for w in within], dtype=bool)


def _invariant(A: Array, terms: Array, near: complex, count: int, gap: float) -> tuple[complex, float, float, Any]:
    """Return the mean of the `count` eigenvalues nearest to a value, its error, their radius, and the vectors (n, g) that they have, from inverse iterations in
    scales like those of the pencil. `gap`: distance of the next eigenvalue. Raises LinAlgError."""
    from scipy.linalg import schur

    n, random = len(A), np.random.default_rng(SEED)
    real = 4 * abs(near.imag) < gap  # else the conjugate is outside
    near = near.real if real else near
    right = left = np.eye(n, dtype=float if real else complex)
    if count < n:
        right, left = (random.standard_normal((n, count)).astype(right.dtype) for _ in range(2))
        shift = near + SHIFT * gap
        rows, columns = equilibrated(A, abs(shift) or gap)
        shifted = (A - shift * np.eye(n)) / rows[:, None] / columns
        for _ in range(SWEEPS):
            right = np.linalg.qr(np.linalg.solve(shifted, right / rows[:, None]) / columns[:, None])[0]
            left = np.linalg.qr(np.linalg.solve(shifted.conj().T, left / columns[:, None]) / rows[:, None])[0]
        right = right @ np.linalg.inv(left.conj().T @ right)
    long = A.astype(np.longdouble) @ right.astype(np.clongdouble)
    inner = (left.conj().T.astype(np.clongdouble) @ long).astype(complex)
    mean = complex(np.trace(inner) / count)
    residual = np.abs(long - right @ inner.astype(np.clongdouble)).astype(float)
    triangle, turned = schur(inner, output="complex")
    change = np.abs((left @ turned).conj().T) @ (
        residual @ np.abs(turned) + ENTRIES * EPS * (terms @ np.abs(right @ turned))
    )
    around = np.abs(triangle - mean * np.eye(count)) + change
    radius = float(np.abs(np.linalg.eigvals(around)).max())
    _, sizes, kinds = np.linalg.svd((inner.real if real else inner) - mean * np.eye(count))
    independent = max(1, int((sizes <= np.linalg.norm(change)).sum()))
    return mean, float(np.trace(change)) / count, radius, right @ kinds.conj().T[:, ::-1][:, :independent]
