"""`multibody` blocks: bodies, frames and joints with their geometry bound."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ...algebra.expression import ONE as TRUE
from ...algebra.expression import ZERO, Symbol, call, select
from ...algebra.formula import Bound, bind
from ...fast_dataclass import dataclass
from ...graph.domains import DOMAINS
from ...graph.mechanism import (
    ATTITUDE,
    CONTACTS,
    COUPLINGS,
    GROUND,
    NOTHING,
    ORIGIN,
    SPANS,
    SPATIAL_JOINTS,
    UNITY,
    UPRIGHT,
    Body,
    Frame,
    Joint,
    Mechanism,
    Vector,
    domain_of,
    freedoms_of,
    reactions_of,
)
from ...graph.network import Reading, Requirement
from ...graph.units import METRE, ONE, SECOND
from ...source import Span
from ...syntax import tree
from ..names.errors import UnknownAttribute, UnknownName, WrongMechanism, WrongType
from ..names.foreign_words import OTHER_JOINTS
from ..names.part_kinds import instead_in_the_plane, kinds_of, noun_of
from ..names.scope import Array, Broken, DeclaredPart, MechanismEntry, PartEntry, Scope
from ..names.statement_errors import AlreadyTold, Wrong, suggestion
from ..resolution.conditions import apart, in_order, known_or_later, not_parallel
from ..resolution.declarations import Declarations
from ..resolution.structure import taken
from .bodies import part_named, read_body, read_frame
from .part_attributes import PartAttributes, counted, of_dimension, static, static_bounds, vector

SPACES = {None: True, "planar": True, "spatial": False}
APART = 1e-9  # of their distance from the origin: points closer than that are one, computed or written with ten digits
AXES = ("from", "to", "middle", "world")
RADIUS_HINT = "It is positive; a wheel under a ceiling has `normal = (0, 0, -1)`, in the plane `(0, -1)`."
AXES_HINT = "`axes = from`, `to`, `middle` or `world`: in whose axes x and y are measured."
TIED = {"gear": ("hinge", "hinge"), "rack": ("hinge", "slide")}


def declare_mechanism(
    elaborator: Declarations, scope: Scope, statement: tree.MechanismSyntax, name: str
) -> MechanismEntry:
    """Declare the names of a mechanism's parts."""
    if statement.space not in SPACES:
        space = str(statement.space)
        hint = suggestion(space, ["planar", "spatial"], "Write `multibody name : planar` or `: spatial`.")
        raise Wrong(UnknownName(statement.span, space, "the kinds of mechanism", hint))
    parts = Scope(scope.definition, scope.path, scope.suffix, scope)
    entry = MechanismEntry(scope.full(name), parts, statement.span, SPACES[statement.space])
    elaborator.mechanism_parts[entry.name] = []
    _declare(elaborator, parts, statement.statements, entry)
    return entry


def _declare(
    elaborator: Declarations, scope: Scope, statements: tuple[tree.SyntaxNode, ...], entry: MechanismEntry
) -> None:
    for statement in taken(elaborator, scope, entry.parts, statements, {}):
        match statement:
            case tree.Declaration():
                elaborator.guard(_declare_part, elaborator, scope, statement, entry)
                for name in statement.names:
                    if entry.parts.vacant(name.name):
                        entry.parts.entries[name.name] = Broken(name.span)
            case tree.LoopSyntax():
                for number in elaborator.rounds(statement, scope):
                    inner = elaborator.round_scope(scope, statement.name, number)
                    _declare(elaborator, inner, statement.statements, entry)
            case tree.SettingSyntax():
                elaborator.guard(_setting, scope, statement, entry)


def _setting(scope: Scope, setting: tree.SettingSyntax, entry: MechanismEntry) -> None:
    """Collect a setting of the mechanism."""
    repeated = scope is not entry.parts
    if repeated or any(s.name == setting.name for s in entry.settings):
        what = f"`{setting.name}` is set " + ("in a `for`" if repeated else "twice")
        raise Wrong(WrongMechanism(setting.span, what, "Set it once, in the block itself."))
    entry.settings.append(setting)


def _declare_part(elaborator: Declarations, scope: Scope, statement: tree.Declaration, entry: MechanismEntry) -> None:
    kind, planar = statement.kind, entry.planar
    if planar and kind in SPATIAL_JOINTS:
        what = f"A `{kind}` joint leaves the plane, and `{entry.name}` is planar"
        raise Wrong(WrongMechanism(statement.span, what, instead_in_the_plane(kind)))
    kinds = kinds_of(planar)
    if kind not in kinds:
        listed = f"In it stand body, frame, and the joints {', '.join(kinds[2:])}."
        what = f"A {'planar' if planar else 'spatial'} mechanism has no `{kind}`"
        other = OTHER_JOINTS.get(kind.lower())
        hint = f"It is written `{other}`." if other in kinds else suggestion(kind, list(kinds), listed)
        raise Wrong(WrongMechanism(statement.span, what, hint))
    ports = {f: DOMAINS[domain_of(f"{kind}.{f}")] for f in freedoms_of(kind, planar)}
    groups = {"reaction": found} if (found := reactions_of(kind, planar)) else {}
    if kind == "body" and not planar:
        groups["attitude"] = ATTITUDE
    for name in statement.names:
        elaborator.counted(name.span)
        index = elaborator.index_of(name.index, scope)
        local = name.name if index is None else f"{name.name}[{', '.join(map(str, index))}]"
        if index is None and scope is not entry.parts:
            hint = f"What stands in a `for` carries an index: `{name.name}[…]`."
            raise Wrong(WrongType(name.span, "An index", "a name alone", hint))
        part = PartEntry(entry.name, local, kind, ports, name.span, groups)
        home = entry.parts
        if index is None:
            elaborator.enter(home, name.name, part, name.span)
        else:
            if home.vacant(name.name):
                elaborator.enter(home, name.name, Array(name.name, name.span), name.span)
            array = home.entries[name.name]
            if not isinstance(array, Array) or index in array.items:
                raise Wrong(WrongMechanism(name.span, f"`{local}` is declared twice", "Rename one of the two."))
            array.items[index] = part
        elaborator.mechanism_parts[entry.name].append(DeclaredPart(part, statement, scope, planar))


