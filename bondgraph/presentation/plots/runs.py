"""Plot of a result over time, for a report: made of matplotlib's objects only, so that no figure of the caller's session changes."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import MissingPackage, UsageError
from ...files import replacing
from ..text.tables import short, time_unit, visible

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ...results.result import Result

    Curve = tuple[str, NDArray[np.float64]]

ENDINGS = (".png", ".svg", ".pdf")
PANELS = 6
CURVES = 16  # most curves in one panel: a legend cannot distinguish more
# Okabe and Ito's colours, which colour-blind readers can distinguish; the dashes distinguish them in print and show the lower one
# of two curves that coincide, as those of symmetric models do.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#444444")
DASHES = ((0, ()), (0, (5, 1.6)), (0, (5, 1.4, 1.2, 1.4)), (0, (1.4, 1.2)))
# The reader's own matplotlibrc must neither turn a name into TeX nor change what a report looks like.
STYLE = {
    "text.usetex": False,
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.formatter.use_mathtext": True,
    "axes.formatter.limits": (-3, 4),
    "axes.unicode_minus": True,
    "agg.path.chunksize": 20_000,
    "path.simplify": True,
    "svg.hashsalt": "bondgraph",
    "savefig.transparent": False,
}


def check_picture(path: str | os.PathLike[str]) -> None:
    """Raise `UsageError` for a file name with an unknown ending, or `MissingPackage` without matplotlib."""
    from importlib.util import find_spec

    if Path(path).suffix.lower() not in ENDINGS:
        raise UsageError(f"a plot is written to a file that ends in {', '.join(ENDINGS)}, not to `{path}`")
    if find_spec("matplotlib") is None:
        raise MissingPackage('a plot needs matplotlib: pip install "bondgraph-lang[plot]"')


def plot_result(result: Result, path: str | os.PathLike[str]) -> None:
    """Draw one panel for each shown unit, over a common time axis, into `path`; completely or not at all.

    At most six panels with sixteen curves each; omitted ones are named below. Raises UsageError, MissingPackage, OSError.
    """
    check_picture(path)
    drawn(lambda: _figure(result), path)


def drawn(make: Callable[[], Any], path: str | os.PathLike[str]) -> None:
    """Make a figure in our style and write it into `path`; completely or not at all."""
    import matplotlib

    kind = Path(path).suffix.lower()[1:]
    with matplotlib.rc_context(STYLE):
        figure = make()
        undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)  # equal results, equal files
        with replacing(path) as stream:
            figure.savefig(stream, format=kind, dpi=160, metadata=undated)


def group_by_unit(result: Result) -> dict[str, list[Curve]]:
    """Return the curves (name, values in the unit) of each shown unit, in the order in which the units appear."""
    groups: dict[str, list[Curve]] = {}
    for item, values in result.shown():
        groups.setdefault(item.unit, []).append((item.name, values))
    return groups


def _figure(result: Result) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    groups = group_by_unit(result)
    drawn = list(groups.items())[:PANELS]
    left_out = [name for _, curves in drawn for name, _ in curves[CURVES:]]
    left_out += [name for curves in list(groups.values())[PANELS:] for name, _ in curves]
    count = max(1, len(drawn))
    figure = Figure(figsize=(8.0, 1.3 + (2.9 if count == 1 else 1.9) * count), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(visible(result.title), fontsize=11, parse_math=False)
    panels = list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])
    unit, factor = time_unit(float(abs(result.time).max()) if len(result.time) else 0.0)
    for panel, (shown_unit, curves) in zip(panels, drawn, strict=False):
        _panel(panel, result.time * factor, shown_unit, curves[:CURVES])
    if not drawn:
        panels[0].text(0.5, 0.5, "no outputs", transform=panels[0].transAxes, ha="center", va="center")
    panels[-1].set_xlabel(f"time [{unit}]")
    if len(result.time) > 1:
        panels[-1].set_xlim(result.time[0] * factor, result.time[-1] * factor)
    figure.align_ylabels(panels)
    if left_out:
        figure.supxlabel(_left_out(left_out), fontsize=7, color="#555555", parse_math=False)
    return figure


def _panel(panel: Any, time: NDArray[np.float64], unit: str, curves: Sequence[Curve]) -> None:
    for place, (_, values) in enumerate(curves):
        look = {"color": COLOURS[place % len(COLOURS)], "linestyle": DASHES[place % len(DASHES)]}
        alone = {"marker": "o", "markersize": 3} if len(time) == 1 else {}
        panel.plot(time, values, linewidth=1.4, **look, **alone)
    head = short(curves[0][0], 30) if len(curves) == 1 else ""
    panel.set_ylabel(f"{head} [{visible(unit)}]".strip(), parse_math=False)
    panel.grid(True, color="#d9d9d9", linewidth=0.6)
    panel.set_axisbelow(True)
    panel.spines[["top", "right"]].set_visible(False)
    panel.margins(x=0.0, y=0.08)
    # The legend is beside the curves and never on them. Its texts are set afterwards: as labels, names that begin
    # with `_` would be omitted, and `$` would begin a formula.
    labels = [f"{place}" for place in range(len(curves))]
    legend = panel.legend(
        panel.get_lines(), labels, loc="upper left", bbox_to_anchor=(1.005, 1.02), borderaxespad=0.0, frameon=False,
        handlelength=2.6, fontsize=8 if len(curves) <= 8 else 6, labelspacing=0.4 if len(curves) <= 8 else 0.2,
    )  # fmt: skip
    for text, (name, _) in zip(legend.get_texts(), curves, strict=True):
        text.set_parse_math(False)
        text.set_text(short(name, 30))


def _left_out(names: Sequence[str]) -> str:
    told = ", ".join(short(name, 24) for name in names[:6])
    rest = f" and {len(names) - 6} more" if len(names) > 6 else ""
    return f"not drawn: {told}{rest}"
