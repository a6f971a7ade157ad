"""Plots of studies: histograms of quantities, and tornado plots of their causes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ...errors import UsageError
from ..text.tables import labelled, short
from .sheet import COLOURS, PANELS, curve_style, legend, picture, sheet, tell_omitted, without_frame

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...studies.fitted import Fit
    from ...studies.tolerances import MonteCarlo
    from ...studies.work_precision import WorkPrecision

COLUMNS = 2
MOST_BINS = 60
STRONGEST = 10
MARKERS = "osD^vPX*<>"
LEAST = 1e-16  # error at which a point without one is drawn, as that of the reference


def _panels(found: MonteCarlo, what: str, height: float) -> tuple[Figure, list[Axes]]:
    count = min(len(found.quantities), PANELS)
    if not count:
        raise UsageError("BR926", "there is nothing to draw: the study has no quantity")
    across = min(count, COLUMNS)
    down = -(-count // across)
    figure = sheet(f"{found.title}, {what}", 4.2 * across + 0.6, 0.8 + height * down)
    panels = list(figure.subplots(down, across, squeeze=False).flat)
    for panel in panels[count:]:
        panel.set_visible(False)
    tell_omitted(figure, found.quantities[count:])
    return figure, panels[:count]


def _in_report(found: MonteCarlo, name: str) -> tuple[str, float, float]:
    """Return a quantity with its unit as reported, and the scale and offset of that unit."""
    unit, scale, offset = found.shown.get(name, (found.units[name], 1.0, 0.0))
    return labelled(name, unit), scale, offset


@picture
def plot_histograms(found: MonteCarlo) -> Figure:
    """Return one panel for each quantity, six at most. Raises UsageError."""
    figure, panels = _panels(found, f"{len(found) - len(found.failures)} points", 2.4)
    for i, (panel, name) in enumerate(zip(panels, found.quantities, strict=False)):
        label, scale, offset = _in_report(found, name)
        column = found(name)
        column = column[np.isfinite(column)] * scale + offset
        edges = np.histogram_bin_edges(column, "fd" if np.ptp(column) > 0 else 1)
        edges = edges if len(edges) <= MOST_BINS + 1 else np.linspace(edges[0], edges[-1], MOST_BINS + 1)
        panel.hist(column, edges.tolist(), color=COLOURS[i % len(COLOURS)], edgecolor="white", linewidth=0.3)
        for share in np.quantile(column, (0.025, 0.5, 0.975)):
            panel.axvline(share, color="#444444", linewidth=0.8, linestyle=(0, (4, 2)))
        panel.set_xlabel(label, parse_math=False)
        panel.set_ylabel("points")
        without_frame(panel)
    return figure


@picture
def plot_tornado(found: MonteCarlo) -> Figure:
    """Return the swing of each quantity by the parameters. Raises UsageError."""
    bars = min(len(found.parameters), STRONGEST)
    low, high = (f"{100 * t:g} %" for t in found.swing.tails)
    figure, panels = _panels(found, f"each parameter from its {low} to its {high} quantile", 1.0 + 0.24 * bars)
    for i, (panel, name) in enumerate(zip(panels, found.quantities, strict=False)):
        label, scale, offset = _in_report(found, name)
        middle = found.swing.middle[i] * scale + offset
        ends = found.swing.ends[i] * scale + offset
        size = np.nan_to_num(np.ptp(ends, axis=1))
        order = np.argsort(size, kind="stable")[-bars:]  # the strongest is last, and so on top
        for side, colour in ((0, COLOURS[0]), (1, COLOURS[1])):
            panel.barh(np.arange(bars), ends[order, side] - middle, left=middle, color=colour, height=0.7)
        panel.axvline(middle, color="#444444", linewidth=0.8)
        texts = panel.set_yticks(np.arange(bars), [short(found.parameters[j], 24) for j in order])
        for tick in texts:
            tick.label1.set_parse_math(False)
        panel.set_xlabel(label, parse_math=False)
        without_frame(panel)
    return figure


@picture
def plot_fit(found: Fit) -> Figure:
    """Return measured and computed values, one panel for each quantity of each file."""
    count = min(len(found.series), PANELS)
    figure = sheet(f"{found.model}, fitted", 8.0, 0.8 + 2.2 * count)
    for i, panel in enumerate(figure.subplots(count, 1, squeeze=False)[:, 0]):
        one, computed = found.series[i], found.computed[i]
        rows = np.array(one.rows) + 1
        sigma = one.sigma if found.weighted else None
        panel.errorbar(rows, one.measured, sigma, fmt="o", markersize=3, color=COLOURS[0], linewidth=0.8)
        panel.plot(rows, computed, color=COLOURS[1], marker="x", markersize=5, linewidth=1.0)
        panel.set_ylabel(labelled(one.name, one.unit, 24), parse_math=False)
        panel.set_xlabel("line of data (dots: measured; crosses: computed)", fontsize=8)
        without_frame(panel)
    return figure


@picture
def plot_work_precision(found: WorkPrecision) -> Figure:
    """Return time over error, a curve for each solver, from loose tolerances at the left to tight ones; the wanted error and what is recommended."""
    figure = sheet(f"{found.title}, run time against error", 8.0, 5.0)
    panel = figure.subplots()
    panel.grid(True, which="major", color="#d9d9d9", linewidth=0.6)
    names = []
    for place, solver in enumerate(found.solvers):
        points = [p for p in found.points if p.solver == solver and math.isfinite(p.error)]
        if not points:
            continue
        style = curve_style(place) | ({"linewidth": 0.9, "alpha": 0.7} if points[0].peer else {})
        panel.loglog(
            [max(p.error, LEAST) for p in points], [1e3 * p.seconds for p in points], marker=MARKERS[place % len(MARKERS)], markersize=4, **style
        )  # fmt: skip
        names.append(solver)
    panel.invert_xaxis()
    panel.set_xlabel("largest error of an output, relative to its magnitude (dashed: the wanted one; ringed: recommended)")  # fmt: skip
    panel.set_ylabel("time of a run [ms]")
    legend(panel, names, beside=True)
    panel.axvline(found.error, color="#444444", linewidth=0.8, linestyle=(0, (4, 2)))
    best = found.recommended
    if best is not None:
        panel.plot(max(best.error, LEAST), 1e3 * best.seconds, "o", markersize=13, markerfacecolor="none", markeredgecolor="#444444")  # fmt: skip
    without_frame(panel)
    return figure
