"""Mechanism geometry: positions of bodies, joints and springs in the drawing's reference, and in another pose.

Points are in the plane of the picture, in m, y upwards; a mechanism in space is seen from the front, right and above.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from compiler.api import Element, Junction, Kind, Quantity, evaluate

if TYPE_CHECKING:
    from compiler.api import Body, BondGraph, Bound, Joint, Mechanism, MechanismNode

Point = tuple[float, float]
Vector = tuple[float, float, float]
Turn = tuple[float, float, float, float]  # a unit quaternion w, x, y, z
# Directions of the picture's right and up, for a mechanism in space.
RIGHT, UP = (math.cos(math.radians(25)), -math.sin(math.radians(25)), 0.0), (0.24, 0.33, 0.92)


@dataclass(frozen=True, slots=True)
class Pose:
    """Position of a body's centre, and its rotation from the reference."""

    place: Vector
    turn: Turn


@dataclass(frozen=True, slots=True)
class BodyGeometry:
    """A body: its centre and its points at joints and frames."""

    name: str
    centre: Point
    points: tuple[Point, ...]


@dataclass(frozen=True, slots=True)
class JointGeometry:
    """A joint: one point on each of the two bodies, and the direction of a slide."""

    name: str
    kind: str
    first: Point
    second: Point
    along: Point
    grounded: bool
    sprung: tuple[str, ...]  # springs at the joint


@dataclass(frozen=True, slots=True)
class MechanismGeometry:
    """Geometry of a mechanism for a picture."""

    name: str
    planar: bool
    limbs: tuple[BodyGeometry, ...]
    links: tuple[JointGeometry, ...]
    marks: tuple[tuple[str, Point], ...]  # frames


def mechanism_geometry_of(
    graph: BondGraph, node: MechanismNode, poses: Mapping[str, Pose] | None = None
) -> MechanismGeometry:
    """Return the bodies and joints in the reference, or in given poses (those of bodies by their names)."""
    mechanism = node.mechanism
    stage = _Stage(graph, mechanism, poses or {})
    joints = [j for j in mechanism.joints if j.kind not in ("gear", "rack")]
    ends = {j.name: stage.ends(j) for j in joints}
    held: dict[str, list[Point]] = {b.name: [] for b in mechanism.bodies}
    for joint in joints:
        for place, point in zip((joint.first, joint.second), ends[joint.name], strict=True):
            body = mechanism.body_of(place)
            if body in held and not stage.free_to_lie(joint):
                held[body].append(point)
    for frame in mechanism.frames:
        if frame.body in held:
            held[frame.body].append(stage.on(frame.body, stage.vector(frame.position)))
    limbs = tuple(_limb(stage, b, held[b.name]) for b in mechanism.bodies)
    springs = dict(springs_of(graph, node))
    links = []
    for joint in joints:
        first, second = ends[joint.name]
        if stage.free_to_lie(joint):
            first = second = _carried(
                next((x for x in limbs if x.name == mechanism.body_of(joint.second)), None), second
            )
        bodies = {mechanism.body_of(p) for p in (joint.first, joint.second)}
        along = stage.across(mechanism.body_of(joint.first), stage.vector(joint.axis))
        links.append(
            JointGeometry(joint.name, joint.kind, first, second, along, "ground" in bodies, springs.get(joint.name, ()))
        )
    marks = tuple((f.name, stage.on(f.body, stage.vector(f.position))) for f in mechanism.frames)
    return MechanismGeometry(node.name, mechanism.planar, limbs, tuple(links), marks)


def _limb(stage: _Stage, body: Body, held: Sequence[Point]) -> BodyGeometry:
    """Return a body; if the position of its centre is not given (the origin then), it is drawn at its joints."""
    place = stage.vector(body.position)
    centre = stage.on(body.name, place)
    if place == (0.0, 0.0, 0.0) and len(held) == 1:
        centre = held[0]
    return BodyGeometry(body.name, centre, tuple(held))


def _carried(limb: BodyGeometry | None, otherwise: Point) -> Point:
    """Return the position of a slide without given position: the mean of its body's other joint points, else its centre."""
    if limb is None:
        return otherwise
    around = limb.points or (limb.centre,)
    return sum(p[0] for p in around) / len(around), sum(p[1] for p in around) / len(around)


