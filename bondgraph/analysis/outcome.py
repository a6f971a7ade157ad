"""Results of an experiment or a sweep: the analyses and runs of each of its points."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array

from ..errors import UsageError
from ..quantities import behind
from ..rendering import OfModel, Plotted, Summarised, draw
from ..results.exports import Arrays, Exported, write_csv
from ..results.json_values import entries, head

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..results.records import LimitLeft
    from ..results.result import Result
    from .equilibrium import Equilibrium
    from .modes import Modes
    from .response import Response

SCHEMA = "bondgraph-outcome/1"
MODES = 6  # most frequencies in a table
Numbers = dict[str, tuple[float, str]]


@dataclass(frozen=True, eq=False)
class Point:
    """One point: swept values, in SI, and its results."""

    settings: Mapping[str, float]
    equilibrium: Equilibrium | None = None
    modes: Modes | None = None
    responses: tuple[Response, ...] = ()
    run: Result | None = None
    failure: str = ""  # reason for missing results
    # results of other steps, by the word of the step, in the order of the experiment
    analyses: tuple[tuple[str, Any], ...] = ()

    def of(self, role: str) -> Any:
        """Return the result of the first step with that word: `of("invert").inputs`. Raises `UsageError`."""
        for word, result in self.analyses:
            if word == role:
                return result
        raise UsageError(
            "BR222", f"there is no `{role}` here; there is {', '.join(w for w, _ in self.analyses) or 'none'}"
        )

    def _of_analyses(self) -> dict[str, tuple[float, str]]:
        """Return numbers with units; a second step with the same name gets it with its number."""
        numbers: dict[str, tuple[float, str]] = {}
        for i, (role, result) in enumerate(self.analyses, 1):
            numbers |= {(n if n not in numbers else f"{n} ({i})"): v for n, v in numbers_of(role, result).items()}
        return numbers

    def units(self) -> dict[str, str]:
        """SI units of `numbers`; names without an entry are in Hz."""
        found: dict[str, str] = {}
        if self.equilibrium is not None:
            found |= {n: self.equilibrium.units.get(n, "1") for n in self.equilibrium.outputs}
        found |= {n: unit for n, (_, unit) in self._of_analyses().items()}
        if self.run is not None:
            found |= {n: self.run.unit(n) for n in self.run.names}
        return found

    def numbers(self) -> dict[str, float]:
        """Numbers of the point in a table: outputs at equilibrium, frequencies, results of other steps, outputs at the end of the run."""
        values: dict[str, float] = {}
        if self.equilibrium is not None:
            values |= dict(self.equilibrium.outputs)
        if self.modes is not None:
            moving = [m for m in self.modes if m.frequency > 0]
            values |= {f"frequency {i}": m.frequency for i, m in enumerate(moving[:MODES], 1)}
        for response in self.responses:
            values |= {f"peak of {given} to {seen}": at for given, seen, at in response.peaks()}
        values |= {n: value for n, (value, _) in self._of_analyses().items()}
        if self.run is not None:
            values |= {n: self.run.final(n) for n in self.run.names}
        return values

    def to_json(self) -> dict[str, Any]:
        """Return {settings, equilibrium, modes, responses, analyses: [{step, …}], run, failure}: the existing parts, each by its own schema."""
        analyses = [{"step": role, **found.to_json()} for role, found in self.analyses]
        there = [word for word in ("equilibrium", "modes", "run") if getattr(self, word) is not None]
        there += [word for word in ("responses", "failure") if getattr(self, word)]
        return entries(self, "settings", *there) | ({"analyses": analyses} if analyses else {})


@dataclass(frozen=True, eq=False, repr=False)
class Outcome(Sequence[Point], OfModel, Summarised, Plotted, Exported):
    """Points of an experiment in order, the last swept name running fastest; one without a sweep has a single point."""

    swept: Mapping[str, str]  # name -> SI unit
    points: tuple[Point, ...]
    shown: Mapping[str, tuple[str, float, float]]  # output -> unit, scale and offset in a table
    notes: tuple[str, ...] = ()
    words: Mapping[str, Sequence[str]] = field(default_factory=dict)  # what swept numbers stand for, from 1

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, place: int | slice) -> Any:
        return self.points[place]

    @property
    def failures(self) -> dict[int, str]:
        """Index of each failed point, and the reason."""
        return {i: p.failure for i, p in enumerate(self.points) if p.failure}

    @property
    def warnings(self) -> dict[int, tuple[LimitLeft, ...]]:
        """Index of each point whose run has warnings, and these."""
        return {i: p.run.warnings for i, p in enumerate(self.points) if p.run is not None and p.run.warnings}

    @property
    def units(self) -> dict[str, str]:
        """SI units of the columns of `table`."""
        found = dict(self.swept)
        for point in self.points:  # a later point may have more: another fold, another mode
            found = point.units() | found
        return {n: found.get(n, "Hz") for n in self.names}

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of `table`: swept names, then results."""
        return (*self.swept, *dict.fromkeys(n for p in self.points for n in p.numbers() if n not in self.swept))

    def table(self) -> Array:
        """Table with one row for each point, one column for each of `names`, in SI and Hz; NaN where a point has no such number."""
        rows = [dict(p.numbers()) | dict(p.settings) for p in self.points]
        table = [[row.get(n, math.nan) for n in self.names] for row in rows]
        return np.array(table, dtype=float).reshape(len(rows), len(self.names))

    def __call__(self, name: str) -> Array:
        """Return a column of the table over the points. Raises `UsageError`."""
        if name not in self.names:
            raise UsageError("BR223", f"there is no `{name}` in this outcome; it has {', '.join(self.names)}")
        return np.asarray(self.table()[:, self.names.index(name)])

    def to_json(self) -> dict[str, Any]:
        """Return JSON values by the schema `bondgraph-outcome/1`: {schema, model, experiment, swept: {name: unit}, points: [{settings, …}], notes}.

        Where words or texts were swept, `words: {name: [word, …]}` are what their numbers stand for, from 1.
        """
        return {**head(SCHEMA, self), **entries(self, "swept", "points", "notes", *["words"] * bool(self.words))}

    def in_words(self, settings: Mapping[str, float]) -> dict[str, str]:
        """Return swept values as texts: the words that numbers stand for, or numbers in the units of a table."""
        return {n: self.words[n][int(v) - 1] if n in self.words else self._with_unit(n, v) for n, v in settings.items()}

    def _with_unit(self, name: str, value: float) -> str:
        unit, scale, offset = self.shown.get(name, (self.swept[name], 1.0, 0.0))
        return f"{value * scale + offset:.7g}{behind(unit)}"

    @property
    def grid(self) -> tuple[int, ...] | None:
        """Number of values of each swept name, if the points are a complete grid of them; None otherwise."""
        values = [list(dict.fromkeys(p.settings[n] for p in self.points)) for n in self.swept]
        whole = [tuple(p.settings[n] for n in self.swept) for p in self.points] == list(itertools.product(*values))
        return tuple(map(len, values)) if whole and self.swept else None

    def _arrays(self) -> Arrays:
        """Return numbers over the swept names if they form a grid, else over `point`; and runs over time, if all have the same instants."""
        table, units, shape = self.table(), self.units, self.grid
        dims = tuple(self.swept) if shape is not None else ("point",)
        shape = shape if shape is not None else (len(self),)
        columns = {n: table[:, i] for i, n in enumerate(self.names)}
        coordinates = {}
        if dims != ("point",):
            coordinates = {n: (np.array(list(dict.fromkeys(columns[n].tolist()))), self.swept[n]) for n in dims}
        variables = {n: (dims, c.reshape(shape), units[n]) for n, c in columns.items() if n not in coordinates}
        times = [p.run.time for p in self.points if p.run is not None]
        if times and all(np.array_equal(t, times[0]) for t in times) and "time" not in dims:
            coordinates["time"] = (times[0], "s")
            for name in next(p.run for p in self.points if p.run is not None):
                rows = [np.full(len(times[0]), np.nan) if p.run is None else p.run[name] for p in self.points]
                variables[name] = ((*dims, "time"), np.array(rows).reshape(*shape, -1), units[name])
        return Arrays(coordinates, variables, {"model": self.model, "experiment": self.experiment})

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the table into a .csv (17 significant digits) file; or all of `to_xarray` into a .npz, .nc or .mat file. Raises OSError, `UsageError`."""
        if os.fspath(path).lower().endswith(".csv"):
            self.to_csv(path)
        else:
            super().write(path)

    def plot_curves(self, path: str | os.PathLike[str] | None = None) -> Figure:
        """Plot the runs of all points over time: a curve for each, or bands of many. Raises as `plot`, `UsageError` where nothing is simulated."""
        return draw(self, path, "curves")

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write the table as .csv, with words where they were swept, into a file of any name. Raises OSError."""
        columns = dict(zip(self.names, self.table().T, strict=True))
        words = {n: np.array([self.in_words(p.settings)[n] for p in self.points]) for n in self.words}
        write_csv(path, columns | words, self.units)


