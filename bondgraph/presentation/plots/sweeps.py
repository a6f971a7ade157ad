"""Plot of a sweep: results over the last swept name, a curve for each combination of the others."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import UsageError
from ..text.tables import short, visible
from .runs import COLOURS, DASHES, PANELS, check_picture, drawn

if TYPE_CHECKING:
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
            "there is nothing to draw: the experiment has neither a sweep nor a response nor another step that makes a picture"
        )
    pictured.plot(path)


def _figure(found: Outcome) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    *others, last = found.swept
    names = [n for n in found.names if n not in found.swept][:PANELS]
    figure = Figure(figsize=(8.0, 1.0 + 2.2 * max(1, len(names))), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(
        visible(found.model if found.experiment is None else f"{found.model}: {found.experiment}"),
        fontsize=11,
        parse_math=False,
    )
    panels = figure.subplots(max(1, len(names)), 1, sharex=True, squeeze=False)[:, 0]
    groups: dict[tuple[float, ...], list[int]] = {}
    for i, point in enumerate(found.points):
        groups.setdefault(tuple(point.settings[n] for n in others), []).append(i)
    for panel, name in zip(panels, names, strict=False):
        unit, scale, offset = found.shown.get(name, ("", 1.0, 0.0))
        column, along = found(name) * scale + offset, found(last)
        for k, rows in enumerate(groups.values()):
            order = np.array(rows)[np.argsort(along[rows], kind="stable")]
            look = {"color": COLOURS[k % len(COLOURS)], "linestyle": DASHES[k % len(DASHES)]}
            panel.plot(along[order], column[order], marker="o", markersize=3, linewidth=1.4, **look)
        panel.set_ylabel(f"{short(name, 24)}{f' [{visible(unit)}]' if unit else ''}", parse_math=False)
        panel.grid(True, color="#d9d9d9", linewidth=0.6)
        panel.spines[["top", "right"]].set_visible(False)
    unit = found.swept[last]
    panels[-1].set_xlabel(f"{short(last, 40)}{f' [{visible(unit)}]' if unit != '1' else ''}", parse_math=False)
    if others:
        legend = panels[0].legend(
            panels[0].get_lines(), [str(i) for i in range(len(groups))], frameon=False, fontsize=7
        )
        for text, key in zip(legend.get_texts(), groups, strict=True):
            text.set_parse_math(False)
            text.set_text(", ".join(f"{short(n, 16)} = {v:.4g}" for n, v in zip(others, key, strict=True)))
    return figure
