"""Measured data: a CSV file whose headings are names with units, `fx [uN],x [um],sigma x [um]`.

A column of a parameter or input is a setting, all others are measurements: outputs at equilibrium, `frequency 1 [Hz]` and so on of the moving modes
(slowest first), or outputs over a column `time [s]`. `sigma NAME` is the standard deviation of the column NAME. An empty field was not measured;
a field that is no number is an error. Lines that begin with `#` are ignored.
"""

from __future__ import annotations

import csv
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from compiler.api import Array

from ..errors import UsageError

_HEAD = re.compile(r"\s*(.*?)\s*(?:\[(.*)\])?\s*", re.DOTALL)
OF_MODES = re.compile(r"(frequency|damping) [1-9]\d*")
SIGMA = "sigma "
LARGEST = 10_000_000  # most fields


@dataclass(frozen=True, eq=False)
class Series:
    """One measured quantity: its rows (from 0) in a file, values in SI, and standard deviations (or sizes, if none are given)."""

    file: str
    name: str
    unit: str
    rows: tuple[int, ...]
    measured: Array
    sigma: Array


@dataclass(frozen=True, eq=False)
class Measurements:
    """Columns `settings` and `found` (n,) in SI by name; NaN in `found` where nothing was measured. `sigmas` of some of them.

    `time` (n,) in s, None if the data are of equilibria.
    """

    file: str
    settings: Mapping[str, Array]
    found: Mapping[str, Array]
    sigmas: Mapping[str, Array]
    time: Array | None

    def __len__(self) -> int:
        return len(next(iter(self.found.values())))


def read_measured(path: str | os.PathLike[str], units: Mapping[str, str], settable: frozenset[str]) -> Measurements:
    """Read a file. `units`: SI units of the model's names; `settable`: its parameters and inputs. Raises `UsageError`, OSError."""
    file = os.fspath(path)
    return _sorted_out(file, read_columns(file, units), settable)


def read_columns(file: str, units: Mapping[str, str], others: bool = False) -> dict[str, Array]:
    """Return the columns of a file in SI by their headings; NaN for empty fields. Raises `UsageError`, OSError.

    `others`: the file may have more columns than the names in `units` and `time`; these are left out.
    """
    with open(file, encoding="utf-8-sig", newline="") as stream:
        try:
            lines = list(enumerate(csv.reader(stream), 1))
        except (UnicodeDecodeError, csv.Error) as problem:
            raise UsageError("BR498", f"{file}: this is no file of columns in UTF-8") from problem
    rows = [(i, row) for i, row in lines if any(x.strip() for x in row) and not row[0].startswith("#")]
    if len(rows) < 2:
        raise UsageError("BR420", f"{file}: a line of headings and at least one of numbers are needed")
    heads = rows[0][1]
    if len(heads) * len(rows) > LARGEST:
        raise UsageError("BR421", f"{file}: at most {LARGEST} fields are read")
    columns = {}
    for place, head in enumerate(heads):
        if others and _name_and_unit(head)[0] not in (*units, "time"):
            continue
        name, values = _column(file, place, head, rows[1:], units)
        if name in columns:
            raise UsageError("BR422", f"{file}: two columns are called `{name}`")
        columns[name] = values
    ragged = next((i for i, row in rows if len(row) != len(heads)), None)
    if ragged is not None:
        raise UsageError("BR423", f"{file}, line {ragged}: as many fields as headings are needed, {len(heads)}")
    return columns


def _name_and_unit(head: str) -> tuple[str, str | None]:
    match = _HEAD.fullmatch(head)
    return (match[1], match[2]) if match is not None else (head, None)


def _column(
    file: str, place: int, head: str, rows: Sequence[tuple[int, Sequence[str]]], units: Mapping[str, str]
) -> tuple[str, Array]:
    from compiler.api import CompilationFailed, Source, counts_radians, read_unit

    name, own = _name_and_unit(head)
    bare = name.removeprefix(SIGMA)
    of_modes = "Hz" if bare.startswith("frequency ") else "1" if OF_MODES.fullmatch(bare) else ""
    kind = "s" if bare == "time" else of_modes or units.get(bare)
    if kind is None or not bare:
        raise UsageError(
            "BR424", f"{file}: the model has no `{bare}`; a heading is a name with its unit, as in `x [um]`"
        )
    try:
        scale, wanted = (read_unit(Source(f"heading `{name}`", u)) for u in (own or "1", "1" if kind == "dB" else kind))
    except CompilationFailed:
        raise UsageError("BR425", f"{file}: `{own}` in the heading of `{name}` is no unit") from None
    if (
        (own is None and kind != "1")
        or scale.dimension != wanted.dimension
        or (kind == "Hz" and counts_radians(own or ""))
    ):
        told = f"in {own}" if own else "without a unit"
        raise UsageError("BR426", f"{file}: `{name}` is in {kind}; it stands there {told}")
    if name != bare and scale.offset:
        raise UsageError("BR427", f"{file}: `{name}` is a difference;", "write it in K")
    return name, np.array([_number(file, line, name, row, place, scale.to_si) for line, row in rows])


def _number(file: str, line: int, name: str, row: Sequence[str], place: int, to_si: object) -> float:
    text = row[place].strip() if place < len(row) else ""
    if not text:
        return math.nan
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UsageError("BR428", f"{file}, line {line}: `{text}` in the column `{name}` is no number")
    return float(to_si(value))  # type: ignore[operator]


def check_complete(file: str, name: str, column: Array) -> None:
    """Raise `UsageError` if a column has empty fields."""
    if np.isnan(column).any():
        raise UsageError("BR430", f"{file}: `{name}` is not given in every line")


def check_path(file: str, time: Array, settings: Sequence[str]) -> None:
    """Raise `UsageError` if columns are no path in time: with settings line by line, or with times that do not grow."""
    if settings:
        raise UsageError(
            "BR433", f"{file}: over time nothing else is set line by line;", f"leave out `{settings[0]}`, or set it for all",
        )  # fmt: skip
    if (np.diff(time) <= 0).any():
        raise UsageError("BR435", f"{file}: the column `time` does not grow from line to line")


def _sorted_out(file: str, columns: Mapping[str, Array], settable: frozenset[str]) -> Measurements:
    settings = {n: c for n, c in columns.items() if n in settable}
    sigmas = {n.removeprefix(SIGMA): c for n, c in columns.items() if n.startswith(SIGMA)}
    found = {n: c for n, c in columns.items() if n not in settings and not n.startswith(SIGMA) and n != "time"}
    time = columns.get("time")
    if not found:
        raise UsageError(
            "BR429", f"{file}: nothing is measured: a column of an output or of `frequency 1 [Hz]` is needed"
        )
    for name in columns:
        if name in settings or name == "time":
            check_complete(file, name, columns[name])
    for name, column in sigmas.items():
        if name not in found:
            raise UsageError("BR431", f"{file}: `sigma {name}` stands beside no `{name}`")
        there = ~np.isnan(found[name])
        if not (column[there] > 0).all():
            raise UsageError("BR432", f"{file}: `sigma {name}` is not above zero wherever `{name}` is measured")
    if time is not None:
        check_path(file, time, list(settings))
        if any(OF_MODES.fullmatch(n) for n in found):
            raise UsageError("BR434", f"{file}: frequencies of modes stand in no column over time")
    empty = next((n for n, c in found.items() if np.isnan(c).all()), None)
    if empty is not None:
        raise UsageError("BR436", f"{file}: the column `{empty}` is empty")
    return Measurements(file, settings, found, sigmas, time)
