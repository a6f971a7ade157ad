"""Marker: a point of a body with its motion, in world axes. Chords, ports and closing joints are functions of markers."""

from __future__ import annotations

from ..fast_dataclass import dataclass
from .rotations import Turn
from .vectors import Vector


@dataclass(frozen=True, slots=True)
class Marker:
    """A marker: a point that is fixed to a body (or the ground).

    `arm`: vector from the body's point of reference to this point, in the body's computing axes (see `own_axes`
    of `mechanics.py`); internal.
    """

    body: str  # "ground" for the world
    point: Vector  # position in the drawing, m
    displacement: Vector  # from there, m; to round-off of its own size, however far the point is from the origin
    turn: Turn  # of the body from the drawing: R turns a vector that is fixed to the body; `turn.swing` is (R - 1) v
    velocity: Vector  # of the point, m/s
    spin: Vector  # angular velocity of the body, 1/s
    arm: Vector


@dataclass(frozen=True, slots=True)
class Carried:
    """A body without mass that turns with another one and is shifted from it; `drift`: the rate of the shift. In the axes of the drawing."""

    by: str
    shift: Vector
    drift: Vector
