"""Plots of many runs over time: a curve for each, or the median and bands where curves would cover each other.

A sweep is drawn over its last name, a curve for each combination of the others; or as contours over two names.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array

from ...errors import RunFailed, UsageError
from ..text.tables import labelled, short, time_unit, visible
from .sheet import PANELS, StrPath, check_picture, curve_style, legend, picture, rows, sheet, stack, tell_omitted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...analysis.outcome import Outcome
    from ...results.ensemble import Ensemble
    from ...results.result import Result

NAMED = 12  # most curves that a legend tells apart
BANDS = ((0.0, 100.0, 0.18, "all runs"), (5.0, 95.0, 0.35, "5 to 95 % of the runs"))  # shares in %, opacity
COLOUR, COLOUR_MAP = "#0b5394", "viridis"  # in the order of the runs; even in grey, and for colour-blind readers
CONTOURS, SURFACE_COLOURS = 12, "cividis"  # even in grey, and for colour-blind readers


@picture
def plot_ensemble(found: Ensemble) -> Figure:
    """Return a panel for each output with all runs that have a result. Raises `RunFailed` if none has."""
    numbered = [(number, run) for number, run in enumerate(found) if not isinstance(run, Exception)]
    labels = [settings_text(found.settings[number]) for number, _ in numbered]
    return _family([run for _, run in numbered], labels)


@picture
def plot_curves(found: Outcome) -> Figure:
    """Return a panel for each output with the runs of all points. Raises `UsageError` if nothing was simulated, `RunFailed` if every run failed."""
    points = [(p.settings, p.run) for p in found.points if p.run is not None]
    if not points and not found.failures:
        raise UsageError("BR943", "there are no curves: nothing is simulated at the points", "ask for `simulate`")
    return _family([run for _, run in points], [settings_text(found.in_words(settings)) for settings, _ in points])


def settings_text(settings: Mapping[str, str | float] | Mapping[str, str]) -> str:
    """Return `R = 10 ohm, C = 1 uF`; numbers are in SI."""
    shown = {n: visible(v) if isinstance(v, str) else f"{v:.7g}" for n, v in settings.items()}
    return ", ".join(f"{short(n, 16)} = {value}" for n, value in shown.items())


def _family(runs: Sequence[Result], labels: Sequence[str]) -> Figure:
    if not runs:
        raise RunFailed("BR944", "none of the runs has a result to draw")
    items = [item for item, _ in runs[0].shown()]
    figure, panels = rows(f"{runs[0].title}, {len(runs)} runs", min(len(items), PANELS))
    unit, factor = time_unit(max(float(np.abs(run.time).max(initial=0.0)) for run in runs))
    times = max((run.time for run in runs), key=len)
    together = all(np.array_equal(run.time, times[: len(run.time)]) for run in runs)
    for panel, item in zip(panels, items, strict=False):
        curves = [(run.time * factor, run[item.name] * item.scale + item.offset) for run in runs]
        if len(runs) > NAMED and together:
            _draw_bands(panel, times * factor, [values for _, values in curves])
        else:
            _draw_curves(panel, curves)
        panel.set_ylabel(labelled(item.name, item.unit), parse_math=False)
        panel.margins(x=0.0, y=0.08)
    if len(runs) <= NAMED:
        legend(panels[0], labels, beside=True, longest=40)
    elif together:
        legend(panels[0], [*(name for *_, name in BANDS), "median"], beside=True)
    panels[-1].set_xlabel(f"time [{unit}]")
    figure.align_ylabels(panels)
    tell_omitted(figure, [item.name for item in items[PANELS:]])
    return figure


def _draw_curves(panel: Axes, curves: Sequence[tuple[Array, Array]]) -> None:
    import matplotlib

    shades = matplotlib.colormaps[COLOUR_MAP](np.linspace(0.0, 0.9, len(curves)))
    width = 1.4 if len(curves) <= NAMED else 0.5
    for (times, values), shade in zip(curves, shades, strict=True):
        panel.plot(times, values, color=shade, linewidth=width)


def _draw_bands(panel: Axes, times: Array, curves: Sequence[Array]) -> None:
    """Draw quantiles at each instant; runs that end early are no part of what comes after."""
    table = np.full((len(curves), len(times)), np.nan)
    for row, values in zip(table, curves, strict=True):
        row[: len(values)] = values
    for low, high, alpha, _ in BANDS:
        below, above = np.nanpercentile(table, (low, high), axis=0)
        panel.fill_between(times, below, above, color=COLOUR, alpha=alpha, linewidth=0)
    panel.plot(times, np.nanmedian(table, axis=0), color=COLOUR, linewidth=1.4)


def plot_outcome(found: Outcome, path: StrPath | None) -> Figure:
    """Draw, also into `path` if there is one; completely or not at all. Raises UsageError, MissingPackage, OSError."""
    check_picture(path)
    if found.swept:
        return _plot_swept(found, path)
    (point,) = found.points
    drawable = (result for _, result in point.analyses if hasattr(result, "plot"))
    pictured = next((p for p in (*point.responses, *drawable, point.run, point.modes) if p is not None), None)
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
        (unit, column), (_, along) = (_as_shown(found, n) for n in (name, last))
        for k, points in enumerate(groups.values()):
            order = np.array(points)[np.argsort(along[points], kind="stable")]
            panel.plot(along[order], column[order], marker="o", markersize=3, **curve_style(k))
        panel.set_ylabel(labelled(name, unit, 24), parse_math=False)
    _set_words(found, last, panels[-1].xaxis)
    panels[-1].set_xlabel(labelled(last, _as_shown(found, last)[0], 40), parse_math=False)
    if others:
        settings = (settings_text(found.in_words(dict(zip(others, key, strict=True)))) for key in groups)
        legend(panels[0], settings, longest=1000, fontsize=7)
    return figure


def _as_shown(found: Outcome, name: str) -> tuple[str, Array]:
    """Return the unit of a column in a table, and its values there."""
    unit, scale, offset = found.shown.get(name, (found.units[name], 1.0, 0.0))
    return unit, found(name) * scale + offset


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
    (slow, slow_values), (fast, fast_values), (unit, values) = (_as_shown(found, n) for n in (*found.swept, name))
    ys, xs = np.unique(slow_values), np.unique(fast_values)
    heights = np.full((len(ys), len(xs)), np.nan)
    heights[np.searchsorted(ys, slow_values), np.searchsorted(xs, fast_values)] = values
    figure = sheet(found.title, 6.4, 4.8)
    panel = figure.subplots()
    relief = panel.contourf(xs, ys, heights, CONTOURS, cmap=SURFACE_COLOURS)
    panel.contour(xs, ys, heights, CONTOURS, colors="#ffffff", linewidths=0.5)
    bar = figure.colorbar(relief)
    bar.set_label(labelled(name, unit), parse_math=False)
    names = list(found.swept)
    panel.set_xlabel(labelled(names[1], fast), parse_math=False)
    panel.set_ylabel(labelled(names[0], slow), parse_math=False)
    return figure