def build_mechanism(elaborator: Declarations, statement: tree.MechanismSyntax, entry: MechanismEntry) -> Mechanism:
    """Read the attributes of all parts. Joints come last, as they may refer to frames."""
    readers = [PartAttributes(elaborator, part) for part in elaborator.mechanism_parts.get(entry.name, [])]
    kinds = [r.part.entry.kind for r in readers]
    bodies = [elaborator.guard(read_body, r) for r, kind in zip(readers, kinds, strict=True) if kind == "body"]
    frames = [elaborator.guard(read_frame, r, entry) for r, kind in zip(readers, kinds, strict=True) if kind == "frame"]
    declared = frozenset(r.part.entry.name for r in readers if r.part.entry.kind == "body")
    places = Places({b.name: b for b in bodies if b}, {f.name: f for f in frames if f}, declared)
    joints: list[Joint] = []
    for reader, kind in zip(readers, kinds, strict=True):
        if kind not in ("body", "frame"):
            joint = elaborator.guard(read_joint, reader, entry, places)
            joints += [joint] if joint else []
            elaborator.limits += joint_limits(reader)
    gravity = ORIGIN
    for setting in entry.settings:
        if setting.name != "gravity":
            point = "(x, y)" if entry.planar else "(x, y, z)"
            hint = suggestion(setting.name, ["gravity"], f"A setting of a mechanism is `gravity = {point}`.")
            elaborator.tell(UnknownAttribute(setting.span, entry.name, setting.name, hint))
            continue
        acceleration = METRE / SECOND**2
        bound = elaborator.guard(vector, elaborator, setting.value, entry.parts, acceleration, "Gravity", entry.planar)
        gravity = bound or gravity
    return Mechanism(
        entry.name, tuple(places.bodies.values()), tuple(places.frames.values()), tuple(joints), gravity, statement.span,
        entry.planar,
    )  # fmt: skip


def joint_limits(reader: PartAttributes) -> list[Requirement]:
    """Limits of one joint, for the warnings of a run. Errors are collected."""
    limits = (reader.resolver.guard(_limit, reader, *item) for item in reader.targeted["limits"].items())
    return [limit for limit in limits if limit]


def _limit(reader: PartAttributes, words: str, attribute: tree.Attribute) -> Requirement:
    resolver, part = reader.resolver, reader.part
    entry, scope = part.entry, part.scope
    coordinate = reader.coordinate(words, attribute)
    template = resolver.template(attribute.value, scope)
    what = f"`{f'limits {words}'.strip()}`"
    dimension = entry.ports[coordinate].dimension("q")
    parts = counted(
        template, attribute.value, (2,), "A pair of limits (low, high)", f"Write `{what[1:-1]} = (low, high)`."
    )
    of_dimension(parts, attribute.value, scope, (dimension,), what)
    low, high = static(resolver, template, scope, what, attribute.value.span)
    _check_order(reader, attribute, low, high)
    reading = Reading(entry.mechanism, f"{entry.name}.{coordinate}", "q")
    place = Symbol(reading)
    inside = call("and", call("less_equal", low.expression, place), call("less_equal", place, high.expression))
    instance = scope.path.removesuffix(".")
    path = f"{entry.mechanism.removeprefix(scope.path)}.{entry.name}.{coordinate}"
    first, second = _texts(attribute.value)
    return Requirement(
        instance, bind(select(inside, TRUE, ZERO)), f"{first} <= {path} <= {second}" if second else f"{path} within {first}",
        f"limits of the {noun_of(entry.kind)} `{path.rpartition('.')[0]}`", ((path, reading, str(dimension)),), attribute.span,
        scope.base().stands,
    )  # fmt: skip


def _check_order(reader: PartAttributes, attribute: tree.Attribute, low: Bound, high: Bound) -> None:
    name = reader.part.entry.name
    known = known_or_later(reader.resolver, (low, high), attribute.span, f"limits of {name}", in_order)
    if known is not None and known[0] > known[1]:
        what = f"The limits of `{name}` are the wrong way round: {known[0]:g} is more than {known[1]:g}"
        raise Wrong(WrongMechanism(attribute.value.span, what, "The lower one comes first."))


def _texts(value: tree.ExpressionSyntax) -> tuple[str, str]:
    """The limits as they are written."""
    if isinstance(value, tree.VectorSyntax):
        first, second = (" ".join(item.span.text.split()) for item in value.items)
        return first, second
    return " ".join(value.span.text.split()), ""


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
