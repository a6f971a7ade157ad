"""Result of a run: time, outputs by the author's names, data of the computation, and the energy balance."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

from .errors import MissingPackage, UnknownOutput
from .files import replacing
from .rendering import draw, text_of

if TYPE_CHECKING:
    import numpy as np
    import pandas
    import xarray
    from numpy.typing import NDArray

    from .door import Certificate
    from .ended import End
    from .exports import Arrays
    from .left_out import LeftOut
    from .run_check import RunCheck

SCHEMA = "bondgraph-result/1"
ROWS_AT_ONCE = 10_000  # CSV rows turned into text at a time


@dataclass(frozen=True, slots=True)
class Column:
    """A recorded quantity: the author's name and the SI unit of its values, as `N*m`; "1" for a bare number."""

    name: str
    unit: str


class Reporting(Protocol):
    """Column of a report: `shown = SI * scale + offset`, in `unit`. `compiler.scene.Reported` is one."""

    @property
    def name(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def scale(self) -> float: ...
    @property
    def offset(self) -> float: ...


@dataclass(frozen=True, slots=True)
class Shown:
    """A column in the unit of a report: `shown = SI * scale + offset`."""

    name: str
    unit: str
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class ElementEnergy:
    """Energy of one element in a run, in J: change of its stored energy, supplied as a source, dissipated.

    `residual`: work of its bonds that none of the three explains: the error of the run, or a law that creates energy.
    """

    name: str
    kind: str
    stored: float
    supplied: float
    dissipated: float
    residual: float = 0.0


@dataclass(frozen=True, slots=True)
class EnergyBalance:
    """Energy balance of a run, in J: each element, the sums, and `residual = supplied - stored - dissipated`."""

    elements: tuple[ElementEnergy, ...]
    stored: float
    supplied: float
    dissipated: float
    residual: float


@dataclass(frozen=True, slots=True)
class LimitLeft:
    """Violation of a limit that a model requires: the first instant, and the values there in SI.

    `owner` is the instance ("" for the model itself), `place` the line of the limit, `stands` that of the instance.
    """

    time: float
    owner: str
    condition: str
    text: str
    values: tuple[tuple[str, float, str], ...]  # name, value, unit
    place: str
    stands: str = ""

    def __str__(self) -> str:
        return f"from t = {self.time:.9g} s {self.words_at_rest}"

    @property
    def words_at_rest(self) -> str:
        """Message without the instant."""
        who = f"`{self.owner}` ({self.stands})" if self.owner else "the model"
        shown = ", ".join(f"{name} = {value:.6g}{f' {unit}' * (unit != '1')}" for name, value, unit in self.values)
        about = f" ({self.text})" if self.text else ""
        where = f"{who} is outside of `{self.condition}`{about}, {self.place}"
        return f"{where}: {shown}" if shown else where


@dataclass(frozen=True, slots=True)
class ToleranceDoubt(LimitLeft):
    """A tolerance of a run that may not be meaningful; `text` gives the reason, `time` since when. The other fields have no meaning."""

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True)
class Occurrence:
    """Record of an event in a run: its time, its condition as written, the instance ("" for the model itself), its line."""

    time: float
    condition: str
    owner: str
    place: str

    def __str__(self) -> str:
        who = f" of `{self.owner}`" if self.owner else ""
        return f"t = {self.time:.9g} s: when {self.condition}{who}, {self.place}"


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """Result of one run; `result["x"]` is the output `x` over `result.time`, in SI.

    `time` (n,) in s; `values` (n, m) in SI, one column for each of `columns`; `report`: outputs shown by the experiment, with units; `steps` and
    `evaluations` count the solver's work, `rtol` is its relative tolerance, `wall_time` in s. `energy`: balance, if requested. `warnings`: violated limits
    of the model (`require`), where the run went on although the model is not valid, and tolerances that may not be meaningful (`ToleranceDoubt`).
    `certificate`: kind of the solved equations; `notes`: remarks on the run; `events`: the `when`s that acted, in order. `stopped`: reason of an early
    end ("" if there is none); `end`: checkpoint, from which `simulate(start=result)` goes on. `left_out`: truncated modes, if a bandwidth was
    requested; `check`: comparison with a repetition. Raises ValueError if the shapes do not fit.
    """

    model: str
    experiment: str | None
    time: NDArray[np.float64]
    columns: tuple[Column, ...]
    values: NDArray[np.float64]
    report: Sequence[Reporting] = ()
    solver: str = ""
    steps: int = 0
    evaluations: Mapping[str, int] = field(default_factory=dict)
    rtol: float = math.nan
    wall_time: float = math.nan
    energy: EnergyBalance | None = None
    warnings: tuple[LimitLeft, ...] = ()
    certificate: Certificate | None = None
    notes: tuple[str, ...] = ()
    events: tuple[Occurrence, ...] = ()
    stopped: str = ""
    end: End | None = None
    left_out: LeftOut | None = None
    check: RunCheck | None = None

    def __post_init__(self) -> None:
        if self.values.shape != (len(self.time), len(self.columns)):
            wanted = (len(self.time), len(self.columns))
            raise ValueError(f"values have the shape {self.values.shape}, time and columns want {wanted}")

    def __repr__(self) -> str:
        return f"<Result of {self.title}: {len(self.time)} instants of {', '.join(self.names) or 'nothing'}>"

    def _repr_html_(self) -> str:
        """Return a table with small curves, for notebooks."""
        return text_of(self, "html")

    @property
    def title(self) -> str:
        """Model and experiment, as in headings."""
        return self.model if self.experiment is None else f"{self.model}: {self.experiment}"

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

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """Return the output of that name over time (n,), in SI; "time" is time. Raises KeyError with the nearest name."""
        if name == "time" and name not in self._places:
            return self.time
        column: NDArray[np.float64] = self.values[:, self._place(name)]
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

    def shown(self) -> tuple[tuple[Reporting, NDArray[np.float64]], ...]:
        """Return the columns for display: the report in its units and order, then the other outputs, in SI."""
        reported = [item for item in self.report if item.name in self._places]
        told = {item.name for item in reported}
        others = [Shown(column.name, column.unit) for column in self.columns if column.name not in told]
        return tuple((item, self[item.name] * item.scale + item.offset) for item in (*reported, *others))

    def to_numpy(self) -> dict[str, NDArray[np.float64]]:
        """Return arrays (n,) in SI by name, `time` first."""
        return {"time": self.time, **{name: self[name] for name in self.names}}

    def to_pandas(self) -> pandas.DataFrame:
        """Return a table in SI with `time` (s) as its index; `table.attrs["units"]` maps names to units.

        Raises MissingPackage without pandas.
        """
        try:
            import pandas
        except ImportError as error:
            raise MissingPackage('a table needs pandas: pip install "bondgraph-lang[table]"') from error
        table = pandas.DataFrame(self.values, index=pandas.Index(self.time, name="time"), columns=list(self.names))
        table.attrs["units"] = {"time": "s"} | {column.name: column.unit for column in self.columns}
        return table

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write `time [s],x [m],…` and the values in SI with 17 significant digits; completely or not at all.

        UTF-8, line feeds, RFC 4180: a name with a comma, a quote or a line break is quoted. A value that is not finite is `nan`, `inf` or `-inf`.
        Raises OSError.
        """
        import numpy as np

        heads = ["time [s]", *(f"{column.name} [{column.unit}]" for column in self.columns)]
        row = ",".join(["%.17g"] * len(heads)) + "\n"
        with replacing(path) as stream:
            stream.write((",".join(map(_csv_field, heads)) + "\n").encode("utf-8"))
            for first in range(0, len(self.time), ROWS_AT_ONCE):
                part = slice(first, first + ROWS_AT_ONCE)
                rows = np.column_stack([self.time[part], self.values[part]]).tolist()
                stream.write("".join(row % tuple(numbers) for numbers in rows).encode("ascii"))

    def to_npz(self, path: str | os.PathLike[str]) -> None:
        """Write the arrays of `to_numpy` for `numpy.load`, for each a text `unit of NAME`, and the data for `read_result`; completely or not at all.

        Equal results give equal bytes. Raises OSError.
        """
        import numpy as np

        from .ended import arrays_of
        from .exports import write_npz

        arrays: dict[str, NDArray[Any]] = dict(self.to_numpy())
        arrays |= {f"unit of {name}": np.array(self.unit(name)) for name in arrays}
        arrays |= arrays_of(self)
        write_npz(path, arrays)

    def _arrays(self) -> Arrays:
        from .exports import Arrays

        told = {"model": self.model, "experiment": self.experiment, "solver": self.solver, "rtol": self.rtol}
        return Arrays({"time": (self.time, "s")}, {n: (("time",), self[n], self.unit(n)) for n in self.names}, told)

    def to_xarray(self) -> xarray.Dataset:
        """Return outputs over `time` in SI, each with its `units`. Raises MissingPackage without xarray."""
        from .exports import dataset

        return dataset(self._arrays())

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write a .csv, .npz, .nc (NetCDF) or .mat (MATLAB) file, by its ending. Raises OSError, UsageError for another ending."""
        from .exports import write_arrays

        ending = os.path.splitext(os.fspath(path))[1].lower()
        if ending == ".csv":
            self.to_csv(path)
        elif ending == ".npz":
            self.to_npz(path)
        else:
            write_arrays(path, self._arrays())

    def to_json(self) -> dict[str, Any]:
        """The run in numbers, for `json.dumps`, by the schema `bondgraph-result/1`:

            schema       "bondgraph-result/1"; the number grows when a reader of the old one would misread the new one
            model        name; experiment: name, or null if none was run
            time         {unit: "s", start, stop, points}
            outputs      {name: {unit, final, minimum, maximum}}, in SI whatever the report shows
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
            stopped      why the run ended before its end: a sentence, or null

        What is not finite is null: a minimum is null if a value anywhere in the run is no number.
        """
        told: dict[str, Any] = {
            "schema": SCHEMA,
            "model": self.model,
            "experiment": self.experiment,
            "time": {"unit": "s", "start": _first(self.time), "stop": _last(self.time), "points": len(self.time)},
            "outputs": {
                column.name: {"unit": column.unit} | {key: _finite(v) for key, v in extremes(self[column.name]).items()}
                for column in self.columns
            },
            "solver": self.solver,
            "steps": int(self.steps),
            "evaluations": {what: int(count) for what, count in self.evaluations.items()},
            "rtol": _finite(self.rtol),
            "wall_time": _finite(self.wall_time),
        }
        told["warnings"] = [_warning_json(item) for item in self.warnings]
        told["notes"] = list(self.notes)
        told["stopped"] = self.stopped or None
        if self.left_out is not None:
            told["bandwidth"] = self.left_out.to_json()
        if self.check is not None:
            told["check"] = self.check.to_json()
        if self.certificate is not None:
            told["certificate"] = self.certificate.to_json()
        if self.energy is not None:
            told["energy"] = _energy_json(self.energy)
        return told

    def plot(self, path: str | os.PathLike[str], over: str | None = None) -> None:
        """Draw the outputs over time, or `over` one of them, into a .png, .svg or .pdf file.

        Raises MissingPackage without matplotlib, UsageError for another ending, OSError.
        """
        if over is None:
            draw(self, path)
        else:
            draw(self, path, "plot over", over)

    def summary(self, sparks: bool = False) -> str:
        """Return a table for terminals: the outputs in the units of the report, the solver's work, the energy if requested."""
        return text_of(self, "summary", sparks)


