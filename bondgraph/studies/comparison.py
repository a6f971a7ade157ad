"""Runs and measured data beside a run: the same outputs over time, and their differences."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from compiler.api import Array

from ..errors import UsageError
from ..rendering import Plotted, Summarised
from ..results.archive import read_result
from ..results.json_values import entries, head
from ..results.result import Result
from .measured import check_complete, check_path, read_columns

SCHEMA = "bondgraph-comparison/1"


@dataclass(frozen=True, eq=False)
class NamedResult:
    """A result and the file that it was read from."""

    file: str
    result: Result


Other = Result | NamedResult | str | os.PathLike[str]


@dataclass(frozen=True, eq=False)
class OtherCurves:
    """Curves beside a run: instants `time` (k,) in s, values (k,) in SI by output (NaN: not measured), the `label`, and whether it was `measured`."""

    label: str
    time: Array
    values: dict[str, Array]
    measured: bool


@dataclass(frozen=True, slots=True)
class CurveDifference:
    """Difference of one output from a run, at the instants of the other within it: the largest in SI with its instant in s, the root of the mean square."""

    output: str
    unit: str
    other: str
    instants: int
    largest: float
    at: float
    root_mean_square: float
    magnitude: float  # largest value of the output of the run


@dataclass(frozen=True, eq=False, repr=False)
class CurveComparison(Summarised, Plotted):
    """A run beside others. Between its reported instants the run is taken as a straight line."""

    run: Result
    others: tuple[OtherCurves, ...]

    @property
    def differences(self) -> tuple[CurveDifference, ...]:
        """Differences of the outputs, in the order of the run, each for all others that have it."""
        return tuple(d for name in self.run.names for other in self.others for d in self._difference(name, other))

    def _difference(self, name: str, other: OtherCurves) -> Iterator[CurveDifference]:
        time, values, own = self.run.time, other.values.get(name), self.run[name]
        if values is None or not len(time):
            return
        common = (other.time >= time[0]) & (other.time <= time[-1]) & np.isfinite(values)
        if not common.any():
            return
        away = np.abs(values[common] - np.interp(other.time[common], time, own))
        place, magnitude = int(np.argmax(away)), float(np.abs(own).max())
        root, at = float(np.sqrt(np.mean(away * away))), float(other.time[common][place])
        yield CurveDifference(
            name, self.run.unit(name), other.label, int(common.sum()), float(away[place]), at, root, magnitude
        )

    def to_json(self) -> dict[str, Any]:
        """Return JSON values by the schema `bondgraph-comparison/1`: {schema, model, experiment, others: [{label, measured, instants}],
        differences: [{output, unit, other, instants, largest, at, root_mean_square, magnitude}]}, in SI.
        """
        others = [{"label": o.label, "measured": o.measured, "instants": len(o.time)} for o in self.others]
        return {**head(SCHEMA, self.run), "others": others, **entries(self, "differences")}


def compare(run: Result, *others: Other) -> CurveComparison:
    """Return a run beside others: results, their .npz files, and .csv files of data over time (`time [s],x [um]`).

    Raises UsageError for files that are none of these, and for others that have none of its outputs, in its units; OSError.
    """
    labels = _labels([_name_of(other, place) for place, other in enumerate(others, 2)])
    return CurveComparison(run, tuple(_curves(run, other, label) for other, label in zip(others, labels, strict=True)))


def opened(files: Sequence[str]) -> tuple[Other, ...]:
    """Return files for `compare`, those of results read: a run need not end before it is known that one is none. Raises UsageError, OSError."""
    for file in files:
        with open(file, "rb"):
            pass
    return tuple(file if file.lower().endswith(".csv") else NamedResult(file, read_result(file)) for file in files)


def _name_of(other: Other, place: int) -> str:
    if isinstance(other, Result):
        return f"run {place}"
    return other.file if isinstance(other, NamedResult) else os.fspath(other)


def _labels(files: Sequence[str]) -> list[str]:
    """Return short labels of files: their names, or all of their paths where names are alike."""
    names = [Path(file).name for file in files]
    return [name if names.count(name) == 1 else file for name, file in zip(names, files, strict=True)]


def _curves(run: Result, other: Other, label: str) -> OtherCurves:
    units = {column.name: column.unit for column in run.columns}
    if isinstance(other, str | os.PathLike) and Path(other).suffix.lower() == ".csv":
        return _measured(os.fspath(other), label, units)
    result = (
        other.result if isinstance(other, NamedResult) else other if isinstance(other, Result) else read_result(other)
    )
    common = [name for name in result.names if name in units]
    for name in common:
        if result.unit(name) != units[name]:
            raise UsageError("BR470", f"{label}: `{name}` is in {result.unit(name)} there, in {units[name]} in the run")
    if not common:
        raise UsageError(
            "BR471",
            f"{label} has none of the outputs {', '.join(run.names)}: it has {', '.join(result.names) or 'none'}",
        )
    return OtherCurves(label, result.time, {name: result[name] for name in common}, False)


def _measured(file: str, label: str, units: dict[str, str]) -> OtherCurves:
    columns = read_columns(file, units, others=True)
    time = columns.pop("time", None)
    if time is None:
        raise UsageError("BR472", f"{file}: data beside a run need a column `time [s]`")
    check_complete(file, "time", time)
    check_path(file, time, ())
    if not columns:
        raise UsageError("BR473", f"{file} has no column of the outputs {', '.join(units)}")
    return OtherCurves(label, time, columns, True)
