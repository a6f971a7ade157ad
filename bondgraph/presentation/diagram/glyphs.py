"""Sizes of the parts of a diagram: letters, labels, boxes; and text widths without a font.

The widths are those of DejaVu Sans and DejaVu Serif, in hundredths of the size: wide faces, so that text that fits with them also fits with
the narrower faces of a viewer. They come with matplotlib, which draws the PNG and PDF.
"""

from __future__ import annotations

from .diagram_model import DiagramNode
from .overlap import Rectangles, Vector, rectangles

LETTER, NAME, PORT = 19.0, 12.5, 11.0  # sizes of letters, names, ports in px
HALF = 9.0  # half the height of a letter
GAP = 5.0  # between a letter and the end of a bond
SHORTEST = 42.0  # bond
STUB = 20.0  # part of a bent bond that is always straight
ARROW = 26.0  # the shortest signal
STROKE = 7.5  # half the length of a causal stroke
_SANS = {
    27: "'", 28: "ijl", 29: "IJ", 32: " ,.", 34: "/:;\\|", 35: "f", 36: "-", 39: "()[]t", 40: "!", 41: "r", 46: '"', 50: "*_`", 52: "sz",
    53: "?", 55: "c", 56: "L", 58: "Fk", 59: "vxy", 60: "P", 61: "TYao", 62: "e", 63: "ESbdghnpqu", 64: "$0123456789{}", 66: "K", 68: "AV",
    69: "BRXZ", 70: "C", 73: "U", 75: "HN", 77: "DG", 78: "&", 79: "OQ", 82: "w", 84: "#+<=>^~", 86: "M", 95: "%", 97: "m", 99: "W", 100: "@",
}  # fmt: skip
_SERIF = {
    27: "'", 31: "j", 32: " ,.il", 34: "-/:;\\|", 37: "f", 39: "()[]", 40: "!IJt", 46: '"', 48: "r", 50: "*_`", 51: "s", 53: "z", 54: "?",
    56: "cvxy", 59: "e", 60: "ao", 61: "k", 64: "$0123456789bdghnpqu{}", 66: "LY", 67: "PT", 69: "FSZ", 71: "X", 72: "AV", 73: "BE", 75: "KR",
    77: "C", 80: "DG", 82: "OQ", 84: "#+<=>U^~", 86: "w", 87: "H", 88: "N", 89: "&", 95: "%m", 100: "@", 102: "M", 103: "W",
}  # fmt: skip
WIDTHS = {
    face: {c: w for w, characters in table.items() for c in characters}
    for face, table in (("sans", _SANS), ("serif", _SERIF))
}
WIDEST = 104  # for characters outside the tables: no letter of an alphabet is wider


def half_width(node: DiagramNode) -> float:
    """Return half the width of a letter; for the source of a signal from outside half its name."""
    if node.shape == "stub":
        return 2.0
    if node.shape == "signal":
        return round(text_width(node.label, NAME) / 2 + 2, 1)
    return round(text_width(node.letter, LETTER, "serif") / 2 + 1.5, 1)


def letter_rectangle(node: DiagramNode) -> tuple[float, float, float, float]:
    """Return the rectangle of a letter around its middle."""
    half = half_width(node)
    return (-half, -HALF, half, HALF)


def shortest(node: DiagramNode) -> float:
    """Return the least length of a line to a node."""
    return {"stub": STUB, "signal": ARROW}.get(node.shape, SHORTEST)


def reach(node: DiagramNode, along: Vector) -> float:
    """Return the distance from the middle of a letter to its border, in a direction."""
    half, (x, y) = half_width(node), along
    return min(half / abs(x) if x else 1e9, HALF / abs(y) if y else 1e9)


def beside(node: DiagramNode, along: Vector) -> tuple[str, float, float, str]:
    """Return the label of an element at the end of a bond in direction `along`: text, x, y of the baseline, anchor."""
    half = half_width(node)
    if along[0] < -0.3:
        return f"{node.label} :", -half - 4, 4.5, "end"
    return f": {node.label}", half + 4, 4.5, "start"


def above(node: DiagramNode) -> tuple[str, float, float, str]:
    """Return the label of a node with several bonds, at its upper left, away from strokes and half arrows."""
    return node.label, -12.5, -15.5, "end"


def text_rectangle(text: str, x: float, y: float, anchor: str, size: float = NAME) -> tuple[float, float, float, float]:
    """Return the rectangle of a line of text: `x` and `y` of its baseline's start, middle or end."""
    width = text_width(text, size)
    left = x - {"start": 0.0, "middle": 0.5, "end": 1.0}[anchor] * width
    return (left, y - 0.78 * size, left + width, y + 0.24 * size)


def letter_and_label(
    node: DiagramNode, along: Vector | None, alone: bool
) -> tuple[Rectangles, tuple[str, float, float, str]]:
    """Return the rectangles of a letter node, the letter's first, and the position of its label. `alone`: at the end of a bond."""
    label = beside(node, along or (1, 0)) if alone and node.shape == "element" else above(node)
    taken = [letter_rectangle(node)]
    if node.label and node.shape != "signal":
        taken.append(text_rectangle(*label))
    return rectangles(taken), label


def text_width(text: str, size: float, face: str = "sans") -> float:
    """Return the width of a line of text, in the unit of `size`."""
    return sum(WIDTHS[face].get(c, WIDEST) for c in text) * size / 100
