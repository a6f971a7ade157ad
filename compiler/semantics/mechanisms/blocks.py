"""`multibody` blocks: bodies, frames and joints with their geometry bound."""

from __future__ import annotations

from ...algebra.expression import ONE as TRUE
from ...algebra.expression import ZERO, Symbol, call, select
from ...algebra.formula import Bound, bind
from ...graph.domains import DOMAINS
from ...graph.mechanism import ATTITUDE, ORIGIN, SPATIAL_JOINTS, Joint, Mechanism, domain_of, freedoms_of, reactions_of
from ...graph.network import Reading, Requirement
from ...graph.units import METRE, SECOND
from ...syntax import tree
from ..names.errors import UnknownAttribute, UnknownName, WrongMechanism, WrongType
from ..names.foreign_words import OTHER_JOINTS
from ..names.part_kinds import instead_in_the_plane, kinds_of, noun_of
from ..names.scope import Array, Broken, DeclaredPart, MechanismEntry, PartEntry, Scope
from ..names.statement_errors import Wrong, suggestion
from ..resolution.conditions import in_order, known_or_later
from ..resolution.declarations import Declarations
from ..resolution.structure import taken
from .bodies import read_body, read_frame
from .joints import Places, read_joint
from .part_attributes import PartAttributes, counted, of_dimension, static, vector

SPACES = {None: True, "planar": True, "spatial": False}


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
