"""State of one link during its computation; and markers, of which chords, ports and closing joints are functions."""

from __future__ import annotations

from dataclasses import field

from ..algebra.expression import ZERO, Expression
from ..fast_dataclass import dataclass
from .assignment_emitter import AssignmentEmitter
from .axes import AxisBranch, Basis
from .coordinates import Attitude, Coordinate
from .rotations import AxialTurn, Turn
from .tree import Link
from .vectors import NULL, Vector

Spatial = tuple[Vector, Vector]  # about the point of reference: spin and velocity, or torque and force


@dataclass(slots=True, eq=False)
class LinkState:
    """A link during its computation, in its own axes about its point of reference.

    `passage` rotates from link axes to those of the parent, `shift` is the vector from the parent's point to its own (in the parent's axes).
    Each of the `columns` is the motion for a unit rate of one coordinate; `bias` is the velocity-dependent acceleration.
    """

    link: Link
    index: int  # in the tree; -1: the ground
    parent: int | None
    branch: AxisBranch
    basis: Basis
    origin: Vector  # the point of reference in the drawing, world axes
    passage: tuple[Turn, ...] = ()
    shift: Vector = NULL
    columns: list[Spatial] = field(default_factory=list)
    coordinates: list[Coordinate] = field(default_factory=list)
    attitude: Attitude | None = None
    angle: Expression = ZERO  # in still axes: how far it has turned about the third
    carried: Vector = NULL  # the parent's spin
    spin: Vector = NULL
    bias: Spatial = (NULL, NULL)
    squares: tuple[Expression, ...] = ()  # products of the spin's components
    direction: Vector = NULL  # of the joint, unit, in the drawing, world axes
    torque: Vector = NULL  # applied from outside
    force: Vector = NULL
    drive: Vector = NULL  # of a ball: the torque on what it carries, against what carries it
    world_force: Vector = NULL  # of a floating body: a force at its centre of mass, world axes

    def out(self, script: AssignmentEmitter, v: Vector, name: str) -> Vector:
        """Rotate from link axes to the parent's."""
        for turn in reversed(self.passage):
            v = turn.apply(script, v, name)
        return v

    def back(self, script: AssignmentEmitter, v: Vector, name: str) -> Vector:
        """Rotate from the parent's axes to link axes."""
        for turn in self.passage:
            v = turn.back(script, v, name)
        return v

    def inner(self, script: AssignmentEmitter, v: Vector, name: str) -> Vector:
        """A vector of the link, given in link axes as drawn, in the present pose. It changes only in still axes."""
        return AxialTurn(2, self.angle).apply(script, v, name) if self.branch.still else v


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
