"""Bodies and frames of a mechanism: mass, inertia, and position in the drawing."""

from __future__ import annotations

from ...algebra.formula import Bound
from ...graph.inertia import ROUNDING, is_impossible, principal_moments
from ...graph.mechanism import COLOURS, GROUND, SHAPES, Appearance, Body, Frame, Inertia
from ...graph.units import KILOGRAM, METRE
from ...syntax import tree
from ..names.errors import UnknownName, WrongMechanism, WrongType
from ..names.part_kinds import noun_of
from ..names.scope import Array, Broken, MechanismEntry, PartEntry, Scope
from ..names.statement_errors import AlreadyTold, Wrong, suggestion
from ..resolution.conditions import known_or_later, not_negative, not_zero, takes_energy
from .part_attributes import PartAttributes, counted, of_dimension, static, static_bounds

MOMENT = KILOGRAM * METRE**2
IN_THE_PLANE = "Write `shape = box(20 cm, 4 cm)` or `sphere(3 cm)`."
IN_SPACE = "Write `shape = box(20 cm, 4 cm, 2 cm)`, `cylinder(1 cm, (20 cm, 0 m, 0 m))` or `sphere(3 cm)`."


def read_body(reader: PartAttributes) -> Body:
    """A body. Raises `Wrong`."""
    part, name = reader.part, reader.part.entry.name
    definition = part.declaration.definition
    if definition is not None:
        words = ", ".join(("mass", "inertia", "at", "angle" if part.planar else "turn"))
        what = f"The body `{name}` has a definition"
        raise Wrong(WrongMechanism(definition.span, what, f"A body has attributes in braces: {words}."))
    mass, inertia, position, turn, starts, appearance = reader.together(
        lambda: _not_negative(reader, "mass", reader.scalar("mass", KILOGRAM)),
        lambda: _planar_inertia(reader) if part.planar else _inertia(reader),
        lambda: reader.point("at"),
        reader.turn,
        reader.starts,
        lambda: _appearance(reader),
    )
    return Body(name, mass, inertia, position, turn, starts, part.entry.span, appearance)


def _appearance(reader: PartAttributes) -> Appearance:
    """Shape and colour of a body in pictures. Raises `Wrong`."""
    colour = reader.word("colour", ("", *COLOURS), f"Colours: {', '.join(COLOURS)}.")
    attribute, planar = reader.given.get("shape"), reader.part.planar
    if attribute is None:
        return Appearance(colour=colour)
    hint = IN_THE_PLANE if planar else IN_SPACE
    call, counts = attribute.value, {"box": 2, "sphere": 1} if planar else SHAPES
    if not isinstance(call, tree.Call) or len(call.arguments) != counts.get(call.function):
        raise Wrong(WrongType(call.span, "A shape", f"`{call.span.words}`", hint))
    sizes: list[Bound] = []
    for number, argument in enumerate(call.arguments):
        count = 3 if call.function == "cylinder" and number else 1
        lengths = static_bounds(
            reader.resolver, argument, reader.part.scope, METRE, f"`{argument.span.words}`", count, hint
        )
        words = f"shape of {reader.part.entry.name}"
        values = known_or_later(reader.resolver, lengths, argument.span, words, not_zero if count > 1 else list)
        if values is not None and not (any(values) and (count > 1 or values[0] > 0)):
            raise Wrong(
                WrongMechanism(
                    argument.span,
                    f"The shape of `{reader.part.entry.name}` has no size",
                    "Lengths of a shape are positive.",
                )
            )
        sizes += lengths
    return Appearance(call.function, tuple(sizes), colour)


def _not_negative(reader: PartAttributes, word: str, bound: Bound) -> Bound:
    name, span = reader.part.entry.name, reader.part.entry.span
    known = known_or_later(reader.resolver, [bound], span, f"{word} of {name}", not_negative)
    if known is not None and known[0] < 0:
        what = f"The {word} of `{name}` is negative: {known[0]:g}"
        raise Wrong(WrongMechanism(span, what, "Masses and inertias are zero or positive."))
    return bound


