"""Result of a Monte Carlo study: the sample, its statistics, Sobol indices, and the swing of each quantity by each parameter.

Sobol indices are the shares of a quantity's variance due to a parameter alone, and in all its interactions: estimators of Saltelli et al., Comput.
Phys. Commun. 181, 2010, in `scipy.stats.sobol_indices`, with bootstrap intervals. They use values at points A, B, and A with one column from B; the
columns of A and B are those of one quasi-random sequence.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array

from ..errors import UsageError
from ..rendering import OfModel, Plotted, Summarised, draw
from ..results.exports import Arrays, Exported
from ..results.json_values import as_json, entries, head

if TYPE_CHECKING:
    from matplotlib.figure import Figure


SCHEMA = "bondgraph-montecarlo/1"
ROUNDING = 4e-15  # relative to a quantity: a smaller deviation is not determined
SHARES = (0.025, 0.25, 0.5, 0.75, 0.975)
CONFIDENCE = 0.95
RESAMPLES = 200
LEAST = 8  # least number of rows
NO_DEVIATION = 1e-12  # relative to a quantity: a smaller deviation is rounding
VAGUE = 1.0  # width of an interval without information on a share between 0 and 1


@dataclass(frozen=True, eq=False)
class Swing:
    """Each quantity with all parameters at their medians (m,), and with one of them at the `tails` of its distribution (m, k, 2)."""

    tails: tuple[float, float]
    middle: Array
    ends: Array


@dataclass(frozen=True, eq=False, repr=False)
class MonteCarlo(OfModel, Summarised, Plotted, Exported):
    """Sample `samples` (n, k) of `parameters`, `values` (n, m) of `quantities`, in SI and Hz; NaN for failed points, with reasons in `failures`.

    `distributions` as texts with numbers in SI; `indices` is None if there are none (with the reason in `notes`). `found("frequency 1")` is a column.
    """

    of: tuple[str, ...]
    seed: int
    distributions: Mapping[str, str]
    correlations: Mapping[tuple[str, str], float]
    units: Mapping[str, str]
    parameters: tuple[str, ...]
    quantities: tuple[str, ...]
    samples: Array
    values: Array
    failures: Mapping[int, str]
    indices: Indices | None
    swing: Swing
    notes: tuple[str, ...]
    shown: Mapping[str, tuple[str, float, float]]  # output -> unit, scale and offset in a table

    def __len__(self) -> int:
        return len(self.samples)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns: parameters, then quantities."""
        return (*self.parameters, *self.quantities)

    def __call__(self, name: str) -> Array:
        """Return a parameter or quantity at all points (n,). Raises `UsageError`."""
        if name not in self.names:
            raise UsageError("BR462", f"there is no `{name}` in this study; it has {', '.join(self.names)}")
        if name in self.quantities:
            return self.values[:, self.quantities.index(name)]
        return self.samples[:, self.parameters.index(name)]

    def statistics(self, name: str) -> dict[str, float]:
        """Return `count` of valid points, `mean`, `standard deviation` (NaN: not determined), `minimum`, `maximum`, and quantiles by `2.5 %` and so on."""
        column = self(name)
        column = column[np.isfinite(column)]
        if not len(column):
            return {"count": 0.0}
        spread = float(column.std(ddof=1)) if len(column) > 1 else math.nan
        if 0 < spread <= ROUNDING * float(np.abs(column).max()):
            spread = math.nan  # only rounding
        found = {"count": float(len(column)), "mean": float(column.mean()), "standard deviation": spread}
        found |= {"minimum": float(column.min()), "maximum": float(column.max())}
        return found | {f"{100 * s:g} %": float(q) for s, q in zip(SHARES, np.quantile(column, SHARES), strict=True)}

    def _arrays(self) -> Arrays:
        """Return parameters and quantities over `point`."""
        columns = {n: (("point",), self(n), self.units[n]) for n in self.names}
        told: dict[str, str | int | float | None] = {
            "model": self.model,
            "experiment": self.experiment,
            "seed": self.seed,
        }
        return Arrays({}, columns, told | {f"distribution of {n}": d for n, d in self.distributions.items()})

    def to_json(self) -> dict[str, Any]:
        """Return JSON values by the schema `bondgraph-montecarlo/1`, in SI and Hz.

        {schema, model, experiment, of, samples, seed, parameters: {name: {unit, distribution}}, correlations: [{between: [name, name], value}], quantities:
        {name: {unit, count, mean, …, swing: {parameter: [low, high]}, indices: {parameter: {first, first_interval, total, total_interval}}}}, failures:
        [{point, why}], notes}.
        """
        told = {**head(SCHEMA, self), "samples": len(self), **entries(self, "of", "seed", "notes")}
        told["parameters"] = {
            n: {"unit": self.units[n], "distribution": self.distributions[n]} for n in self.parameters
        }
        told["correlations"] = [{"between": list(pair), "value": v} for pair, v in self.correlations.items()]
        told["quantities"] = {n: self._quantity(n, i) for i, n in enumerate(self.quantities)}
        told["failures"] = [{"point": i, "why": why} for i, why in self.failures.items()]
        return told

    def _quantity(self, name: str, i: int) -> dict[str, Any]:
        told: dict[str, Any] = {"unit": self.units[name], **as_json(self.statistics(name))}
        told["swing"] = {p: as_json(self.swing.ends[i, j]) for j, p in enumerate(self.parameters)}
        if self.indices is not None:
            parts = {w: getattr(self.indices, w)[i] for w in ("first", "first_interval", "total", "total_interval")}
            told["indices"] = {
                p: {word: as_json(part[j]) for word, part in parts.items()} for j, p in enumerate(self.parameters)
            }
        return told

    def plot_tornado(self, path: str | os.PathLike[str] | None = None) -> Figure:
        """Plot the swing of each quantity by each parameter, the strongest on top. Raises as `Result.plot`."""
        return draw(self, path, "tornado")


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
    at_a: Array, at_b: Array, at_mixed: Array, seed: int, noise: Array | float = NO_DEVIATION
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
    varies = at_a[rows].std(axis=0) > np.maximum(noise, NO_DEVIATION) * np.abs(at_a[rows]).max(axis=0)
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
