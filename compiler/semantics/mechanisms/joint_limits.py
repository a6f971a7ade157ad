"""`limits = (a, b)` of a joint: the same as a `require` on its coordinate, under the joint's name."""

from __future__ import annotations

from ...algebra.expression import ONE as TRUE
from ...algebra.expression import ZERO, Symbol, call, select
from ...algebra.formula import Bound, bind
from ...graph.network import Reading, Requirement
from ...syntax import tree
from ..names.errors import WrongMechanism
from ..names.part_kinds import noun_of
from ..names.statement_errors import Wrong
from .part_attributes import PartAttributes, counted, of_dimension, static


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
    first, second = (reader.resolver.value_of(b, attribute.span) for b in (low, high))
    if first is not None and second is not None and first > second:
        what = f"The limits of `{reader.part.entry.name}` are the wrong way round: {first:g} is more than {second:g}"
        raise Wrong(WrongMechanism(attribute.value.span, what, "The lower one comes first."))


def _texts(value: tree.ExpressionSyntax) -> tuple[str, str]:
    """The limits as they are written."""
    if isinstance(value, tree.VectorSyntax):
        first, second = (" ".join(item.span.text.split()) for item in value.items)
        return first, second
    return " ".join(value.span.text.split()), ""
