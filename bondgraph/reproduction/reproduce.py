"""Reproduction of a list of published values."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..errors import UsageError
from .compared import Erratum, PictureFile, Reproduction
from .computing import Computing
from .listed import listed


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
        from ..presentation.plots.sweeps import plot_surface

        plot_surface(outcome, path, str(entry.get("of", "")))
    elif kind in ("time", "phase"):
        (point,) = outcome.points if len(outcome) == 1 else (None,)
        if point is None or point.run is None:
            raise UsageError("BR811", f"{entry['what']}: `{experiment}` is not one simulation")
        point.run.plot(path, entry.get("over") if kind == "phase" else None)
    else:
        outcome.plot(path)
