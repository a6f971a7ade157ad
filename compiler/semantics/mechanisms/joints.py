"""Joints: the parts that they connect, their place, axes and freedoms."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ...algebra.expression import call
from ...algebra.formula import Bound, bind
from ...fast_dataclass import dataclass
from ...graph.mechanism import (
    CONTACTS,
    COUPLINGS,
    GROUND,
    NOTHING,
    ORIGIN,
    SPANS,
    UNITY,
    UPRIGHT,
    Body,
    Frame,
    Joint,
    Vector,
)
from ...graph.units import METRE, ONE
from ...source import Span
from ...syntax import tree
from ..names.errors import WrongMechanism
from ..names.part_kinds import noun_of
from ..names.scope import MechanismEntry
from ..names.statement_errors import AlreadyTold, Wrong
from ..resolution.conditions import apart, known_or_later, not_parallel
from .bodies import part_named
from .part_attributes import PartAttributes, static_bounds

APART = 1e-9  # of their distance from the origin: points closer than that are one, computed or written with ten digits
AXES = ("from", "to", "middle", "world")
RADIUS_HINT = "It is positive; a wheel under a ceiling has `normal = (0, 0, -1)`, in the plane `(0, -1)`."
AXES_HINT = "`axes = from`, `to`, `middle` or `world`: in whose axes x and y are measured."
TIED = {"gear": ("hinge", "hinge"), "rack": ("hinge", "slide")}


@dataclass(frozen=True, slots=True)
class Places:
    """Bodies and frames of a mechanism that could be read. `declared` holds the names of all bodies."""

    bodies: Mapping[str, Body]
    frames: Mapping[str, Frame]
    declared: frozenset[str]

    def body_of(self, name: str) -> str:
        """Body that a name denotes. Raises `AlreadyTold` if its frame has an error."""
        if name == GROUND or name in self.declared:
            return name
        if name not in self.frames:
            raise AlreadyTold
        return self.frames[name].body

    def point_of(self, name: str) -> Vector:
        """Position of a frame or of the centre of a body in the drawing. Raises `AlreadyTold` if it has an error."""
        part = self.frames.get(name) or self.bodies.get(name)
        if part is None:
            raise AlreadyTold
        return part.position


def read_joint(reader: PartAttributes, entry: MechanismEntry, places: Places) -> Joint:
    """A joint. Raises `Wrong`."""
    part, kind, name = reader.part, reader.part.entry.kind, reader.part.entry.name
    definition = part.declaration.definition
    if not isinstance(definition, tree.LinkSyntax):
        ends = " to ".join(TIED.get(kind, ("A", "B")))
        what = f"The joint `{name}` joins nothing"
        raise Wrong(WrongMechanism(part.declaration.span, what, f"Write `{kind} {name} : {ends}`."))
    if kind in COUPLINGS:
        return _coupling(reader, entry, definition)
    first, second = (_end(reader, end, entry) for end in (definition.first, definition.second))
    _check_bodies(name, definition, first, second, places)
    position, (axis, other, turn), ratio, axes, starts, rest, locked = reader.together(
        lambda: _position(reader, definition, first, second, places),
        lambda: _directions(reader, kind),
        lambda: _ratio(reader, kind),
        lambda: reader.word("axes", AXES, AXES_HINT),
        reader.starts, reader.rests, reader.locked,
    )  # fmt: skip
    return Joint(
        name, kind, first, second, position, axis, turn, starts, part.entry.span, axes, other, ratio, rest, locked,
        part.planar,
    )  # fmt: skip


def _ratio(reader: PartAttributes, kind: str) -> Bound:
    """Lead of a screw, radius of a wheel."""
    if kind == "screw":
        return reader.nonzero("lead", METRE, "What turns and does not move along is a hinge.")
    return reader.positive("radius", METRE, RADIUS_HINT) if kind == "wheel" else NOTHING


def _end(reader: PartAttributes, place: tree.ExpressionSyntax, entry: MechanismEntry) -> str:
    """The body, frame or ground at one end."""
    found = part_named(reader, place, reader.part.scope, entry, "A body", "Name a body, a frame, or `ground`.")
    if found is not None and found.kind not in ("body", "frame"):
        what = f"`{place.span.text}` is a {noun_of(found.kind)}, not a body"
        raise Wrong(WrongMechanism(place.span, what, "Joints join bodies, frames of them, and `ground`."))
    return GROUND if found is None else found.name


def _check_bodies(name: str, definition: tree.LinkSyntax, first: str, second: str, places: Places) -> None:
    one, two = places.body_of(first), places.body_of(second)
    if one == two:
        how = f"`{one}` to itself" if first == second else f"`{first}` to `{second}`, both of `{one}`"
        hint = "A joint joins two bodies, or `ground` and a body."
        raise Wrong(WrongMechanism(definition.span, f"The joint `{name}` joins {how}", hint))


def _coupling(reader: PartAttributes, entry: MechanismEntry, definition: tree.LinkSyntax) -> Joint:
    """A gear or a rack: the coordinate of the second joint is a multiple of the first's."""
    part, kind, name = reader.part, reader.part.entry.kind, reader.part.entry.name
    ends = []
    example = f"Write `{kind} {name} : {' to '.join(TIED[kind])}`, with the names of joints."
    for place, wanted in zip((definition.first, definition.second), TIED[kind], strict=True):
        found = part_named(reader, place, part.scope, entry, "A joint", example)
        if found is None or found.kind != wanted:
            which = "the world" if found is None else f"a {noun_of(found.kind)}"
            what = f"The {kind} `{name}` needs a {wanted} here, `{place.span.text}` is {which}"
            raise Wrong(WrongMechanism(place.span, what, example))
        ends.append(found.name)
    if ends[0] == ends[1]:
        what = f"The {kind} `{name}` ties `{ends[0]}` to itself"
        raise Wrong(WrongMechanism(definition.span, what, "It ties two different joints."))
    if kind == "gear":
        ratio = reader.nonzero("ratio", ONE, "`ratio = -3`: the second hinge turns three times as far, the other way.")
    else:
        ratio = reader.nonzero("radius", METRE, "The slide moves by the radius for each radian of the hinge.")
    return Joint(
        name, kind, ends[0], ends[1], ORIGIN, UPRIGHT if part.planar else ORIGIN, ORIGIN, {}, part.entry.span,
        ratio=ratio, planar=part.planar,
    )  # fmt: skip


