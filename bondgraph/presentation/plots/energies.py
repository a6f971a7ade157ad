"""Plot of energy over time: supplied energy and its distribution; below, the elements with most of it."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from ..text.tables import short, time_unit, visible
from .runs import COLOURS, DASHES, check_picture, drawn

if TYPE_CHECKING:
    from ...analysis.energies import Energies

MOST = 6  # most elements
PREFIXES = ((1e-15, "fJ"), (1e-12, "pJ"), (1e-9, "nJ"), (1e-6, "uJ"), (1e-3, "mJ"), (1.0, "J"), (1e3, "kJ"), (1e6, "MJ"))  # fmt: skip


def plot_energies(found: Energies, path: str | os.PathLike[str]) -> None:
    """Draw into `path`; completely or not at all. Raises UsageError, MissingPackage, OSError."""
    check_picture(path)
    drawn(lambda: _figure(found), path)


def _figure(found: Energies) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 6.0), layout="constrained")
    FigureCanvasAgg(figure)
    head = found.model if found.experiment is None else f"{found.model}: {found.experiment}"
    figure.suptitle(visible(f"{head}, energy"), fontsize=11, parse_math=False)
    panels = figure.subplots(2, 1, sharex=True)
    sums = {
        "supplied": found.supplied,
        "stored": found.stored,
        "in motion": found.motion,
        "dissipated": found.dissipated,
    }
    sums = {n: v for n, v in sums.items() if np.abs(v).max(initial=0.0) > 0}
    sizes = {n: float(np.abs(v).max(initial=0.0)) for n, v in found.elements.items()}
    chosen = sorted((n for n in sizes if sizes[n] > 0), key=lambda n: -sizes[n])[:MOST]
    unit, factor = time_unit(float(np.abs(found.time).max(initial=0.0)))
    scale, name = _prefix(max([float(np.abs(v).max()) for v in sums.values()], default=1.0))
    for panel, curves in ((panels[0], sums), (panels[1], {n: found.elements[n] for n in chosen})):
        for place, values in enumerate(curves.values()):
            look = {"color": COLOURS[place % len(COLOURS)], "linestyle": DASHES[place % len(DASHES)]}
            panel.plot(found.time * factor, values / scale, linewidth=1.4, **look)
        panel.set_ylabel(f"energy [{name}]")
        panel.grid(True, color="#d9d9d9", linewidth=0.6)
        panel.spines[["top", "right"]].set_visible(False)
        panel.margins(x=0.0)
        legend = panel.legend(
            panel.get_lines(), [str(i) for i in range(len(curves))], loc="upper left", bbox_to_anchor=(1.005, 1.02),
            borderaxespad=0.0, frameon=False, fontsize=8,
        )  # fmt: skip
        for text, label in zip(legend.get_texts(), curves, strict=True):
            text.set_parse_math(False)
            text.set_text(short(label, 30))
    panels[1].set_xlabel(f"time [{unit}]")
    figure.align_ylabels(panels)
    return figure


def _prefix(largest: float) -> tuple[float, str]:
    return next(((s, n) for s, n in reversed(PREFIXES) if largest >= s), PREFIXES[0])
