"""Plot of energy over time: supplied energy and its distribution; below, the elements with most of it."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np

from ..text.tables import time_unit
from .sheet import check_picture, curve_style, drawn, heading, legend, sheet, with_grid

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...analysis.energies import Energies

MOST = 6  # most elements
PREFIXES = ((1e-15, "fJ"), (1e-12, "pJ"), (1e-9, "nJ"), (1e-6, "uJ"), (1e-3, "mJ"), (1.0, "J"), (1e3, "kJ"), (1e6, "MJ"))  # fmt: skip


def plot_energies(found: Energies, path: str | os.PathLike[str]) -> None:
    """Draw into `path`; completely or not at all. Raises UsageError, MissingPackage, OSError."""
    check_picture(path)
    drawn(lambda: _figure(found), path)


def _figure(found: Energies) -> Figure:
    figure = sheet(f"{heading(found.model, found.experiment)}, energy", 8.0, 6.0)
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
            panel.plot(found.time * factor, values / scale, **curve_style(place))
        panel.set_ylabel(f"energy [{name}]")
        with_grid(panel)
        panel.margins(x=0.0)
        legend(panel, curves, beside=True)
    panels[1].set_xlabel(f"time [{unit}]")
    figure.align_ylabels(panels)
    return figure


def _prefix(largest: float) -> tuple[float, str]:
    return next(((s, n) for s, n in reversed(PREFIXES) if largest >= s), PREFIXES[0])
