"""Bode plot: magnitude above phase, a pair of panels for each output."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from ..text.tables import short, visible
from .sheet import check_picture, curve_style, drawn, heading, legend, sheet, tell_omitted, with_grid

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...analysis.response import Response

MOST = 3  # most outputs
NARROW = 5.0  # ratio of the last to the first frequency below which the axis is linear


def plot_response(found: Response, path: str | os.PathLike[str]) -> None:
    """Draw into `path`; completely or not at all. Raises UsageError, MissingPackage, OSError."""
    check_picture(path)
    drawn(lambda: _figure(found), path)


def _figure(found: Response) -> Figure:
    shown = found.outputs[:MOST]
    figure = sheet(heading(found.model, found.experiment), 8.0, 4.2 * len(shown))
    panels = figure.subplots(2 * len(shown), 1, sharex=True, squeeze=False, height_ratios=[1.6, 1.0] * len(shown))[:, 0]
    phase = found.phase
    for i, seen in enumerate(shown):
        above, below = panels[2 * i], panels[2 * i + 1]
        for j in range(len(found.inputs)):
            above.loglog(found.frequencies, found.magnitude[:, i, j], **curve_style(j))
            below.semilogx(found.frequencies, phase[:, i, j], **curve_style(j))
        unit = found.unit(found.inputs[0], seen)
        above.set_ylabel(f"{short(seen, 30)} [{visible(unit)}]", parse_math=False)
        below.set_ylabel("phase [deg]")
        legend(above, (f"from {given}" for given in found.inputs), longest=40)
        for panel in (above, below):
            with_grid(panel)
    panels[-1].set_xlabel("frequency [Hz]")
    panels[-1].set_xlim(found.frequencies[0], found.frequencies[-1])
    if found.frequencies[-1] < NARROW * found.frequencies[0]:
        panels[-1].set_xscale("linear")  # a logarithmic axis would have at most one tick
    if len(found.outputs) > MOST:
        tell_omitted(figure, found.outputs[MOST:])
    return figure
