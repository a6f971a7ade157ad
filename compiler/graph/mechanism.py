"""A mechanism as it was drawn: bodies and joints placed in one world frame, in the reference configuration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..algebra.formula import Bound
from ..source import Span

GROUND = "ground"


@dataclass(frozen=True, slots=True)
class Body:
    """A planar rigid body: mass (kg), inertia about its centre of mass (kg m^2), where that centre is (m) and its angle."""

    name: str
    mass: Bound
    inertia: Bound
    position: tuple[Bound, Bound]
    angle: Bound
    starts: Mapping[str, Bound]  # "x", "x.f", …: the pose and its rate
    span: Span


@dataclass(frozen=True, slots=True)
class Frame:
    """A point that is fixed to a body."""

    name: str
    body: str
    position: tuple[Bound, Bound]
    span: Span
    starts: Mapping[str, Bound] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Joint:
    """What two bodies leave each other: `second` seen from `first`, in a frame given in the reference configuration."""

    name: str
    kind: str  # slide, hinge, free or weld
    first: str
    second: str
    position: tuple[Bound, Bound]
    angle: Bound
    axes: str  # from, to or middle: in whose axes a free joint measures
    starts: Mapping[str, Bound]
    span: Span

    @property
    def freedoms(self) -> tuple[str, ...]:
        """The names of its coordinates."""
        return FREEDOMS[self.kind]


FREEDOMS: Mapping[str, tuple[str, ...]] = {"slide": ("x",), "hinge": ("phi",), "free": ("x", "y", "phi"), "weld": ()}


@dataclass(frozen=True, slots=True)
class Mechanism:
    """A planar mechanism."""

    name: str
    bodies: tuple[Body, ...]
    frames: tuple[Frame, ...]
    joints: tuple[Joint, ...]
    gravity: tuple[Bound, Bound]
    span: Span
