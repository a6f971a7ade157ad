"""Attributes of one part of a mechanism: numbers, points and directions with values known before the run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ...algebra.formula import Bound
from ...graph.mechanism import ATTITUDE, NOTHING, ORIGIN, Vector
from ...graph.units import METRE, ONE, Dimension
from ...source import Span
from ...syntax import tree
from ..expressions.lists import parts_of, rows_of, sort_of
from ..expressions.template import Template, Typed
from ..names.errors import DimensionMismatch, UnknownAttribute, WrongMechanism, WrongType, WrongValue
from ..names.part_kinds import NEEDED, TARGETED, attributes_of, foreign_attribute, noun_of
from ..names.scope import DeclaredPart, Scope
from ..names.statement_errors import AlreadyTold, Wrong, describe, suggestion, unit_hint
from ..resolution.conditions import known_or_later, not_zero
from ..resolution.resolver import Resolver

EXPECTED = {1: "A single number", 2: "A point (x, y)", 3: "A point (x, y, z)"}


def static_bounds(
    resolver: Resolver, value: tree.ExpressionSyntax, scope: Scope, dimension: Dimension, what: str, count: int,
    hint: str = "",
) -> list[Bound]:  # fmt: skip
    """`count` numbers of one dimension that are known before the run. Raises `Wrong`."""
    template = resolver.template(value, scope)
    parts = counted(template, value, (count,), EXPECTED[count], hint)
    of_dimension(parts, value, scope, (dimension,), what)
    return static(resolver, template, scope, what, value.span)


def counted(
    template: Template, value: tree.ExpressionSyntax, counts: tuple[int, ...], expected: str, hint: str = ""
) -> tuple[Typed, ...]:
    """The parts of a list of one of these lengths. Raises `Wrong`."""
    parts, is_matrix = parts_of(template.value), bool(rows_of(template.value))
    if len(parts) not in counts or is_matrix:
        found = f"{len(parts)} numbers" if len(parts) > 1 and not is_matrix else sort_of(template.value)
        raise Wrong(WrongType(value.span, expected, found, *([hint] if hint else [])))
    return parts


def of_dimension(
    parts: tuple[Typed, ...], value: tree.ExpressionSyntax, scope: Scope, allowed: tuple[Dimension, ...], what: str
) -> None:
    """Raise `Wrong` unless all parts have one of these dimensions, and the same."""
    if scope.plain:
        return
    known = {p.dimension for p in parts} - {None}
    wrong = next((d for d in known if d not in allowed), None) or (known.pop() if len(known) > 1 else None)
    if wrong is not None:
        wanted = " or ".join(describe(d) for d in allowed)
        what = f"{what} is {wanted}, but `{value.span.text}` is {describe(wrong)}"
        hint = unit_hint(wrong, allowed[0], value)
        raise Wrong(DimensionMismatch(value.span, what, hint))


def static(resolver: Resolver, template: Template, scope: Scope, what: str, span: Span) -> list[Bound]:
    """Return the bound formulas of a template. Raises `Wrong` if one reads a value that changes during a run, or has no value."""
    resolver.require_static(template, scope, what)
    bounds = [resolver.bind(template, formula, scope) for formula in template.formulas]
    for bound in bounds:
        resolver.value_of(bound, span, decides=False)
    return bounds


def vector(
    resolver: Resolver, value: tree.ExpressionSyntax, scope: Scope, dimension: Dimension, what: str, planar: bool
) -> Vector:
    """Point or vector in the space of the mechanism; z = 0 in the plane."""
    hint = "In the plane it has two components." if planar else "In space it has three components."
    bounds = static_bounds(resolver, value, scope, dimension, what, 2 if planar else 3, hint)
    return bounds[0], bounds[1], NOTHING if planar else bounds[2]


class PartAttributes:
    """The attributes of one part."""

    def __init__(self, resolver: Resolver, part: DeclaredPart) -> None:
        self.resolver, self.part = resolver, part
        self.given: dict[str, tree.Attribute] = {}
        self.targeted: dict[str, dict[str, tree.Attribute]] = {word: {} for word in TARGETED}
        for attribute in part.declaration.attributes:
            resolver.guard(self._take, attribute)

    def _take(self, attribute: tree.Attribute) -> None:
        name, entry = attribute.name, self.part.entry
        allowed = attributes_of(entry.kind, self.part.planar)
        if name not in allowed:
            noun = noun_of(entry.kind)
            listed = f"A {noun} has: {', '.join(allowed)}." if allowed else f"A {noun} has no attributes."
            hint = foreign_attribute(entry.kind, name, self.part.planar) or suggestion(name, list(allowed), listed)
            raise Wrong(UnknownAttribute(attribute.span, entry.name, name, hint))
        words = "" if attribute.target is None else attribute.target.words
        if words and name not in TARGETED:
            raise Wrong(UnknownAttribute(attribute.span, entry.name, f"{name} {words}", f"Write `{name} = …`."))
        home, key = (self.targeted[name], words) if name in TARGETED else (self.given, name)
        if key in home:
            before = home[key].span.line
            hint = f"It is given on line {before}; leave one of the two out."
            raise Wrong(WrongMechanism(attribute.span, f"`{f'{name} {words}'.strip()}` is given twice", hint))
        home[key] = attribute

    @property
    def planar(self) -> bool:
        return self.part.planar

    def together(self, *readings: Callable[[], Any]) -> list[Any]:
        """Do several readings and return their results. All are done, so that all errors of a part are reported. Raises `AlreadyTold`."""
        before = len(self.resolver.diagnostics)
        found = [self.resolver.guard(reading) for reading in readings]
        if len(self.resolver.diagnostics) > before or any(item is None for item in found):
            raise AlreadyTold
        return found

    def needed(self, name: str) -> tree.Attribute:
        """A required attribute. Raises `Wrong`."""
        attribute = self.given.get(name)
        if attribute is None:
            kind, own = self.part.entry.kind, self.part.entry.name
            what, example = NEEDED[name]
            example = "along = 90 deg" if self.planar and name == "along" else example
            hint = f"Give it: `{{ {example} }}`."
            raise Wrong(WrongMechanism(self.part.declaration.span, f"The {noun_of(kind)} `{own}` has no {what}", hint))
        return attribute

    def scalar(self, name: str, dimension: Dimension, hint: str = "") -> Bound:
        """A number; zero if the attribute is missing."""
        attribute = self.given.get(name)
        if attribute is None:
            return NOTHING
        (bound,) = static_bounds(self.resolver, attribute.value, self.part.scope, dimension, f"`{name}`", 1, hint)
        return bound

    def nonzero(self, name: str, dimension: Dimension, why: str) -> Bound:
        """A required number other than zero."""
        attribute = self.needed(name)
        bound = self.scalar(name, dimension)
        words = f"{name} of {self.part.entry.name}"
        if known_or_later(self.resolver, [bound], attribute.span, words, not_zero) == [0]:
            what = f"The {name} of `{self.part.entry.name}` is zero"
            raise Wrong(WrongMechanism(attribute.value.span, what, why))
        return bound

    def positive(self, name: str, dimension: Dimension, why: str) -> Bound:
        """A required positive number."""
        bound = self.nonzero(name, dimension, why)
        attribute = self.needed(name)
        values = known_or_later(self.resolver, [bound], attribute.span, f"{name} of {self.part.entry.name}", list)
        if values is not None and values[0] < 0:
            what = f"The {name} of `{self.part.entry.name}` is negative"
            raise Wrong(WrongMechanism(attribute.value.span, what, why))
        return bound

    def point(self, name: str) -> Vector:
        """A position; the origin if the attribute is missing."""
        attribute = self.given.get(name)
        if attribute is None:
            return ORIGIN
        found = vector(self.resolver, attribute.value, self.part.scope, METRE, f"`{name}`", self.planar)
        for bound in found:  # values that are not finite are reported here, where their line is known
            self.resolver.value_of(bound, attribute.span, decides=False)
        return found

    def turn(self) -> Vector:
        """Rotation in the drawing: `angle` in the plane, the rotation vector `turn` in space."""
        if self.planar:
            return NOTHING, NOTHING, self.scalar("angle", ONE)
        attribute = self.given.get("turn")
        if attribute is None:
            return ORIGIN
        what, hint = "A rotation vector (rx, ry, rz)", "Its length is the angle: `turn = (0, 0, 30 deg)` is about z."
        return self._three(attribute, what, hint, (ONE,))

    def direction(self, name: str) -> Vector:
        """A direction: bare numbers or lengths, of any norm but zero."""
        attribute = self.needed(name)
        if self.planar:
            what, hint = "A direction (x, y)", f"Write `{name} = (0, 1)`."
            if name == "along":
                what, hint = "An angle or a direction (x, y)", "Write `along = 90 deg` or `along = (0, 1)`."
        else:
            what, hint = "A direction (x, y, z)", f"Write `{name} = (0, 0, 1)`."
        found = self._three(attribute, what, hint, (ONE, METRE))
        words = f"{name} of {self.part.entry.name}"
        values = known_or_later(self.resolver, found, attribute.span, words, not_zero)
        if values is not None and not any(values):
            what = f"The direction `{name}` of `{self.part.entry.name}` has the length zero"
            raise Wrong(
                WrongMechanism(
                    attribute.value.span,
                    what,
                    f"Any length but zero will do: `{'(0, 1)' if self.planar else '(0, 0, 1)'}`.",
                )
            )
        return found

    def _three(self, attribute: tree.Attribute, expected: str, hint: str, allowed: tuple[Dimension, ...]) -> Vector:
        """Two components in the plane, three in space."""
        resolver, scope = self.resolver, self.part.scope
        template = resolver.template(attribute.value, scope)
        parts = counted(template, attribute.value, (2,) if self.planar else (3,), expected, hint)
        of_dimension(parts, attribute.value, scope, allowed, f"`{attribute.name}`")
        bounds = static(resolver, template, scope, f"`{attribute.name}`", attribute.value.span)
        return bounds[0], bounds[1], NOTHING if self.planar else bounds[2]

    def word(self, name: str, allowed: tuple[str, ...], hint: str) -> str:
        """One of several words; the first if the attribute is missing."""
        attribute = self.given.get(name)
        if attribute is None:
            return allowed[0]
        found = attribute.value.words if isinstance(attribute.value, tree.PathSyntax) else ""
        if found not in allowed:
            text = attribute.value.span.text
            hint = suggestion(found, list(allowed), hint)
            raise Wrong(WrongValue(attribute.value.span, name, self.part.entry.name, text, hint))
        return found

    def locked(self) -> bool:
        """Return True if the joint is locked, so that it has no degree of freedom in this run."""
        attribute = self.given.get("locked")
        if attribute is None:
            return False
        template = self.resolver.template(attribute.value, self.part.scope)
        if not isinstance(template.value, Typed) or not template.value.truth:
            hint = "Write `locked = true`, or compare parameters: `locked = stroke == 0`."
            found = "a list" if isinstance(template.value, tuple) else "a number"
            raise Wrong(WrongType(attribute.value.span, "A condition", found, hint))
        (bound,) = static(self.resolver, template, self.part.scope, "`locked`", attribute.value.span)
        return bool(self.resolver.value_of(bound, attribute.value.span))

    # ------------------------------------------------------------ by coordinate
    def starts(self) -> Mapping[str, Bound]:
        """`start x = …`, `start x.v = …`, of a body in space `start attitude = (w, x, y, z)`; keys `x`, `x.f`, `attitude.w`."""
        result: dict[str, Bound] = {}
        for words, attribute in self.targeted["start"].items():
            if words == "attitude" and "attitude" in self.part.entry.groups:
                result.update(self._attitude(attribute))
            else:
                self.resolver.guard(self._start, words, attribute, result)
        if "attitude.w" in result and result.keys() & {"rx", "ry", "rz"}:
            span = self.targeted["start"]["attitude"].span
            what = f"The start of `{self.part.entry.name}` says twice how it is turned"
            self.resolver.tell(WrongMechanism(span, what, "Give the attitude, or rx, ry and rz."))
        return result

    def _start(self, words: str, attribute: tree.Attribute, result: dict[str, Bound]) -> None:
        port, variable = self._variable(words, "start", attribute, "qf")
        domain = self.part.entry.ports[port]
        key = port if variable == "q" else f"{port}.f"
        dimension = domain.dimension(variable)
        (result[key],) = static_bounds(
            self.resolver, attribute.value, self.part.scope, dimension, f"`start {words}`", 1
        )

    def _attitude(self, attribute: tree.Attribute) -> Mapping[str, Bound]:
        found = attitude_bounds(self.resolver, attribute.value, self.part.scope)
        return {} if found is None else {f"attitude.{c}": b for c, b in zip(ATTITUDE, found, strict=True)}

    def rests(self) -> Mapping[str, Bound]:
        """Values of the coordinates in the drawing, by coordinate."""
        result: dict[str, Bound] = {}
        for words, attribute in self.targeted["rest"].items():
            self.resolver.guard(self._rest, words, attribute, result)
        return result

    def _rest(self, words: str, attribute: tree.Attribute, result: dict[str, Bound]) -> None:
        port = self.coordinate(words, attribute)
        if port in ("rx", "ry", "rz"):
            what = f"The rotation vector of `{self.part.entry.name}` is zero in the drawing"
            hint = "Turn the axes of the joint, or the body, instead: rotation vectors do not add."
            raise Wrong(WrongMechanism(attribute.span, what, hint))
        dimension = self.part.entry.ports[port].dimension("q")
        (result[port],) = static_bounds(
            self.resolver, attribute.value, self.part.scope, dimension, f"`{f'rest {words}'.strip()}`", 1
        )

    def coordinate(self, words: str, attribute: tree.Attribute) -> str:
        """Coordinate that `limits` or `rest` names; without a name, the only one. Raises `Wrong`."""
        if not words and len(self.part.entry.ports) == 1:
            return next(iter(self.part.entry.ports))
        return self._variable(words, attribute.name, attribute, "q")[0]

    def _variable(self, words: str, name: str, attribute: tree.Attribute, allowed: str) -> tuple[str, str]:
        ports = self.part.entry.ports
        port, _, letter = words.partition(".")
        if port not in ports and len(ports) == 1:
            port, letter = next(iter(ports)), port
        domain = ports.get(port)
        variable = None if domain is None else (domain.variable(letter) if letter else "q")
        if domain is None or variable is None or variable not in allowed:
            first = next(iter(ports), "x")
            value = "(low, high)" if name == "limits" else "…"
            hint = f"Write `{name} {first} = {value}`"
            if words.startswith("attitude") and "attitude" in self.part.entry.groups:
                hint = "Write `start attitude = (w, x, y, z)`"
            elif "f" in allowed and ports:
                hint += f" or `{name} {first}.{ports[first].letter('f')} = …`"
            if len(ports) > 1:
                hint += f"; its coordinates: {', '.join(ports)}"
            raise Wrong(UnknownAttribute(attribute.span, self.part.entry.name, f"{name} {words}".strip(), f"{hint}."))
        return port, variable


def attitude_bounds(resolver: Resolver, value: tree.ExpressionSyntax, scope: Scope) -> list[Bound] | None:
    """A unit quaternion (w, x, y, z). On an error, which is collected, return None."""
    return resolver.guard(_attitude_bounds, resolver, value, scope)  # type: ignore[no-any-return]


def _attitude_bounds(resolver: Resolver, value: tree.ExpressionSyntax, scope: Scope) -> list[Bound]:
    template = resolver.template(value, scope)
    hint = "An attitude is a unit quaternion: `(1, 0, 0, 0)` is the drawing's axes; (cos(a/2), sin(a/2)*n) turns by a about n."
    parts = counted(template, value, (4,), "A unit quaternion (w, x, y, z)", hint)
    of_dimension(parts, value, scope, (ONE,), "`start attitude`")
    bounds = static(resolver, template, scope, "`start attitude`", value.span)
    _check_length(resolver, bounds, value.span)
    return bounds


def _check_length(resolver: Resolver, bounds: list[Bound], span: Span) -> None:
    values = [resolver.value_of(b, span) for b in bounds]
    known = [v for v in values if v is not None]
    length = sum(v * v for v in known) ** 0.5
    if len(known) == len(values) and abs(length - 1) > 1e-6:
        hint = "It is a unit quaternion (w, x, y, z)"
        if length:
            hint += f": divided by its length it is ({', '.join(f'{v / length:.9g}' for v in known)})"
        raise Wrong(WrongMechanism(span, f"This attitude has the length {length:.6g}, not 1", f"{hint}."))
