"""Bode plot: magnitude above phase, a pair of panels for each output."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from ..text.tables import short, visible
from .runs import COLOURS, DASHES, check_picture, drawn

if TYPE_CHECKING:
    from ...analysis.response import Response

MOST = 3  # most outputs
NARROW = 5.0  # ratio of the last to the first frequency below which the axis is linear


def plot_response(found: Response, path: str | os.PathLike[str]) -> None:
    """Draw into `path`; completely or not at all. Raises UsageError, MissingPackage, OSError."""
    check_picture(path)
    drawn(lambda: _figure(found), path)


def _figure(found: Response) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    shown = found.outputs[:MOST]
    figure = Figure(figsize=(8.0, 4.2 * len(shown)), layout="constrained")
    FigureCanvasAgg(figure)
    title = found.model if found.experiment is None else f"{found.model}: {found.experiment}"
    figure.suptitle(visible(title), fontsize=11, parse_math=False)
    panels = figure.subplots(2 * len(shown), 1, sharex=True, squeeze=False, height_ratios=[1.6, 1.0] * len(shown))[:, 0]
    phase = found.phase
    for i, seen in enumerate(shown):
        above, below = panels[2 * i], panels[2 * i + 1]
        for j in range(len(found.inputs)):
            look = {"color": COLOURS[j % len(COLOURS)], "linestyle": DASHES[j % len(DASHES)], "linewidth": 1.4}
            above.loglog(found.frequencies, found.magnitude[:, i, j], **look)
            below.semilogx(found.frequencies, phase[:, i, j], **look)
        unit = found.unit(found.inputs[0], seen)
        above.set_ylabel(f"{short(seen, 30)} [{visible(unit)}]", parse_math=False)
        below.set_ylabel("phase [deg]")
        _legend(above, [short(f"from {given}", 40) for given in found.inputs])
        for panel in (above, below):
            panel.grid(True, which="major", color="#d9d9d9", linewidth=0.6)
            panel.spines[["top", "right"]].set_visible(False)
    panels[-1].set_xlabel("frequency [Hz]")
    panels[-1].set_xlim(found.frequencies[0], found.frequencies[-1])
    if found.frequencies[-1] < NARROW * found.frequencies[0]:
        panels[-1].set_xscale("linear")  # a logarithmic axis would have at most one tick
    if len(found.outputs) > MOST:
        figure.supxlabel(
            f"not drawn: {', '.join(short(n, 24) for n in found.outputs[MOST:])}", fontsize=7, parse_math=False
        )
    return figure


def _legend(panel: Any, names: list[str]) -> None:
    """Set the texts of a legend afterwards: as labels, names that begin with `_` would be omitted, and `$` would begin a formula."""
    legend = panel.legend(panel.get_lines(), [str(i) for i in range(len(names))], frameon=False, fontsize=8)
    for text, name in zip(legend.get_texts(), names, strict=True):
        text.set_parse_math(False)
        text.set_text(name)
