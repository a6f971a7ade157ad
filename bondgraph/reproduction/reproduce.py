"""Reproduction of a list of published values.

The list of a folder is read and checked; each experiment is computed once, however many entries use it.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..analysed_model import AnalysedModel
from ..compiled_model import source_of
from ..errors import UsageError
from ..quantities import in_unit, quantity
from .compared import Compared, Erratum, PictureFile, Reproduction, Table

if TYPE_CHECKING:
    from ..analysis.outcome import Outcome, Point

DIGITS = 6  # digits of computed tables
FILE = "published.toml"
MOST = 10_000  # most entries of a kind
TAKES = ("final", "minimum", "maximum", "peak to peak")
KINDS = ("time", "phase", "energy", "response", "sweep", "surface", "modes")
Words = Mapping[str, type | tuple[type, ...]]
NUMBER = (float, int)
SECTIONS: Mapping[str, Words] = {
    "value": {
        "where": str, "what": str, "model": str, "experiment": str, "of": str, "published": (float, int, list), "unit": str, "digits": NUMBER,
    },
    "table": {"where": str, "what": str, "model": str, "experiment": str},
    "inversion": {"where": str, "what": str, "model": str, "by": list, "outputs": list, "setpoints": list},
    "picture": {"where": str, "what": str, "model": str, "experiment": str, "kind": str},
    "erratum": {"where": str, "text": str},
}  # fmt: skip


def reproduce(
    folder: str | os.PathLike[str], page: str | os.PathLike[str] | None = None, pictures: str = ""
) -> Reproduction:
    """Run all entries of `published.toml` of a folder. `pictures`: "svg" or "png" are drawn beside a `page`, which is not written here.

    Raises `UsageError` for an invalid list, and as `Model.run`.
    """
    place = Path(folder)
    found = listed(place)
    computing = Computing(place)
    values = tuple(v for entry in found.get("value", ()) for v in computing.values(entry))
    tables = (
        *(computing.table(entry) for entry in found.get("table", ())),
        *(computing.inversion(entry) for entry in found.get("inversion", ())),
    )
    errata = tuple(Erratum(e["where"], e["text"]) for e in found.get("erratum", ()))
    title, source = str(found.get("title", place.name)), str(found.get("source", ""))
    made = Reproduction(title, source, values, errata, tables)
    if page is None or not pictures:
        return made
    return replace(made, pictures=draw_all(computing, found.get("picture", ()), Path(page), pictures))


def draw_all(
    computing: Computing, entries: Sequence[Mapping[str, Any]], page: Path, kind: str
) -> tuple[PictureFile, ...]:
    """Draw each figure into `PAGE_N.KIND` in the folder of the page. Raises `UsageError`, `MissingPackage`, OSError, and as `Model.run`."""
    drawn = []
    for number, entry in enumerate(entries, 1):
        path = page.with_name(f"{page.stem}_{number}.{kind}")
        _draw(computing, entry, path)
        drawn.append(PictureFile(entry["where"], entry["what"], path.name))
    return tuple(drawn)


def _draw(computing: Computing, entry: Mapping[str, Any], path: Path) -> None:
    model, experiment, kind = computing.model(entry["model"]), entry["experiment"], entry["kind"]
    if kind == "modes":
        from ..presentation.diagram import shapes_of, write_figure

        write_figure(shapes_of(model, experiment or None, entry.get("of"), int(entry.get("count", 6))), path)
        return
    if kind == "energy":
        from ..analysis.energies import energies

        energies(model, experiment).plot(path)
        return
    outcome = computing.outcome(entry["model"], experiment)
    if kind == "surface":
        from ..presentation.plots.families import plot_surface

        plot_surface(outcome, path, str(entry.get("of", "")))
    elif kind in ("time", "phase"):
        (point,) = outcome.points if len(outcome) == 1 else (None,)
        if point is None or point.run is None:
            raise UsageError("BR811", f"{entry['what']}: `{experiment}` is not one simulation")
        point.run.plot(path, entry.get("over") if kind == "phase" else None)
    else:
        outcome.plot(path)


class Computing:
    """Models of a folder and their results."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._models: dict[str, AnalysedModel] = {}
        self._outcomes: dict[tuple[str, str], Outcome] = {}

    def model(self, file: str) -> AnalysedModel:
        """Return a model of the folder, read once."""
        if file not in self._models:
            self._models[file] = AnalysedModel(source_of(inside(self.folder, file)))
        return self._models[file]

    def outcome(self, file: str, experiment: str) -> Outcome:
        """Return the outcome of an experiment; "": of the model at equilibrium."""
        from ..simulation.run_options import RunRequest
        from ..studies.experiment import run, sweep
        from ..studies.scalar_study import ScalarStudy

        key = file, experiment
        if key not in self._outcomes:
            model = self.model(file)
            self._outcomes[key] = (
                run(model, RunRequest(experiment))
                if experiment
                else sweep(model, {}, ScalarStudy(("equilibrium",), RunRequest(None)), False)
            )
        return self._outcomes[key]

    # ------------------------------------------------------------ values
    def values(self, entry: Mapping[str, Any]) -> list[Compared]:
        """Return a published value, or one for each point of a sweep."""
        outcome = self.outcome(entry["model"], entry["experiment"])
        published = entry["published"]
        if not isinstance(published, list):
            return [self._value(outcome, entry, entry["what"], float(published), entry.get("point", 0))]
        if len(published) != len(outcome):
            raise UsageError(
                "BR801", f"{entry['what']}: {len(published)} values are published, and the experiment has {len(outcome)} points",
            )  # fmt: skip
        return [
            self._value(outcome, entry, f"{entry['what']}, {_setting(outcome, i, entry)}", float(number), i)
            for i, number in enumerate(published)
        ]

    def _value(self, outcome: Outcome, entry: Mapping[str, Any], what: str, published: float, place: object) -> Compared:  # fmt: skip
        name = entry["of"]
        if name not in outcome.names or not isinstance(place, int) or not 0 <= place < len(outcome):
            known: Sequence[str] = outcome.names
            raise UsageError(
                "BR802", f"{entry['what']}: there is no `{name}` at point {place} of `{entry['experiment']}`; there is {', '.join(known)}",
            )  # fmt: skip
        number = taken(outcome.points[place], name, entry, float(outcome(name)[place]))
        computed = in_unit(number, entry["unit"], outcome.units[name], what)
        return Compared(
            entry["where"], what, entry["unit"], published, computed, float(entry["digits"]), str(entry.get("note", ""))
        )

    # ------------------------------------------------------------ tables
    def table(self, entry: Mapping[str, Any]) -> Table:
        """Return all points of an experiment, as it reports them."""
        outcome = self.outcome(entry["model"], entry["experiment"])
        names = list(outcome.names)
        shown = [outcome.shown.get(n, (outcome.units[n], 1.0, 0.0)) for n in names]
        swept = {n: _shown_sweep(outcome, n, entry) for n in outcome.swept}
        shown = [swept.get(n, s) for n, s in zip(names, shown, strict=True)]
        rows = []
        for i, point in enumerate(outcome.points):
            numbers = [taken(point, n, entry, float(outcome(n)[i])) for n in names]
            rows.append(tuple(x * scale + offset for x, (_, scale, offset) in zip(numbers, shown, strict=True)))
        heads = tuple(_head(n, s[0]) for n, s in zip(names, shown, strict=True))
        return Table(entry["where"], entry["what"], heads, tuple(rows), str(entry.get("note", "")))

    def inversion(self, entry: Mapping[str, Any]) -> Table:
        """Return inputs that hold setpoints at equilibrium, and the model's outputs there, verified by a separate equilibrium search."""
        model, by, outputs = self.model(entry["model"]), list(map(str, entry["by"])), list(map(str, entry["outputs"]))
        known = model.compilation().whole_graph.outputs
        show = [_unit_of(text, known) for text in entry.get("show", ())]
        units = model.compilation().whole_graph.quantities
        rows, heads = [], list[str]()
        for setpoint in entry["setpoints"]:
            if not isinstance(setpoint, Mapping) or not set(setpoint) <= set(outputs):
                raise UsageError("BR803", f"{entry['what']}: a setpoint gives values to {', '.join(outputs)}")
            wanted = {n: quantity(setpoint.get(n, 0.0), known[n].kind, n) for n in outputs}
            inputs = model.invert(wanted, by, None).inputs
            rest = model.equilibrium(None, inputs)
            missed = max(abs(rest[n] - wanted[n]) for n in outputs)
            signed = [inputs[a] - (inputs[b] if b else 0.0) for a, _, b in (pair.partition("/") for pair in by)]
            heads = [
                "setpoint",
                *(_head(a, units[a.partition("/")[0]].unit) for a in by),
                *(_head(n, u) for n, u in show), "off by (SI)",
            ]  # fmt: skip
            values = [in_unit(rest[n], u, known[n].unit or "1", n) if u else rest[n] for n, u in show]
            told = ", ".join(f"{n} = {v}" for n, v in setpoint.items())
            rows.append((told, *signed, *values, missed))
        return Table(entry["where"], entry["what"], tuple(heads), tuple(rows), str(entry.get("note", "")))


