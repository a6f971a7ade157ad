"""Result of an inversion along a path: inputs over time, as numbers, as a table, as a model that can be run."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from compiler.api import Array, Reported

from ...errors import RunFailed, UsageError
from ...quantities import behind
from ...rendering import OfModel, Plotted, Summarised
from ...results.json_values import arrays_with_units, entries, head, with_units
from .equations import Drive

SCHEMA = "bondgraph-feed-forward/1"
NEAR = 1e-12  # relative to the largest of its unit: rounding of a rest, as of a rate in its search; such a start is the model's own
MOST_ROWS = 10_000  # most rows of a file of columns


@dataclass(frozen=True, eq=False, repr=False)
class FeedForward(OfModel, Summarised, Plotted):
    """The `inputs` with which `outputs` follow the path `wanted`, at `time` (N,), name -> (N,) in SI.

    `strengths`: of each input, or of each pair the signed value (`powers` 1) or square (2), which is smooth where the pair changes sides.
    `degrees`: number of derivatives of each output in the inverse. `internal`: eigenvalues (1/s) of the internal dynamics, empty if there are none.
    `start`: states in which it begins, where they differ from the model's own. `notes` name the jumps of inputs.
    """

    wanted: Mapping[str, str]
    settings: Mapping[str, float]
    time: Array
    inputs: Mapping[str, Array]
    outputs: Mapping[str, Array]
    states: Mapping[str, Array]
    strengths: Mapping[str, Array]
    drives: tuple[Drive, ...]
    degrees: Mapping[str, int]
    internal: tuple[complex, ...]
    start: Mapping[str, float]
    units: Mapping[str, str]
    notes: tuple[str, ...]
    file: Path | None = None
    plain: bool = False  # a model of bare numbers, without units
    report: Sequence[Reported] = ()  # units in which the experiment shows outputs

    def __getitem__(self, name: str) -> Array:
        """Return an input, output or state over time. Raises KeyError."""
        for values in (self.inputs, self.outputs, self.states):
            if name in values:
                return values[name]
        raise KeyError(f"there is no `{name}` here; there is {', '.join((*self.inputs, *self.outputs, *self.states))}")

    def to_json(self) -> dict[str, Any]:
        """Return JSON values by the schema `bondgraph-feed-forward/1`, in SI.

        {schema, model, experiment, wanted, time, inputs, outputs: {name: {unit, values}}, degrees, internal: [{re, im}], start: {name: {value, unit}},
        notes}.
        """
        told = {**head(SCHEMA, self), **entries(self, "wanted", "degrees", "internal", "notes")}
        told |= arrays_with_units({"time": self.time}, {"time": "s"})
        told |= {word: arrays_with_units(getattr(self, word), self.units) for word in ("inputs", "outputs")}
        return {**told, "start": with_units(self.start, self.units)}

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write time, inputs and outputs, in SI, with the units in the header; the file is written completely or not at all."""
        columns = {**self.inputs, **self.outputs}
        heads = ["time [s]", *(_head(name, self.units.get(name, "1")) for name in columns)]
        _write_columns(path, heads, [self.time, *columns.values()])

    def to_model(self, path: str | os.PathLike[str]) -> None:
        """Write a model (.bg) of the plant with its controller, and the controller's table (.csv) beside it; both completely or not at all.

        Raises `UsageError` if the model has no file, or if the new one would lie outside its project folder.
        """
        target = Path(path)
        text = model_text(self, target)
        heads, columns = table_of(self)
        _write_columns(target.with_suffix(".csv"), heads, columns)
        from ...files import write_text

        write_text(target, text)


# ---------------------------------------------------------------- the controller as a model
# Tables hold strengths: for a pair whose force is proportional to the square of the input the signed square, as that is smooth where the pair changes
# sides, and the root is not. They are interpolated by a cubic; before and after the path its end values hold.


def table_of(found: FeedForward) -> tuple[list[str], list[Any]]:
    """Return headers and columns of the controller's table."""
    heads, columns = ["time" if found.plain else "time [s]"], [found.time]
    for number, (drive, strength) in enumerate(zip(found.drives, found.strengths.values(), strict=True), 1):
        unit = _unit(drive, found)
        heads.append(f"strength_{number}" + ("" if unit == "1" else f" [{unit}]"))
        columns.append(strength)
    return heads, columns


def _unit(drive: Drive, found: FeedForward) -> str:
    unit = found.units.get(drive.push, "1")
    if drive.power == 1 or unit == "1":
        return unit
    return f"{unit}^2" if unit.isalpha() else f"({unit})^2"


