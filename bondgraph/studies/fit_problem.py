"""Fit as a least-squares problem: coordinates of the parameters, residuals over their sigmas, and their derivatives."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from compiler.api import Array, BoundedParameter, CompilationFailed

from ..analysis.placement import operating_point
from ..analysis.run_sensitivity import Partitions, run_sensitivity
from ..analysis.sensitivity import sensitivity
from ..compiled_model import CompiledModel
from ..errors import RunFailed, UsageError
from ..keywords import AnalysisRequest
from ..quantities import quantity
from ..simulation.settings import Settings
from .measured import OF_MODES, Measurements, Series
from .point_failure import why


def sought(text: str, unit: str, name: str) -> BoundedParameter:
    """Return the fit parameter of a text: `log`, `1.5 um .. 2.5 um`, `log 1 N/m .. 100 N/m`, or nothing. Raises `UsageError`."""
    words = re.fullmatch(r"\s*(log\b)?\s*(.*?)\s*", text, re.DOTALL)
    assert words is not None
    logarithmic, bounds = bool(words[1]), words[2]
    if not bounds:
        return BoundedParameter(name, logarithmic=logarithmic)
    low, dots, high = bounds.partition("..")
    if not dots:
        raise UsageError(
            "BR411", f"{name}: bounds are written `LOW .. HIGH`, with `log` before them for a logarithmic scale; this is `{text}`",
        )  # fmt: skip
    ends = quantity(low, unit, name), quantity(high, unit, name)
    if not ends[0] < ends[1]:
        raise UsageError("BR412", f"{name}: bounds go from low to high; {ends[0]:g} is not below {ends[1]:g}")
    if logarithmic and ends[0] < 0:
        raise UsageError("BR413", f"{name}: a logarithmic scale has no bounds below zero")
    return BoundedParameter(name, *ends, logarithmic)


class Problem:
    """Least-squares problem: residuals over their sigmas, (n,), and their derivatives (n, k). Failed points have infinite residuals."""

    def __init__(
        self, model: CompiledModel, data: Sequence[Measurements], given: Sequence[BoundedParameter], experiment: str | None, settings: Settings,
    ) -> None:  # fmt: skip
        self.model, self.data, self.experiment, self.settings = model, tuple(data), experiment, dict(settings)
        self.sought, self.names = tuple(given), tuple(s.name for s in given)
        self.logarithmic = np.array([s.logarithmic for s in given])
        self.failure = ""
        self.partitions: Partitions = {}
        self.compiled_in = False  # True if each value is compiled into a separate program
        self._kept: tuple[bytes, Array, Array] | None = None
        self.start = self._start()
        self.scale = np.array([self._size(s, abs(value)) for s, value in zip(given, self.start.tolist(), strict=True)])

    def _size(self, sought: BoundedParameter, value: float) -> float:
        """Return the size of a parameter: its start, else its farther bound, else the smallest parameter of its unit, else 1 in SI."""
        if value:
            return value
        quantities = self.model.compilation(self.model.scene(self.experiment, self.settings)).whole_graph.quantities
        others = [
            q
            for q in quantities.values()
            if q.role in ("parameter", "constant") and q.unit == quantities[sought.name].unit
        ]
        bounds = [abs(b) for b in (sought.low, sought.high) if b is not None and 0 < abs(b) < math.inf]
        return max(bounds, default=0.0) or min((abs(q.value) for q in others if q.value), default=1.0)

    def _start(self) -> Array:
        graph = self.model.compilation(self.model.scene(self.experiment, self.settings)).whole_graph
        self.following = [n for n in self.names if (d := graph.quantities[n].definition) is not None and d.arguments]
        self.inputs = {n for n in self.names if graph.quantities[n].role == "input"}
        found = []
        for s in self.sought:
            quantity = graph.quantities[s.name]
            constant = None if quantity.definition is None else quantity.definition.formula.expression
            starts = s.start, quantity.value, getattr(constant, "value", None)  # the last of an input that is a number
            value = next((v for v in starts if v is not None), None)
            if quantity.role not in ("parameter", "input") or value is None:
                raise UsageError("BR414", f"`{s.name}` is no parameter or input with a value: it cannot be fitted")
            if not (s.low is None or s.low <= value) or not (s.high is None or value <= s.high):
                raise UsageError(
                    "BR415", f"{s.name}: the search begins where the model (or --set) has it, at {value:g}, which is outside of its bounds",
                )  # fmt: skip
            if s.logarithmic and not value > 0:
                raise UsageError(
                    "BR416", f"{s.name}: on a logarithmic scale the search begins above zero, not at {value:g}"
                )
            found.append(value)
        return np.array(found, dtype=float)

    # ------------------------------------------------------------ coordinates
    def coordinates(self, values: Array) -> Array:
        """Return the coordinates of values in SI."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.logarithmic, np.log(np.where(self.logarithmic, values, 1.0)), values / self.scale)

    def values(self, coordinates: Array) -> Array:
        """Return the values in SI."""
        return np.where(
            self.logarithmic, np.exp(np.where(self.logarithmic, coordinates, 0.0)), coordinates * self.scale
        )

    def stretch(self, coordinates: Array) -> Array:
        """Return the derivatives of values by coordinates."""
        return np.where(self.logarithmic, self.values(coordinates), self.scale)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Return the bounds of the coordinates."""
        low = [
            s.low if s.low is not None else 0.0 if v > 0 else -np.inf
            for s, v in zip(self.sought, self.start, strict=True)
        ]
        high = [
            s.high if s.high is not None else 0.0 if v < 0 else np.inf
            for s, v in zip(self.sought, self.start, strict=True)
        ]
        with np.errstate(divide="ignore"):
            return self.coordinates(np.array(low)), self.coordinates(np.array(high))

    # ------------------------------------------------------------ residuals
    @cached_property
    def series(self) -> tuple[Series, ...]:
        """Measured quantities, in the order of the residuals."""
        return tuple(
            Series(data.file, name, self.units[name], tuple(np.flatnonzero(~np.isnan(column)).tolist()), column[~np.isnan(column)], self._sigma(data, name))
            for data in self.data for name, column in data.found.items()
        )  # fmt: skip

    @cached_property
    def units(self) -> dict[str, str]:
        """SI units of the measured quantities."""
        return _units(self.model, self.experiment, self.settings, self.data)

    @property
    def weighted(self) -> bool:
        """True if all sigmas are given."""
        return all(name in data.sigmas for data in self.data for name in data.found)

    def _sigma(self, data: Measurements, name: str) -> Array:
        column = data.found[name]
        there = ~np.isnan(column)
        if name in data.sigmas:
            return data.sigmas[name][there]
        size = float(np.sqrt(np.mean(column[there] ** 2)))  # equal weight for equal relative size
        return np.full(int(there.sum()), size or 1.0)

    def residuals(self, coordinates: Array) -> Array:
        """Return computed minus measured values, over sigma."""
        return self._both(coordinates)[0]

    def slopes(self, coordinates: Array) -> Array:
        """Return the derivatives of the residuals by coordinates."""
        return self._both(coordinates)[1]

    def computed(self, coordinates: Array) -> list[Array]:
        """Return the model's values for each of the series."""
        residuals, at, found = self._both(coordinates)[0], 0, []
        for one in self.series:
            found.append(residuals[at : at + len(one.measured)] * one.sigma + one.measured)
            at += len(one.measured)
        return found

    def compile_in(self) -> None:
        """Compile each value into a separate program from now on."""
        self.compiled_in, self._kept = True, None

    def _both(self, coordinates: Array) -> tuple[Array, Array]:
        key = coordinates.tobytes()
        if self._kept is None or self._kept[0] != key:
            self._kept = (key, *self._made(coordinates))
        return self._kept[1], self._kept[2]

    def _made(self, coordinates: Array) -> tuple[Array, Array]:
        values = dict(zip(self.names, map(float, self.values(coordinates)), strict=True))
        count = sum(len(s.measured) for s in self.series)
        try:
            tables = [table for data in self.data for table in self._tables(data, values)]
        except (RunFailed, CompilationFailed) as problem:
            self.failure = why(problem)
            return np.full(count, np.inf), np.full((count, len(self.names)), np.nan)
        residuals, slopes = [], []
        for one, (found, moved) in zip(self.series, tables, strict=True):
            rows = list(one.rows)
            residuals.append((found[rows] - one.measured) / one.sigma)
            slopes.append(moved[rows] / one.sigma[:, None])
        return np.concatenate(residuals), np.concatenate(slopes) * self.stretch(coordinates)

    def _tables(self, data: Measurements, values: Mapping[str, float]) -> list[tuple[Array, Array]]:
        """Return for each measured column its computed values (n,) and derivatives by parameters (n, k)."""
        if data.time is not None:
            return self._over_time(data, data.time, values)
        found = {
            name: (np.full(len(data), np.nan), np.full((len(data), len(self.names)), np.nan)) for name in data.found
        }
        for row in range(len(data)):
            wanted = [name for name, column in data.found.items() if not np.isnan(column[row])]
            given = {n: float(c[row]) for n, c in data.settings.items()}
            told = self._at_rest(wanted, given, values)
            for name in wanted:
                found[name][0][row], found[name][1][row] = told[name]
        return list(found.values())

    def _over_time(self, data: Measurements, time: Array, values: Mapping[str, float]) -> list[tuple[Array, Array]]:
        settings, moved = self._given({}, values)
        asked = AnalysisRequest(self.experiment, settings, tuple(sorted(data.found)))
        told = run_sensitivity(self.model, self.names, asked, time, moved=moved, known=self.partitions)
        places = {n: told.outputs.index(n) for n in data.found}
        return [(told.values[:, i], told.slopes[:, i]) for i in places.values()]

    def _given(self, row: Settings, values: Mapping[str, float]) -> tuple[dict[str, str | float], dict[str, float]]:
        """Return the settings, and the values that are changed in a program made with the author's values."""
        moved = {} if self.compiled_in else {n: v for n, v in values.items() if n not in self.inputs}
        return {**self.settings, **row, **{n: v for n, v in values.items() if n not in moved}}, moved

    def _at_rest(
        self, wanted: Sequence[str], row: Settings, values: Mapping[str, float]
    ) -> dict[str, tuple[float, Array]]:
        outputs = tuple(sorted({n for n in wanted if not OF_MODES.fullmatch(n)}))
        of = (*(("equilibrium",) if outputs else ()), *(("modes",) if len(outputs) < len(wanted) else ()))
        settings, moved = self._given(row, values)
        asked = AnalysisRequest(self.experiment, settings, outputs or None, self.names)
        point = operating_point(self.model, asked, moved=moved)
        told = sensitivity(point, of)
        missing = next((n for n in wanted if n not in told.quantities), None)
        if missing is not None:
            raise RunFailed("BR417", f"there is no `{missing}`: fewer modes move")
        places = {n: told.quantities.index(n) for n in wanted}
        return {n: (float(told.values[i]), told.slopes[i]) for n, i in places.items()}


def _units(
    model: CompiledModel, experiment: str | None, settings: Settings, data: Sequence[Measurements]
) -> dict[str, str]:
    space = model.compilation(model.scene(experiment, settings), everything=True).state_space
    units = {v.name: v.unit for v in space.variables} | {n: space.variables[v].unit for n, v in space.outputs.items()}
    names = [n for d in data for n in d.found]
    return {n: "Hz" if n.startswith("frequency ") else "1" if OF_MODES.fullmatch(n) else units[n] for n in names}
