"""Inputs along a path: as a table for terminals, and as a plot."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from ..text.analyses import title
from ..text.tables import aligned, short, shown_unit, time_unit, visible
from .runs import COLOURS, DASHES, check_picture, drawn

if TYPE_CHECKING:
    from ...analysis.inversion.feed_forward import FeedForward

ROWS = 11  # instants in the table


def feed_forward_text(found: FeedForward) -> str:
    """Return some instants of the inputs and outputs, the number of differentiations of the outputs, and notes."""
    columns = {**found.inputs, **found.outputs}
    rows: list[tuple[str, ...]] = [
        ("time", *(short(n, 20) for n in columns)),
        ("s", *(shown_unit(found.units.get(n, "1")) for n in columns)),
    ]
    for i in np.unique(np.linspace(0, len(found.time) - 1, ROWS).astype(int)):
        rows.append((f"{found.time[i]:.6g}", *(f"{v[i]:.6g}" for v in columns.values())))
    head = title(found.model, found.experiment, f"inverted along a path, {len(found.time)} points")
    orders = ", ".join(f"{visible(n)} {d}" for n, d in found.degrees.items())
    told = [f"derivatives taken: {orders}", *(visible(n) for n in found.notes)]
    return "\n\n".join([head, aligned(rows, ">" * len(rows[0])), "\n".join(told)])


def plot_feed_forward(found: FeedForward, path: str | os.PathLike[str]) -> None:
    """Draw into `path`; completely or not at all. Raises UsageError, MissingPackage, OSError."""
    check_picture(path)
    drawn(lambda: _figure(found), path)


def _figure(found: FeedForward) -> Any:
    """Return a figure with outputs above, by units; inputs below, pulling ones drawn downwards."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    panels = _panels(found)
    figure = Figure(figsize=(8.0, 1.2 + 2.0 * len(panels)), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title(found.model, found.experiment, "inputs along a path"), fontsize=11, parse_math=False)
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    unit, factor = time_unit(float(np.abs(found.time).max()))
    for panel, (shown, curves) in zip(axes, panels, strict=True):
        for place, (_, values) in enumerate(curves):
            look = {"color": COLOURS[place % len(COLOURS)], "linestyle": DASHES[place % len(DASHES)]}
            panel.plot(found.time * factor, values, linewidth=1.4, **look)
        panel.set_ylabel(f"[{visible(shown)}]", parse_math=False)
        panel.grid(True, color="#d9d9d9", linewidth=0.6)
        panel.spines[["top", "right"]].set_visible(False)
        panel.margins(x=0.0)
        _legend(panel, [name for name, _ in curves])
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


def _legend(panel: Any, names: list[str]) -> None:
    """Set the texts of a legend afterwards: as labels, names that begin with `_` would be omitted, and `$` would begin a formula."""
    legend = panel.legend(
        panel.get_lines(), [str(i) for i in range(len(names))], loc="upper left", bbox_to_anchor=(1.005, 1.02),
        borderaxespad=0.0, frameon=False, fontsize=8,
    )  # fmt: skip
    for text, name in zip(legend.get_texts(), names, strict=True):
        text.set_parse_math(False)
        text.set_text(short(name, 30))
