"""Result of a Monte Carlo study: the sample, its statistics, Sobol indices, and the swing of each quantity by each parameter."""

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

    from .indices import Indices


SCHEMA = "bondgraph-montecarlo/1"
ROUNDING = 4e-15  # relative to a quantity: a smaller deviation is not determined
SHARES = (0.025, 0.25, 0.5, 0.75, 0.975)


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
