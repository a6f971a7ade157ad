"""Plot of a result over time."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from compiler.api import Array

from ..text.tables import short, time_unit, visible
from .sheet import PANELS, check_picture, curve_style, drawn, legend, sheet, with_grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...results.result import Result

    Curve = tuple[str, Array]

CURVES = 16  # most curves in one panel: a legend cannot distinguish more


def plot_result(result: Result, path: str | os.PathLike[str]) -> None:
    """Draw one panel for each shown unit, over a common time axis, into `path`; completely or not at all.

    At most six panels with sixteen curves each; omitted ones are named below. Raises UsageError, MissingPackage, OSError.
    """
    check_picture(path)
    drawn(lambda: _figure(result), path)


def group_by_unit(result: Result) -> dict[str, list[Curve]]:
    """Return the curves (name, values in the unit) of each shown unit, in the order in which the units appear."""
    groups: dict[str, list[Curve]] = {}
    for item, values in result.shown():
        groups.setdefault(item.unit, []).append((item.name, values))
    return groups


def _figure(result: Result) -> Figure:
    groups = group_by_unit(result)
    drawn = list(groups.items())[:PANELS]
    left_out = [name for _, curves in drawn for name, _ in curves[CURVES:]]
    left_out += [name for curves in list(groups.values())[PANELS:] for name, _ in curves]
    count = max(1, len(drawn))
    figure = sheet(result.title, 8.0, 1.3 + (2.9 if count == 1 else 1.9) * count)
    panels = list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])
    unit, factor = time_unit(float(abs(result.time).max()) if len(result.time) else 0.0)
    for panel, (shown_unit, curves) in zip(panels, drawn, strict=False):
        _panel(panel, result.time * factor, shown_unit, curves[:CURVES])
    if not drawn:
        panels[0].text(0.5, 0.5, "no outputs", transform=panels[0].transAxes, ha="center", va="center")
    panels[-1].set_xlabel(f"time [{unit}]")
    if len(result.time) > 1:
        panels[-1].set_xlim(result.time[0] * factor, result.time[-1] * factor)
    figure.align_ylabels(panels)
    if left_out:
        figure.supxlabel(_left_out(left_out), fontsize=7, color="#555555", parse_math=False)
    return figure


def _panel(panel: Axes, time: Array, unit: str, curves: Sequence[Curve]) -> None:
    for place, (_, values) in enumerate(curves):
        alone: dict[str, Any] = {"marker": "o", "markersize": 3} if len(time) == 1 else {}
        panel.plot(time, values, **curve_style(place), **alone)
    head = short(curves[0][0], 30) if len(curves) == 1 else ""
    panel.set_ylabel(f"{head} [{visible(unit)}]".strip(), parse_math=False)
    with_grid(panel)
    panel.set_axisbelow(True)
    panel.margins(x=0.0, y=0.08)
    many = len(curves) > 8
    legend(
        panel, (name for name, _ in curves), True, handlelength=2.6, fontsize=6 if many else 8, labelspacing=0.2 if many else 0.4
    )  # fmt: skip


def _left_out(names: Sequence[str]) -> str:
    told = ", ".join(short(name, 24) for name in names[:6])
    rest = f" and {len(names) - 6} more" if len(names) > 6 else ""
    return f"not drawn: {told}{rest}"
