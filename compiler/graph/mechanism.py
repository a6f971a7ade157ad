"""A mechanism as it was drawn: bodies and joints placed in one world frame, in the reference configuration.

Vectors have three components (m, in world axes); those of a planar mechanism have z = 0 and turn about (0, 0, 1).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..algebra.expression import ONE, ZERO
from ..algebra.formula import Bound, Formula
from ..source import Span

GROUND = "ground"
NOTHING = Bound(Formula(0, ZERO), ())
UNITY = Bound(Formula(0, ONE), ())

Vector = tuple[Bound, Bound, Bound]
ORIGIN: Vector = (NOTHING, NOTHING, NOTHING)
UPRIGHT: Vector = (NOTHING, NOTHING, UNITY)  # the axis about which everything planar turns


@dataclass(frozen=True, slots=True)
class Inertia:
    """About the centre of mass, in the body's own axes (kg m^2). A planar body has `zz` alone."""

    xx: Bound = NOTHING
    yy: Bound = NOTHING
    zz: Bound = NOTHING
    xy: Bound = NOTHING
    xz: Bound = NOTHING
    yz: Bound = NOTHING


@dataclass(frozen=True, slots=True)
class Body:
    """A rigid body: mass (kg), inertia, where its centre of mass is, and how its own axes are turned in the reference.

    `turn` is a rotation vector (rad); in the plane its z is the angle.
    """

    name: str
    mass: Bound
    inertia: Inertia
    position: Vector
    turn: Vector
    starts: Mapping[str, Bound]  # "x", "x.f", …: the pose and its rate
    span: Span


@dataclass(frozen=True, slots=True)
class Frame:
    """A point that is fixed to a body. `axes`: world or body, in which its port and its starts are."""

    name: str
    body: str
    position: Vector
    span: Span
    starts: Mapping[str, Bound] = field(default_factory=dict)
    axes: str = "world"


@dataclass(frozen=True, slots=True)
class Joint:
    """What two bodies leave each other: `second` seen from `first`, in a frame given in the reference configuration."""

    name: str
    kind: str  # a key of FREEDOMS
    first: str
    second: str  # bodies, frames or ground; of a gear or rack: joints
    position: Vector
    axis: Vector  # of slide, hinge, cylinder, screw, universal (its first); need not be of length 1
    turn: Vector  # of a free or planar joint: how its axes are turned, a rotation vector (rad)
    starts: Mapping[str, Bound]
    span: Span
    axes: str = "from"  # from, to, middle or world: in whose axes a free joint measures
    other_axis: Vector = ORIGIN  # the second of a universal joint
    ratio: Bound = NOTHING  # gear: turn of the second by that of the first; rack: m by rad; screw: m by turn (2 pi)
    rest: Mapping[str, Bound] = field(default_factory=dict)  # what a coordinate reads in the reference, if not zero
    locked: bool = False  # it leaves nothing in this run
    planar: bool = True  # whether it stands in a planar mechanism

    @property
    def freedoms(self) -> tuple[str, ...]:
        """The names of its coordinates."""
        return FREEDOMS[self.kind] if self.planar or self.kind != "free" else POSE


POSE = ("x", "y", "z", "rx", "ry", "rz")  # of a body in space
PLANAR_POSE = ("x", "y", "phi")

# The freedoms that each kind leaves. A distance measures and a rod, a gear or a rack only ties.
FREEDOMS: Mapping[str, tuple[str, ...]] = {
    "slide": ("x",),
    "hinge": ("phi",),
    "free": PLANAR_POSE,
    "weld": (),
    "cylinder": ("x", "phi"),
    "screw": ("phi",),
    "planar": PLANAR_POSE,
    "universal": ("phi1", "phi2"),
    "ball": ("rx", "ry", "rz"),
    "distance": ("d",),
    "rod": (),
    "gear": (),
    "rack": (),
}


@dataclass(frozen=True, slots=True)
class Mechanism:
    """Bodies and joints, in the plane or in space."""

    name: str
    bodies: tuple[Body, ...]
    frames: tuple[Frame, ...]
    joints: tuple[Joint, ...]
    gravity: Vector
    span: Span
    planar: bool = True
