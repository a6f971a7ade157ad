"""Plots over time: outputs of a run, its energies, inputs along a path."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array

from ..text.analyses import ReportedUnits
from ..text.tables import labelled, short, time_unit, visible
from .sheet import PANELS, curve_style, legend, picture, rows, stack, tell_omitted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...analysis.energies import Energies
    from ...analysis.inversion.feed_forward import FeedForward
    from ...results.result import Result
    from ...studies.comparison import CurveComparison

CURVES = 16  # most curves in one panel: a legend cannot distinguish more
MOST = 6  # most elements
PREFIXES = ((1e-15, "fJ"), (1e-12, "pJ"), (1e-9, "nJ"), (1e-6, "uJ"), (1e-3, "mJ"), (1.0, "J"), (1e3, "kJ"), (1e6, "MJ"))  # fmt: skip
Curve = tuple[str, Array]


@picture
def plot_result(result: Result, ax: Axes | Sequence[Axes] | None = None) -> Figure:
    """Return one panel for each shown unit: at most six panels with sixteen curves each; omitted ones are named below a sheet of our own."""
    groups = group_by_unit(result)
    shown = list(groups.items())[:PANELS]
    omitted = [name for _, curves in shown for name, _ in curves[CURVES:]]
    omitted += [name for curves in list(groups.values())[PANELS:] for name, _ in curves]
    figure, panels = rows(result.title, len(shown), ax)
    labels = (f"{short(c[0][0], 30) if len(c) == 1 else ''} [{visible(unit)}]".strip() for unit, c in shown)
    curves = [(label, c[:CURVES]) for label, (_, c) in zip(labels, shown, strict=True)]
    factor = _over_time(figure, panels, result.time, curves, _crowded)
    if not shown:
        panels[0].text(0.5, 0.5, "no outputs", transform=panels[0].transAxes, ha="center", va="center")
    for panel in panels[: len(shown)]:
        panel.margins(x=0.0, y=0.08)
    if len(result.time) > 1 and ax is None:
        panels[-1].set_xlim(result.time[0] * factor, result.time[-1] * factor)
    tell_omitted(figure, omitted if ax is None else ())
    return figure


@picture
def plot_comparison(comparison: CurveComparison) -> Figure:
    """Return one panel for each output, with the run and all that stand beside it; measured values are points."""
    run = comparison.run
    shown = [
        (item, values) for item, values in run.shown() if any(item.name in other.values for other in comparison.others)
    ]
    panels_of, omitted = shown[:PANELS], [item.name for item, _ in shown[PANELS:]]
    title = f"{run.title} and {', '.join(other.label for other in comparison.others)}"
    figure, panels = rows(short(title, 90), len(panels_of))
    unit, factor = time_unit(float(np.abs(run.time).max(initial=0.0)))
    for panel, (item, values) in zip(panels, panels_of, strict=False):
        panel.plot(run.time * factor, values, **curve_style(0))
        names = ["this run"]
        for place, other in enumerate(comparison.others, 1):
            if item.name in other.values:
                points = {"linestyle": "", "marker": "o", "markersize": 3.5} if other.measured else {}
                shown_values = other.values[item.name] * item.scale + item.offset
                panel.plot(other.time * factor, shown_values, **curve_style(place) | points)
                names.append(other.label)
        panel.set_ylabel(labelled(item.name, item.unit), parse_math=False)
        panel.margins(x=0.0, y=0.08)
        legend(panel, names, beside=True, handlelength=2.6)
    if len(run.time) > 1:
        panels[-1].set_xlim(run.time[0] * factor, run.time[-1] * factor)
    panels[-1].set_xlabel(f"time [{unit}]")
    figure.align_ylabels(panels)
    tell_omitted(figure, omitted)
    return figure


def group_by_unit(result: Result) -> dict[str, list[Curve]]:
    """Return the curves (name, values in the unit) of each shown unit, in the order in which the units appear."""
    groups: dict[str, list[Curve]] = {}
    for item, values in result.shown():
        groups.setdefault(item.unit, []).append((item.name, values))
    return groups


def _crowded(count: int) -> dict[str, Any]:
    """Return the style of a legend of so many curves."""
    return {"handlelength": 2.6, "fontsize": 6, "labelspacing": 0.2} if count > 8 else {"handlelength": 2.6, "labelspacing": 0.4}  # fmt: skip


@picture
def plot_energies(found: Energies) -> Figure:
    """Return supplied energy and its distribution; below, the elements with most of it."""
    figure, panels = stack(f"{found.title}, energy", 8.0, 6.0, 2)
    parts = (found.supplied, found.stored, found.motion, found.dissipated)
    named = zip(("supplied", "stored", "in motion", "dissipated"), parts, strict=True)
    sums = {n: v for n, v in named if np.abs(v).max(initial=0.0) > 0}
    sizes = {n: float(np.abs(v).max(initial=0.0)) for n, v in found.elements.items()}
    largest = sorted((n for n in sizes if sizes[n] > 0), key=lambda n: -sizes[n])[:MOST]
    most = max([float(np.abs(v).max()) for v in sums.values()], default=1.0)
    scale, unit = next((pair for pair in reversed(PREFIXES) if most >= pair[0]), PREFIXES[0])
    drawn = (sums, {n: found.elements[n] for n in largest})
    curves = [(f"energy [{unit}]", [(n, v / scale) for n, v in row.items()]) for row in drawn]
    _over_time(figure, panels, found.time, curves)
    return figure


@picture
def plot_feed_forward(found: FeedForward, ax: Axes | Sequence[Axes] | None = None) -> Figure:
    """Return outputs above, by units; inputs below. Raises UsageError for another number of axes."""
    curves = [(f"[{visible(unit)}]", drawn) for (_, unit), drawn in along_path(found).items()]
    figure, panels = stack(f"{found.title}, inputs along a path", 8.0, 1.2 + 2.0 * len(curves), len(curves), ax)
    _over_time(figure, panels, found.time, curves)
    return figure


def along_path(found: FeedForward) -> dict[tuple[str, str], list[Curve]]:
    """Return the outputs, then the inputs, by their units as reported; of a pair its difference: the pulling input is drawn downwards."""
    shown, groups = ReportedUnits(found), dict[tuple[str, str], list[Curve]]()
    for name, values in found.outputs.items():
        groups.setdefault(("out", shown(name)[0]), []).append((name, shown.of(name, values)))
    for drive in found.drives:
        name, values = drive.push, shown.of(drive.push, found.inputs[drive.push])
        if drive.pull is not None:
            name, values = f"{drive.push} - {drive.pull}", values - shown.of(drive.pull, found.inputs[drive.pull])
        groups.setdefault(("in", shown(drive.push)[0]), []).append((name, values))
    return groups


def _over_time(
    figure: Figure, panels: Sequence[Axes], time: Array, curves: Sequence[tuple[str, Sequence[Curve]]],
    legend_style: Callable[[int], Mapping[str, Any]] = lambda count: {},
) -> float:  # fmt: skip
    """Draw the label and the curves of each panel; return the number of the axis' units in a second."""
    unit, factor = time_unit(float(np.abs(time).max(initial=0.0)))
    alone: dict[str, Any] = {"marker": "o", "markersize": 3} if len(time) == 1 else {}
    for panel, (label, drawn) in zip(panels, curves, strict=False):
        for place, (_, values) in enumerate(drawn):
            panel.plot(time * factor, values, **curve_style(place), **alone)
        panel.set_ylabel(label, parse_math=False)
        panel.margins(x=0.0)
        legend(panel, (name for name, _ in drawn), beside=True, **legend_style(len(drawn)))
    panels[-1].set_xlabel(f"time [{unit}]")
    figure.align_ylabels(panels)
    return factor