def _planar_inertia(reader: PartAttributes) -> Inertia:
    moment = reader.scalar("inertia", MOMENT, "In the plane a body has one inertia, about the axis out of it.")
    return Inertia(zz=_not_negative(reader, "inertia", moment))


def _inertia(reader: PartAttributes) -> Inertia:
    """Three principal moments of inertia, or the six entries of the tensor. Negative kinetic energy is refused."""
    attribute, resolver, scope = reader.given.get("inertia"), reader.resolver, reader.part.scope
    if attribute is None:
        return Inertia()
    template = resolver.template(attribute.value, scope)
    expected = "An inertia (Ixx, Iyy, Izz) or (Ixx, Iyy, Izz, Ixy, Ixz, Iyz)"
    hint = "About the centre of mass, in the body's own axes; of a ball three times the same number."
    parts = counted(template, attribute.value, (3, 6), expected, hint)
    of_dimension(parts, attribute.value, scope, (MOMENT,), "`inertia`")
    bounds = static(resolver, template, scope, "`inertia`", attribute.value.span)
    words = f"inertia of {reader.part.entry.name}"
    known = known_or_later(resolver, bounds, attribute.span, words, takes_energy(ROUNDING))
    if known is not None:
        principal = principal_moments([*known, 0.0, 0.0, 0.0][:6])
        if is_impossible(principal):
            shown = ", ".join(f"{p:.6g}" for p in principal)
            what = f"The inertia of `{reader.part.entry.name}` is impossible: its principal moments are {shown} kg*m^2"
            hint = "No moment can be negative. Ixy, Ixz, Iyz are entries of the tensor: minus the integrals of xy, xz, yz over the mass."
            raise Wrong(WrongMechanism(attribute.value.span, what, hint))
    return Inertia(*bounds)


def read_frame(reader: PartAttributes, entry: MechanismEntry) -> Frame:
    """A frame. Raises `Wrong`."""
    part, name = reader.part, reader.part.entry.name
    definition = part.declaration.definition
    if not isinstance(definition, tree.PathSyntax):
        point = "(x, y)" if part.planar else "(x, y, z)"
        what = f"The frame `{name}` is on no body"
        raise Wrong(WrongMechanism(part.entry.span, what, f"Write `frame name : body {{ at = {point} }}`."))
    found = part_named(reader, definition, part.scope, entry, "A body", "Name a body, or `ground`.")
    if found is not None and found.kind != "body":
        what = f"`{definition.words}` is a {noun_of(found.kind)}, not a body"
        raise Wrong(WrongMechanism(definition.span, what, "A frame is a point of a body, or of `ground`."))
    hint = "`axes = world` or `body`: in which its force, torque and pose are."
    point, starts, axes = reader.together(
        lambda: reader.point("at"), reader.starts, lambda: reader.word("axes", ("world", "body"), hint)
    )
    return Frame(name, GROUND if found is None else found.name, point, part.entry.span, starts, axes)


def part_named(
    reader: PartAttributes, place: tree.ExpressionSyntax, scope: Scope, entry: MechanismEntry, what: str, hint: str
) -> PartEntry | None:
    """The part of that name; None for the ground. Raises `Wrong` or `AlreadyTold`."""
    if not isinstance(place, tree.PathSyntax):
        raise Wrong(WrongType(place.span, what, "an expression", hint))
    if place.words == GROUND:
        return None
    found = entry.parts.entries.get(place.head)
    if isinstance(found, Array) and len(place.steps) == 1 and isinstance(place.steps[0], tree.Index):
        index = reader.resolver.index_of(place.steps[0], scope)
        assert index is not None
        found = found.items.get(index)
    elif place.steps:
        found = None
    if isinstance(found, Broken):
        raise AlreadyTold
    if not isinstance(found, PartEntry):
        known = [n for n, e in entry.parts.entries.items() if isinstance(e, PartEntry | Array)]
        hint = suggestion(place.head, known, "Bodies are declared in the same block.")
        raise Wrong(UnknownName(place.span, place.words, f"the mechanism `{entry.name}`", hint))
    return found
