"""Result of a fit: parameters with intervals, quality of the fit, undetermined directions."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array

from ..errors import UsageError
from ..rendering import OfModel, Plotted, Summarised
from ..results.json_values import as_json, entries, finite, head

if TYPE_CHECKING:
    from .identify import Direction, Explanation
    from .measured import Series


SCHEMA = "bondgraph-fit/1"


@dataclass(frozen=True, slots=True)
class Fitted:
    """A parameter in SI: start and end of the search, standard error and 95 % interval."""

    name: str
    unit: str
    start: float
    value: float
    error: float
    low: float
    high: float


@dataclass(frozen=True, eq=False, repr=False)
class Fit(OfModel, Summarised, Plotted):
    """Result of a fit; `found["d"]` is a fitted value in SI.

    `squares`: sum of squared residuals over sigma; `freedom`: number of data minus number of parameters; `scatter`: squares over degrees of freedom.
    `directions`: of relative changes, the least certain first. `explanations`: small sets of parameters that fit the data alone, if requested.
    """

    parameters: tuple[Fitted, ...]
    correlations: Array
    series: tuple[Series, ...]
    computed: tuple[Array, ...]
    squares: float
    freedom: int
    weighted: bool
    scatter: float
    directions: tuple[Direction, ...]
    explanations: tuple[Explanation, ...]
    notes: tuple[str, ...]

    def __getitem__(self, name: str) -> float:
        return self.of(name).value

    def of(self, name: str) -> Fitted:
        """Return a parameter by its name. Raises `UsageError`."""
        for one in self.parameters:
            if one.name == name:
                return one
        raise UsageError("BR418", f"`{name}` was not fitted; {', '.join(p.name for p in self.parameters)} were")

    @property
    def settings(self) -> dict[str, float]:
        """Fitted values, as settings for other calls."""
        return {p.name: p.value for p in self.parameters}

    def to_json(self) -> dict[str, Any]:
        """Return JSON values by the schema `bondgraph-fit/1`, in SI and Hz.

        {schema, model, experiment, parameters: {name: {unit, start, value, standard_error, low, high}}, correlations (rows), squares, freedom, scatter,
        weighted, data: [{file, name, unit, rows, measured, computed, sigma}], directions: [{deviation, open, weights}], explanations: [{values, changes,
        squares, left}], notes}.
        """
        parameters = {
            p.name: entries(p, "unit", "start", "value", "low", "high") | {"standard_error": finite(p.error)}
            for p in self.parameters
        }
        data = [
            entries(s, "file", "name", "unit", "rows", "measured")
            | {"computed": as_json(c), "sigma": as_json(s.sigma) if self.weighted else None}
            for s, c in zip(self.series, self.computed, strict=True)
        ]
        names = ("correlations", "squares", "freedom", "scatter", "weighted", "directions", "explanations", "notes")
        return {**head(SCHEMA, self), "parameters": parameters, "data": data, **entries(self, *names)}

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write row, measured, computed and sigma of all data in SI, stacked, into a .csv, .npz, .nc or .mat file. Raises OSError, `UsageError`."""
        from ..results.exports import write_columns

        columns: dict[str, Array] = {
            "series": np.concatenate([np.full(len(s.rows), float(i)) for i, s in enumerate(self.series, 1)]),
            "row": np.concatenate([np.array(s.rows, dtype=float) + 1 for s in self.series]),
            "measured": np.concatenate([s.measured for s in self.series]),
            "computed": np.concatenate(self.computed),
            "sigma": np.concatenate([s.sigma for s in self.series]),
        }
        names = {f"series {i}": f"{s.name} [{s.unit}] of {s.file}" for i, s in enumerate(self.series, 1)}
        write_columns(path, columns, dict.fromkeys(columns, "1"), "datum", {"model": self.model, **names})
