"""Dashed frames around the parts of an instance, where no other part lies in between; inside them names are short."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from .diagram_model import DiagramModel
from .glyphs import PORT, text_rectangle, text_width
from .overlap import NOTHING, Rectangles, bounds, joined, lane, rectangles, touches
from .place import DiagramLayout, node_rectangles, place

PADDING, TITLE = 6.0, 15.0


@dataclass(frozen=True, slots=True)
class Framed:
    """Frame around an instance, and the position of its name: x and y of the baseline's start."""

    instance: str
    left: float
    top: float
    right: float
    bottom: float
    title: tuple[float, float]


def place_framed(model: DiagramModel) -> tuple[DiagramModel, DiagramLayout, tuple[Framed, ...]]:
    """Return the layout with short names in frames if all instances that can have frames keep them; else with full names."""
    layout = place(model)
    sizes = {name: sum(node.inside == name for node in model.nodes) for name in model.instances}
    several = frozenset(name for name, size in sizes.items() if size > 1)
    short = frozenset(f.instance for f in _whole_rows(_frames(model, layout, several), several))
    if not short:
        return model, layout, ()
    named = _named(model, short)
    shorter = place(named)
    frames = _whole_rows(_frames(named, shorter, short), short)
    if {f.instance for f in frames} == short:
        return named, shorter, frames
    return model, layout, tuple(f for f in _frames(model, layout, short) if f.instance in short)


def _whole_rows(frames: Iterator[Framed], instances: Collection[str]) -> tuple[Framed, ...]:
    """Return the frames without those of instance arrays in which some instances have none."""
    found = tuple(frames)
    having = {f.instance for f in found}
    lacking = {name.partition("[")[0] for name in instances if name not in having}
    return tuple(f for f in found if f.instance.partition("[")[0] not in lacking)


def _named(model: DiagramModel, short: Collection[str]) -> DiagramModel:
    """Return the model with names that do not repeat the name of the frame around them."""
    nodes = (
        replace(n, label=n.label.removeprefix(f"{n.inside}.")) if n.inside in short and n.shape != "box" else n
        for n in model.nodes
    )
    signals = []
    for signal in model.signals:
        inside = model.nodes[signal.target].inside
        strip = signal.source is None and inside in short
        signals.append(replace(signal, label=signal.label.replace(f"{inside}.", "")) if strip else signal)
    return replace(model, nodes=tuple(nodes), signals=tuple(signals))


def _frames(model: DiagramModel, layout: DiagramLayout, instances: Collection[str]) -> Iterator[Framed]:
    things = _things(model, layout)
    taken: Rectangles = NOTHING
    for instance in model.instances:
        if instance not in instances:
            continue
        own = joined(NOTHING, *(r for home, r in things if home == instance))
        others = joined(taken, *(r for home, r in things if home != instance))
        left, top, right, bottom = bounds(own)
        frame = (left - PADDING, top - PADDING, right + PADDING, bottom + PADDING)
        if touches(others, rectangles([frame]), 1.0):
            continue
        through = joined(
            NOTHING, *(r for home, r in things if home in (instance, "")), *_crossing(model, layout, instance)
        )
        title = _title(instance, frame, through, others)
        if title is not None:
            frame = (frame[0], min(frame[1], title[1] - TITLE), max(frame[2], title[2]), max(frame[3], title[3]))
            taken = joined(taken, rectangles([frame]))
            yield Framed(instance, *frame, (title[0], title[1]))


def _title(
    instance: str, frame: tuple[float, float, float, float], inside: Rectangles, others: Rectangles
) -> tuple[float, float, float, float] | None:
    """Return a position for the name of a frame, in a corner or in a strip above, and its extent to the right and down; None if there is no room."""
    left, top, right, bottom = frame
    width = text_width(instance, PORT)
    spots = [
        (left + 5, top + 12),
        (right - width - 5, top + 12),
        (left + 5, bottom - 5),
        (right - width - 5, bottom - 5),
        (left + 5, top - 3),
    ]
    for x, y in spots:
        area = rectangles([text_rectangle(instance, x, y, "start", PORT)])
        wide = rectangles([(min(left, x - 5), min(top, y - TITLE + 2), max(right, x + width + 5), bottom)])
        if not touches(inside, area, 2.0) and not touches(others, wide, 1.0):
            return x, y, max(right, x + width + 5), bottom
    return None


def _things(model: DiagramModel, layout: DiagramLayout) -> list[tuple[str, Rectangles]]:
    """Return all placed parts with their instance: nodes with their names, bonds and signals between them."""
    found = []
    for number, node in enumerate(model.nodes):
        home = node.inside if node.shape != "box" or node.inside else "\0"
        found.append((home, rectangles(node_rectangles(node, number, layout))))
    for number, line in enumerate(model.lines):
        homes = {model.nodes[n].inside for n in line.ends}
        if len(homes) == 1:
            found.append((homes.pop() or "\0", _way(layout.bonds[number])))
    for number, way in layout.signals.items():
        signal = model.signals[number]
        home = model.nodes[signal.target].inside
        if signal.source is None:
            x, y = layout.texts[number]
            label = rectangles([text_rectangle(signal.label, x, y + 4, "middle")])
            found.append((home or "\0", joined(_way(way), label)))
        elif model.nodes[signal.source].inside == home:
            found.append((home or "\0", _way(way)))
    return found


def _crossing(model: DiagramModel, layout: DiagramLayout, instance: str) -> Iterator[Rectangles]:
    """Yield the bonds and signals across the border of a frame: its name must not cover them."""
    for number, line in enumerate(model.lines):
        if sum(model.nodes[n].inside == instance for n in line.ends) == 1:
            yield _way(layout.bonds[number])
    for number, way in layout.signals.items():
        signal = model.signals[number]
        ends = [n for n in (signal.source, signal.target) if n is not None]
        if sum(model.nodes[n].inside == instance for n in ends) == 1:
            yield _way(way)


def _way(way: Sequence[tuple[float, float]]) -> Rectangles:
    return joined(NOTHING, *(lane(a, b, 7.0) for a, b in pairwise(way)))
