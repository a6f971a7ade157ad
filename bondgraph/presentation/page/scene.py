"""Mechanisms of an animated page: points fixed to bodies in the reference, and the names of the poses that a run reports.

The page rotates points with their bodies, as `diagram/mechanism_geometry.py` does for a picture, and draws them again at each instant.
A body in space is seen as the box or cylinder that has its mass and inertia: a text says no more of its shape.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from compiler.api import Body, BondGraph, MechanismNode

from ..diagram.mechanism_geometry import Vector, number_of, numbers_of, reference_of, turned
from ..diagram.poses import mechanisms_of, pose_parts, quaternion

ALIKE = 1e-6  # relative: moments of inertia that count as equal


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
            "solid": None if mechanism.planar else _solid(graph, own),
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
        "name": mechanism.name, "planar": mechanism.planar, "up": _up(graph, node), "bodies": bodies, "links": links, "marks": marks,
    }  # fmt: skip


def _up(graph: BondGraph, node: MechanismNode) -> Sequence[float]:
    """Return the direction that a picture has upwards: in space against gravity, else z; in the plane y."""
    if node.mechanism.planar:
        return 0.0, 1.0, 0.0
    weight = numbers_of(graph, node.mechanism.gravity)
    size = math.hypot(*weight)
    return [-w / size for w in weight] if 0 < size < math.inf else (0.0, 0.0, 1.0)


def _solid(graph: BondGraph, body: Body) -> dict[str, Any] | None:
    """Return the box (`round` 0), cylinder (2) or ball (3) with the mass and inertia of a body: halves of its sides, a cylinder's axis last."""
    import numpy as np

    mass, own = number_of(graph, body.mass), body.inertia
    rows = ((own.xx, own.xy, own.xz), (own.xy, own.yy, own.yz), (own.xz, own.yz, own.zz))
    tensor = np.array([numbers_of(graph, row) for row in rows])
    if not (mass > 0 and np.isfinite(tensor).all() and tensor.any()):
        return None
    moments, axes = np.linalg.eigh(tensor)
    if moments[1] - moments[0] > ALIKE * moments[2]:  # two equal moments come first
        moments, axes = moments[[1, 2, 0]], axes[:, [1, 2, 0]]
    alike = ALIKE * moments.max()
    around = 0 if moments[1] - moments[0] > alike else 3 if abs(moments[2] - moments[0]) <= alike else 2
    squares = np.maximum(1.5 / mass * (moments.sum() - 2 * moments), 0.0)
    squares[:around] *= {0: 1.0, 2: 4 / 3, 3: 5 / 3}[around]
    frame = quaternion(numbers_of(graph, body.turn))
    sides: list[Vector] = [turned(frame, tuple(side)) for side in (axes * np.sqrt(squares)).T.tolist()]
    return {"round": around, "axes": sides}