# ---------------------------------------------------------------- places
def _position(reader: PartAttributes, definition: tree.LinkSyntax, first: str, second: str, places: Places) -> Vector:
    """Position of a joint: `at`, or the position of the frame that it is on; of what rolls or slides on a plane a point of B. Raises `Wrong`."""
    if reader.part.entry.kind in SPANS:
        _check_span(reader, definition, first, second, places)
        return ORIGIN
    if "at" in reader.given:
        return reader.point("at")
    if reader.part.entry.kind in CONTACTS and second != GROUND:
        return places.point_of(second)
    frames = [n for n in (first, second) if n in places.frames]
    if not frames:
        return ORIGIN
    points = [places.point_of(n) for n in frames]
    if len(points) == 2 and _distance(reader, points[0], points[1], definition.span, APART) > 0:
        what = f"The frames `{first}` and `{second}` are not at one place in the drawing"
        hint = f"Say where the joint `{reader.part.entry.name}` is: `at = …`; or draw the two frames at the same point."
        raise Wrong(WrongMechanism(definition.span, what, hint))
    return points[0]


def _check_span(reader: PartAttributes, definition: tree.LinkSyntax, first: str, second: str, places: Places) -> None:
    """A distance or rod lies between two points that are not the same."""
    kind, name = reader.part.entry.kind, reader.part.entry.name
    for end, place in ((first, definition.first), (second, definition.second)):
        if end == GROUND:
            what = f"The {kind} `{name}` needs a point of the ground"
            raise Wrong(WrongMechanism(place.span, what, "Name one: `frame anchor : ground { at = … }`."))
    points = (*places.point_of(first), *places.point_of(second))
    known = known_or_later(reader.resolver, points, definition.span, f"length of {name}", apart(APART))
    if known is not None and _length(known, APART) == 0:
        what = f"The {kind} `{name}` has the length zero in the drawing, so no direction"
        raise Wrong(WrongMechanism(definition.span, what, "Draw its two ends apart."))


