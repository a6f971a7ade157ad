"""Work-precision diagram: run time against error."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from .sheet import curve_style, heading, legend, picture, sheet, without_frame

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...studies.work_precision import WorkPrecision

MARKERS = "osD^vPX*<>"
LEAST = 1e-16  # error at which a point without one is drawn, as that of the reference


@picture
def plot_work_precision(found: WorkPrecision) -> Figure:
    """Return time over error, a curve for each solver, from loose tolerances at the left to tight ones; the wanted error and what is recommended."""
    figure = sheet(f"{heading(found.model, found.experiment)}, run time against error", 8.0, 5.0)
    panel = figure.subplots()
    panel.grid(True, which="major", color="#d9d9d9", linewidth=0.6)
    names = []
    for place, solver in enumerate(found.solvers):
        points = [p for p in found.points if p.solver == solver and math.isfinite(p.error)]
        if not points:
            continue
        style = curve_style(place) | ({"linewidth": 0.9, "alpha": 0.7} if points[0].peer else {})
        panel.loglog(
            [max(p.error, LEAST) for p in points], [1e3 * p.seconds for p in points], marker=MARKERS[place % len(MARKERS)], markersize=4, **style
        )  # fmt: skip
        names.append(solver)
    panel.invert_xaxis()
    panel.set_xlabel("largest error of an output, relative to its magnitude (dashed: the wanted one; ringed: recommended)")  # fmt: skip
    panel.set_ylabel("time of a run [ms]")
    legend(panel, names, beside=True)
    panel.axvline(found.error, color="#444444", linewidth=0.8, linestyle=(0, (4, 2)))
    best = found.recommended
    if best is not None:
        panel.plot(max(best.error, LEAST), 1e3 * best.seconds, "o", markersize=13, markerfacecolor="none", markeredgecolor="#444444")  # fmt: skip
    without_frame(panel)
    return figure
