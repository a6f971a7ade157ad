"""Sizes of the parts of a diagram: letters, labels, boxes."""

from __future__ import annotations

from .diagram_model import DiagramNode
from .lettering import text_width
from .overlap import Rectangles, Vector, rectangles

LETTER, NAME, PORT = 19.0, 12.5, 11.0  # sizes of letters, names, ports in px
HALF = 9.0  # half the height of a letter
GAP = 5.0  # between a letter and the end of a bond
SHORTEST = 42.0  # bond
STUB = 20.0  # part of a bent bond that is always straight
ARROW = 26.0  # the shortest signal
STROKE = 7.5  # half the length of a causal stroke


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