def _distance(reader: PartAttributes, a: Vector, b: Vector, span: Span, threshold: float) -> float:
    """Distance of two points in the drawing; 0 below the threshold, NaN if it is not known yet, so that no error is reported."""
    values = [reader.resolver.value_of(x, span) for x in (*a, *b)]
    known = [v for v in values if v is not None]
    return _length(known, threshold) if len(known) == len(values) else math.nan


def _length(known: list[float], threshold: float) -> float:
    found = math.dist(known[:3], known[3:])
    return found if found > threshold * max(map(abs, known), default=0.0) else 0.0


# ---------------------------------------------------------------- directions
def _directions(reader: PartAttributes, kind: str) -> tuple[Vector, Vector, Vector]:
    """Axis of a joint, second axis of a universal joint, and the rotation of the axes in which it measures."""
    axis, turn = _axis(reader, kind)
    if kind in CONTACTS:
        return axis, _normal(reader, axis), turn
    return axis, _second_axis(reader, axis) if kind == "universal" else ORIGIN, turn


def _axis(reader: PartAttributes, kind: str) -> tuple[Vector, Vector]:
    """Axis of a joint, and the rotation of the axes in which it measures."""
    if kind in ("slide", "skate") and reader.planar:
        return _planar_slide(reader)
    if kind == "wheel":
        return reader.direction("about") if "about" in reader.given else ORIGIN, ORIGIN
    if kind in ("slide", "cylinder", "screw", "skate"):
        return reader.direction("along"), ORIGIN
    if kind in ("hinge", "universal") and not reader.planar:
        return reader.direction("about"), ORIGIN
    if kind in ("free", "planar"):
        return UPRIGHT, reader.turn()
    return UPRIGHT if kind == "hinge" or reader.planar else ORIGIN, ORIGIN


def _planar_slide(reader: PartAttributes) -> tuple[Vector, Vector]:
    """`along = 90 deg` or `along = (0, 1)`: a direction and its angle."""
    attribute = reader.needed("along")
    if isinstance(reader.resolver.template(attribute.value, reader.part.scope).value, tuple):
        axis = reader.direction("along")
        return axis, (NOTHING, NOTHING, bind(call("atan2", axis[1].expression, axis[0].expression)))
    (angle,) = static_bounds(reader.resolver, attribute.value, reader.part.scope, ONE, "`along`", 1)
    axis = bind(call("cos", angle.expression)), bind(call("sin", angle.expression)), NOTHING
    return axis, (NOTHING, NOTHING, angle)


def _second_axis(reader: PartAttributes, first: Vector) -> Vector:
    """Second axis of a universal joint, which is not parallel to the first."""
    second = reader.direction("then")
    what = f"Both axes of the universal joint `{reader.part.entry.name}` are parallel"
    _check_apart(reader, first, second, "then", (what, "Two different axes leave two freedoms."))
    return second


def _normal(reader: PartAttributes, first: Vector) -> Vector:
    """Normal of the plane that a wheel or skate touches: upwards, if nothing else is said. A wheel does not lie on it, nor does a skate stand on end."""
    upright = (NOTHING, UNITY, NOTHING) if reader.planar else UPRIGHT
    normal = reader.direction("normal") if "normal" in reader.given else upright
    if first == ORIGIN or reader.planar:
        return normal
    kind, name = reader.part.entry.kind, reader.part.entry.name
    word = "about" if kind == "wheel" else "along"
    lies = ("lies flat in the drawing: its axle is the normal of the plane", "Tilt it: a wheel touches at one point.")
    ends = (
        "stands on end in the drawing: it is along the normal of the plane",
        "Say with `along` which way it slides.",
    )
    what, hint = lies if kind == "wheel" else ends
    _check_apart(reader, first, normal, word, (f"The {kind} `{name}` {what}", hint))
    return normal


def _check_apart(reader: PartAttributes, first: Vector, second: Vector, word: str, told: tuple[str, str]) -> None:
    """Raise `Wrong` with a sentence and advice if two directions are parallel. `word`: the attribute to point at."""
    attribute = reader.needed(word)
    words = f"axes of {reader.part.entry.name}"
    known = known_or_later(reader.resolver, (*first, *second), attribute.span, words, not_parallel(APART))
    if known is not None:
        a, b = known[:3], known[3:]
        normal = [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]
        if math.hypot(*normal) <= APART * math.hypot(*a) * math.hypot(*b):
            raise Wrong(WrongMechanism(attribute.value.span, *told))