def extremes(values: NDArray[np.float64]) -> dict[str, float]:
    """Return `final`, `minimum` and `maximum` of a column (n,); NaN where there is none."""
    if not len(values):
        return {"final": math.nan, "minimum": math.nan, "maximum": math.nan}
    return {"final": float(values[-1]), "minimum": float(values.min()), "maximum": float(values.max())}


def _csv_field(text: str) -> str:
    """Return a heading as a field; text that a spreadsheet would take for a formula is in brackets: `-x [m]` becomes `(-x [m])`."""
    if text[:1] in "=+-@\t\r":
        text = f"({text})"
    if any(mark in text for mark in ',"\r\n'):
        return '"' + text.replace('"', '""') + '"'
    return text


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _first(time: NDArray[np.float64]) -> float | None:
    return _finite(time[0]) if len(time) else None


def _last(time: NDArray[np.float64]) -> float | None:
    return _finite(time[-1]) if len(time) else None


def read_result(path: str | os.PathLike[str]) -> Result:
    """Return a result from a file of `to_npz`. Raises OSError, and UsageError if the file is not valid."""
    from .ended import read

    return read(os.fspath(path))


def _warning_json(item: LimitLeft) -> dict[str, Any]:
    values = {name: {"value": _finite(value), "unit": unit} for name, value, unit in item.values}
    told = {"time": item.time, "owner": item.owner, "condition": item.condition, "text": item.text}
    return {**told, "values": values, "place": item.place}


def _energy_json(energy: EnergyBalance) -> dict[str, Any]:
    sums = ("stored", "supplied", "dissipated")
    told: dict[str, Any] = {"unit": "J"} | {key: _finite(getattr(energy, key)) for key in (*sums, "residual")}
    told["elements"] = {
        element.name: {"kind": element.kind} | {key: _finite(getattr(element, key)) for key in (*sums, "residual")}
        for element in energy.elements
    }
    return told
