"""Mechanisms of an animated page: points fixed to bodies in the reference, and the names of the poses that a run reports.

The page rotates points with their bodies, as `diagram/mechanism_geometry.py` does for a picture, and draws them again at each instant.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..diagram.mechanism_geometry import RIGHT, UP, ReferenceMechanism, reference_of
from ..diagram.poses import mechanisms_of, pose_parts, quaternion

if TYPE_CHECKING:
    from compiler.api import BondGraph


@dataclass(frozen=True, slots=True)
class Scenes:
    """Mechanisms of a page: `told` has their data; `names` has the poses, body by body in the order of the data."""

    told: tuple[dict[str, Any], ...]
    names: tuple[str, ...]


def scenes_of(graph: BondGraph) -> Scenes:
    """Return all mechanisms of a model."""
    scenes: list[dict[str, Any]] = []
    names: list[str] = []
    for node in mechanisms_of(graph):
        if node.mechanism.bodies:
            scenes.append({**_scene(reference_of(graph, node)), "first": len(names)})
            names += pose_parts(node)
    return Scenes(tuple(scenes), tuple(names))


def _scene(mechanism: ReferenceMechanism) -> dict[str, Any]:
    """Return the data of a mechanism: bodies and joints by number, -1 is the ground; points in m in world axes."""
    numbers = {body.name: number for number, body in enumerate(mechanism.bodies)}
    bodies = [
        {
            "name": b.name,
            "at": b.place,
            "centre": b.centre,
            "points": b.points,
            "outlines": b.outlines,
            "turn": quaternion(b.turn),
        }
        for b in mechanism.bodies
    ]
    links = [
        {
            "name": j.name, "kind": j.kind, "axis": j.axis, "axis_of": numbers.get(j.axis_of, -1),
            "ends": [{"body": numbers.get(body, -1), "at": point} for body, point in j.ends],
            "grounded": j.grounded, "sprung": j.sprung,
        }
        for j in mechanism.joints
    ]  # fmt: skip
    marks = [{"name": name, "body": numbers.get(body, -1), "at": point} for name, body, point in mechanism.frames]
    right, up = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)) if mechanism.planar else (RIGHT, UP)
    return {
        "name": mechanism.name, "planar": mechanism.planar, "right": right, "up": up, "bodies": bodies, "links": links, "marks": marks,
    }  # fmt: skip
