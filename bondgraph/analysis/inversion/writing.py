"""Feed-forward controller as text: the model with tables of time at its inputs.

Tables hold strengths: for a pair whose force is proportional to the square of the input the signed square, as that is smooth where the pair changes
sides, and the root is not. They are interpolated by a cubic; before and after the path its end values hold.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import UsageError

if TYPE_CHECKING:
    from .drives import Drive
    from .feed_forward import FeedForward


MOST_ROWS = 10_000  # most rows of a file of columns


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
            f"a table of a model has at most {MOST_ROWS} rows, this path has {len(found.time)} points: ask for fewer"
        )
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
    lines += [f'  "{output} = {text}"' for output, text in _plain(found)]
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


def _plain(found: FeedForward) -> list[tuple[str, str]]:
    return [(o, t.replace('"', "'").replace("\n", " ")) for o, t in found.wanted.items()]


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
        raise UsageError("a feed-forward model imports the model that it drives: save that as a file first")
    if found.experiment is not None:
        raise UsageError("a feed-forward model is made of a model as it is: leave the experiment out, set what it sets")
    whole, folder = found.file.resolve(), target.resolve().parent
    if not whole.is_relative_to(project_folder(target)):
        raise UsageError(
            f"{target} would have to import {found.file}, which is not in its project folder {project_folder(target)}: write it beside the model"
        )
    import os

    return Path(os.path.relpath(whole, folder)).as_posix()
