"""Plots of many runs over time: a curve for each, or the median and bands where curves would cover each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from compiler.api import Array

from ...errors import RunFailed, UsageError
from ..text.tables import labelled, short, time_unit, visible
from .sheet import PANELS, legend, picture, rows, tell_omitted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...analysis.outcome import Outcome
    from ...results.ensemble import Ensemble
    from ...results.result import Result

NAMED = 12  # most curves that a legend tells apart
BANDS = ((0.0, 100.0, 0.18, "all runs"), (5.0, 95.0, 0.35, "5 to 95 % of the runs"))  # shares in %, opacity
COLOUR, COLOUR_MAP = "#0b5394", "viridis"  # in the order of the runs; even in grey, and for colour-blind readers


@picture
def plot_ensemble(found: Ensemble) -> Figure:
    """Return a panel for each output with all runs that have a result. Raises `RunFailed` if none has."""
    numbered = [(number, run) for number, run in enumerate(found) if not isinstance(run, Exception)]
    labels = [settings_text(found.settings[number], {}) for number, _ in numbered]
    return _family([run for _, run in numbered], labels)


@picture
def plot_curves(found: Outcome) -> Figure:
    """Return a panel for each output with the runs of all points. Raises `UsageError` if nothing was simulated, `RunFailed` if every run failed."""
    points = [(p.settings, p.run) for p in found.points if p.run is not None]
    if not points and not found.failures:
        raise UsageError("BR943", "there are no curves: nothing is simulated at the points", "ask for `simulate`")
    return _family(
        [run for _, run in points], [settings_text(found.in_words(settings), found.swept) for settings, _ in points]
    )


def settings_text(settings: Mapping[str, str | float], units: Mapping[str, str]) -> str:
    """Return `R = 10 ohm, C = 1e-06 F`, in SI where they are numbers."""
    shown = {
        n: v if isinstance(v, str) else f"{v:.7g} {visible(units.get(n, '1'))}".removesuffix(" 1")
        for n, v in settings.items()
    }
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
