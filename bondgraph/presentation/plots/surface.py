"""Contour plot of a sweep over two quantities."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np

from ...errors import UsageError
from ..text.tables import labelled
from .sheet import check_picture, drawn, heading, sheet

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...analysis.outcome import Outcome

LINES = 12
COLOURS = "cividis"  # even in grey, and for colour-blind readers


def plot_surface(found: Outcome, name: str, path: str | os.PathLike[str]) -> None:
    """Draw the output `name` into `path`; completely or not at all. Raises UsageError, MissingPackage, OSError."""
    check_picture(path)
    if len(found.swept) != 2:
        raise UsageError("BR932", "a relief is of two quantities that are swept")
    if name not in found.names or name in found.swept:
        raise UsageError(
            "BR933", f"there is no `{name}` to draw; there is {', '.join(n for n in found.names if n not in found.swept)}",
        )  # fmt: skip
    drawn(lambda: _figure(found, name), path)


def _figure(found: Outcome, name: str) -> Figure:
    slow, fast = found.swept
    ys, xs = (np.unique(found(n)) for n in (slow, fast))
    unit, scale, offset = found.shown.get(name, (found.units[name], 1.0, 0.0))
    heights = np.full((len(ys), len(xs)), np.nan)
    heights[np.searchsorted(ys, found(slow)), np.searchsorted(xs, found(fast))] = found(name) * scale + offset
    figure = sheet(heading(found.model, found.experiment), 6.4, 4.8)
    panel = figure.subplots()
    relief = panel.contourf(xs, ys, heights, LINES, cmap=COLOURS)
    panel.contour(xs, ys, heights, LINES, colors="#ffffff", linewidths=0.5)
    bar = figure.colorbar(relief)
    bar.set_label(labelled(name, unit), parse_math=False)
    panel.set_xlabel(labelled(fast, found.swept[fast]), parse_math=False)
    panel.set_ylabel(labelled(slow, found.swept[slow]), parse_math=False)
    return figure
