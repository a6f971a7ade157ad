"""Figures of a page, as requested by a list."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import UsageError
from .compared import PictureFile
from .computing import Computing


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
