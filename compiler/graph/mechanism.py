"""A mechanism as drawn: bodies and joints placed in one world frame, in the reference configuration.

Vectors have three components (m, in world axes); those of a planar mechanism have z = 0, and its rotations are about (0, 0, 1).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from ..algebra.expression import ONE, ZERO
from ..algebra.formula import Bound, Formula
from ..fast_dataclass import dataclass
from ..source import Span
from .domains import COMPONENT_DOMAINS

GROUND = "ground"
NOTHING = Bound(Formula(0, ZERO), ())
UNITY = Bound(Formula(0, ONE), ())

Vector = tuple[Bound, Bound, Bound]
ORIGIN: Vector = (NOTHING, NOTHING, NOTHING)
UPRIGHT: Vector = (NOTHING, NOTHING, UNITY)  # the axis about which everything planar turns


@dataclass(frozen=True, slots=True)
class Inertia:
    """Inertia about the centre of mass, in body axes (kg m^2). A planar body has `zz` alone."""

    xx: Bound = NOTHING
    yy: Bound = NOTHING
    zz: Bound = NOTHING
    xy: Bound = NOTHING
    xz: Bound = NOTHING
    yz: Bound = NOTHING


SHAPES = {"box": 3, "cylinder": 2, "sphere": 1}  # number of arguments in space
COLOURS = ("red", "orange", "yellow", "green", "blue", "purple", "brown", "grey", "black", "white")


@dataclass(frozen=True, slots=True)
class Appearance:
    """Shape and colour of a body in pictures, about its centre of mass in its own axes (m); empty where the text gives none.

    A box has the lengths of its sides, a cylinder its radius and the vector from end to end, a sphere its radius.
    """

    shape: str = ""
    sizes: tuple[Bound, ...] = ()
    colour: str = ""


@dataclass(frozen=True, slots=True)
class Body:
    """A rigid body: mass (kg), inertia, position of its centre of mass, and rotation of its own axes in the reference configuration.

    `turn` is a rotation vector (rad); in the plane its z is the angle.
    """

    name: str
    mass: Bound
    inertia: Inertia
    position: Vector
    turn: Vector
    starts: Mapping[str, Bound]  # "x", "x.f", …: the pose and its rate
    span: Span
    appearance: Appearance = Appearance()


@dataclass(frozen=True, slots=True)
class Frame:
    """A point fixed to a body or to the ground. `axes`: world or body, the axes of its port and its starts."""

    name: str
    body: str
    position: Vector
    span: Span
    starts: Mapping[str, Bound] = field(default_factory=dict)
    axes: str = "world"


@dataclass(frozen=True, slots=True)
class Joint:
    """Joint: the relative motion that two bodies have, of `second` relative to `first`, with axes given in the reference configuration.

    A distance or rod connects the points of its ends (`Mechanism.point_of`); other joints are at `position`.
    """

    name: str
    kind: str  # a key of FREEDOMS
    first: str
    second: str  # bodies, frames or ground; of a gear or rack: joints
    position: Vector
    axis: Vector  # of slide, hinge, cylinder, screw, universal (its first), skate, wheel in space; need not be of length 1
    turn: Vector  # of a free or planar joint: how its axes are turned, a rotation vector (rad)
    starts: Mapping[str, Bound]
    span: Span
    axes: str = "from"  # from, to, middle or world: in whose axes a free joint measures
    other_axis: Vector = ORIGIN  # the second of a universal joint; of a wheel or skate: the normal of its plane
    # gear: turn of the second by that of the first; rack: m by rad; screw: m by turn (2 pi); wheel: radius
    ratio: Bound = NOTHING
    rest: Mapping[str, Bound] = field(default_factory=dict)  # coordinates as drawn, if not zero
    locked: bool = False  # it leaves nothing in this run
    planar: bool = True  # True in a planar mechanism

    @property
    def freedoms(self) -> tuple[str, ...]:
        """Names of its coordinates."""
        return freedoms_of(self.kind, self.planar)


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
    "wheel": (),
    "skate": (),
}

ATTITUDE = ("w", "x", "y", "z")  # of a body in space: a unit quaternion, read and started as `attitude.w`, …
HOLDING_NOTHING = frozenset({"free", "distance"})
COUPLINGS = frozenset({"gear", "rack"})  # they tie two joints
CONTACTS = frozenset({"wheel", "skate"})  # they roll or slide on a plane of their first body
SPANS = frozenset({"distance", "rod"})  # they lie between two points
SPATIAL_JOINTS = frozenset({"planar", "cylinder", "screw", "universal", "ball"})


def freedoms_of(kind: str, planar: bool) -> tuple[str, ...]:
    """Power ports of a body or frame (its pose), or of a joint of this kind."""
    if kind in FREEDOMS and (planar or kind != "free"):
        return FREEDOMS[kind]
    return PLANAR_POSE if planar else POSE


def reactions_of(kind: str, planar: bool) -> tuple[str, ...]:
    """Reaction components of a joint, which can be read as `joint.reaction.x`.

    Force and torque on its second body at the joint's point, in world axes; for a rod only the force, for a gear the torque and for a
    rack the force on its second joint. Of a wheel the point is that of contact.
    """
    if kind in HOLDING_NOTHING or kind not in FREEDOMS:
        return ()
    if kind in COUPLINGS:
        return ("phi",) if kind == "gear" else ("x",)
    pose = PLANAR_POSE if planar else POSE
    return (
        tuple(p for p in pose if COMPONENT_DOMAINS[p] == "translation") if kind == "rod" or kind in CONTACTS else pose
    )


def domain_of(port: str) -> str:
    """Domain of a port or reading of a mechanism: of `pin.phi`, `pin.reaction.x`, `top.attitude.w`."""
    _, *inner, freedom = port.split(".")
    if inner == ["attitude"]:
        return "rotation"  # bare numbers, as angles are
    return "translation" if freedom == "d" else COMPONENT_DOMAINS[freedom]


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

    def body_of(self, place: str) -> str:
        """Body, or `ground`, that the name of a body, frame or the ground denotes."""
        return next((f.body for f in self.frames if f.name == place), place)

    def point_of(self, place: str) -> Vector:
        """Position in the drawing: the frame's point, the body's centre, or the origin."""
        parts: tuple[Frame | Body, ...] = (*self.frames, *self.bodies)
        return next((p.position for p in parts if p.name == place), ORIGIN)
