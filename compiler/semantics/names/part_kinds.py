"""Kinds of parts of a mechanism, with their attributes in the plane and in space."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from ...graph.mechanism import FREEDOMS, SPATIAL_JOINTS

COORDINATE = ("start", "limits", "rest", "locked")  # of a joint that leaves something

# Rotation: `angle` in the plane, `turn = (rx, ry, rz)`, a rotation vector, in space. Axes are named in space:
# `along` for translation, `about` for rotation.
PLANAR: Mapping[str, tuple[str, ...]] = {
    "body": ("mass", "inertia", "at", "angle", "start", "shape", "colour"),
    "frame": ("at", "axes", "start"),
    "slide": ("along", "at", *COORDINATE),
    "hinge": ("at", *COORDINATE),
    "free": ("at", "angle", "axes", *COORDINATE),
    "weld": ("at",),
    "distance": ("start", "limits"),
    "rod": (),
    "gear": ("ratio",),
    "rack": ("radius",),
    "wheel": ("radius", "at", "normal"),
    "skate": ("along", "at"),
}
SPATIAL: Mapping[str, tuple[str, ...]] = {
    "body": ("mass", "inertia", "at", "turn", "start", "shape", "colour"),
    "frame": ("at", "axes", "start"),
    "slide": ("along", "at", *COORDINATE),
    "hinge": ("about", "at", *COORDINATE),
    "planar": ("at", "turn", *COORDINATE),
    "cylinder": ("along", "at", *COORDINATE),
    "screw": ("along", "lead", "at", *COORDINATE),
    "universal": ("about", "then", "at", *COORDINATE),
    "ball": ("at", "start", "limits", "locked"),
    "free": ("at", "turn", "axes", *COORDINATE),
    "weld": ("at",),
    "distance": ("start", "limits"),
    "rod": (),
    "gear": ("ratio",),
    "rack": ("radius",),
    "wheel": ("radius", "about", "at", "normal"),
    "skate": ("along", "at", "normal"),
}


class Needed(NamedTuple):
    """A required attribute: the word for it in errors, and an example."""

    what: str
    example: str


NEEDED: Mapping[str, Needed] = {
    "along": Needed("direction", "along = (1, 0, 0)"),
    "about": Needed("axis", "about = (0, 0, 1)"),
    "then": Needed("second axis", "then = (0, 1, 0)"),
    "lead": Needed("lead", "lead = 2 mm"),
    "ratio": Needed("ratio", "ratio = -3"),
    "radius": Needed("radius", "radius = 10 mm"),
}

TARGETED = frozenset({"start", "limits", "rest"})  # attributes that name a coordinate: `start x = …`


def attributes_of(kind: str, planar: bool) -> tuple[str, ...]:
    """The attributes of a part."""
    return (PLANAR if planar else SPATIAL)[kind]


def kinds_of(planar: bool) -> tuple[str, ...]:
    """Kinds of parts in a planar or a spatial mechanism."""
    return tuple(PLANAR if planar else SPATIAL)


def noun_of(kind: str) -> str:
    """Word for a part of this kind in a sentence."""
    return f"{kind} joint" if kind in ("free", "planar", "universal") else kind


def instead_in_the_plane(kind: str) -> str:
    """Advice for a joint that exists only in space."""
    if kind == "planar":
        return "In the plane it would leave everything, as `free` does: write that, or `multibody … : spatial`."
    return (
        "Write `multibody … : spatial`, or take a joint that the plane has: "
        + ", ".join(k for k in FREEDOMS if k not in SPATIAL_JOINTS)
        + "."
    )


def foreign_attribute(kind: str, name: str, planar: bool) -> str:
    """Advice for an attribute that this kind has in the other space or under another name; empty if there is none."""
    if planar and name == "turn":
        return "In the plane things turn by an `angle`."
    if not planar and name == "angle":
        return "In space things are turned by a rotation vector: `turn = (0, 0, 30 deg)`."
    if planar and name == "about":
        return "In the plane everything turns about the same axis, which needs no name."
    if name == "limits" and kind in ("rod", "weld", "wheel", "skate"):
        return f"A {kind} has no coordinate; limit a joint of its bodies, or a coordinate with `require`."
    if name == "limits" and kind in ("gear", "rack"):
        return f"A {kind} has no coordinate; limit a joint that it ties."
    return ""
