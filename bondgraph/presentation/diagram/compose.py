"""Figure from a model and its layout: half arrows, strokes, letters, boxes, signals, the legend.

A half arrow's barb is on the side where textbooks write the flow: below a bond, or right of one that goes up or down. The causal stroke is
drawn across the end of the bond that receives the effort.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

from ..text.tables import some_of
from .box import port_of
from .diagram_model import TAIL, DiagramLine, DiagramModel, DiagramNode
from .figure import Circle, Figure, Group, Lettering, Polyline, RoundedBox, Shape
from .frames import Framed
from .glyphs import PORT, STROKE, text_rectangle, text_width
from .overlap import NOTHING, Point, Rectangles, bounds, joined, rectangles, touches, unit_vector
from .place import DiagramLayout
from .styles import STYLES

BARB, SPREAD = 11.0, 7.0  # the half arrow along and across the bond
DOUBLE = 2.0  # half the distance between the lines of a multibond
BORDER = 16.0
MEANINGS = {"derivative": "storage in derivative form", "loop": "in an algebraic loop"}


def compose(model: DiagramModel, layout: DiagramLayout, frames: Sequence[Framed] = (), numbers: bool = False) -> Figure:
    """Return the figure. `numbers`: show the numbers of the bonds."""
    groups = [
        *map(_frame, frames),
        *_lines(model, layout),
        *_signals(model, layout),
        *(_node(node, number, layout) for number, node in enumerate(model.nodes)),
        *_ports(model, layout),
    ]
    if numbers:
        groups += _numbers(model, layout, groups)
    outer = [(x, y, x, y) for way in layout.signals.values() for x, y in way]
    outer += [(frame.left, frame.top, frame.right, frame.bottom) for frame in frames]
    whole = joined(layout.taken, rectangles(outer))
    left, top, right, bottom = bounds(whole) if len(whole) else (0.0, 0.0, 200.0, 20.0)
    legend, height, width = _legend(model, left, bottom + 20)
    dx, dy = round(BORDER - left, 1), round(BORDER - top, 1)
    size = (max(right - left, width) + 2 * BORDER, bottom - top + height + 2 * BORDER)
    shifted = tuple(group_at(g, dx, dy) for g in (*groups, *legend))
    return Figure(math.ceil(size[0]), math.ceil(size[1]), f"bond graph of {model.name}", shifted)


def _frame(frame: Framed) -> Group:
    shape = RoundedBox(frame.left, frame.top, frame.right - frame.left, frame.bottom - frame.top, "frame", 6.0)
    return Group(
        "instance", (shape, Lettering(frame.instance, *frame.title, "port")), {"name": frame.instance}, frame.instance
    )


# ---------------------------------------------------------------- bonds


def _lines(model: DiagramModel, layout: DiagramLayout) -> Iterator[Group]:
    for number, line in enumerate(model.lines):
        way = layout.bonds[number]
        shapes: list[Shape] = [
            *_shaft(way, len(line.bonds) > 1),
            _barb(way, len(line.bonds) > 1),
            _stroke(way, line.stroke),
        ]
        tail, head = (model.nodes[n].name for n in line.ends)
        facts = {
            "bonds": " ".join(map(str, line.bonds)), "tail": tail, "head": head, "stroke": "tail" if line.stroke == TAIL else "head",
        }  # fmt: skip
        yield Group("bond", tuple(shapes), facts, _words_of_line(model, line), _mark(line))


def _words_of_line(model: DiagramModel, line: DiagramLine) -> str:
    ends = [f"{model.nodes[n].name}{'.' * bool(p)}{p}" for n, p in zip(line.ends, line.ports, strict=True)]
    effort, flow = ends if line.stroke != TAIL else ends[::-1]
    many = f"{len(line.bonds)} bonds, " if len(line.bonds) > 1 else ""
    return f"{ends[0]} -> {ends[1]} ({many}{line.domain}; {line.place}): effort from {effort}, flow from {flow}"


def _shaft(way: Sequence[Point], double: bool) -> Iterator[Polyline]:
    if not double:
        yield Polyline(tuple(way), "line")
        return
    for side in (-DOUBLE, DOUBLE):
        yield Polyline(tuple(_beside(way, side)), "line")


def _beside(way: Sequence[Point], side: float) -> Iterator[Point]:
    """Yield the same way, shifted to its left by a distance."""
    for i, (x, y) in enumerate(way):
        around = [unit_vector(way[j], way[j + 1]) for j in (i - 1, i) if 0 <= j < len(way) - 1]
        yield x + side * sum(-v for _, v in around), y + side * sum(u for u, _ in around)


def _flow_side(along: Point) -> Point:
    """Return the direction across a bond to its flow: below, or right of an upright one."""
    across = (-along[1], along[0])
    lower = across[1] > 0.3 or (abs(across[1]) <= 0.3 and across[0] > 0)
    return across if lower else (-across[0], -across[1])


def _barb(way: Sequence[Point], double: bool) -> Polyline:
    tip, along = way[-1], unit_vector(way[-2], way[-1])
    across = _flow_side(along)
    if double:
        tip = (tip[0] + DOUBLE * across[0], tip[1] + DOUBLE * across[1])
    end = (tip[0] - BARB * along[0] + SPREAD * across[0], tip[1] - BARB * along[1] + SPREAD * across[1])
    return Polyline((tip, end), "barb")


def _stroke(way: Sequence[Point], where: int) -> Polyline:
    (x, y), (u, v) = (
        (way[0], unit_vector(way[0], way[1])) if where == TAIL else (way[-1], unit_vector(way[-2], way[-1]))
    )
    return Polyline(((x - STROKE * -v, y - STROKE * u), (x + STROKE * -v, y + STROKE * u)), "stroke")


def _numbers(model: DiagramModel, layout: DiagramLayout, groups: Sequence[Group]) -> Iterator[Group]:
    """Yield the number of each bond beside its longest part, on the side of the flow if there is room, else elsewhere."""
    taken = joined(NOTHING, *(_taken(shape) for group in groups for shape in group.shapes))
    for number, line in enumerate(model.lines):
        if not line.bonds:
            continue
        first, last = line.bonds[0] + 1, line.bonds[-1] + 1
        text = str(first) if first == last else f"{first}-{last}"
        spots = list(_spots(text, layout.bonds[number]))
        areas = [rectangles([text_rectangle(t.text, t.x, t.y, t.anchor, STYLES["number"].size)]) for t in spots]
        free = [n for n, area in enumerate(areas) if not touches(taken, area, 0.5)]
        chosen = free[0] if free else 0
        taken = joined(taken, areas[chosen])
        yield Group("number", (spots[chosen],), {"bonds": " ".join(map(str, line.bonds))})


def _spots(text: str, way: Sequence[Point]) -> Iterator[Lettering]:
    """Yield positions for a number, best first: in the middle of the free part of a bond, nearer to one end, on the other side."""
    parts = sorted(pairwise(way), key=lambda part: -math.dist(*part))
    for side in (1, -1):
        for start, end in parts:
            along = unit_vector(start, end)
            across = _flow_side(along)
            for share in (0.42, 0.5, 0.3, 0.6, 0.2, 0.75):
                x, y = (a + share * (b - a) for a, b in zip(start, end, strict=True))
                if abs(across[1]) > abs(across[0]):
                    yield Lettering(text, x, y + (12.5 if side > 0 else -7.5), "number", "middle")
                else:
                    yield Lettering(text, x + 6 * side, y + 3.5, "number", "start" if side > 0 else "end")


def _taken(shape: Shape) -> Rectangles:
    """Return the rectangles that a shape occupies."""
    match shape:
        case Polyline(points):
            parts = [sorted(axis) for a, b in pairwise(points) for axis in zip(a, b, strict=True)]
            return rectangles(
                (x[0] - 1, y[0] - 1, x[1] + 1, y[1] + 1) for x, y in zip(parts[::2], parts[1::2], strict=True)
            )
        case RoundedBox(left, top, width, height):
            return rectangles([(left, top, left + width, top + height)])
        case Lettering(text, x, y, look, anchor):
            return rectangles([text_rectangle(text, x, y, anchor, STYLES[look].size)])
    return NOTHING


def _mark(item: DiagramLine | DiagramNode) -> str:
    return "derivative" if item.derivative else "loop" if item.loop else ""


# ---------------------------------------------------------------- nodes


def _node(node: DiagramNode, number: int, layout: DiagramLayout) -> Group:
    x, y = layout.places[number]
    facts = {"name": node.name, "letter": node.letter}
    words = f"{node.letter} {node.name} ({node.place})"
    if node.shape == "box":
        box = layout.boxes[number]
        shapes: list[Shape] = [
            RoundedBox(box.left, box.top, box.right - box.left, box.bottom - box.top, "box", 6.0),
            Lettering(node.letter, box.title[0], box.title[1], "kind", "middle"),
            Lettering(node.label, box.title[0], box.title[1] + 15, "title", "middle"),
        ]
        return Group("node", tuple(shapes), facts, words, _mark(node))
    shapes = [Lettering(node.letter, x, y + 6.3, "letter", "middle")]
    if node.label:
        shapes.append(
            Lettering(layout.labels[number][0], *layout.labels[number][1:3], "name", layout.labels[number][3])
        )
    return Group("node", tuple(shapes), facts, words, _mark(node))


def _ports(model: DiagramModel, layout: DiagramLayout) -> Iterator[Group]:
    """Yield the names of ports, inside their boxes."""
    for number, line in enumerate(model.lines):
        for end, point in zip(line.ends, (layout.bonds[number][0], layout.bonds[number][-1]), strict=True):
            name = port_of(line, end)
            if end in layout.boxes and name:
                text, x, y, anchor = layout.boxes[end].port_text(name, *point)
                yield Group("port", (Lettering(text, x, y, "port", anchor),), {"node": model.nodes[end].name})


# ---------------------------------------------------------------- signals


def _signals(model: DiagramModel, layout: DiagramLayout) -> Iterator[Group]:
    for number, signal in enumerate(model.signals):
        if number not in layout.signals:
            continue
        way = layout.signals[number]
        target = model.nodes[signal.target].name
        source = "" if signal.source is None else model.nodes[signal.source].name
        shapes: list[Shape] = [Polyline(way, "signal"), _full_arrow(way)]
        if number in layout.texts:
            x, y = layout.texts[number]
            shapes.append(Lettering(signal.label, x, y + 4, "kind", "middle"))
        words = f"{signal.label or source} is read by {target}"
        yield Group("signal", tuple(shapes), {"source": source, "target": target, "names": signal.label}, words)


def _full_arrow(way: Sequence[Point]) -> Polyline:
    (x, y), (u, v) = way[-1], unit_vector(way[-2], way[-1])
    return Polyline(
        ((x, y), (x - 8 * u - 3 * v, y - 8 * v + 3 * u), (x - 8 * u + 3 * v, y - 8 * v - 3 * u)), "point", True
    )


# ---------------------------------------------------------------- legend


def _legend(model: DiagramModel, left: float, top: float) -> tuple[list[Group], float, float]:
    """Return one line for each colour in use, and omitted parts; with height and width."""
    marks = {*map(_mark, model.nodes), *map(_mark, model.lines)} - {""}
    groups, y, width = [], top, 0.0
    for mark in (m for m in MEANINGS if m in marks):
        sample = Polyline(((left, y - 4), (left + 22, y - 4)), "line")
        end = Polyline(((left + 22, y - 4 - STROKE), (left + 22, y - 4 + STROKE)), "stroke")
        groups.append(Group("legend", (sample, end, Lettering(MEANINGS[mark], left + 30, y, "note")), {}, "", mark))
        width = max(width, 30 + text_width(MEANINGS[mark], PORT))
        y += 20
    if model.left_out:
        omitted = f"not drawn, as they give nothing: {some_of(model.left_out, 3)}"
        groups.append(Group("legend", (Lettering(omitted, left, y, "note"),)))
        width = max(width, text_width(omitted, PORT))
        y += 20
    return groups, (y - top + 6) if groups else 0.0, width


def group_at(group: Group, dx: float, dy: float) -> Group:
    """Return the same group at another position."""
    return Group(group.kind, tuple(_at(s, dx, dy) for s in group.shapes), group.facts, group.words, group.mark)


def _at(shape: Shape, dx: float, dy: float) -> Shape:
    match shape:
        case Polyline(points, look, closed):
            return Polyline(tuple((x + dx, y + dy) for x, y in points), look, closed)
        case Circle((x, y), radius, look):
            return Circle((x + dx, y + dy), radius, look)
        case RoundedBox(left, top, width, height, look, rounding):
            return RoundedBox(left + dx, top + dy, width, height, look, rounding)
        case Lettering(text, x, y, look, anchor):
            return Lettering(text, x + dx, y + dy, look, anchor)