def taken(point: Point, name: str, entry: Mapping[str, Any], final: float) -> float:
    """Return the value requested from a run: its last value, or a minimum, maximum or range after some instant."""
    take = entry.get("take", "final")
    if take == "final" or point.run is None or name not in point.run:
        return final
    from ..simulation.run_options import seconds

    run = point.run
    values = run[name][run.time >= seconds(str(entry.get("after", "0 s")))]
    if not len(values):
        raise UsageError("BR804", f"{entry['what']}: the run ends before {entry['after']}")
    least, most = float(np.min(values)), float(np.max(values))
    return {"minimum": least, "maximum": most, "peak to peak": most - least}[take]


def _setting(outcome: Outcome, i: int, entry: Mapping[str, Any]) -> str:
    """Return the swept values as text."""
    told = []
    for name, value in outcome.points[i].settings.items():
        unit, scale, _ = _shown_sweep(outcome, name, entry)
        told.append(f"{name} = {value * scale:.6g}{'' if unit == '1' else f' {unit}'}")
    return ", ".join(told)


def _shown_sweep(outcome: Outcome, name: str, entry: Mapping[str, Any]) -> tuple[str, float, float]:
    """Return unit, scale and offset of a swept value: the unit named by the entry (`swept_in`), else SI."""
    unit = str(entry.get("swept_in", outcome.swept[name]))
    return unit, in_unit(1.0, unit, outcome.swept[name], name), 0.0


