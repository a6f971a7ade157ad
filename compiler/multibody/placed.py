"""A point of a body and how it moves: what chords, ports and closing joints are written over. All in world axes."""

from __future__ import annotations

from ..nouns import dataclass
from .turns import Turn
from .vectors import Vector


@dataclass(frozen=True, slots=True)
class Placed:
    """A point that is fixed to a body (or the ground).

    `arm`: from the point of the body that it is reckoned from to this point, in the body's computing axes (see `own_axes`
    of `mechanics.py`); nobody outside needs it.
    """

    body: str  # "ground" for the world
    point: Vector  # where it is in the drawing, m
    displacement: Vector  # from there, m; to round-off of its own size, however far the point is from the origin
    turn: Turn  # of the body from the drawing: R turns a vector that is fixed to the body; `turn.swing` is (R - 1) v
    velocity: Vector  # of the point, m/s
    spin: Vector  # angular velocity of the body, 1/s
    arm: Vector
