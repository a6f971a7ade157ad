"""Collocation of linear differential equations: Radau IIA with 5 stages (order 9; Hairer and Wanner, Solving ODEs II, 1996, IV.5), many steps at once."""

from __future__ import annotations

import numpy as np

from compiler.api import Array

NODES = np.array([0.05710419611451768, 0.2768430136381238, 0.5835904323689168, 0.8602401356562195, 1.0])
_POWERS = np.arange(len(NODES))
_WEIGHTS = NODES[:, None] ** (_POWERS + 1) / (_POWERS + 1) @ np.linalg.inv(NODES[:, None] ** _POWERS)
MOST_NUMBERS = 4_000_000  # in matrices that are solved at once


def affine_steps(length: Array, A: Array, B: Array) -> tuple[Array, Array]:
    """Return P (m, n, n) and q (m, n, k) of steps y -> P y + q of y' = A y + B; `length` (m,), A (m, stages, n, n) and B (m, stages, n, k) at the nodes."""
    count, stages, n, k = B.shape
    P, q = np.empty((count, n, n)), np.empty((count, n, k))
    most = max(1, MOST_NUMBERS // (stages * n) ** 2)
    unit = np.tile(np.eye(n), (stages, 1))
    for first in range(0, count, most):
        part = slice(first, first + most)
        weights = length[part, None, None] * _WEIGHTS
        coupling = np.einsum("mij,mjab->miajb", weights, A[part])
        matrix = np.eye(stages * n) - coupling.reshape(len(weights), stages * n, stages * n)
        right = np.einsum("mij,mjak->miak", weights, B[part]).reshape(len(weights), stages * n, k)
        right_sides = np.concatenate([np.broadcast_to(unit, (len(right), *unit.shape)), right], axis=2)
        end = np.linalg.solve(matrix, right_sides)[:, -n:]
        P[part], q[part] = end[..., :n], end[..., n:]
    return P, q
