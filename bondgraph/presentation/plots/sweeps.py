"""Plots of a sweep: results over the last swept name, a curve for each combination of the others; and contours over two names."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import UsageError
from ..text.tables import labelled
from .families import settings_text
from .sheet import PANELS, StrPath, check_picture, curve_style, legend, picture, sheet, stack

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...analysis.outcome import Outcome

CONTOURS, COLOUR_MAP = 12, "cividis"  # even in grey, and for colour-blind readers


def plot_outcome(found: Outcome, path: StrPath | None) -> Figure:
    """Draw, also into `path` if there is one; completely or not at all. Raises UsageError, MissingPackage, OSError."""
    check_picture(path)
    if found.swept:
        return _plot_swept(found, path)
    (point,) = found.points
    drawable = (result for _, result in point.analyses if hasattr(result, "plot"))
    pictured = next((p for p in (*point.responses, *drawable, point.run) if p is not None), None)
    if pictured is None:
        raise UsageError(
            "BR934", "there is nothing to draw: the experiment has neither a sweep nor a response nor another step that makes a picture",
        )  # fmt: skip
    figure: Figure = pictured.plot(path)
    return figure


@picture
def _plot_swept(found: Outcome) -> Figure:
    *others, last = found.swept
    names = [n for n in found.names if n not in found.swept][:PANELS]
    count = max(1, len(names))
    figure, panels = stack(found.title, 8.0, 1.0 + 2.2 * count, count)
    groups: dict[tuple[float, ...], list[int]] = {}
    for i, point in enumerate(found.points):
        groups.setdefault(tuple(point.settings[n] for n in others), []).append(i)
    for panel, name in zip(panels, names, strict=False):
        unit, scale, offset = found.shown.get(name, (found.units[name], 1.0, 0.0))
        column, along = found(name) * scale + offset, found(last)
        for k, rows in enumerate(groups.values()):
            order = np.array(rows)[np.argsort(along[rows], kind="stable")]
            panel.plot(along[order], column[order], marker="o", markersize=3, **curve_style(k))
        panel.set_ylabel(labelled(name, unit, 24), parse_math=False)
    _set_words(found, last, panels[-1].xaxis)
    panels[-1].set_xlabel(labelled(last, found.swept[last], 40), parse_math=False)
    if others:
        settings = (settings_text(found.in_words(dict(zip(others, key, strict=True))), found.swept) for key in groups)
        legend(panels[0], settings, longest=1000, fontsize=7)
    return figure


def _set_words(found: Outcome, name: str, axis: Any) -> None:
    """Show the words that were swept in the place of their numbers."""
    if name in found.words:
        axis.set_ticks(np.arange(len(found.words[name])) + 1.0, found.words[name])


@picture
def plot_surface(found: Outcome, name: str) -> Figure:
    """Return contours of the output `name` over two swept names. Raises UsageError."""
    if len(found.swept) != 2:
        raise UsageError("BR932", "a relief is of two quantities that are swept")
    if name not in found.names or name in found.swept:
        raise UsageError(
            "BR933", f"there is no `{name}` to draw; there is {', '.join(n for n in found.names if n not in found.swept)}",
        )  # fmt: skip
    slow, fast = found.swept
    ys, xs = (np.unique(found(n)) for n in (slow, fast))
    unit, scale, offset = found.shown.get(name, (found.units[name], 1.0, 0.0))
    heights = np.full((len(ys), len(xs)), np.nan)
    heights[np.searchsorted(ys, found(slow)), np.searchsorted(xs, found(fast))] = found(name) * scale + offset
    figure = sheet(found.title, 6.4, 4.8)
    panel = figure.subplots()
    relief = panel.contourf(xs, ys, heights, CONTOURS, cmap=COLOUR_MAP)
    panel.contour(xs, ys, heights, CONTOURS, colors="#ffffff", linewidths=0.5)
    bar = figure.colorbar(relief)
    bar.set_label(labelled(name, unit), parse_math=False)
    panel.set_xlabel(labelled(fast, found.swept[fast]), parse_math=False)
    panel.set_ylabel(labelled(slow, found.swept[slow]), parse_math=False)
    return figure
