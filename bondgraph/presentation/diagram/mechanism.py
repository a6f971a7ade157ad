"""Picture of a mechanism: bodies as plates and bars, joints by the signs of kinematics, springs at their joints, the ground hatched."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import chain, pairwise

from .compose import group_at
from .figure import Circle, Figure, Group, Lettering, Polyline, Shape
from .glyphs import PORT, text_rectangle
from .mechanism_geometry import BodyGeometry, JointGeometry, MechanismGeometry
from .overlap import NOTHING, Point, Rectangles, bounds, joined, lane, rectangles, touches, unit_vector

SIZE = 520.0  # longer side of the drawing, px
BORDER = 34.0
HINGE, MASS = 5.0, 6.0  # radii
BAR = 7.0  # half the width of a bar
BLADE = 18.0  # half the length of a skate
NEAR = 1.5  # px: the same point


def draw_mechanism(geometry: MechanismGeometry, heading: str = "", behind: MechanismGeometry | None = None) -> Figure:
    """Return the figure of a mechanism in one pose; `behind`: the same in another pose, drawn as outlines."""
    page = _Page(geometry, behind)
    groups = [] if behind is None else [page.shadow(limb) for limb in behind.limbs]
    groups += [*map(page.limb, geometry.limbs), *map(page.link, geometry.links), *map(page.mark, geometry.marks)]
    groups += [*_names(geometry, page, groups)]
    boxes = [_extent(s) for g in groups for s in g.shapes]
    if heading:
        note = Lettering(heading, min(b[0] for b in boxes), max(b[3] for b in boxes) + 22, "note")
        groups.append(Group("legend", (note,)))
        boxes.append(_extent(note))
    left, top, right, bottom = bounds(rectangles(boxes))
    moved = tuple(group_at(g, -round(left - 12, 1), -round(top - 12, 1)) for g in groups)
    width, height = math.ceil(right + 12 - (left - 12)), math.ceil(bottom + 12 - (top - 12))
    return Figure(width, height, f"mechanism {geometry.name}", moved)


class _Page:
    """Scale of a picture, and the signs at that scale."""

    def __init__(self, geometry: MechanismGeometry, behind: MechanismGeometry | None = None) -> None:
        both = [s for s in (geometry, behind) if s is not None]
        points = [
            p
            for s in both
            for limb in s.limbs
            for p in (limb.centre, *limb.points, *chain(*limb.outlines, *limb.edges))
        ]
        points += [p for s in both for link in s.links for p in (link.first, link.second)] or [(0.0, 0.0)]
        xs, ys = [p[0] for p in points], [p[1] for p in points]
        span = max(max(xs) - min(xs), max(ys) - min(ys))
        self.scale = SIZE / span if span > 0 else 1.0
        self.origin = (min(xs), max(ys))

    def at(self, point: Point) -> Point:
        """Return the position of a point of the mechanism on the page."""
        return (point[0] - self.origin[0]) * self.scale, (self.origin[1] - point[1]) * self.scale

    def limb(self, limb: BodyGeometry) -> Group:
        """Return a body: a plate through its joint points, a bar for two points, and the sign of its centre of mass."""
        lines = (Polyline(tuple(map(self.at, line)), "line") for line in limb.outlines)
        shapes = (*self.figure(limb), *lines, *_mass(self.at(limb.centre)))
        return Group("limb", shapes, {"name": limb.name}, f"body {limb.name}")

    def figure(self, limb: BodyGeometry) -> Iterator[Shape]:
        """Yield the shape that the text gives, seen from the front, or a plate through the joint points."""
        look = limb.colour or "body"
        if not limb.edges:
            yield self.plate(limb, look)
            return
        if limb.radius:
            yield Circle(self.at(limb.centre), limb.radius * self.scale, look)
        else:
            yield Polyline(tuple(_hull([self.at(point) for line in limb.edges for point in line])), look, True)
        if len(limb.edges) > 1:
            yield from (Polyline(tuple(map(self.at, line)), "edge") for line in limb.edges)

    def shadow(self, limb: BodyGeometry) -> Group:
        """Return a body in another pose, as an outline."""
        return Group("shadow", (self.plate(limb, "frame"),), {"name": limb.name}, f"body {limb.name} at rest")

    def plate(self, limb: BodyGeometry, look: str) -> Shape:
        """Return the shape of a body."""
        centre = self.at(limb.centre)
        points = _distinct([*_distinct([self.at(p) for p in limb.points]), centre])
        if len(points) > 1:
            return Polyline(tuple(_round(_hull(points))), look, True)
        return Circle(centre, 2 * BAR, look)

    def mark(self, mark: tuple[str, Point]) -> Group:
        """Return the sign of a frame: a small cross."""
        name, (x, y) = mark[0], self.at(mark[1])
        cross = (Polyline(((x - 4, y), (x + 4, y)), "line"), Polyline(((x, y - 4), (x, y + 4)), "line"))
        return Group("frame", cross, {"name": name}, f"frame {name}")

    def link(self, link: JointGeometry) -> Group:
        """Return the sign of a joint, with its springs beside it."""
        first, second = self.at(link.first), self.at(link.second)
        along = (link.along[0], -link.along[1])
        shapes = list(_sign(link, first, second, along))
        words = f"{link.kind} {link.name}" + (f", with {', '.join(link.sprung)}" if link.sprung else "")
        return Group("link", tuple(shapes), {"name": link.name, "kind": link.kind}, words)


def _sign(link: JointGeometry, first: Point, second: Point, along: Point) -> Iterator[Shape]:
    if link.kind in ("distance", "rod"):
        if link.sprung:
            yield _coil(first, second)
        else:
            yield Polyline((first, second), "line" if link.kind == "rod" else "measure")
        yield from (Circle(p, 3.0, "pin") for p in (first, second))
        return
    if link.kind in ("slide", "cylinder", "screw"):
        yield from _slide(first, second, along, link)
        return
    if link.kind in ("free", "planar"):
        if math.dist(first, second) > NEAR:
            yield _coil(first, second) if link.sprung else Polyline((first, second), "measure")
        yield from (Circle(p, 3.0, "pin") for p in _distinct([first, second]))
        if link.sprung and math.dist(first, second) <= NEAR:
            yield _coil((first[0] - 15, first[1]), (first[0] + 15, first[1]))
        return
    if link.kind in ("wheel", "skate"):
        (x, y), (u, v) = second, along
        if link.kind == "skate":
            yield Polyline(((x - BLADE * u, y - BLADE * v), (x + BLADE * u, y + BLADE * v)), "line")
        yield Circle(second, 3.0, "pin")
        return
    if link.grounded:
        yield from _ground(first)
    if link.kind == "weld":
        x, y = second
        yield Polyline(((x - 4, y - 4), (x + 4, y - 4), (x + 4, y + 4), (x - 4, y + 4)), "solid", True)
        return
    if link.sprung:
        yield Polyline(tuple(_spiral(second)), "line")
    if link.kind == "universal":
        yield Circle(second, HINGE + 3, "pin")
    yield Circle(second, HINGE, "solid" if link.kind == "ball" else "pin")


def _ground(point: Point) -> Iterator[Shape]:
    """Yield a stand with hatching below a joint."""
    x, y = point
    yield Polyline(((x, y), (x - 9, y + 16), (x + 9, y + 16)), "stand", True)
    yield from _hatch((x - 14, y + 16), (x + 14, y + 16))


def _hatch(start: Point, end: Point) -> Iterator[Shape]:
    """Yield a line with strokes for the ground, on its right going from start to end."""
    yield Polyline((start, end), "line")
    u, v = unit_vector(start, end)
    for i in range(int(math.dist(start, end) // 6) + 1):
        x, y = start[0] + 6 * i * u, start[1] + 6 * i * v
        yield Polyline(((x, y), (x - 5 * u - 5 * v, y - 5 * v + 5 * u)), "hatch")


def _slide(first: Point, second: Point, along: Point, link: JointGeometry) -> Iterator[Shape]:
    """Yield a block on a rail along its axis; the rail is hatched if it is the ground."""
    u, v = along if along != (0.0, 0.0) else (1.0, 0.0)
    x, y = second
    across = (-v, u) if u > 0 or (u == 0 and v > 0) else (v, -u)  # downwards on the page
    half = max(26.0, abs((second[0] - first[0]) * u + (second[1] - first[1]) * v) + 20)
    base = (x + 8 * across[0], y + 8 * across[1])
    ends = ((base[0] - half * u, base[1] - half * v), (base[0] + half * u, base[1] + half * v))
    if link.grounded:
        yield from _hatch(*(ends if across == (-v, u) else ends[::-1]))
    else:
        yield Polyline(ends, "line")
    corners = [
        (x + a * 11 * u + b * 7 * across[0], y + a * 11 * v + b * 7 * across[1])
        for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    yield Polyline(tuple(corners), "pin", True)
    if link.kind != "slide":
        yield Circle(second, 3.5, "pin")
    if link.sprung:
        wall = (x - (half + 16) * u, y - (half + 16) * v)
        yield _coil((x - 11 * u, y - 11 * v), wall)
        yield Polyline(((wall[0] - 7 * v, wall[1] + 7 * u), (wall[0] + 7 * v, wall[1] - 7 * u)), "line")


def _coil(start: Point, end: Point) -> Polyline:
    """Return a spring as a zigzag."""
    length, (u, v) = math.dist(start, end), unit_vector(start, end)
    lead, turns = min(8.0, length / 6), max(3, min(8, round(length / 11)))
    points = [start, (start[0] + lead * u, start[1] + lead * v)]
    for i in range(2 * turns):
        way, side = lead + (i + 0.5) * (length - 2 * lead) / (2 * turns), 5.0 * (1 if i % 2 else -1)
        points.append((start[0] + way * u - side * v, start[1] + way * v + side * u))
    return Polyline((*points, (end[0] - lead * u, end[1] - lead * v), end), "spring")


def _spiral(middle: Point) -> Iterator[Point]:
    """Yield the points of a torsion spring around a hinge."""
    for i in range(41):
        angle, radius = 2 * math.pi * 2 * i / 40, HINGE + 3 + 8 * i / 40
        yield middle[0] + radius * math.cos(angle), middle[1] - radius * math.sin(angle)


def _mass(centre: Point) -> Iterator[Shape]:
    """Yield the sign of a centre of mass: a circle with two filled quarters."""
    x, y = centre
    yield Circle(centre, MASS, "pin")
    for turn in (0.0, math.pi):
        arc = [
            (x + MASS * math.cos(turn + i * math.pi / 16), y + MASS * math.sin(turn + i * math.pi / 16))
            for i in range(9)
        ]
        yield Polyline((centre, *arc), "solid", True)


# ---------------------------------------------------------------- shapes


def _distinct(points: Sequence[Point]) -> list[Point]:
    kept: list[Point] = []
    for point in points:
        if all(math.dist(point, other) > NEAR for other in kept):
            kept.append(point)
    return kept


def _hull(points: Sequence[Point]) -> list[Point]:
    """Return the corners of the convex hull of some points (Andrew's monotone chain)."""
    ordered = sorted(points)

    def half(items: Sequence[Point]) -> list[Point]:
        chain: list[Point] = []
        for p in items:
            while len(chain) > 1 and _left_turn(chain[-2], chain[-1], p) <= 1e-9:
                chain.pop()
            chain.append(p)
        return chain[:-1]

    return half(ordered) + half(ordered[::-1])


def _left_turn(a: Point, b: Point, c: Point) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _round(hull: Sequence[Point]) -> Iterator[Point]:
    """Yield the points of the shape widened by half a bar, with round corners."""
    count = len(hull)
    for i, (x, y) in enumerate(hull):
        before, after = hull[i - 1], hull[(i + 1) % count]
        start = math.atan2(y - before[1], x - before[0]) - math.pi / 2
        turn = (math.atan2(after[1] - y, after[0] - x) - math.pi / 2 - start) % (2 * math.pi)
        steps = max(2, round(turn / 0.25))
        for k in range(steps + 1):
            angle = start + turn * k / steps
            yield x + BAR * math.cos(angle), y + BAR * math.sin(angle)


def _extent(shape: Shape) -> tuple[float, float, float, float]:
    match shape:
        case Polyline(points):
            xs, ys = [p[0] for p in points], [p[1] for p in points]
            return min(xs), min(ys), max(xs), max(ys)
        case Circle((x, y), radius):
            return x - radius, y - radius, x + radius, y + radius
        case Lettering(text, x, y, _, anchor):
            return text_rectangle(text, x, y, anchor, PORT)
    raise AssertionError(shape)


# ---------------------------------------------------------------- names


def _names(geometry: MechanismGeometry, page: _Page, groups: Sequence[Group]) -> Iterator[Group]:
    """Yield the name of each body, joint and frame near it, at the position that covers least."""
    taken = joined(NOTHING, *(_outline(s) for g in groups for s in g.shapes))
    wanted = [(b.name, page.at(b.centre), "name") for b in geometry.limbs]
    wanted += [(k.name, _halfway(page.at(k.first), page.at(k.second)), "port") for k in geometry.links]
    wanted += [(name, page.at(point), "port") for name, point in geometry.marks]
    for name, point, look in wanted:
        spots = list(_spots(name, point, look))
        areas = [rectangles([text_rectangle(t.text, t.x, t.y, t.anchor)]) for t in spots]
        best = next((i for i, area in enumerate(areas) if not touches(taken, area, 0.5)), None)
        if best is None:
            continue  # no room: the pointer shows the name
        taken = joined(taken, areas[best])
        yield Group("label", (spots[best],), {"name": name})


def _outline(shape: Shape) -> Rectangles:
    """Return the rectangles that no name may cover: lines, and the inside of small shapes."""
    if isinstance(shape, Polyline) and shape.look != "solid":
        corners = (*shape.points, shape.points[0]) if shape.closed else shape.points
        return joined(NOTHING, *(lane(a, b, 1.5) for a, b in pairwise(corners) if a != b))
    return rectangles([_extent(shape)])


def _halfway(a: Point, b: Point) -> Point:
    return (a[0] + b[0]) / 2, (a[1] + b[1]) / 2


def _spots(name: str, point: Point, look: str) -> Iterator[Lettering]:
    x, y = point
    for far in (11.0, 16.0, 24.0, 34.0, 46.0):
        yield Lettering(name, x + far, y - far * 0.5, look)
        yield Lettering(name, x - far, y - far * 0.5, look, "end")
        yield Lettering(name, x + far, y + far * 0.5 + 8, look)
        yield Lettering(name, x - far, y + far * 0.5 + 8, look, "end")
        yield Lettering(name, x, y - far, look, "middle")
        yield Lettering(name, x, y + far + 8, look, "middle")
