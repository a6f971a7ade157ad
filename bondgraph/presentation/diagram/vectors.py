"""Vectors of a drawing (m, in world axes), their rotations, and numbers of the text."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from compiler.api import BondGraph, Bound, Quantity, evaluate

Vector = tuple[float, float, float]
Turn = tuple[float, float, float, float]  # a unit quaternion w, x, y, z
ORIGIN: Vector = (0.0, 0.0, 0.0)
ROUND = 36  # corners of a circle


def numbers_of(graph: BondGraph, bounds: Sequence[Bound]) -> Vector:
    """Return three numbers from the text; numbers unknown before a run count as zero."""
    x, y, z = (number_of(graph, bound) for bound in bounds)
    return x, y, z


def number_of(graph: BondGraph, bound: Bound) -> float:
    """Return a number from the text; numbers unknown before a run count as zero."""

    def value(key: object) -> float:
        if isinstance(key, float):
            return key
        named = graph.quantities.get(key.name) if isinstance(key, Quantity) else None
        return 0.0 if named is None or named.value is None else named.value

    return evaluate(bound.expression, value)


def turned(turn: Turn, point: Vector) -> Vector:
    """Return a vector rotated by a unit quaternion."""
    w, x, y, z = turn
    a, b, c = point
    tx, ty, tz = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx


def quaternion(turn: Vector) -> Turn:
    """Return the unit quaternion of a rotation vector."""
    angle = math.hypot(*turn)
    share = math.sin(angle / 2) / angle if angle else 0.5
    return math.cos(angle / 2), share * turn[0], share * turn[1], share * turn[2]


def circle(centre: Vector, axle: Vector, radius: float) -> Iterator[Vector]:
    """Yield points of a circle about an axle."""
    sides = across(axle, radius)
    for i in range(ROUND + 1):
        cosine, sine = math.cos(2 * math.pi * i / ROUND), math.sin(2 * math.pi * i / ROUND)
        x, y, z = (p + cosine * v + sine * w for p, v, w in zip(centre, *sides, strict=True))
        yield x, y, z


def across(axle: Vector, length: float) -> tuple[Vector, Vector]:
    """Return two vectors of a length at right angles to an axle and to each other."""
    least = min(range(3), key=lambda i: abs(axle[i]))
    first = _cross(axle, (float(least == 0), float(least == 1), float(least == 2)))
    second = _cross(axle, first)
    return _scaled(first, length / math.hypot(*first)), _scaled(second, length / math.hypot(*second))


def _scaled(a: Vector, factor: float) -> Vector:
    return factor * a[0], factor * a[1], factor * a[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
