"""Plot of inputs along a path."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from ..text.tables import time_unit, visible
from .sheet import check_picture, curve_style, drawn, heading, legend, sheet, with_grid

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...analysis.inversion.feed_forward import FeedForward


def plot_feed_forward(found: FeedForward, path: str | os.PathLike[str]) -> None:
    """Draw into `path`; completely or not at all. Raises UsageError, MissingPackage, OSError."""
    check_picture(path)
    drawn(lambda: _figure(found), path)


def _figure(found: FeedForward) -> Figure:
    """Return a figure with outputs above, by units; inputs below, pulling ones drawn downwards."""
    panels = _panels(found)
    figure = sheet(f"{heading(found.model, found.experiment)}, inputs along a path", 8.0, 1.2 + 2.0 * len(panels))
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    unit, factor = time_unit(float(np.abs(found.time).max()))
    for panel, (shown, curves) in zip(axes, panels, strict=True):
        for place, (_, values) in enumerate(curves):
            panel.plot(found.time * factor, values, **curve_style(place))
        panel.set_ylabel(f"[{visible(shown)}]", parse_math=False)
        with_grid(panel)
        panel.margins(x=0.0)
        legend(panel, (name for name, _ in curves), beside=True)
    axes[-1].set_xlabel(f"time [{unit}]")
    figure.align_ylabels(axes)
    return figure


def _panels(found: FeedForward) -> list[tuple[str, list[tuple[str, Any]]]]:
    panels: dict[tuple[str, str], list[tuple[str, Any]]] = {}
    for name, values in found.outputs.items():
        panels.setdefault(("out", found.units.get(name, "1")), []).append((name, values))
    for drive in found.drives:
        name, values = drive.push, found.inputs[drive.push]
        if drive.pull is not None:
            name, values = f"{drive.push} - {drive.pull}", values - found.inputs[drive.pull]
        panels.setdefault(("in", found.units.get(drive.push, "1")), []).append((name, values))
    return [(unit, curves) for (_, unit), curves in panels.items()]
