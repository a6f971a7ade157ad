"""State of one link during its computation."""

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
