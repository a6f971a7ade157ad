"""Result of a run: time, outputs by the author's names, data of the computation, and the energy balance."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Reported

from ..errors import MissingPackage, UnknownOutput, UsageError
from ..rendering import OfModel, draw, text_of
from .exports import Arrays, Exported, write_npz, write_rows
from .json_values import as_json, entries, finite, head
from .later import LaterField
from .records import Column, EnergyBalance, EventRecord, Extremes, LimitLeft

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from compiler.api import Array, Certificate

    from .checkpoint import Checkpoint
    from .run_check import ErrorEstimate, RunCheck
    from .truncation import TruncationReport

SCHEMA = "bondgraph-result/1"
ARCHIVE, RUN = "bondgraph-run/1", "the run"  # schema of a file, and its array with everything but numbers
NO_WARNINGS: Any = LaterField(())
NO_EVENTS: Any = LaterField(())
NO_CHECKPOINT: Any = LaterField(None)


@dataclass(frozen=True, eq=False, repr=False)
class Result(OfModel, Exported):
    """Result of one run; `result["x"]` is the output `x` over `result.time`, in SI.

    `time` (n,) in s; `values` (n, m) in SI, one column for each of `columns`; `report`: outputs shown by the experiment, with units; `steps` and
    `evaluations` count the solver's work, `rtol` is its relative tolerance, `wall_time` in s. `energy`: balance, if requested. `warnings`: violated limits
    of the model (`require`), where the run went on although the model is not valid, and tolerances that may not be meaningful (`ToleranceDoubt`).
    `certificate`: kind of the solved equations; `notes`: remarks on the run; `events`: the `when`s that acted, in order; `stopped_by`: the
    `stop when` at which the run ended, whose instant is then the last one. `stopped`: reason of an early
    end ("" if there is none); `checkpoint`: its end, from which `simulate(start=result)` goes on. `truncation`: truncated modes, if a bandwidth was
    requested; `check`: comparison with a repetition; `accuracy`: wanted largest error of an output relative to its magnitude; `error`: its estimate.
    `searched`: the extremes of each column between the reported instants, if they were asked for.
    Raises ValueError if the shapes do not fit.
    """

    time: Array
    columns: tuple[Column, ...]
    values: Array
    report: Sequence[Reported] = ()
    solver: str = ""
    steps: int = 0
    evaluations: Mapping[str, int] = field(default_factory=dict)
    rtol: float = math.nan
    wall_time: float = math.nan
    energy: EnergyBalance | None = None
    warnings: tuple[LimitLeft, ...] = NO_WARNINGS
    certificate: Certificate | None = None
    notes: tuple[str, ...] = ()
    events: tuple[EventRecord, ...] = NO_EVENTS
    stopped: str = ""
    checkpoint: Checkpoint | None = NO_CHECKPOINT
    truncation: TruncationReport | None = None
    check: RunCheck | None = None
    accuracy: float | None = None
    error: ErrorEstimate | None = None
    searched: tuple[Extremes, ...] = ()

    def __post_init__(self) -> None:
        if self.values.shape != (len(self.time), len(self.columns)):
            wanted = (len(self.time), len(self.columns))
            raise ValueError(f"values have the shape {self.values.shape}, time and columns want {wanted}")

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "warnings": self.warnings, "events": self.events, "checkpoint": self.checkpoint}

    @property
    def stopped_by(self) -> EventRecord | None:
        """The `stop when` of the experiment that ended the run; None if the run went to its end."""
        last = self.events[-1] if self.events and len(self.time) else None
        return last if last is not None and last.stops and last.time == self.time[-1] else None

    def __repr__(self) -> str:
        return f"<Result of {self.title}: {len(self.time)} instants of {', '.join(self.names) or 'nothing'}>"

    def _repr_html_(self) -> str:
        """Return a table with small curves, for notebooks."""
        return text_of(self, "html")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the outputs, in order, without `time`."""
        return tuple(column.name for column in self.columns)

    @cached_property
    def _places(self) -> Mapping[str, int]:
        return {column.name: place for place, column in enumerate(self.columns)}

    def _place(self, name: str) -> int:
        if name in self._places:
            return self._places[name]
        from difflib import get_close_matches

        near = get_close_matches(name, self.names, n=1)
        hint = f"did you mean `{near[0]}`?" if near else f"it has: {', '.join(self.names) or 'no outputs'}"
        hint += f"; what else the model has is asked for: `report {name}` in the experiment, or `outputs=({name!r},)`"
        raise UnknownOutput(f"there is no output `{name}` in the result of {self.title}; {hint}")

    def __getitem__(self, name: str) -> Array:
        """Return the output of that name over time (n,), in SI; "time" is time. Raises KeyError with the nearest name."""
        if name == "time" and name not in self._places:
            return self.time
        column: Array = self.values[:, self._place(name)]
        return column

    def __contains__(self, name: object) -> bool:
        return name == "time" or name in self._places

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def unit(self, name: str) -> str:
        """Return the SI unit of an output, "1" for a bare number. Raises KeyError."""
        if name == "time" and name not in self._places:
            return "s"
        return self.columns[self._place(name)].unit

    def final(self, name: str) -> float:
        """Return the last value of an output in SI, NaN if there is no instant. Raises KeyError."""
        values = self[name]
        return float(values[-1]) if len(values) else math.nan

    def extremes(self, name: str) -> Extremes:
        """Return the least and greatest value of an output in SI: in the solution if the run had `extremes`, else at the reported instants.

        Raises KeyError.
        """
        if self.searched:
            return self.searched[self._place(name)]
        values = self[name]
        if not len(values):
            return Extremes(math.nan, math.nan, math.nan, math.nan)
        low, high = int(values.argmin()), int(values.argmax())
        return Extremes(float(values[low]), float(self.time[low]), float(values[high]), float(self.time[high]))

    def shown(self) -> tuple[tuple[Reported, Array], ...]:
        """Return the columns for display: the report in its units and order, then the other outputs, in SI."""
        reported = [item for item in self.report if item.name in self._places]
        told = {item.name for item in reported}
        others = [Reported(column.name, column.unit) for column in self.columns if column.name not in told]
        return tuple((item, self[item.name] * item.scale + item.offset) for item in (*reported, *others))

    def to_numpy(self) -> dict[str, Array]:
        """Return arrays (n,) in SI by name, `time` first."""
        return {"time": self.time, **{name: self[name] for name in self.names}}

    def to_pandas(self) -> pandas.DataFrame:
        """Return a table in SI with `time` (s) as its index; `table.attrs["units"]` maps names to units.

        Raises MissingPackage without pandas.
        """
        try:
            import pandas
        except ImportError as error:
            raise MissingPackage("BR906", "a table needs pandas:", 'pip install "bondgraph-lang[table]"') from error
        table = pandas.DataFrame(self.values, index=pandas.Index(self.time, name="time"), columns=list(self.names))
        table.attrs["units"] = {"time": "s"} | {column.name: column.unit for column in self.columns}
        return table

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write `time [s],x [m],…` and the values in SI with 17 significant digits; completely or not at all.

        UTF-8, line feeds, RFC 4180: a name with a comma, a quote or a line break is quoted. A value that is not finite is `nan`, `inf` or `-inf`.
        Raises OSError.
        """
        heads = ["time [s]", *(f"{column.name} [{column.unit}]" for column in self.columns)]
        write_rows(path, list(map(_csv_field, heads)), [self.time, *self.values.T])

    def to_npz(self, path: str | os.PathLike[str]) -> None:
        """Write the arrays of `to_numpy` for `numpy.load`, for each a text `unit of NAME`, and the data for `read_result`; completely or not at all.

        Equal results give equal bytes. Raises OSError.
        """
        arrays: dict[str, NDArray[Any]] = dict(self.to_numpy())
        arrays |= {f"unit of {name}": np.array(self.unit(name)) for name in arrays}
        arrays[RUN] = np.array(json.dumps(self._facts()))
        write_npz(path, arrays | (self.checkpoint.arrays() if self.checkpoint is not None else {}))

    def _facts(self) -> dict[str, Any]:
        """Return everything but the columns' values and the arrays of the checkpoint, for a file."""
        return {
            "schema": ARCHIVE, "model": self.model, "experiment": self.experiment, "stopped": self.stopped,
            "columns": [[c.name, c.unit] for c in self.columns],
            "report": [[r.name, r.unit, r.scale, r.offset] for r in self.report],
            "solver": self.solver, "steps": self.steps, "evaluations": dict(self.evaluations), "rtol": self.rtol,
            "notes": list(self.notes), "warnings": [asdict(w) for w in self.warnings], "events": [asdict(e) for e in self.events],
            "bandwidth": None if self.truncation is None else self.truncation.to_json(),
            "energy": None if self.energy is None else asdict(self.energy),
            "extremes": [asdict(e) for e in self.searched],
            **({"end": None} if self.checkpoint is None else self.checkpoint.to_json()),
        }  # fmt: skip

    def _arrays(self) -> Arrays:
        told = {"model": self.model, "experiment": self.experiment, "solver": self.solver, "rtol": self.rtol}
        return Arrays({"time": (self.time, "s")}, {n: (("time",), self[n], self.unit(n)) for n in self.names}, told)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write a .csv, .npz, .nc (NetCDF) or .mat (MATLAB) file, by its ending. Raises OSError, UsageError for another ending."""
        ending = os.path.splitext(os.fspath(path))[1].lower()
        if ending == ".csv":
            self.to_csv(path)
        elif ending == ".npz":
            self.to_npz(path)
        else:
            super().write(path)

    def to_json(self) -> dict[str, Any]:
        """The run in numbers, for `json.dumps`, by the schema `bondgraph-result/1`:

            schema       "bondgraph-result/1"; the number grows when a reader of the old one would misread the new one
            model        name; experiment: name, or null if none was run
            time         {unit: "s", start, stop, points}
            outputs      {name: {unit, final, minimum, minimum_at, maximum, maximum_at}}, in SI whatever the report shows; instants in s
            extremes     what minimum and maximum are of: "solution", or "reported instants"
            solver       name; steps: accepted ones; evaluations: {what: count}; rtol; wall_time in s
            certificate  by `bondgraph-certificate/1`, if the result has one
            energy       only if asked for: {unit: "J", stored, supplied, dissipated, residual,
                         elements: {name: {kind, stored, supplied, dissipated, residual}}}
            warnings     limits of the model that were left: [{time, owner, condition, text, values: {name: {value, unit}}, place}];
                         tolerances in doubt: the same with the condition "tolerance" and no place
            notes        what became known of the run on its way: sentences
            bandwidth    if one was asked for: {frequency in Hz, faster: modes that ring faster, modes: those that were left out [{frequency, damping,
                         elements}], instants, outputs: {name: amplitude of what was left out}, kept: {name: its effect on what is kept,
                         null if it is not known}, energy in J or null, reason: a sentence or null}
            check        if it was asked for: {holds, sentence, solver, rtol, parts, outputs: {name: {unit, difference, magnitude, covered,
                         holds}}, events: [in the run, in its repetition], shift of their instants in s}
            accuracy     largest error of an output relative to its magnitude that was asked for, or null
            error        estimate of the errors: {rtol of the repetition, outputs: {name: {unit, error, magnitude}}, failure: a sentence or null}
            stopped      why the run ended before its end: a sentence, or null

        What is not finite is null: a minimum is null if a value anywhere in the run is no number.
        """
        start, stop = self.time[[0, -1]] if len(self.time) else (math.nan, math.nan)
        outputs = {
            column.name: {
                "unit": column.unit,
                "final": finite(self.final(column.name)),
                **as_json(self.extremes(column.name)),
            }
            for column in self.columns
        }
        told = {
            **head(SCHEMA, self),
            "time": {"unit": "s", "start": finite(start), "stop": finite(stop), "points": len(self.time)},
            "outputs": outputs,
            "extremes": "solution" if self.searched else "reported instants",
            "stopped": self.stopped or None,
            **entries(self, "solver", "steps", "evaluations", "rtol", "wall_time", "warnings", "notes", "accuracy"),
        }
        parts = {"bandwidth": self.truncation} | {
            w: getattr(self, w) for w in ("error", "check", "certificate", "energy")
        }
        return told | {word: part.to_json() for word, part in parts.items() if part is not None}

    def plot(
        self,
        path: str | os.PathLike[str] | None = None,
        over: str | None = None,
        ax: Axes | Sequence[Axes] | None = None,
    ) -> Figure:
        """Draw the outputs over time, or `over` one of them, also into a .png, .svg or .pdf file; or over time into axes of the caller, one for each unit.

        Raises MissingPackage without matplotlib, UsageError for another ending and for another number of axes or another option with them, OSError.
        """
        if ax is not None:
            if path is not None or over is not None:
                raise UsageError("BR941", "a plot into axes is over time, and is written by its owner: give `ax` alone")
            return draw(self, None, "plot", ax)
        return draw(self, path) if over is None else draw(self, path, "plot over", over)

    def summary(self, sparks: bool = False) -> str:
        """Return a table for terminals: the outputs in the units of the report, the solver's work, the energy if requested."""
        return text_of(self, "summary", sparks)


def _csv_field(text: str) -> str:
    """Return a heading as a field; text that a spreadsheet would take for a formula is in brackets: `-x [m]` becomes `(-x [m])`."""
    if text[:1] in "=+-@\t\r":
        text = f"({text})"
    if any(mark in text for mark in ',"\r\n'):
        return '"' + text.replace('"', '""') + '"'
    return text
