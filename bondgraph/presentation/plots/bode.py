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
NARROW = 5.0  # ratio of the last to the first frequency below which the axis is linear


@picture
def plot_response(found: Response) -> Figure:
    """Return magnitude and phase of the first outputs, a curve for each input."""
    shown = found.outputs[:MOST]
    ratios = [1.6, 1.0] * len(shown)
    figure, panels = stack(found.title, 8.0, 4.2 * len(shown), len(ratios), height_ratios=ratios)
    phase = found.phase
    for i, output in enumerate(shown):
        above, below = panels[2 * i], panels[2 * i + 1]
        for j in range(len(found.inputs)):
            above.loglog(found.frequencies, found.magnitude[:, i, j], **curve_style(j))
            below.semilogx(found.frequencies, phase[:, i, j], **curve_style(j))
        units = {name: found.unit(name, output) for name in found.inputs}
        shared = units[found.inputs[0]] if len(set(units.values())) == 1 else "1"  # else each is told beside its input
        above.set_ylabel(labelled(output, shared), parse_math=False)
        below.set_ylabel("phase [deg]")
        legend(above, (labelled(f"from {n}", "1" if u == shared else u, 40) for n, u in units.items()), longest=60)
    panels[-1].set_xlabel("frequency [Hz]")
    panels[-1].set_xlim(found.frequencies[0], found.frequencies[-1])
    if found.frequencies[-1] < NARROW * found.frequencies[0]:
        panels[-1].set_xscale("linear")  # a logarithmic axis would have at most one tick
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
    panel.set_xlabel("frequency [Hz]")
    panel.set_ylabel("damping ratio")
    return figure


def stems(found: Modes) -> tuple[Array, Array]:
    """Return frequencies and damping ratios of the lines from zero up to the damping ratio at each frequency."""
    moving = [mode for mode in found if mode.frequency > 0]
    damping = [x for mode in moving for x in (0.0, mode.damping, np.nan)]
    return np.repeat([mode.frequency for mode in moving], 3), np.array(damping)
