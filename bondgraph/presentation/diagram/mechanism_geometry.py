"""Mechanism geometry: positions of bodies, joints and springs in the drawing's reference, and in another pose.

Points are in the plane of the picture, in m, y upwards; a mechanism in space is seen from the front, right and above.

Most models have no poses as outputs. So for the poses of a run or an analysis the model is written flat, as the experiment sets it, with its poses as outputs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from compiler.api import BondGraph, Bound, Element, Joint, Junction, Kind, MechanismNode, Scene, write_text

from ...compiled_model import CompiledModel, source_of
from .body_shapes import BALL, BodyShape, outlines_of, shape_of
from .vectors import ORIGIN, Turn, Vector, circle, number_of, numbers_of, quaternion, turned

Point = tuple[float, float]
# Directions of the picture's right and up, for a mechanism in space.
RIGHT, UP = (math.cos(math.radians(25)), -math.sin(math.radians(25)), 0.0), (0.24, 0.33, 0.92)
PLANE, SPACE = ("x", "y", "phi"), ("x", "y", "z", "attitude.w", "attitude.x", "attitude.y", "attitude.z")


@dataclass(frozen=True, slots=True)
class Pose:
    """Position of a body's centre, and its rotation from the reference."""

    place: Vector
    turn: Turn


@dataclass(frozen=True, slots=True)
class ReferenceBody:
    """A body in the reference: its position, the centre of the drawing, its points at joints and frames, its rotation vector, lines on it.

    `shape`: the one that the text gives, with its lines; `colour`: empty if the text gives none.
    """

    name: str
    place: Vector
    centre: Vector
    points: tuple[Vector, ...]
    turn: Vector
    outlines: tuple[tuple[Vector, ...], ...]
    shape: BodyShape | None
    edges: tuple[tuple[Vector, ...], ...]
    colour: str


@dataclass(frozen=True, slots=True)
class ReferenceJoint:
    """A joint in the reference: its axis, and one point on each of its two bodies (or the ground). `sprung`: springs at the joint."""

    name: str
    kind: str
    axis: Vector
    axis_of: str
    ends: tuple[tuple[str, Vector], tuple[str, Vector]]
    grounded: bool
    sprung: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ReferenceMechanism:
    """A mechanism in the reference: bodies, joints, and frames as name, body and point; all in m, in world axes."""

    name: str
    planar: bool
    bodies: tuple[ReferenceBody, ...]
    joints: tuple[ReferenceJoint, ...]
    frames: tuple[tuple[str, str, Vector], ...]


@dataclass(frozen=True, slots=True)
class BodyGeometry:
    """A body: its centre, its points at joints and frames, lines on it, and the edges and the colour of the shape that the text gives."""

    name: str
    centre: Point
    points: tuple[Point, ...]
    outlines: tuple[tuple[Point, ...], ...]
    edges: tuple[tuple[Point, ...], ...]
    colour: str
    radius: float = 0.0  # of a ball (m)


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


def reference_of(graph: BondGraph, node: MechanismNode) -> ReferenceMechanism:
    """Return the bodies and joints of a mechanism as drawn by its author.

    A body whose centre has no given position (the origin then) is drawn at its joint, a slide without position at the mean of its body's other points.
    """
    mechanism = node.mechanism

    def vector(bounds: Sequence[Bound]) -> Vector:
        return numbers_of(graph, bounds)

    def ends_of(joint: Joint) -> list[tuple[str, Vector]]:
        names = (joint.first, joint.second)
        apart = joint.kind in ("distance", "rod")
        return [(mechanism.body_of(n), vector(mechanism.point_of(n) if apart else joint.position)) for n in names]

    joints = [j for j in mechanism.joints if j.kind not in ("gear", "rack")]
    floating = {j.name for j in joints if j.kind in ("slide", "planar") and vector(j.position) == ORIGIN}
    points: dict[str, list[Vector]] = {b.name: [] for b in mechanism.bodies}
    fixed = [end for j in joints if j.name not in floating for end in ends_of(j)]
    for body, point in (*fixed, *((f.body, vector(f.position)) for f in mechanism.frames)):
        if body in points:
            points[body].append(point)
    springs = dict(springs_of(graph, node))
    bodies, links = [], []
    for item in mechanism.bodies:
        place, held = vector(item.position), tuple(points[item.name])
        centre = held[0] if place == ORIGIN and len(held) == 1 else place
        rims = [rim_of(graph, j) for j in joints if j.kind == "wheel" and mechanism.body_of(j.second) == item.name]
        outlines = tuple(line for rim in rims for line in rim)
        shape = shape_of(graph, item, mechanism.planar)
        edges = () if shape is None else outlines_of(shape, place, mechanism.planar)
        bodies.append(
            ReferenceBody(
                item.name, place, centre, held, vector(item.turn), outlines, shape, edges, item.appearance.colour
            )
        )
    for joint in joints:
        first, second = ends_of(joint)
        if joint.name in floating:
            around = points.get(second[0]) or [vector(mechanism.point_of(second[0]))]
            x, y, z = (sum(p[i] for p in around) / len(around) for i in range(3))
            first = second = (second[0], (x, y, z))
        held_by = [mechanism.body_of(n) for n in (joint.first, joint.second)]
        axis_of = held_by[joint.kind == "skate"]  # a blade is fixed to the second body
        links.append(
            ReferenceJoint(
                joint.name, joint.kind, vector(joint.axis), axis_of, (first, second), "ground" in held_by, springs.get(joint.name, ())
            )
        )  # fmt: skip
    frames = tuple((f.name, f.body, vector(f.position)) for f in mechanism.frames)
    return ReferenceMechanism(node.name, mechanism.planar, tuple(bodies), tuple(links), frames)