def springs_of(graph: BondGraph, node: MechanismNode) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield each joint with the springs at its ports, directly or over junctions of one flow."""
    number = graph.nodes.index(node)
    found: dict[str, list[str]] = {}
    for bond in graph.incident[number]:
        ends = graph.bonds[bond]
        here, there = (ends.tail, ends.head) if ends.tail.node == number else (ends.head, ends.tail)
        joint = node.ports[here.port].name.rpartition(".")[0]
        waiting, seen = [there.node], {number}
        while waiting:
            place = waiting.pop()
            seen.add(place)
            other = graph.nodes[place]
            if isinstance(other, Element) and other.kind is Kind.CAPACITOR:
                found.setdefault(joint, []).append(other.name)
            if isinstance(other, Junction) and other.kind is Kind.ONE:
                around = [e.node for b in graph.incident[place] for e in (graph.bonds[b].tail, graph.bonds[b].head)]
                waiting += [n for n in around if n not in seen]
    yield from ((joint, tuple(dict.fromkeys(names))) for joint, names in found.items())


def numbers_of(graph: BondGraph, bounds: Sequence[Bound]) -> Vector:
    """Return three numbers from the text; numbers unknown before a run count as zero."""

    def value(key: object) -> float:
        if isinstance(key, float):
            return key
        named = graph.quantities.get(key.name) if isinstance(key, Quantity) else None
        return 0.0 if named is None or named.value is None else named.value

    x, y, z = (evaluate(b.expression, value) for b in bounds)
    return x, y, z


@dataclass(frozen=True, slots=True)
class _Stage:
    """Numbers of a mechanism, and the poses of its bodies."""

    graph: BondGraph
    mechanism: Mechanism
    poses: Mapping[str, Pose]

    def vector(self, bounds: Sequence[Bound]) -> Vector:
        """Return three numbers from the text."""
        return numbers_of(self.graph, bounds)

    def on(self, body: str, point: Vector) -> Point:
        """Return the position of a point of a body in the picture, from its position in the reference."""
        pose = self.poses.get(body)
        if pose is not None:
            centre = self.vector(self.mechanism.point_of(body))
            x, y, z = turned(pose.turn, (point[0] - centre[0], point[1] - centre[1], point[2] - centre[2]))
            point = (pose.place[0] + x, pose.place[1] + y, pose.place[2] + z)
        return self.seen(point)

    def across(self, body: str, axis: Vector) -> Point:
        """Return a direction fixed to a body, as projected into the picture, of length 1 (or 0, seen from its end)."""
        pose = self.poses.get(body)
        x, y = self.seen(turned(pose.turn, axis) if pose is not None else axis)
        length = math.hypot(x, y)
        return (x / length, y / length) if length > 1e-9 else (0.0, 0.0)

    def seen(self, point: Vector) -> Point:
        """Return the picture's coordinates of a point."""
        if self.mechanism.planar:
            return point[0], point[1]
        return sum(a * b for a, b in zip(point, RIGHT, strict=True)), sum(a * b for a, b in zip(point, UP, strict=True))

    def ends(self, joint: Joint) -> tuple[Point, Point]:
        """Return the points at which a joint holds its first and its second body."""
        names = (joint.first, joint.second)
        bodies = [self.mechanism.body_of(n) for n in names]
        if joint.kind in ("distance", "rod"):
            points = [self.vector(self.mechanism.point_of(n)) for n in names]
        else:
            points = [self.vector(joint.position)] * 2
        first, second = (self.on(b, p) for b, p in zip(bodies, points, strict=True))
        return first, second

    def free_to_lie(self, joint: Joint) -> bool:
        """Return True if the position of a joint has no meaning: a slide, or a planar joint, without given position."""
        kind, at = joint.kind, self.vector(joint.position)
        return kind in ("slide", "planar") and at == (0.0, 0.0, 0.0)


def turned(turn: Turn, point: Vector) -> Vector:
    """Return a vector rotated by a unit quaternion."""
    w, x, y, z = turn
    a, b, c = point
    tx, ty, tz = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx
