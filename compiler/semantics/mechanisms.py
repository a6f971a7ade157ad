"""`multibody` blocks: bodies, frames and joints with their geometry bound."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..algebra.expression import call
from ..algebra.formula import Bound, Formula
from ..graph.domains import BUNDLES, DOMAINS, Domain
from ..graph.mechanism import FREEDOMS, GROUND, NOTHING, ORIGIN, UPRIGHT, Body, Frame, Inertia, Joint, Mechanism, Vector
from ..graph.units import KILOGRAM, METRE, ONE, SECOND, Dimension
from ..syntax import tree
from .errors import (
    DimensionMismatch,
    NotStatic,
    UnknownAttribute,
    UnknownKind,
    UnknownName,
    Unsupported,
    WrongMechanism,
    WrongType,
    WrongValue,
)
from .scope import STATIC_ROLES, Array, MechanismEntry, PartEntry, Scope, Wrong, describe, suggestion, unit_hint

if TYPE_CHECKING:
    from .elaborate import Elaborator

JOINTS = frozenset(FREEDOMS)
LATER_JOINTS = frozenset(["distance", "ball", "cylinder", "universal", "screw", "planar", "rod", "gear", "rack"])
PLANAR = {name: DOMAINS[domain] for name, domain in BUNDLES["planar"].items()}
ATTRIBUTES = {
    "body": ("mass", "inertia", "at", "angle", "start"),
    "frame": ("at", "start"),
    "slide": ("along", "at", "start"),
    "hinge": ("at", "start"),
    "free": ("at", "angle", "along", "axes", "start"),
    "weld": ("at", "angle"),
}


@dataclass(frozen=True, slots=True)
class _Part:
    """A declared part before its attributes are read."""

    entry: PartEntry
    declaration: tree.Declaration
    scope: Scope


def declare_mechanism(elaborator: Elaborator, scope: Scope, statement: tree.Mechanism) -> MechanismEntry:
    """Declare the names of a mechanism's parts."""
    if statement.space not in (None, "planar"):
        if statement.space == "spatial":
            raise Wrong(
                Unsupported(statement.span, "A spatial mechanism", "Planar mechanisms are: `multibody name : planar`.")
            )
        raise Wrong(
            UnknownName(
                statement.span, str(statement.space), "the kinds of mechanism", "Write `multibody name : planar`."
            )
        )
    parts = Scope(scope.definition, scope.path, scope.suffix, scope)
    entry = MechanismEntry(scope.full(statement.name), parts, statement.span)
    declared: list[_Part] = []
    _declare(elaborator, parts, statement.statements, entry, declared)
    elaborator.mechanism_parts[entry.name] = declared
    return entry


def _declare(
    elaborator: Elaborator,
    scope: Scope,
    statements: tuple[tree.Node, ...],
    entry: MechanismEntry,
    declared: list[_Part],
) -> None:
    for statement in statements:
        if isinstance(statement, tree.Quantities):
            elaborator.declare_quantities(scope, statement, {})
    for statement in statements:
        if isinstance(statement, tree.Declaration):
            elaborator.guard(_declare_part, elaborator, scope, statement, entry, declared)
        elif isinstance(statement, tree.Loop):
            for number in elaborator.rounds(statement, scope):
                _declare(
                    elaborator,
                    elaborator.round_scope(scope, statement.name, number),
                    statement.statements,
                    entry,
                    declared,
                )


def _declare_part(
    elaborator: Elaborator, scope: Scope, statement: tree.Declaration, entry: MechanismEntry, declared: list[_Part]
) -> None:
    kind = statement.kind
    if kind in LATER_JOINTS:
        raise Wrong(Unsupported(statement.span, f"The joint `{kind}`", "Joints are slide, hinge, free and weld."))
    if kind not in ATTRIBUTES:
        hint = suggestion(
            kind, list(ATTRIBUTES), "In a mechanism stand body, frame, and the joints slide, hinge, free, weld."
        )
        raise Wrong(UnknownKind(statement.span, kind, hint))
    freedoms: tuple[str, ...] = FREEDOMS.get(kind, ("x", "y", "phi"))
    ports: dict[str, Domain] = {f: PLANAR[f] for f in freedoms}
    for name in statement.names:
        elaborator.counted(name.span)
        index = elaborator.index_of(name.index, scope)
        local = name.name if index is None else f"{name.name}[{', '.join(map(str, index))}]"
        if index is None and scope.suffix:
            raise Wrong(
                WrongType(
                    name.span, "An index", "a name alone", f"What stands in a `for` carries an index: `{name.name}[…]`."
                )
            )
        part = PartEntry(entry.name, local, kind, ports, name.span)
        home = entry.parts
        if index is None:
            elaborator.enter(home, name.name, part, name.span)
        else:
            array = home.entries.get(name.name)
            if array is None:
                array = Array(name.name, name.span)
                elaborator.enter(home, name.name, array, name.span)
            if not isinstance(array, Array) or index in array.items:
                raise Wrong(WrongMechanism(name.span, f"`{local}` is declared twice", "Rename one of the two."))
            array.items[index] = part
        declared.append(_Part(part, statement, scope))


def build_mechanism(
    elaborator: Elaborator, scope: Scope, statement: tree.Mechanism, entry: MechanismEntry
) -> Mechanism:
    """Read the attributes of all parts."""
    bodies: list[Body] = []
    frames: list[Frame] = []
    joints: list[Joint] = []
    for part in elaborator.mechanism_parts.get(entry.name, []):
        reader = _Attributes(elaborator, part)
        found = elaborator.guard(_read_part, elaborator, part, reader, entry)
        if isinstance(found, Body):
            bodies.append(found)
        elif isinstance(found, Frame):
            frames.append(found)
        elif isinstance(found, Joint):
            joints.append(found)
    gravity = ORIGIN
    for setting in _settings(statement.statements):
        if setting.name != "gravity":
            hint = suggestion(setting.name, ["gravity"], "A setting of a mechanism is `gravity = (x, y)`.")
            elaborator.tell(UnknownAttribute(setting.span, entry.name, setting.name, hint))
            continue
        bound = elaborator.guard(_vector, elaborator, setting.value, entry.parts, METRE / SECOND**2, "Gravity")
        gravity = bound or gravity
    return Mechanism(entry.name, tuple(bodies), tuple(frames), tuple(joints), gravity, statement.span)


def _settings(statements: tuple[tree.Node, ...]) -> Iterator[tree.Setting]:
    return (s for s in statements if isinstance(s, tree.Setting))


class _Attributes:
    """The attributes of one part."""

    def __init__(self, elaborator: Elaborator, part: _Part) -> None:
        self.elaborator, self.part = elaborator, part
        self.given: dict[str, tree.Attribute] = {}
        self.starts: dict[str, tree.Attribute] = {}
        allowed = ATTRIBUTES[part.entry.kind]
        for attribute in part.declaration.attributes:
            if attribute.name not in allowed:
                hint = suggestion(attribute.name, list(allowed), f"A {part.entry.kind} has: {', '.join(allowed)}.")
                elaborator.tell(UnknownAttribute(attribute.span, part.entry.name, attribute.name, hint))
            elif attribute.name == "start":
                self.starts[attribute.target.words if attribute.target else ""] = attribute
            else:
                self.given[attribute.name] = attribute

    def scalar(self, name: str, dimension: Dimension) -> Bound:
        attribute = self.given.get(name)
        if attribute is None:
            return NOTHING
        (bound,) = static_bounds(self.elaborator, attribute.value, self.part.scope, dimension, f"`{name}`", 1)
        return bound

    def point(self, name: str) -> Vector:
        attribute = self.given.get(name)
        if attribute is None:
            return ORIGIN
        return _vector(self.elaborator, attribute.value, self.part.scope, METRE, f"`{name}`")

    def start_values(self) -> Mapping[str, Bound]:
        result: dict[str, Bound] = {}
        ports = self.part.entry.ports
        for words, attribute in self.starts.items():
            port, _, letter = words.partition(".")
            if port not in ports and len(ports) == 1:
                port, letter = next(iter(ports)), port
            domain = ports.get(port)
            variable = None if domain is None else (domain.variable(letter) if letter else "q")
            if domain is None or variable not in ("q", "f"):
                hint = f"Write `start {next(iter(ports), 'x')} = …` or `start {next(iter(ports), 'x')}.v = …`."
                self.elaborator.tell(UnknownAttribute(attribute.span, self.part.entry.name, f"start {words}", hint))
                continue
            key = port if variable == "q" else f"{port}.f"
            (result[key],) = static_bounds(
                self.elaborator, attribute.value, self.part.scope, domain.dimension(variable), f"`start {words}`", 1
            )
        return result


def _vector(elaborator: Elaborator, value: tree.Expression, scope: Scope, dimension: Dimension, what: str) -> Vector:
    x, y = static_bounds(elaborator, value, scope, dimension, what, 2)
    return x, y, NOTHING


def static_bounds(
    elaborator: Elaborator, value: tree.Expression, scope: Scope, dimension: Dimension, what: str, count: int
) -> list[Bound]:
    template = elaborator.template(value, scope)
    parts = template.value if isinstance(template.value, tuple) else (template.value,)
    if len(parts) != count:
        expected = "A point (x, y)" if count == 2 else "A single number"
        raise Wrong(WrongType(value.span, expected, f"{len(parts)} numbers" if len(parts) > 1 else "a single number"))
    for part in parts:
        if not scope.plain and part.dimension not in (None, dimension):
            raise Wrong(
                DimensionMismatch(
                    value.span,
                    f"{what} is {describe(dimension)}, but `{value.span.text}` is {describe(part.dimension)}",
                    unit_hint(part.dimension, dimension, value),
                )
            )
    for slot in template.slots:
        scalar = elaborator.scalar_at(slot, scope)
        if scalar.role not in STATIC_ROLES:
            raise Wrong(NotStatic(slot.path.span, what, slot.words))
    return [elaborator.bind(template, formula, scope) for formula in template.formulas]