def mechanism_geometry_of(graph: BondGraph, node: MechanismNode, posed: Sequence[Pose] = ()) -> MechanismGeometry:
    """Return the bodies and joints in the plane of the picture: in the reference, or with all bodies in given poses."""
    mechanism = reference_of(graph, node)
    poses = {body.name: pose for body, pose in zip(mechanism.bodies, posed, strict=False)}
    places = {body.name: body.place for body in mechanism.bodies}

    def projected(point: Vector) -> Point:
        if mechanism.planar:
            return point[0], point[1]
        return sum(a * b for a, b in zip(point, RIGHT, strict=True)), sum(a * b for a, b in zip(point, UP, strict=True))

    def seen(body: str, point: Vector) -> Point:
        if (pose := poses.get(body)) is not None:
            (a, b, c), (x0, y0, z0) = places[body], point
            x, y, z = turned(pose.turn, (x0 - a, y0 - b, z0 - c))
            point = (pose.place[0] + x, pose.place[1] + y, pose.place[2] + z)
        return projected(point)

    def direction(body: str, axis: Vector) -> Point:
        """Return a direction fixed to a body, of length 1 (or 0, seen from its end)."""
        x, y = projected(turned(poses[body].turn, axis) if body in poses else axis)
        length = math.hypot(x, y)
        return (x / length, y / length) if length > 1e-9 else (0.0, 0.0)

    limbs = tuple(
        BodyGeometry(
            b.name,
            seen(b.name, b.centre),
            tuple(seen(b.name, p) for p in b.points),
            tuple(tuple(seen(b.name, p) for p in line) for line in b.outlines),
            tuple(tuple(seen(b.name, p) for p in line) for line in b.edges),
            b.colour,
            math.hypot(*b.shape.axes[0]) if b.shape is not None and b.shape.around == BALL else 0.0,
        )
        for b in mechanism.bodies
    )
    links = tuple(
        JointGeometry(j.name, j.kind, seen(*j.ends[0]), seen(*j.ends[1]), direction(j.axis_of, j.axis), j.grounded, j.sprung)
        for j in mechanism.joints
    )  # fmt: skip
    marks = tuple((name, seen(body, point)) for name, body, point in mechanism.frames)
    return MechanismGeometry(mechanism.name, mechanism.planar, limbs, links, marks)


def rim_of(graph: BondGraph, joint: Joint) -> list[tuple[Vector, ...]]:
    """Return the rim of a wheel with a spoke, of a sphere two circles; points in the reference."""
    radius, axle = number_of(graph, joint.ratio), numbers_of(graph, joint.axis)
    axles = [(0.0, 0.0, 1.0)] if joint.planar else [axle] if any(axle) else [(0.0, 0.0, 1.0), (0.0, 1.0, 0.0)]
    centre = numbers_of(graph, joint.position)
    return [(centre, *circle(centre, axle, radius)) for axle in axles]


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


@dataclass(frozen=True, slots=True)
class PosedModel:
    """A model written flat. `names`: the poses of all bodies, as outputs."""

    model: CompiledModel
    graph: BondGraph
    names: tuple[str, ...]

    def poses(self, node: MechanismNode, values: Mapping[str, float]) -> list[Pose]:
        """Return the poses of the bodies of a mechanism of the graph, from the values of their components."""
        numbers = [values[name] for name in pose_parts(node)]
        size = len(PLANE if node.mechanism.planar else SPACE)
        return [
            _pose(numbers_of(self.graph, body.turn), numbers[size * i : size * (i + 1)])
            for i, body in enumerate(node.mechanism.bodies)
        ]


def posed_model(model: CompiledModel, experiment: str | None) -> PosedModel:
    """Return the model as an experiment sets it. Raises `CompilationFailed`."""
    flat = CompiledModel(source_of(write_text(model.compilation(Scene(model.model, experiment)).whole_graph)))
    graph = flat.compilation().whole_graph
    return PosedModel(flat, graph, tuple(name for node in mechanisms_of(graph) for name in pose_parts(node)))


def mechanisms_of(graph: BondGraph) -> list[MechanismNode]:
    """Return the mechanisms in the order of the text."""
    return [node for node in graph.nodes if isinstance(node, MechanismNode)]


def pose_parts(node: MechanismNode) -> dict[str, str]:
    """Return the names of the components of the poses of all bodies, each with its part: x, phi, attitude.w and so on."""
    parts = PLANE if node.mechanism.planar else SPACE
    return {f"{node.name}.{body.name}.{part}": part for body in node.mechanism.bodies for part in parts}


def _pose(reference: Vector, values: list[float]) -> Pose:
    """Return the pose from the values of a body: they are absolute, and a picture rotates the body from its reference."""
    w, *axis = quaternion(reference)
    now: Sequence[float]
    if len(values) == len(PLANE):
        x, y, phi = values
        place, now = (x, y, 0.0), quaternion((0.0, 0.0, phi))
    else:
        length = math.hypot(*values[3:])
        x, y, z, *attitude = values
        place, now = (x, y, z), tuple(v / length for v in attitude)
    return Pose(place, _after(now, (w, *(-v for v in axis))))


def _after(p: Sequence[float], q: Sequence[float]) -> Turn:
    """Return the rotation p after the rotation q."""
    a, b, c, d = p
    w, x, y, z = q
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )
