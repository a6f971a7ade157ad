"""A diagram read back from its SVG: drawn items and their places, measured with a font's own widths."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any
from xml.etree import ElementTree

from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath

Point = tuple[float, float]
Box = tuple[float, float, float, float]
SVG = "{http://www.w3.org/2000/svg}"
# Faces as wide as any that a viewer takes: DejaVu's, at the sizes of the picture.
FACES = {"letter": ("DejaVu Serif", 19.0, "normal"), "name": ("DejaVu Sans", 12.5, "normal"), "title": ("DejaVu Sans", 13.5, "bold"),
         "kind": ("DejaVu Sans", 11.0, "italic"), "port": ("DejaVu Sans", 11.0, "normal"), "number": ("DejaVu Sans", 10.0, "normal"),
         "note": ("DejaVu Sans", 11.0, "normal")}  # fmt: skip


@dataclass(frozen=True)
class Bond:
    """A bond or multibond as drawn."""

    numbers: tuple[int, ...]
    tail: str
    head: str
    ways: tuple[tuple[Point, ...], ...]  # one line, or the two of a multibond
    barb: tuple[Point, Point]
    stroke: tuple[Point, Point]
    said: str  # the end at which the stroke is said to be
    mark: str

    @property
    def ends(self) -> tuple[Point, Point]:
        """Tail and head."""
        first, last = [w[0] for w in self.ways], [w[-1] for w in self.ways]
        return middle(*first), middle(*last)


@dataclass(frozen=True)
class Read:
    """A diagram."""

    bonds: tuple[Bond, ...]
    nodes: dict[str, Any]
    texts: tuple[tuple[str, str, Box], ...]  # look, text, what it takes
    letters: dict[str, Box]
    boxes: dict[str, Box]
    frames: dict[str, Box]
    signals: tuple[tuple[str, str, tuple[Point, ...]], ...]
    size: Point


def middle(*points: Point) -> Point:
    """The mean of some points."""
    return sum(p[0] for p in points) / len(points), sum(p[1] for p in points) / len(points)


def read(svg: str) -> Read:
    """Content of an SVG text."""
    root = ElementTree.fromstring(svg)
    bonds, signals, texts = [], [], []
    nodes, letters, boxes, frames = dict[str, Any](), dict[str, Box](), dict[str, Box](), dict[str, Box]()
    for group in root.iter(f"{SVG}g"):
        kind = group.get("class", "").split()
        if "bond" in kind:
            bonds.append(_bond(group, kind))
        if "signal" in kind:
            signals.append(
                (group.get("data-source", ""), group.get("data-target", ""), _points(_paths(group, "signal")[0]))
            )
        if "node" in kind:
            name = group.get("data-name", "")
            nodes[name] = group
            boxes.update((name, _box(r)) for r in group.iter(f"{SVG}rect"))
            letters.update((name, measured(t)) for t in group.iter(f"{SVG}text") if t.get("class") == "letter")
        if "instance" in kind:
            frames.update((group.get("data-name", ""), _box(r)) for r in group.iter(f"{SVG}rect"))
        texts += [(t.get("class", ""), t.text or "", measured(t)) for t in group.iter(f"{SVG}text")]
    return Read(
        tuple(bonds), nodes, tuple(texts), letters, boxes, frames, tuple(signals), (float(root.get("width", 0)), float(root.get("height", 0)))
    )  # fmt: skip


def _bond(group: ElementTree.Element, kind: list[str]) -> Bond:
    (barb,), (stroke,) = _paths(group, "barb"), _paths(group, "stroke")
    a, b = _points(barb), _points(stroke)
    return Bond(
        tuple(map(int, group.get("data-bonds", "").split())), group.get("data-tail", ""), group.get("data-head", ""),
        tuple(map(_points, _paths(group, "line"))), (a[0], a[1]), (b[0], b[1]), group.get("data-stroke", ""),
        next((k for k in kind if k in ("derivative", "loop")), ""),
    )  # fmt: skip


def _paths(group: ElementTree.Element, look: str) -> list[str]:
    return [p.get("d", "") for p in group.iter(f"{SVG}path") if p.get("class") == look]


def _points(path: str) -> tuple[Point, ...]:
    numbers = [float(n) for n in re.findall(r"-?[\d.]+", path)]
    return tuple(zip(numbers[::2], numbers[1::2], strict=True))


def _box(item: ElementTree.Element) -> Box:
    x, y, width, height = (float(item.get(n, 0)) for n in ("x", "y", "width", "height"))
    return x, y, x + width, y + height


def measured(item: ElementTree.Element) -> Box:
    """The rectangle that a text takes, by the outlines of a wide face."""
    family, size, way = FACES[item.get("class", "")]
    left, bottom, right, top = _outline(item.text or "", family, size, way)
    x, y = float(item.get("x", 0)), float(item.get("y", 0))
    shift = {"start": 0.0, "middle": 0.5, "end": 1.0}[item.get("text-anchor", "start")] * right
    return x + left - shift, y - top, x + right - shift, y - bottom


@cache
def _outline(text: str, family: str, size: float, way: str) -> Box:
    font = FontProperties(
        family=family, style="italic" if way == "italic" else "normal", weight="bold" if way == "bold" else "normal"
    )
    box = TextPath((0, 0), text, size=size, prop=font).get_extents()
    return float(box.x0), float(box.y0), float(box.x1), float(box.y1)


def overlap(a: Box, b: Box, spare: float = 0.0) -> bool:
    """Return True if two rectangles have an inner point in common."""
    return a[0] < b[2] - spare and b[0] < a[2] - spare and a[1] < b[3] - spare and b[1] < a[3] - spare


def segments(read: Read) -> Iterator[tuple[int, Point, Point]]:
    """Every straight part of every bond's lines, half arrow and stroke, with the bond's place in the list."""
    for number, bond in enumerate(read.bonds):
        for way in (*bond.ways, bond.barb, bond.stroke):
            for start, end in pairwise(way):
                yield number, start, end


def through(start: Point, end: Point, box: Box) -> bool:
    """Return True if a straight line passes through the inside of a rectangle (Liang and Barsky)."""
    low, high = 0.0, 1.0
    for axis in (0, 1):
        step = end[axis] - start[axis]
        if step == 0:
            if not box[axis] < start[axis] < box[axis + 2]:
                return False
            continue
        ends = sorted(((box[axis] - start[axis]) / step, (box[axis + 2] - start[axis]) / step))
        low, high = max(low, ends[0]), min(high, ends[1])
    return low < high


def cross(a: Point, b: Point, c: Point, d: Point) -> bool:
    """Return True if two straight lines cross."""

    def side(p: Point, q: Point, r: Point) -> float:
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0
