"""Sobol indices: share of a quantity's variance due to a parameter alone, and in all its interactions.

Estimators of Saltelli et al., Comput. Phys. Commun. 181, 2010, in `scipy.stats.sobol_indices`, with bootstrap intervals. They use values at points
A, B, and A with one column from B; the columns of A and B are those of one quasi-random sequence.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from compiler.api import Array

CONFIDENCE = 0.95
RESAMPLES = 200
LEAST = 8  # least number of rows
ROUNDING = 1e-12  # relative to a quantity: a smaller deviation is rounding
VAGUE = 1.0  # width of an interval without information on a share between 0 and 1


@dataclass(frozen=True, eq=False)
class Indices:
    """Indices of shape (quantities, parameters); the intervals (quantities, parameters, 2) hold 95 % of bootstrapped estimates.

    An index is NaN if it is not determined: a quantity varies by rounding only, or the interval contains all shares. `count`: number of rows of A used.
    """

    count: int
    first: Array
    total: Array
    first_interval: Array
    total_interval: Array


def mixed(first: Array, second: Array) -> Array:
    """Return the points A with column j from B, one block after the other for each j; shape (k n, k)."""
    blocks = []
    for j in range(first.shape[1]):
        block = first.copy()
        block[:, j] = second[:, j]
        blocks.append(block)
    return np.concatenate(blocks)


def indices(
    at_a: Array, at_b: Array, at_mixed: Array, seed: int, noise: Array | float = ROUNDING
) -> tuple[Indices | None, int]:  # fmt: skip
    """Return the indices from values (n, m) at A and B and (k n, m) at the mixed points, and the number of rows with failures.

    None if too few rows remain. `noise` (m,): the relative error of the values; smaller deviations are ignored.
    """
    n, m = at_a.shape
    mixes = at_mixed.reshape(-1, n, m)
    good = np.isfinite(at_a).all(axis=1) & np.isfinite(at_b).all(axis=1) & np.isfinite(mixes).all(axis=(0, 2))
    lost, left = int((~good).sum()), int(good.sum())
    if left < LEAST:
        return None, lost
    count = 1 << (left.bit_length() - 1)  # the estimators need a power of two
    rows = np.flatnonzero(good)[:count]
    varies = at_a[rows].std(axis=0) > np.maximum(noise, ROUNDING) * np.abs(at_a[rows]).max(axis=0)
    shape = (m, mixes.shape[0])
    found = {w: np.full(shape, np.nan) for w in ("first", "total")}
    found |= {f"{w}_interval": np.full((*shape, 2), np.nan) for w in ("first", "total")}
    if varies.any():
        _estimate(at_a[rows][:, varies], at_b[rows][:, varies], mixes[:, rows][:, :, varies], seed, found, varies)
    for word in ("first", "total"):
        interval = found[f"{word}_interval"]
        found[word][~(interval[..., 1] - interval[..., 0] < VAGUE)] = np.nan
    return Indices(count, **found), lost


def _estimate(a: Array, b: Array, ab: Array, seed: int, found: dict[str, Array], varies: Array) -> None:
    from scipy.stats import sobol_indices

    size = a.std(axis=0)  # quantities of very different size, 1e-6 and 1e6
    kept = len(size)
    if kept == 1:  # for a single quantity scipy's arrays lose an axis
        a, b, ab, size = (np.repeat(x, 2, axis=-1) for x in (a, b, ab, size))
    func = {"f_A": (a / size).T, "f_B": (b / size).T, "f_AB": np.moveaxis(ab / size, 1, 2)}
    rows, generator = len(a), np.random.default_rng(seed)
    made = sobol_indices(func=func, n=rows)
    again = [generator.integers(0, rows, rows) for _ in range(RESAMPLES)]
    drawn = [sobol_indices(func={w: f[..., chosen] for w, f in func.items()}, n=rows) for chosen in again]
    shape, shares = (len(size), ab.shape[0]), ((1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2)
    for word in ("first", "total"):
        values = np.array([np.reshape(getattr(x, f"{word}_order"), shape) for x in (made, *drawn)])[:, :kept]
        found[word][varies] = values[0]
        found[f"{word}_interval"][varies] = np.moveaxis(np.quantile(values[1:], shares, axis=0), 0, -1)