def _read_part(
    elaborator: Elaborator, part: _Part, reader: _Attributes, entry: MechanismEntry
) -> Body | Frame | Joint | None:
    name, kind, span = part.entry.name, part.entry.kind, part.entry.span
    definition = part.declaration.definition
    if kind == "body":
        if definition is not None:
            raise Wrong(
                WrongMechanism(
                    definition.span,
                    f"The body `{name}` has a definition",
                    "A body has attributes in braces: mass, inertia, at, angle.",
                )
            )
        mass, inertia = reader.scalar("mass", KILOGRAM), reader.scalar("inertia", KILOGRAM * METRE**2)
        for word, bound in (("mass", mass), ("inertia", inertia)):
            value = elaborator.value_of(bound, span)
            if value is not None and value < 0:
                raise Wrong(
                    WrongMechanism(
                        span,
                        f"The {word} of `{name}` is negative: {value:g}",
                        "Masses and inertias are zero or positive.",
                    )
                )
        turn = (NOTHING, NOTHING, reader.scalar("angle", ONE))
        return Body(name, mass, Inertia(zz=inertia), reader.point("at"), turn, reader.start_values(), span)
    if kind == "frame":
        if not isinstance(definition, tree.Path):
            raise Wrong(
                WrongMechanism(span, f"The frame `{name}` is on no body", "Write `frame name : body { at = (x, y) }`.")
            )
        place = _body(elaborator, definition, part.scope, entry)
        return Frame(name, place, reader.point("at"), span, reader.start_values())
    if not isinstance(definition, tree.Link):
        raise Wrong(
            WrongMechanism(
                part.declaration.span, f"The joint `{name}` joins nothing", f"Write `{kind} {name} : A to B`."
            )
        )
    first, second = (_body(elaborator, end, part.scope, entry) for end in (definition.first, definition.second))
    if first == second:
        raise Wrong(
            WrongMechanism(
                definition.span,
                f"The joint `{name}` joins `{first}` to itself",
                "A joint joins two bodies, or `ground` and a body.",
            )
        )
    angle = reader.scalar("along" if kind == "slide" or "along" in reader.given else "angle", ONE)
    if kind == "slide" and "along" not in reader.given:
        raise Wrong(
            WrongMechanism(
                part.declaration.span, f"The slide `{name}` has no direction", "Give it: `{ along = 90 deg }`."
            )
        )
    axis = (_applied("cos", angle), _applied("sin", angle), NOTHING) if kind == "slide" else UPRIGHT
    turn = (NOTHING, NOTHING, angle)
    return Joint(
        name,
        kind,
        first,
        second,
        reader.point("at"),
        axis,
        turn,
        reader.start_values(),
        span,
        _axes(elaborator, reader),
    )


def _applied(function: str, bound: Bound) -> Bound:
    return Bound(Formula(bound.formula.arity, call(function, bound.formula.expression)), bound.arguments)


def _axes(elaborator: Elaborator, reader: _Attributes) -> str:
    attribute = reader.given.get("axes")
    if attribute is None:
        return "from"
    word = attribute.value.words if isinstance(attribute.value, tree.Path) else ""
    if word not in ("from", "to", "middle"):
        hint = suggestion(
            word, ["from", "to", "middle"], "`axes = from`, `to` or `middle`: in whose axes x and y are measured."
        )
        raise Wrong(WrongValue(attribute.value.span, "axes", reader.part.entry.name, attribute.value.span.text, hint))
    return word


def _body(elaborator: Elaborator, place: tree.Expression, scope: Scope, entry: MechanismEntry) -> str:
    if not isinstance(place, tree.Path):
        raise Wrong(WrongType(place.span, "A body", "an expression", "Name a body, or `ground`."))
    if place.words == GROUND:
        return GROUND
    found = entry.parts.entries.get(place.head)
    if isinstance(found, Array) and len(place.steps) == 1 and isinstance(place.steps[0], tree.Index):
        index = elaborator.index_of(place.steps[0], scope)
        assert index is not None
        found = found.items.get(index)
    elif place.steps:
        found = None
    if not isinstance(found, PartEntry):
        hint = suggestion(
            place.head,
            [n for n, e in entry.parts.entries.items() if isinstance(e, PartEntry | Array)],
            "Bodies are declared in the same block.",
        )
        raise Wrong(UnknownName(place.span, place.words, f"the mechanism `{entry.name}`", hint))
    if found.kind not in ("body", "frame"):
        raise Wrong(WrongMechanism(place.span, f"`{place.words}` is a {found.kind}, not a body", "Joints join bodies."))
    if found.kind == "frame":
        raise Wrong(Unsupported(place.span, "A joint on a frame", "Name the body and give the place with `at`."))
    return found.name
