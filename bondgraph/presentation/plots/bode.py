"""Plots over frequency: magnitude above phase, a pair of panels for each output; the damping of modes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from compiler.api import Array

from ...errors import UsageError
from ..text.tables import labelled
from .sheet import curve_style, legend, picture, stack, tell_omitted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...analysis.modes import Modes
    from ...analysis.response import Response

MOST = 3  # most outputs
NARROW, WIDE = 5.0, 100.0  # ratios of frequencies below which the axis is linear, or has ticks at 1, 2 and 5
DEEPEST = 1e-6  # of a dip, relative to the largest magnitude


@picture
def plot_response(found: Response) -> Figure:
    """Return magnitude and phase of the first outputs, a curve for each input."""
    shown = found.outputs[:MOST]
    ratios = [1.6, 1.0] * len(shown)
    figure, panels = stack(found.title, 8.0, 4.2 * len(shown), len(ratios), height_ratios=ratios)
    phase = found.phase
    for i, output in enumerate(shown):
        above, below, cuts = panels[2 * i], panels[2 * i + 1], list[str]()
        for j in range(len(found.inputs)):
            magnitude, cut = with_cut_dips(found.magnitude[:, i, j])
            above.loglog(found.frequencies, magnitude, **curve_style(j))
            cuts.append(cut)
            below.semilogx(found.frequencies, phase[:, i, j], **curve_style(j))
        units = {name: found.unit(name, output) for name in found.inputs}
        shared = units[found.inputs[0]] if len(set(units.values())) == 1 else "1"  # else each is told beside its input
        above.set_ylabel(labelled(output, shared), parse_math=False)
        below.set_ylabel("phase [deg]")
        names = (labelled(f"from {n}", "1" if u == shared else u, 40) for n, u in units.items())
        legend(above, map(str.__add__, names, cuts), longest=70)
    panels[-1].set_xlim(found.frequencies[0], found.frequencies[-1])
    _over_frequency(panels[-1])
    tell_omitted(figure, found.outputs[MOST:], None)
    return figure


@picture
def plot_modes(found: Modes, ax: Axes | Sequence[Axes] | None = None) -> Figure:
    """Return the damping ratio of each mode at its frequency. Raises UsageError if all have the frequency zero, or for several axes."""
    frequencies, damping = stems(found)
    if not len(frequencies):
        raise UsageError("BR950", "there is nothing to draw: no mode has a frequency")
    figure, (panel,) = stack(f"{found.title}, modes", 8.0, 3.2, 1, ax)
    panel.semilogx(frequencies, damping, **curve_style(0))
    panel.semilogx(frequencies[1::3], damping[1::3], "o", color=curve_style(0)["color"], markersize=4)
    panel.axhline(0.0, color="#444444", linewidth=0.8)
    _over_frequency(panel)
    panel.set_ylabel("damping ratio")
    return figure


def _over_frequency(panel: Axes) -> None:
    """Name the axis; ticks are at 1, 2 and 5 where it has few decades."""
    panel.set_xlabel("frequency [Hz]")
    low, high = panel.get_xlim()
    if high < NARROW * low:
        panel.set_xscale("linear")  # a logarithmic axis would have at most one tick
    elif high < WIDE * low:
        panel.set_xscale("log", subs=(2, 5))
        panel.xaxis.set_major_formatter("{x:g}")
        panel.xaxis.set_minor_formatter("{x:g}")


def with_cut_dips(magnitude: Array) -> tuple[Array, str]:
    """Return magnitudes, cut where they are far below the largest and below both ends, and the words for it: rounding would stretch an axis."""
    positive = magnitude[np.isfinite(magnitude) & (magnitude > 0)]
    cut = float(min(positive.max() * DEEPEST, positive[0], positive[-1])) if len(positive) else 0.0
    return np.maximum(magnitude, cut), f", cut at {20 * np.log10(cut):.0f} dB" if (magnitude < cut).any() else ""


def stems(found: Modes) -> tuple[Array, Array]:
    """Return frequencies and damping ratios of the lines from zero up to the damping ratio at each frequency."""
    moving = [mode for mode in found if mode.frequency > 0]
    damping = [x for mode in moving for x in (0.0, mode.damping, np.nan)]
    return np.repeat([mode.frequency for mode in moving], 3), np.array(damping)