def _head(name: str, unit: str) -> str:
    return name if unit in ("", "1") else f"{name} [{unit}]"


def _unit_of(text: str, known: Mapping[str, Any]) -> tuple[str, str]:
    """Return name and unit of a text such as `missed1 in nm`."""
    name, _, unit = text.partition(" in ")
    if name not in known:
        raise UsageError("BR805", f"there is no output `{name}`; outputs are {', '.join(known)}")
    return name, unit


def listed(folder: Path) -> Mapping[str, Any]:
    """Return the list as read from TOML. Raises `UsageError`, OSError."""
    path = folder / FILE
    try:
        found = tomllib.loads(path.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as problem:
        raise UsageError("BR806", f"{path}: {problem}") from None
    for section, words in SECTIONS.items():
        entries = found.get(section, [])
        if not isinstance(entries, list) or len(entries) > MOST:
            raise UsageError("BR807", f"{path}: `[[{section}]]` begins each {section}, at most {MOST} of them")
        for number, entry in enumerate(entries, 1):
            _check(path, section, number, entry, words)
    return found


def _check(path: Path, section: str, number: int, entry: Mapping[str, Any], words: Words) -> None:
    told = f"{path}: {section} {number} ({entry.get('what', '')})"
    for word, kind in words.items():
        if not isinstance(entry.get(word), kind) or isinstance(entry.get(word), bool):
            raise UsageError("BR808", f"{told} has no `{word}`, or one of another kind")
    for word, known in (("take", TAKES), ("kind", KINDS)):
        if entry.get(word, known[0]) not in known:
            raise UsageError("BR809", f"{told}: `{word}` is {', '.join(known)}; not `{entry[word]}`")


def inside(folder: Path, file: str) -> Path:
    """Return the path of a file in the folder. Raises `UsageError`."""
    path = (folder / file).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise UsageError("BR810", f"`{file}` lies outside of {folder}")
    return path
