"""Shapes of bodies: those that a text gives, and the solids that have a body's mass and inertia."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from compiler.api import Body, BondGraph

from .vectors import ROUND, Vector, across, number_of, numbers_of, quaternion, turned

BOX, CYLINDER, BALL = 0, 2, 3  # how many of the half sides are radii
ALIKE = 1e-6  # relative: moments of inertia that count as equal
FLAT = 0.2  # thickness of what lies in the plane, as a share of its smaller side


@dataclass(frozen=True, slots=True)
class BodyShape:
    """A box, cylinder or ball about the centre of mass: three half sides in the reference (m, in world axes), a cylinder's axis last."""

    around: int  # BOX, CYLINDER or BALL
    axes: tuple[Vector, Vector, Vector]


def shape_of(graph: BondGraph, body: Body, planar: bool) -> BodyShape | None:
    """Return the shape that the text gives; None if it gives none, or its sizes are not known before a run."""
    kind, sizes = body.appearance.shape, [number_of(graph, size) for size in body.appearance.sizes]
    if not kind or not (0 < sizes[0] < math.inf and all(map(math.isfinite, sizes)) and any(sizes[1:] or (1.0,))):
        return None
    radius = sizes[0]
    if kind == "cylinder":
        half = sizes[1] / 2, sizes[2] / 2, sizes[3] / 2
        sides, around = (*across(half, radius), half), CYLINDER
    elif kind == "sphere":
        sides, around = (
            ((radius, 0.0, 0.0), (0.0, radius, 0.0), (0.0, 0.0, radius * (FLAT if planar else 1.0))),
            CYLINDER if planar else BALL,
        )
    else:
        a, b, c = sizes if len(sizes) == 3 else (*sizes, FLAT * min(sizes))
        sides, around = ((a / 2, 0.0, 0.0), (0.0, b / 2, 0.0), (0.0, 0.0, c / 2)), BOX
    turn = quaternion(numbers_of(graph, body.turn))
    x, y, z = (turned(turn, side) for side in sides)
    return BodyShape(around, (x, y, z))


def solid_of(graph: BondGraph, body: Body) -> BodyShape | None:
    """Return the solid with the mass and inertia of a body in space; None for a body that has none, or numbers that are not known before a run."""
    mass, own = number_of(graph, body.mass), body.inertia
    rows = ((own.xx, own.xy, own.xz), (own.xy, own.yy, own.yz), (own.xz, own.yz, own.zz))
    tensor = np.array([numbers_of(graph, row) for row in rows])
    if not (mass > 0 and np.isfinite(tensor).all() and tensor.any()):
        return None
    moments, axes = np.linalg.eigh(tensor)
    if moments[1] - moments[0] > ALIKE * moments[2]:  # two equal moments come first
        moments, axes = moments[[1, 2, 0]], axes[:, [1, 2, 0]]
    alike = ALIKE * moments.max()
    around = BOX if moments[1] - moments[0] > alike else BALL if abs(moments[2] - moments[0]) <= alike else CYLINDER
    squares = np.maximum(1.5 / mass * (moments.sum() - 2 * moments), 0.0)
    squares[:around] *= {BOX: 1.0, CYLINDER: 4 / 3, BALL: 5 / 3}[around]
    turn = quaternion(numbers_of(graph, body.turn))
    x, y, z = (turned(turn, tuple(side)) for side in (axes * np.sqrt(squares)).T.tolist())
    return BodyShape(around, (x, y, z))


def outlines_of(shape: BodyShape, centre: Vector, planar: bool) -> tuple[tuple[Vector, ...], ...]:
    """Return the edges of a shape as lines of points; in the plane one closed line."""

    def at(*shares: float) -> Vector:
        x, y, z = (
            c + sum(f * v for f, v in zip(shares, sides, strict=True))
            for c, sides in zip(centre, zip(*shape.axes, strict=True), strict=True)
        )
        return x, y, z

    angles = [2 * math.pi * k / ROUND for k in range(ROUND + 1)]
    corners = [(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)]
    rim = corners if shape.around == BOX else [(math.cos(a), math.sin(a)) for a in angles]
    if planar:
        return (tuple(at(u, v, 0.0) for u, v in rim),)
    if shape.around == BALL:
        return tuple(
            tuple(at(*point) for point in circle)
            for circle in ([(u, v, 0.0) for u, v in rim], [(u, 0.0, v) for u, v in rim], [(0.0, u, v) for u, v in rim])
        )
    ends = tuple(tuple(at(u, v, w) for u, v in rim) for w in (-1.0, 1.0))
    sides = rim[:4] if shape.around == BOX else [(1.0, 0.0), (-1.0, 0.0)]
    return (*ends, *((at(u, v, -1.0), at(u, v, 1.0)) for u, v in sides))
