"""Sheet of a plot: its style, its panels, its legends, its file.

Made of matplotlib's objects only, so that no figure of the caller's session changes.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

import numpy as np

from ...errors import MissingPackage, UsageError
from ...files import replacing
from ..text.tables import short, some_of, visible

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Subject = TypeVar("Subject")
Options = ParamSpec("Options")
StrPath = str | os.PathLike[str]

ENDINGS = (".png", ".svg", ".pdf")
PANELS = 6
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


def check_picture(path: StrPath | None) -> None:
    """Raise `UsageError` for a file name with an unknown ending, or `MissingPackage` without matplotlib."""
    from importlib.util import find_spec

    if path is not None and Path(path).suffix.lower() not in ENDINGS:
        raise UsageError("BR927", f"a plot is written to a file that ends in {', '.join(ENDINGS)}, not to `{path}`")
    if find_spec("matplotlib") is None:
        raise MissingPackage("BR928", "a plot needs matplotlib:", 'pip install "bondgraph-lang[plot]"')


def picture(
    figure_of: Callable[Concatenate[Subject, Options], Figure],
) -> Callable[Concatenate[Subject, StrPath | None, Options], Figure]:
    """Return a function that makes a figure of a result in our style, and writes it into the file `path` if there is one: completely or not at all.

    It raises UsageError, MissingPackage, OSError.
    """

    @wraps(figure_of)
    def drawn(subject: Subject, path: StrPath | None, /, *options: Options.args, **named: Options.kwargs) -> Figure:
        check_picture(path)
        import matplotlib

        with matplotlib.rc_context(STYLE):
            figure = figure_of(subject, *options, **named)
            if path is not None:
                kind = Path(path).suffix.lower()[1:]
                undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)  # equal results, equal files
                with replacing(path) as stream:
                    figure.savefig(stream, format=kind, dpi=160, metadata=undated)
        return figure

    return drawn


def sheet(title: str, width: float, height: float) -> Figure:
    """Return an empty figure with a title; width and height in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(visible(title), fontsize=11, parse_math=False)
    return figure


def stack(
    title: str, width: float, height: float, count: int, ax: Axes | Sequence[Axes] | None = None, **options: Any
) -> tuple[Figure, list[Axes]]:
    """Return a sheet with `count` panels with grids, one above the other, over a common axis; or the axes of the caller. Raises UsageError."""
    if ax is not None:
        panels = list(np.ravel(np.asarray(ax, dtype=object)))
        if len(panels) != count:
            raise UsageError("BR949", f"there are {count} panels to draw, one for each unit, and {len(panels)} axes")
        return panels[0].get_figure(root=True), panels
    figure = sheet(title, width, height)
    panels = list(figure.subplots(count, 1, sharex=True, squeeze=False, **options)[:, 0])
    for panel in panels:
        panel.grid(True, color="#d9d9d9", linewidth=0.6)
        panel.set_axisbelow(True)
        without_frame(panel)
    return figure, panels


def rows(title: str, count: int, ax: Axes | Sequence[Axes] | None = None) -> tuple[Figure, list[Axes]]:
    """Return a sheet with panels over time, at least one; a single one is higher. As `stack`."""
    count = max(1, count)
    return stack(title, 8.0, 1.3 + (2.9 if count == 1 else 1.9) * count, count, ax)


def curve_style(place: int) -> dict[str, Any]:
    """Return colour, dashes and width of a panel's curve at this place."""
    return {"color": COLOURS[place % len(COLOURS)], "linestyle": DASHES[place % len(DASHES)], "linewidth": 1.4}


def without_frame(panel: Axes) -> None:
    """Remove the upper and the right border."""
    panel.spines[["top", "right"]].set_visible(False)


def legend(panel: Axes, names: Iterable[str], beside: bool = False, longest: int = 30, **options: Any) -> None:
    """Name the bands and lines of a panel, `beside` it if they would lie below the legend; after those that a legend of it names already.

    The texts are set afterwards: as labels, names that begin with `_` would be omitted, and `$` would begin a formula.
    """
    before = panel.get_legend()
    names = [*(text.get_text() for text in (before.get_texts() if before else ())), *names]
    if beside:
        options |= {"loc": "upper left", "bbox_to_anchor": (1.005, 1.02), "borderaxespad": 0.0}
    made = panel.legend(
        [*panel.collections, *panel.get_lines()][-len(names) :],
        [str(i) for i in range(len(names))],
        **({"frameon": False, "fontsize": 8} | options),
    )
    for text, name in zip(made.get_texts(), names, strict=True):
        text.set_parse_math(False)
        text.set_text(short(name, longest))


def tell_omitted(figure: Figure, names: Sequence[str], color: str | None = "#555555") -> None:
    """Name below a figure what is not drawn, if there is something."""
    if names:
        listed = some_of([short(name, 24) for name in names], 6)
        figure.supxlabel(f"not drawn: {listed}", fontsize=7, parse_math=False, color=color)
