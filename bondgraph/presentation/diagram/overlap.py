"""Overlap of rectangles, and the distance by which a part must be pushed to avoid it.

Arrays of rectangles have the shape (n, 4): left, top, right, bottom; y grows downwards, as in SVG.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from compiler.api import Array

Rectangles = Array
Point = tuple[float, float]
Vector = tuple[float, float]

NOTHING: Rectangles = np.empty((0, 4))
MARGIN = 5.0
FAR = 20000.0
LANE = 8.0  # free space of a bond at each side of its line: half a stroke, a half arrow


def unit_vector(start: Point, end: Point) -> Vector:
    """Return the direction from one point to another, of length 1."""
    length = math.dist(start, end)
    return (end[0] - start[0]) / length, (end[1] - start[1]) / length


def rectangles(items: Iterable[tuple[float, float, float, float]]) -> Rectangles:
    """Return an array of rectangles from tuples."""
    listed = list(items)
    return np.array(listed, dtype=float) if listed else NOTHING


def moved(items: Rectangles, x: float, y: float) -> Rectangles:
    """Return the same rectangles, shifted."""
    return np.asarray(items + np.array((x, y, x, y)))


def joined(*parts: Rectangles) -> Rectangles:
    """Return several arrays of rectangles as one."""
    return np.concatenate(parts)


def bounds(items: Rectangles) -> tuple[float, float, float, float]:
    """Return the bounding rectangle of all."""
    low, high = items[:, :2].min(axis=0), items[:, 2:].max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def overlapping(first: Rectangles, second: Rectangles, margin: float = MARGIN) -> Any:
    """Return a mask of the pairs that are nearer to each other than the margin; shape (n, m)."""
    (left, top, right, bottom), (x0, y0, x1, y1) = first.T, second.T
    return _near(left, right, x0, x1, margin) & _near(top, bottom, y0, y1, margin)


def _near(low: Array, high: Array, start: Array, end: Array, margin: float) -> Any:
    """Return a mask of the pairs of intervals that are nearer to each other than the margin."""
    return (low[:, None] < end + margin) & (start < (high + margin)[:, None])


def touches(first: Rectangles, second: Rectangles, margin: float = MARGIN) -> bool:
    """Return True if any pair is nearer than the margin."""
    return bool(len(first) and len(second) and overlapping(first, second, margin).any())


def lane(start: Point, end: Point, width: float = LANE) -> Rectangles:
    """Return the rectangles of a straight bond; a slanted one gets a chain of small ones."""
    (x0, y0), (x1, y1) = start, end
    if x0 == x1 or y0 == y1:
        sides = (width * (x0 == x1), width * (y0 == y1))
        return np.array(
            [(min(x0, x1) - sides[0], min(y0, y1) - sides[1], max(x0, x1) + sides[0], max(y0, y1) + sides[1])]
        )
    count = max(2, math.ceil(math.hypot(x1 - x0, y1 - y0) / 8))
    half = 0.6 * width
    shares = np.arange(count + 1)
    x, y = x0 + (x1 - x0) * shares / count, y0 + (y1 - y0) * shares / count
    return np.stack((x - half, y - half, x + half, y + half), axis=1)


def corridor(along: Vector, start: float) -> Rectangles:
    """Return the space that the bond that carries a part may need at any length; it arrives in direction `along`."""
    x, y = along
    return lane((-x * (start + MARGIN + 4), -y * (start + MARGIN + 4)), (-x * FAR, -y * FAR))


def push(still: Rectangles, moving: Rectangles, along: Vector, least: float) -> float:
    """Return the least distance, at least `least`, by which `moving` must be shifted in direction `along` to be clear of `still`."""
    distance = least
    if not len(still) or not len(moving):
        return distance
    x, y = along
    if x and y:
        while overlapping(still, moved(moving, x * distance, y * distance)).any():
            distance += 6.0
        return distance
    low, high, side, end = (0, 2, 1, 3) if x else (1, 3, 0, 2)
    i, j = np.nonzero(_near(still[:, side], still[:, end], moving[:, side], moving[:, end], MARGIN))
    borders, fronts, backs = still[i], moving[j, low], moving[j, high]
    lows, highs = borders[:, low], borders[:, high]
    way = x or y
    while True:
        front, back = fronts + way * distance, backs + way * distance
        pairs = (lows < back + MARGIN) & (front < highs + MARGIN)
        if not pairs.any():
            return distance
        gap = np.abs(highs - front if way > 0 else lows - back)[pairs] + MARGIN
        distance += math.ceil(float(gap.max()) + 1e-6)
