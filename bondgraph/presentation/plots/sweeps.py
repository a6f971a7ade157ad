"""Plot of a sweep: results over the last swept name, a curve for each combination of the others."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np

from ...errors import UsageError
from ..text.tables import short, visible
from .sheet import PANELS, check_picture, curve_style, drawn, heading, legend, sheet, with_grid

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...analysis.outcome import Outcome


def plot_outcome(found: Outcome, path: str | os.PathLike[str]) -> None:
    """Draw into `path`; completely or not at all. Raises UsageError, MissingPackage, OSError."""
    check_picture(path)
    if found.swept:
        drawn(lambda: _figure(found), path)
        return
    (point,) = found.points
    drawable = (found for _, found in point.analyses if hasattr(found, "plot"))
    pictured = next((p for p in (*point.responses, *drawable, point.run) if p is not None), None)
    if pictured is None:
        raise UsageError(
            "BR934", "there is nothing to draw: the experiment has neither a sweep nor a response nor another step that makes a picture",
        )  # fmt: skip
    pictured.plot(path)


def _figure(found: Outcome) -> Figure:
    *others, last = found.swept
    names = [n for n in found.names if n not in found.swept][:PANELS]
    figure = sheet(heading(found.model, found.experiment), 8.0, 1.0 + 2.2 * max(1, len(names)))
    panels = figure.subplots(max(1, len(names)), 1, sharex=True, squeeze=False)[:, 0]
    groups: dict[tuple[float, ...], list[int]] = {}
    for i, point in enumerate(found.points):
        groups.setdefault(tuple(point.settings[n] for n in others), []).append(i)
    for panel, name in zip(panels, names, strict=False):
        unit, scale, offset = found.shown.get(name, ("", 1.0, 0.0))
        column, along = found(name) * scale + offset, found(last)
        for k, rows in enumerate(groups.values()):
            order = np.array(rows)[np.argsort(along[rows], kind="stable")]
            panel.plot(along[order], column[order], marker="o", markersize=3, **curve_style(k))
        panel.set_ylabel(f"{short(name, 24)}{f' [{visible(unit)}]' if unit else ''}", parse_math=False)
        with_grid(panel)
    unit = found.swept[last]
    panels[-1].set_xlabel(f"{short(last, 40)}{f' [{visible(unit)}]' if unit != '1' else ''}", parse_math=False)
    if others:
        settings = (", ".join(f"{short(n, 16)} = {v:.4g}" for n, v in zip(others, key, strict=True)) for key in groups)
        legend(panels[0], settings, longest=1000, fontsize=7)
    return figure
