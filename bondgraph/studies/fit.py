"""Parameter estimation from measured data: weighted least squares with generated derivatives, and the uncertainty of the result.

`scipy.optimize.least_squares` (trust region, bounds) in coordinates of size 1: a parameter over its scale, or its logarithm. With given sigmas the
covariance is (J'J)^-1 and intervals are normal; where the scatter is larger than sigmas allow, or none are given, it is multiplied by the scatter
found, and intervals are Student's (Seber and Wild, Nonlinear Regression, 1989, section 5.1).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..analysis.operating_point import Asked, operating_point
from ..analysis.run_sensitivity import run_sensitivity
from ..analysis.sensitivity import sensitivity
from ..door import CompilationFailed
from ..errors import RunFailed, UsageError
from .asked import Settings, why
from .fitted import Fit, Fitted, Series
from .identify import OPEN, Found, directions, explanations, uncertainty
from .measured import OF_MODES, Measurements, read_measured
from .sweep import units_of

if TYPE_CHECKING:
    import os

    from numpy.typing import NDArray

    from ..analysed_model import AnalysedModel

    Array = NDArray[np.float64]

TOLERANCE = 1e-9  # relative tolerance of steps, of the sum of squares, and of its gradient at the start
MOST_STEPS = 100
NEAREST = 1e-6  # relative to the largest singular value: regularisation towards the start in undetermined directions
MOST_PARAMETERS = 100
SAME = 1e-7  # relative to the residuals and their derivatives: difference of two programs that agree


@dataclass(frozen=True, slots=True)
class Sought:
    """Fit parameter with bounds in SI (None: it keeps its sign); `start` None: its value in the model."""

    name: str
    low: float | None = None
    high: float | None = None
    logarithmic: bool = False
    start: float | None = None


def sought(text: str, unit: str, name: str) -> Sought:
    """Return the fit parameter of a text: `log`, `1.5 um .. 2.5 um`, `log 1 N/m .. 100 N/m`, or nothing. Raises `UsageError`."""
    from ..quantities import quantity

    words = re.fullmatch(r"\s*(log\b)?\s*(.*?)\s*", text, re.DOTALL)
    assert words is not None
    logarithmic, bounds = bool(words[1]), words[2]
    if not bounds:
        return Sought(name, logarithmic=logarithmic)
    low, dots, high = bounds.partition("..")
    if not dots:
        raise UsageError(
            f"{name}: bounds are written `LOW .. HIGH`, with `log` before them for a logarithmic scale; this is `{text}`"
        )
    ends = quantity(low, unit, name), quantity(high, unit, name)
    if not ends[0] < ends[1]:
        raise UsageError(f"{name}: bounds go from low to high; {ends[0]:g} is not below {ends[1]:g}")
    if logarithmic and ends[0] < 0:
        raise UsageError(f"{name}: a logarithmic scale has no bounds below zero")
    return Sought(name, *ends, logarithmic)


class Problem:
    """Least-squares problem: residuals over their sigmas, (n,), and their derivatives (n, k). Failed points have infinite residuals."""

    def __init__(
        self,
        model: AnalysedModel,
        data: Sequence[Measurements],
        given: Sequence[Sought],
        experiment: str | None,
        settings: Settings,
    ) -> None:
        self.model, self.data, self.experiment, self.settings = model, tuple(data), experiment, dict(settings)
        self.sought, self.names = tuple(given), tuple(s.name for s in given)
        self.logarithmic = np.array([s.logarithmic for s in given])
        self.failure = ""
        self.compiled_in = False  # True if each value is compiled into a separate program
        self._kept: tuple[bytes, Array, Array] | None = None
        self.start = self._start()
        self.scale = np.where(self.start != 0, np.abs(self.start), 1.0)

    def _start(self) -> Array:
        graph = self.model.compilation(self.model.scene(self.experiment, self.settings)).whole_graph
        self.following = [n for n in self.names if (d := graph.quantities[n].definition) is not None and d.arguments]
        self.inputs = {n for n in self.names if graph.quantities[n].role == "input"}
        found = []
        for s in self.sought:
            quantity = graph.quantities[s.name]
            value = s.start if s.start is not None else quantity.value
            if quantity.role not in ("parameter", "input") or value is None:
                raise UsageError(f"`{s.name}` is no parameter or input with a value: it cannot be fitted")
            if not (s.low is None or s.low <= value) or not (s.high is None or value <= s.high):
                raise UsageError(
                    f"{s.name}: the search begins where the model (or --set) has it, at {value:g}, which is outside of its bounds"
                )
            if s.logarithmic and not value > 0:
                raise UsageError(f"{s.name}: on a logarithmic scale the search begins above zero, not at {value:g}")
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
        told = run_sensitivity(
            self.model, self.names, self.experiment, settings, tuple(sorted(data.found)), time, None, 0, moved=moved
        )  # fmt: skip
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
        asked = Asked(self.experiment, settings, outputs or None, self.names)
        point = operating_point(self.model, asked, moved=moved)
        told = sensitivity(point, of)
        missing = next((n for n in wanted if n not in told.quantities), None)
        if missing is not None:
            raise RunFailed(f"there is no `{missing}`: fewer modes move")
        places = {n: told.quantities.index(n) for n in wanted}
        return {n: (float(told.values[i]), told.slopes[i]) for n, i in places.items()}


def fit(
    model: AnalysedModel, files: Sequence[str | os.PathLike[str] | Measurements], given: Mapping[str, str | Sought], experiment: str | None,
    settings: Settings, explain: bool | None = None,
) -> Fit:  # fmt: skip
    """Return the parameters that fit the data best.

    `explain`: examine small sets of parameters too (None: if the data leave parameters undetermined). Raises `UsageError`, `CompilationFailed`,
    `RunFailed`, OSError.
    """
    if not given or len(given) > MOST_PARAMETERS:
        raise UsageError(f"name the parameters to fit, from one to {MOST_PARAMETERS}")
    units = units_of(model, tuple(given), experiment, settings)
    starts = {n: v for n, v in _numbers(settings, units).items() if n in given}
    wanted = [sought(s, units[n], n) if isinstance(s, str) else s for n, s in given.items()]
    wanted = [replace(s, start=starts.get(s.name, s.start)) for s in wanted]
    left = {n: v for n, v in settings.items() if n not in given}
    data = _data(model, files, experiment, left, frozenset(given))
    problem = Problem(model, data, wanted, experiment, left)
    found = _checked(problem, solve(problem))
    sure = uncertainty(problem, found)
    told = directions(problem, found)
    open_ = any(d.open for d in told)
    subsets = explanations(problem, solve) if (explain if explain is not None else open_) else ()
    values = problem.values(found.coordinates)
    fitted = tuple(
        Fitted(n, units[n], float(problem.start[i]), float(values[i]), *sure.of(i)) for i, n in enumerate(problem.names)
    )
    compilation = model.compilation(model.scene(experiment, left))
    return Fit(
        compilation.whole_graph.name, compilation.plan.experiment, fitted, sure.correlations, problem.series, tuple(problem.computed(found.coordinates)),
        found.squares, found.count - len(fitted), problem.weighted, sure.scatter, told, subsets, (*sure.notes, *_notes(found, problem)),
    )  # fmt: skip


def _checked(problem: Problem, found: Found) -> Found:
    """Check the result of a program made with the author's values against programs with the values compiled in.

    If they differ, the values decide more than numbers, and the search is repeated with a program for each value.
    """
    quick = found.residuals
    problem.compile_in()
    honest = problem.residuals(found.coordinates)
    size = float(np.abs(quick).max(initial=0.0)) + float(np.abs(found.slopes).max(initial=0.0))
    if np.isfinite(honest).all() and np.abs(honest - quick).max(initial=0.0) <= SAME * size:
        problem.compiled_in = False
        return found
    return solve(problem)


def solve(problem: Problem, free: Sequence[int] | None = None, most: int = MOST_STEPS) -> Found:
    """Minimise the sum of squares; among equal minima the nearest to the start. Only the parameters `free` change (None: all).

    Raises `RunFailed` if the model fails at the start.
    """
    from scipy.optimize import least_squares

    start = problem.coordinates(problem.start)
    places = np.arange(len(start)) if free is None else np.array(free)
    low, high = problem.bounds

    def whole(x: Array) -> Array:
        found = start.copy()
        found[places] = x
        return found

    first = problem.residuals(start)
    if not np.isfinite(first).all():
        raise RunFailed(f"where the search begins the model has no answer: {problem.failure}")
    inside = np.clip(start[places], low[places], high[places])
    sizes = np.linalg.svd(problem.slopes(start)[:, places], compute_uv=False)
    is_open = len(sizes) < len(places) or not sizes[-1] > OPEN * sizes[0]
    pull = NEAREST * float(sizes.max(initial=0.0)) * np.eye(len(places)) if is_open else np.zeros((0, len(places)))
    settled = max(TOLERANCE * float(np.abs(problem.slopes(start)[:, places].T @ first).max()), 1e-15)
    done: Any = least_squares(
        lambda x: np.concatenate([problem.residuals(whole(x)), pull @ (x - inside)]), inside,
        jac=lambda x: np.concatenate([problem.slopes(whole(x))[:, places], pull]), bounds=(low[places], high[places]),
        xtol=TOLERANCE, ftol=TOLERANCE, gtol=settled, max_nfev=most,
    )  # fmt: skip
    at = whole(done.x)
    return Found(
        at, problem.residuals(at), problem.slopes(at), bool(done.status > 0), places[done.active_mask != 0], is_open
    )


def _numbers(settings: Settings, units: Mapping[str, str]) -> dict[str, float]:
    from ..quantities import quantity

    return {n: quantity(v, units[n], n) if isinstance(v, str) else float(v) for n, v in settings.items() if n in units}


def _data(
    model: AnalysedModel,
    files: Sequence[str | os.PathLike[str] | Measurements],
    experiment: str | None,
    settings: Settings,
    taken: frozenset[str],
) -> list[Measurements]:
    if not files:
        raise UsageError("there are no data: name a file")
    graph = model.compilation(model.scene(experiment, settings)).whole_graph
    settable = frozenset(n for n, q in graph.quantities.items() if q.role in ("parameter", "input"))
    space = model.compilation(model.scene(experiment, settings), everything=True).state_space
    units = {n: q.unit for n, q in graph.quantities.items()} | {v.name: v.unit for v in space.variables}
    units |= {n: space.variables[v].unit for n, v in space.outputs.items()}
    data = [f if isinstance(f, Measurements) else read_measured(f, units, settable) for f in files]
    for one in data:
        both = sorted(taken & set(one.settings))
        if both:
            raise UsageError(f"{one.file}: `{both[0]}` is fitted, and set line by line: one of the two")
    return data


def _units(
    model: AnalysedModel, experiment: str | None, settings: Settings, data: Sequence[Measurements]
) -> dict[str, str]:
    space = model.compilation(model.scene(experiment, settings), everything=True).state_space
    units = {v.name: v.unit for v in space.variables} | {n: space.variables[v].unit for n, v in space.outputs.items()}
    names = [n for d in data for n in d.found]
    return {n: "Hz" if n.startswith("frequency ") else "1" if OF_MODES.fullmatch(n) else units[n] for n in names}


def _notes(found: Found, problem: Problem) -> list[str]:
    notes = []
    if problem.following:
        names = ", ".join(f"`{n}`" for n in problem.following)
        notes.append(f"{names} follows from others in the model; here it is taken by itself, and stays when these move")
    if not found.ended:
        notes.append(f"the search did not settle within {MOST_STEPS} steps: the values are not the best ones yet")
    if found.open:
        notes.append(
            "the data leave parameters open: of all values that meet them as well, these are the nearest to the start"
        )
    if len(found.held):
        names = ", ".join(f"`{problem.names[i]}`" for i in found.held)
        notes.append(f"{names} ended on a bound: intervals there say little")
    return notes
