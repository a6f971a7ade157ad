"""Figure as PNG or PDF, drawn by matplotlib: it is installed for plots, needs no system library, and brings its fonts."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import MissingPackage, UsageError
from ...files import replacing, write_text
from ..text.tables import visible
from .figure import Circle, Figure, Group, Lettering, Polyline, RoundedBox, Shape
from .styles import GROUND, MARKS, SHAPE_STYLES, STYLES, Style
from .svg import svg_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ENDINGS = (".svg", ".png", ".pdf")
INCH = 96.0  # px
SCALE = 2.0  # of a PNG, so that it is sharp in print and on dense screens
FACES: Mapping[str, str] = {"serif": "STIXGeneral", "sans": "DejaVu Sans"}  # both come with matplotlib


def check_drawing(path: str | os.PathLike[str]) -> None:
    """Raise `UsageError` if the ending of a file name is not one of a diagram, or `MissingPackage`."""
    from importlib.util import find_spec

    ending = Path(path).suffix.lower()
    if ending not in ENDINGS:
        raise UsageError("BR936", f"a diagram is written to a file that ends in {', '.join(ENDINGS)}, not to `{path}`")
    if ending != ".svg" and find_spec("matplotlib") is None:
        raise MissingPackage(
            "BR937", f"a diagram as {ending} needs matplotlib:", 'pip install "bondgraph-lang[plot]"; .svg needs nothing',
        )  # fmt: skip


def write_figure(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a figure in the format of the file's ending, completely or not at all. Raises UsageError, MissingPackage, OSError."""
    check_drawing(path)
    if Path(path).suffix.lower() == ".svg":
        write_text(path, svg_text(figure))
        return
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as Page

    kind = Path(path).suffix.lower()[1:]
    with matplotlib.rc_context({"text.usetex": False, "pdf.fonttype": 42}):
        page = Page(figsize=(figure.width / INCH, figure.height / INCH), facecolor=GROUND)
        FigureCanvasAgg(page)
        axes = page.add_axes((0, 0, 1, 1))
        axes.set_xlim(0, figure.width)
        axes.set_ylim(figure.height, 0)
        axes.set_axis_off()
        for group in figure.groups:
            for shape in group.shapes:
                _draw(axes, shape, group)
        undated = {"CreationDate": None} if kind == "pdf" else None  # equal figures, equal files
        with replacing(path) as stream:
            page.savefig(stream, format=kind, dpi=INCH * SCALE, metadata=undated)


def _draw(axes: Axes, shape: Shape, group: Group) -> None:
    from matplotlib import patches

    look = {**STYLES, **SHAPE_STYLES}[shape.look]
    colour = MARKS[group.mark] if group.mark and look.marked else look.colour
    match shape:
        case Polyline(points, _, closed):
            axes.add_patch(patches.Polygon(points, closed=closed, **_lines(look, colour, closed)))
        case Circle(middle, radius):
            axes.add_patch(patches.Circle(middle, radius, **_lines(look, colour, True)))
        case RoundedBox(left, top, width, height, _, rounding):
            style = f"round,pad=0,rounding_size={rounding}"
            axes.add_patch(
                patches.FancyBboxPatch((left, top), width, height, boxstyle=style, **_lines(look, colour, True))
            )
        case Lettering(text, x, y, _, anchor):
            side = {"start": "left", "middle": "center", "end": "right"}[anchor]
            axes.text(
                x, y, visible(text), color=colour, fontsize=look.size * 72 / INCH, ha=side, va="baseline", family=FACES[look.face],
                style="italic" if look.italic else "normal", weight="bold" if look.bold else "normal", parse_math=False,
            )  # fmt: skip


def _lines(look: Style, colour: str, closed: bool) -> dict[str, Any]:
    dashes = (0, tuple(d / look.width for d in look.dashes)) if look.dashes else "solid"
    return {
        "fill": look.filled and closed, "facecolor": look.inside or colour, "edgecolor": colour, "linewidth": look.width * 72 / INCH, "linestyle": dashes,
        "capstyle": "round", "joinstyle": "round",
    }  # fmt: skip
