"""Eigenvalues and vectors of a linear model.

A lossless network in which every storage has its own quantity is skew up to scales: x_i / d_i turn its matrix into one with
s_ij = -s_ji. If moreover displacements only move momenta and these only displacements, the eigenvalues are +-i times singular values
of half the size, exact to rounding of the largest, at a small part of the time. All else has bounds (`eigenvalues.py`), or goes through LAPACK's geev
where there are many states.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array, ComplexArray, IntArray

from ..numerics.scales import equilibrated
from .eigenvalues import EXTENDED, bounded_eigenvalues

LARGEST = 500  # most states for which the rank is computed
SINGULAR = 1e-11  # relative to the largest singular value
HIDDEN = 1e-11  # relative to the largest: singular values that rounding changes by 1e-5 and more
SLOW = 1e-8  # relative to the fastest: zero eigenvalues come out below that
CONSISTENT = 1e-10  # relative difference of the scales along the two ways round a ring of states


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Eigenvalues `values` (n,) and right vectors `shapes` (n, n), column by column; both of a conjugate pair. `bounds` (n,) of errors, if computed."""

    values: ComplexArray
    shapes: Array | ComplexArray
    bounds: Any = None


def spectrum(A: Array) -> Spectrum:
    """Return the spectrum of a real matrix (n, n)."""
    from scipy.linalg import eig

    if not len(A):
        return Spectrum(np.zeros(0, dtype=complex), np.zeros((0, 0), dtype=complex))
    scale = _scales(A)
    exact = None if scale is None else _lossless(A, *scale)
    if exact is not None:
        return exact
    if len(A) > EXTENDED:
        values, shapes = eig(A)
        return Spectrum(_with_zeros(A, values), shapes)
    bounded = bounded_eigenvalues(A)
    sizes = np.abs(bounded.values)
    values = np.where(sizes <= np.minimum(bounded.bounds, SLOW * sizes.max()), 0.0, bounded.values)
    return Spectrum(_with_zeros(A, values), bounded.shapes / np.linalg.norm(bounded.shapes, axis=0), bounded.bounds)


def _with_zeros(A: Array, values: ComplexArray) -> ComplexArray:
    """Return the eigenvalues with as many exact zeros as the rank requires: rounding changes them slightly."""
    if len(A) > LARGEST:
        return values
    sizes = np.linalg.svd(equilibrated(A)[0], compute_uv=False)
    missing = int((sizes <= SINGULAR * sizes.max(initial=0.0)).sum())
    smallest = np.argsort(np.abs(values))[:missing]
    slow = np.abs(values[smallest]) < SLOW * np.abs(values).max(initial=0.0)
    result = np.array(values, dtype=complex)
    result[smallest[slow]] = 0.0
    return result


def left_shapes(A: Array) -> tuple[Any, Any, Any]:
    """Return eigenvalues, left vectors w and right vectors v with w^H v = 1 for each; infinite where they are orthogonal (a Jordan block)."""
    from scipy.linalg import eig

    values, left, right = eig(A, left=True, right=True)
    products = np.einsum("ij,ij->j", left.conj(), right)
    with np.errstate(divide="ignore", invalid="ignore"):
        return values, left / products.conj(), right


def _scales(A: Array) -> tuple[Array, IntArray] | None:
    """Return scales d and sides (0 or 1) of the states that make A skew and couple only different sides; None if there are none."""
    if np.diag(A).any() or ((A != 0) != (A.T != 0)).any() or (A * A.T > 0).any():
        return None
    n = len(A)
    scale, side = np.zeros(n), np.zeros(n, dtype=int)
    neighbours = [np.flatnonzero(row) for row in A]
    for root in range(n):
        if scale[root]:
            continue
        scale[root], stack = 1.0, [root]
        while stack:
            i = stack.pop()
            for j in neighbours[i]:  # a_ij d_j / d_i = -a_ji d_i / d_j
                expected = scale[i] * float(np.sqrt(-A[j, i] / A[i, j]))
                if not scale[j]:
                    scale[j], side[j] = expected, 1 - side[i]
                    stack.append(int(j))
                elif abs(scale[j] - expected) > CONSISTENT * expected or side[j] == side[i]:
                    return None
    return (scale, side) if np.isfinite(scale).all() else None


def _lossless(A: Array, scale: Array, side: IntArray) -> Spectrum | None:
    """Return the spectrum from the singular values between the two sides: with M v = s u, (u, i v) belongs to i s. None if that fails."""
    first, second = np.flatnonzero(side == 0), np.flatnonzero(side == 1)
    block = np.sign(A) * np.sqrt(np.abs(A * A.T))
    try:
        u, sizes, v = np.linalg.svd(block[np.ix_(first, second)])
    except np.linalg.LinAlgError:
        return None
    n, rank = len(A), len(sizes)
    if n <= EXTENDED and rank and sizes[-1] < HIDDEN * sizes[0]:
        return None
    values, shapes = np.zeros(n, dtype=complex), np.zeros((n, n), dtype=complex)
    for sign, at in ((1j, 0), (-1j, rank)):
        values[at : at + rank] = sign * sizes
        shapes[first, at : at + rank] = u[:, :rank]
        shapes[second, at : at + rank] = sign * v[:rank].T
    for side_, rest in ((first, u[:, rank:]), (second, v[rank:].T)):  # one of them is empty
        shapes[side_, 2 * rank : 2 * rank + rest.shape[1]] = rest
    shapes *= scale[:, None]
    return Spectrum(values, shapes / np.linalg.norm(shapes, axis=0))