def numbers_of(role: str, found: Any) -> Numbers:
    """Return the numbers of one step's result; empty for a linear model."""
    return _READ[role](found) if role in _READ else {}


def _sensitivity(found: Any) -> Numbers:
    over_time = hasattr(found, "outputs")
    quantities = found.outputs if over_time else found.quantities
    slopes = found.slopes[-1] if over_time else found.slopes
    return {
        f"{q} by {p}": (float(slopes[i, j]), _over(found.units[q], found.units[p]))
        for i, q in enumerate(quantities)
        for j, p in enumerate(found.parameters)
    }


def _over(upper: str, lower: str) -> str:
    return upper if lower == "1" else f"{upper}/({lower})"


def _branch(found: Any) -> Numbers:
    unit, count, values = found.units.get(found.parameter, "1"), dict[str, int](), Numbers()
    for special in found.special:
        count[special.kind] = count.get(special.kind, 0) + 1
        values[f"{special.kind} {count[special.kind]} of {found.parameter}"] = (special.value, unit)
    return values or {f"last {found.parameter}": (float(found.values[-1]), unit)}


def _inversion(found: Any) -> Numbers:
    inputs: Mapping[str, Any] = found.inputs
    along = hasattr(found, "time")
    return {
        f"largest {n}" if along else n: (float(np.max(np.abs(v))) if along else float(v), found.units.get(n, "1"))
        for n, v in inputs.items()
    }


def _fit(found: Any) -> Numbers:
    return {p.name: (p.value, p.unit) for p in found.parameters}


def _chance(found: Any) -> Numbers:
    values = Numbers()
    for name in found.quantities:
        some = found.statistics(name)
        for word, short in (("mean", "mean"), ("standard deviation", "deviation")):
            values[f"{short} of {name}"] = (some.get(word, float("nan")), found.units[name])
    return values


_READ: dict[str, Callable[[Any], Numbers]] = {
    "sensitivity": _sensitivity,
    "continue": _branch,
    "invert": _inversion,
    "fit": _fit,
    "montecarlo": _chance,
}