def model_text(found: FeedForward, target: Path) -> str:
    """Return the text of a model beside `target`'s table. Raises `UsageError`."""
    if len(found.time) > MOST_ROWS:
        raise UsageError(
            "BR309", f"a table of a model has at most {MOST_ROWS} rows, this path has {len(found.time)} points:", "ask for fewer",
        )  # fmt: skip
    imported, name = _place(found, target), found.model
    own = "Driven" if name != "Driven" else "Controlled"
    table, outputs = target.with_suffix(".csv").name, list(found.outputs)
    first, last = (f"{t!r}{'' if found.plain else ' s'}" for t in (float(found.time[0]), float(found.time[-1])))
    lines = [
        f'"{name} with the inputs that lead {", ".join(outputs)} along a path: found by inversion of its equations."',
        "",
        f'import {name} from "{imported}"',
        "",
        f"{'plain ' if found.plain else ''}model {own} {{",
    ]
    for output, text in found.wanted.items():
        lines.append('  "{} = {}"'.format(output, text.replace('"', "'").replace("\n", " ")))
    lines.append(f"  signal at = min(max(time, {first}), {last})")
    given: list[str] = []
    for number, drive in enumerate(found.drives, 1):
        lines.append(
            f'  signal strength_{number} = cubic(at, column("{table}", "time"), column("{table}", "strength_{number}"))'
        )
        given += _given(drive, number, _unit(drive, found), found)
    lines.append(f"  {name} plant {{ {'; '.join(given)} }}")
    lines += [f"  output {_own(o)} = plant.{o}" for o in outputs]
    lines += [f"  output {_own(i)} = plant.{i}" for i in found.inputs]
    lines += ["", "  experiment follow {"]
    lines += [f"    set plant.{n} = {_number(v, found.units.get(n, '1'))}" for n, v in found.settings.items()]
    lines += [f"    start plant.{n} = {_number(v, found.units.get(n, '1'))}" for n, v in found.start.items()]
    lines += [
        f"    simulate {first} .. {last} {{ rtol = 1e-9, points = {len(found.time)} }}",
        "    report " + ", ".join(map(_own, (*outputs, *found.inputs))),
        "  }",
        "}",
    ]
    return "\n".join(lines) + "\n"


def _given(drive: Drive, number: int, unit: str, found: FeedForward) -> list[str]:
    """Return the assignments of the instance's inputs."""
    name = f"strength_{number}"
    zero = "0" if unit == "1" else f"0 [{unit}]"
    if drive.pull is None:
        return [f"{drive.push} = {name if drive.power == 1 else f'sqrt(max({name}, {zero}))'}"]
    sides = (f"max({name}, {zero})", f"max(-{name}, {zero})")
    if drive.power == 2:
        sides = (f"sqrt({sides[0]})", f"sqrt({sides[1]})")
    return [f"{drive.push} = {sides[0]}", f"{drive.pull} = {sides[1]}"]


def _own(name: str) -> str:
    """Return a name in the new model for one of the old, which may be nested."""
    return "".join(c if c.isalnum() else "_" for c in name).strip("_")


def _number(value: float, unit: str) -> str:
    return f"{value!r}" if unit == "1" else f"{value!r} [{unit}]"


def _place(found: FeedForward, target: Path) -> str:
    """Return the path of the model from the new file."""
    from compiler.api import project_folder

    if found.file is None:
        raise UsageError("BR310", "a feed-forward model imports the model that it drives:", "save that as a file first")
    if found.experiment is not None:
        raise UsageError("BR311", "a feed-forward model is made of a model as it is:", "name no experiment (`-e none`), set what it sets")  # fmt: skip
    whole, folder = found.file.resolve(), target.resolve().parent
    if not whole.is_relative_to(project_folder(target)):
        raise UsageError(
            "BR312", f"{target} would have to import {found.file}, which is not in its project folder {project_folder(target)}:", "write it beside the model",
        )  # fmt: skip
    return Path(os.path.relpath(whole, folder)).as_posix()


def _head(name: str, unit: str) -> str:
    text = name if unit == "1" else f"{name} [{unit}]"
    return '"' + text.replace('"', '""') + '"' if "," in text or '"' in text else text


def _write_columns(path: str | os.PathLike[str], heads: Sequence[str], columns: Sequence[Any]) -> None:
    from ...files import write_text

    rows = [",".join(f"{x:.17g}" for x in row) for row in np.column_stack(columns).tolist()]
    write_text(path, "\n".join([", ".join(heads), *rows]) + "\n")


def within_limits(found: Mapping[str, Array], times: Array, limits: Mapping[str, float], units: Mapping[str, str]) -> None:  # fmt: skip
    """Raise `RunFailed` where an input exceeds its limit."""
    for name, limit in limits.items():
        if name not in found:
            raise UsageError("BR313", f"`{name}` is none of the inputs that are looked for: {', '.join(found)}")
        size = np.abs(found[name])
        worst = int(size.argmax())
        if size[worst] > limit:
            unit = behind(units.get(name, "1"))
            raise RunFailed(
                "BR314", f"the path needs {size[worst]:.6g}{unit} of `{name}` at t = {times[worst]:.6g} s; it may have {limit:.6g}{unit}",
            )  # fmt: skip
