"""Mechanisms of an animated page: points fixed to bodies in the reference, and the names of the poses that a run reports.

The page rotates points with their bodies, as `diagram/mechanism_geometry.py` does for a picture, and draws them again at each instant.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from compiler.api import MechanismNode

from ..diagram.mechanism_geometry import RIGHT, UP, Vector, numbers_of, springs_of
from ..diagram.poses import PLANE, SPACE, quaternion

if TYPE_CHECKING:
    from compiler.api import BondGraph, Bound, Joint, Mechanism

NOWHERE = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Scenes:
    """Mechanisms of a page: `told` has their data; `names` has the poses, body by body in the order of the data."""

    told: tuple[dict[str, Any], ...]
    names: tuple[str, ...]


def scenes_of(graph: BondGraph) -> Scenes:
    """Return all mechanisms of a model."""
    told: list[dict[str, Any]] = []
    names: list[str] = []
    for node in graph.nodes:
        if isinstance(node, MechanismNode) and node.mechanism.bodies:
            told.append({**_Points(graph, node).told(), "first": len(names)})
            parts = PLANE if node.mechanism.planar else SPACE
            names += [f"{node.name}.{body.name}.{part}" for body in node.mechanism.bodies for part in parts]
    return Scenes(tuple(told), tuple(names))


class _Points:
    """A mechanism in the reference: points of bodies at joints and frames."""

    def __init__(self, graph: BondGraph, node: MechanismNode) -> None:
        self.graph, self.node = graph, node
        self.mechanism: Mechanism = node.mechanism
        self.bodies = [b.name for b in self.mechanism.bodies]
        self.joints = [j for j in self.mechanism.joints if j.kind not in ("gear", "rack")]
        self.held: dict[str, list[Vector]] = {name: [] for name in self.bodies}
        for joint in self.joints:
            for body, point in self._ends(joint):
                if body in self.held and not self._lies_free(joint):
                    self.held[body].append(point)
        for frame in self.mechanism.frames:
            if frame.body in self.held:
                self.held[frame.body].append(self._vector(frame.position))

    def told(self) -> dict[str, Any]:
        """Return the data: bodies and joints by number, -1 is the ground; points in m in world axes."""
        planar = self.mechanism.planar
        view = {"right": (1.0, 0.0, 0.0), "up": (0.0, 1.0, 0.0)} if planar else {"right": RIGHT, "up": UP}
        bodies = [self._body(name) for name in self.bodies]
        marks = [
            {"name": f.name, "body": self._number(f.body), "at": self._vector(f.position)}
            for f in self.mechanism.frames
        ]
        return {
            "name": self.node.name, "planar": planar, **view, "bodies": bodies, "links": list(self._links()), "marks": marks,
        }  # fmt: skip

    def _body(self, name: str) -> dict[str, Any]:
        """Return a body; if the position of its centre is not given (the origin then), it is drawn at its joints."""
        (body,) = (b for b in self.mechanism.bodies if b.name == name)
        place, held = self._vector(body.position), self.held[name]
        centre = held[0] if place == NOWHERE and len(held) == 1 else place
        return {
            "name": name, "at": place, "centre": centre, "points": held,
            "turn": quaternion(numbers_of(self.graph, body.turn)),
        }  # fmt: skip

    def _links(self) -> Iterator[dict[str, Any]]:
        springs = dict(springs_of(self.graph, self.node))
        for joint in self.joints:
            ends = self._ends(joint)
            if self._lies_free(joint):
                body = ends[1][0]
                around: Sequence[Vector] = self.held.get(body) or [self._vector(self.mechanism.point_of(body))]
                x, y, z = (sum(p[i] for p in around) / len(around) for i in range(3))
                ends = [(body, (x, y, z))] * 2
            yield {
                "name": joint.name, "kind": joint.kind, "axis": self._vector(joint.axis),
                "axis_of": self._number(self.mechanism.body_of(joint.first)),
                "ends": [{"body": self._number(body), "at": point} for body, point in ends],
                "grounded": "ground" in (self.mechanism.body_of(joint.first), self.mechanism.body_of(joint.second)),
                "sprung": list(springs.get(joint.name, ())),
            }  # fmt: skip

    def _ends(self, joint: Joint) -> list[tuple[str, Vector]]:
        """Return the two bodies of a joint, and its points on them."""
        names = (joint.first, joint.second)
        if joint.kind in ("distance", "rod"):
            points = [self._vector(self.mechanism.point_of(n)) for n in names]
        else:
            points = [self._vector(joint.position)] * 2
        return [(self.mechanism.body_of(n), p) for n, p in zip(names, points, strict=True)]

    def _lies_free(self, joint: Joint) -> bool:
        """Return True if the position of a joint has no meaning: a slide, or a planar joint, without given position."""
        return joint.kind in ("slide", "planar") and self._vector(joint.position) == NOWHERE

    def _number(self, body: str) -> int:
        return self.bodies.index(body) if body in self.bodies else -1

    def _vector(self, bounds: Sequence[Bound]) -> Vector:
        return numbers_of(self.graph, bounds)
