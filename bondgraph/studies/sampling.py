"""Sampling: quasi-random points, and their conversion by distributions and correlations.

Points of Sobol's sequence, scrambled by a seed (Owen; `scipy.stats.qmc`), fill the unit cube evenly: means converge nearly as 1/n instead of
1/sqrt(n). Correlations are those of a Gaussian copula: of the normal variables with the same quantiles as the values (Nelsen, An Introduction to
Copulas, 2006, section 2.3), so that each parameter keeps its own distribution.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from compiler.api import Array, Distribution

from ..errors import UsageError
from .distributions import EDGE, quantiles

MOST_NAMES = 1000
IMPOSSIBLE = -1e-10  # an eigenvalue below it is more than rounding


def cube(count: int, size: int, seed: int) -> Array:
    """Return points in the unit cube of `size` dimensions, shape (count, size). The first 2^k are as even as any 2^k."""
    from scipy.stats import qmc

    power = max(0, math.ceil(math.log2(count)))
    return np.asarray(qmc.Sobol(size, scramble=True, rng=np.random.default_rng(seed)).random_base2(power)[:count])


def correlation_matrix(names: Sequence[str], pairs: Mapping[tuple[str, str], float]) -> Array | None:
    """Return the matrix of the copula from its pairs; None if all are independent. Raises `UsageError` for an impossible one."""
    if not pairs:
        return None
    matrix = np.eye(len(names))
    seen: set[frozenset[str]] = set()
    for (one, other), value in pairs.items():
        for name in (one, other):
            if name not in names:
                raise UsageError("BR444", f"correlation of `{one}` and `{other}`: `{name}` has no distribution")
        if one == other or frozenset((one, other)) in seen:
            raise UsageError("BR445", f"correlation of `{one}` and `{other}`: one number for each pair of two")
        if not -1 <= value <= 1:
            raise UsageError("BR446", f"correlation of `{one}` and `{other}`: {value:g} is not between -1 and 1")
        seen.add(frozenset((one, other)))
        i, j = names.index(one), names.index(other)
        matrix[i, j] = matrix[j, i] = value
    values, vectors = np.linalg.eigh(matrix)
    if values[0] < IMPOSSIBLE:
        weights = vectors[:, 0]
        told = ", ".join(f"`{names[i]}`" for i in np.argsort(-np.abs(weights)) if abs(weights[i]) > 0.1)
        raise UsageError(
            "BR447", f"no quantities are correlated like this: {told} contradict each other (the matrix has the eigenvalue {values[0]:.3g})",
        )  # fmt: skip
    return matrix


def values_of(shares: Array, distributions: Sequence[Distribution], correlation: Array | None) -> Array:
    """Return values (n, k) at points of the unit cube (n, k)."""
    if correlation is not None:
        from scipy.special import ndtr, ndtri

        values, vectors = np.linalg.eigh(correlation)
        root = vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T  # symmetric root, also of singular matrices
        shares = ndtr(ndtri(np.clip(shares, EDGE, 1 - EDGE)) @ root)
    return np.stack([quantiles(d, shares[:, j]) for j, d in enumerate(distributions)], axis=1)
