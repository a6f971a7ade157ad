"""Colours, widths and letters of diagrams.

Colours are Okabe and Ito's, which colour-blind readers can distinguish, and no meaning depends on a colour alone: a legend names it, and the marked
part is bolder.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from .glyphs import LETTER, NAME, PORT

INK, PALE, GROUND = "#1c1c1c", "#6a6a6a", "#ffffff"
MARKS: Mapping[str, str] = {"derivative": "#c44a00", "loop": "#0068b0"}

# Replacement of each colour on a dark page.
# Colours that a text gives to bodies: of their faces; their edges are darker.
FILLS = {
    "red": "#e57368", "orange": "#f0a35e", "yellow": "#ecd163", "green": "#7cc08a", "blue": "#74a9dc", "purple": "#b492cf", "brown": "#b08a6a",
    "grey": "#b4bbc2", "black": "#50575e", "white": "#f4f4f2",
}  # fmt: skip
DARK: Mapping[str, str] = {
    INK: "#e8e8e8", PALE: "#a2a8ad", GROUND: "#16191c", "#9a9a9a": "#6d7378", "#5b6b7a": "#9db0c2", "#dfe6ec": "#2c3944", "#f1f1f1": "#2a2e31",
    "#8a4b00": "#e2a14e", "#c44a00": "#ff9a5c", "#0068b0": "#5eb6f5",
    **{fill: fill for fill in FILLS.values()},
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Style:
    """Style of a shape; None or 0 for properties that it does not have."""

    colour: str
    width: float = 0.0
    filled: bool = False
    inside: str = ""  # colour of the inside, if it differs from that of the border
    dashes: tuple[float, ...] = ()
    size: float = 0.0
    face: str = ""
    italic: bool = False
    bold: bool = False
    marked: bool = True  # True if it takes the colour of its group


STYLES: Mapping[str, Style] = {
    "line": Style(INK, 1.4),
    "barb": Style(INK, 1.4),
    "stroke": Style(INK, 2.0),
    "signal": Style(PALE, 1.0, marked=False),
    "point": Style(PALE, 1.0, filled=True, marked=False),
    "box": Style(INK, 1.3),
    "frame": Style("#9a9a9a", 1.0, dashes=(4, 3), marked=False),
    "body": Style("#5b6b7a", 1.3, filled=True, inside="#dfe6ec"),
    "pin": Style(INK, 1.3, filled=True, inside=GROUND),
    "solid": Style(INK, 1.0, filled=True),
    "stand": Style(INK, 1.3, filled=True, inside="#f1f1f1"),
    "hatch": Style(INK, 0.8),
    "spring": Style("#8a4b00", 1.5),
    "measure": Style(PALE, 1.0, dashes=(5, 3)),
    "letter": Style(INK, size=LETTER, face="serif"),
    "name": Style(INK, size=NAME, face="sans"),
    "title": Style(INK, size=NAME + 1, face="sans", bold=True),
    "kind": Style(PALE, size=PORT, face="sans", italic=True, marked=False),
    "port": Style(PALE, size=PORT, face="sans", marked=False),
    "number": Style(PALE, size=10.0, face="sans", marked=False),
    "note": Style(PALE, size=PORT, face="sans", marked=False),
    "ground": Style(GROUND, filled=True, marked=False),
}
# Of the shapes that a text gives to bodies: a picture without them has no rules of them.
SHAPE_STYLES: Mapping[str, Style] = {
    "edge": Style("#5b6b7a", 0.8),
    **{name: Style("#5b6b7a", 1.3, filled=True, inside=fill) for name, fill in FILLS.items()},
}
