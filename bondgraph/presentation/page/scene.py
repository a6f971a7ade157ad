"""Mechanisms of an animated page: points fixed to bodies in the reference, and the names of the poses that a run reports.

The page rotates points with their bodies, as `diagram/mechanism_geometry.py` does for a picture, and draws them again at each instant.
A body has the shape that its text gives; one in space without a shape is seen as the box or cylinder that has its mass and inertia.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from compiler.api import BondGraph, MechanismNode

from ..diagram.body_shapes import BodyShape, solid_of
from ..diagram.mechanism_geometry import reference_of
from ..diagram.poses import mechanisms_of, pose_parts
from ..diagram.styles import FILLS
from ..diagram.vectors import number_of, numbers_of, quaternion


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
            scenes.append({**_scene(graph, node), "first": len(names)})
            names += pose_parts(node)
    return Scenes(tuple(scenes), tuple(names))


def _scene(graph: BondGraph, node: MechanismNode) -> dict[str, Any]:
    """Return the data of a mechanism: bodies and joints by number, -1 is the ground; points in m in world axes."""
    mechanism = reference_of(graph, node)
    numbers = {body.name: number for number, body in enumerate(mechanism.bodies)}
    bodies = [
        {
            "name": b.name,
            "at": b.place,
            "centre": b.centre,
            "points": b.points,
            "outlines": b.outlines,
            "turn": quaternion(b.turn),
            "heavy": number_of(graph, own.mass) > 0,
            "solid": _solid(b.shape or (None if mechanism.planar else solid_of(graph, own))),
            "given": b.shape is not None,
            "colour": FILLS.get(b.colour),
        }
        for b, own in zip(mechanism.bodies, node.mechanism.bodies, strict=True)
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
    return {
        "name": mechanism.name, "planar": mechanism.planar, "bodies": bodies, "links": links, "marks": marks,
        "up": _up(graph, node), "floor": not mechanism.planar or _weight(graph, node)[1] < 0,
    }  # fmt: skip


def _solid(shape: BodyShape | None) -> dict[str, Any] | None:
    return None if shape is None else {"round": shape.around, "axes": shape.axes}


def _up(graph: BondGraph, node: MechanismNode) -> Sequence[float]:
    """Return the direction that a picture has upwards: in space against gravity, else z; in the plane y."""
    if node.mechanism.planar:
        return 0.0, 1.0, 0.0
    weight = _weight(graph, node)
    size = math.hypot(*weight)
    return [-w / size for w in weight] if 0 < size < math.inf else (0.0, 0.0, 1.0)


def _weight(graph: BondGraph, node: MechanismNode) -> Sequence[float]:
    return numbers_of(graph, node.mechanism.gravity)
