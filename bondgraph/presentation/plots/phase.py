"""Phase plot of a run's outputs over another one, with arrows in the direction of time; and plot of a branch of equilibria over its parameter."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from compiler.api import Array

from ...errors import UsageError
from ..text.tables import labelled
from .sheet import COLOURS, DASHES, PANELS, picture, stack

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...analysis.branch import Branch
    from ...results.result import Result

ARROWS = (0.2, 0.45, 0.7)  # positions, as fractions of the length of a curve
LOOKS = {"fold": "o", "branch": "D", "oscillation": "s", "jump": "|"}


@picture
def plot_phase(result: Result, over: str) -> Figure:
    """Return a panel for each shown output, over the output `over`. Raises UsageError."""
    shown = {item.name: (item.unit, values) for item, values in result.shown()}
    if over not in shown:
        raise UsageError("BR929", f"the run shows no `{over}`; it shows {', '.join(shown) or 'nothing'}")
    if len(shown) < 2:
        raise UsageError("BR930", f"there is nothing to draw over `{over}`: the run shows no other output")
    unit, x = shown[over]
    others = [n for n in shown if n != over][:PANELS]
    figure, panels = stack(result.title, 7.0, 0.9 + 3.4 * len(others), len(others))
    for place, (panel, name) in enumerate(zip(panels, others, strict=True)):
        own, y = shown[name]
        colour = COLOURS[place % len(COLOURS)]
        panel.plot(x, y, color=colour, linewidth=1.3)
        _arrows(panel, x, y, colour)
        panel.plot(x[:1], y[:1], "o", color="#1c1c1c", markersize=4)
        panel.set_ylabel(labelled(name, own), parse_math=False)
        panel.margins(0.05)
    panels[-1].set_xlabel(labelled(over, unit), parse_math=False)
    return figure


def _arrows(panel: Axes, x: Array, y: Array, colour: str) -> None:
    """Draw arrows by the visible length of the curve, so that they do not gather on slow parts."""
    spans = [float(np.ptp(v)) or 1.0 for v in (x, y)]
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x) / spans[0], np.diff(y) / spans[1]))])
    if not way[-1] > 0:
        return
    for share in ARROWS:
        i = int(np.searchsorted(way, share * way[-1]))
        if 0 < i < len(way) and way[i] > way[i - 1]:
            panel.annotate(
                "", (x[i], y[i]), (x[i - 1], y[i - 1]), arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.0, "mutation_scale": 12}
            )  # fmt: skip


@picture
def plot_branch(found: Branch, names: Sequence[str] = ()) -> Figure:
    """Return outputs of equilibria over the parameter: stable parts solid, unstable ones dashed, special points marked. Raises UsageError."""
    unknown = [n for n in names if n not in found.outputs and n not in found.states]
    if unknown:
        raise UsageError(
            "BR931", f"the branch has no `{unknown[0]}`; it has {', '.join((*found.outputs, *found.states))}"
        )
    names = (list(names) or list(found.outputs) or list(found.states))[:PANELS]
    figure, panels = stack(found.title, 7.0, 0.9 + 2.9 * len(names), len(names))
    for panel, name in zip(panels, names, strict=True):
        for line in (found, *found.others):
            _line(panel, line, name)
        for special in found.special:
            y = special.outputs[name] if name in special.outputs else special.states[name]
            panel.plot([special.value], [y], LOOKS[special.kind], color="#d55e00", markersize=6, label=special.kind)
        panel.set_ylabel(labelled(name, found.units.get(name, "1")), parse_math=False)
        handles, labels = panel.get_legend_handles_labels()
        once = dict(zip(labels, handles, strict=True))
        panel.legend(once.values(), once.keys(), frameon=False, fontsize=8)
    panels[-1].set_xlabel(labelled(found.parameter, found.units.get(found.parameter, "1")), parse_math=False)
    return figure


def _line(panel: Axes, found: Branch, name: str) -> None:
    """Draw a line, cut where stability changes: at the special point between two points, if it was found."""
    x, y, stable = list(found.values), list(found[name]), list(found.stable)
    cuts = [i for i in range(1, len(x)) if stable[i] != stable[i - 1]]
    for i in reversed(cuts):
        middle = 0.5 * (x[i - 1] + x[i])
        between = min(found.special, key=lambda s: abs(s.value - middle), default=None)
        if between is not None:
            x.insert(i, between.value)
            y.insert(i, between.outputs.get(name, between.states.get(name, y[i])))
            stable.insert(i, stable[i])
    edges = [0, *(i for i in range(1, len(x)) if stable[i] != stable[i - 1]), len(x) - 1]
    for begin, end in pairwise(edges):
        good = bool(stable[begin])
        panel.plot(
            x[begin : end + 1], y[begin : end + 1], linewidth=1.5, color=COLOURS[0] if good else "#8a8a8a",
            linestyle="-" if good else DASHES[1], label="stable" if good else "unstable",
        )  # fmt: skip
