"""`require CONDITION "text"`: conditions under which an instance is valid."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ...algebra.expression import ONE as TRUE
from ...algebra.expression import ZERO, Expression, call, select
from ...algebra.formula import bind
from ...graph.network import Named, Requirement
from ...graph.run_time_parameters import behind, quantities_in
from ...graph.units import ONE
from ...syntax import tree
from ..names.scope import STATIC_ROLES, Scope
from ..resolution.resolver import read_condition
from .elaborate import Elaborator

MAXIMUM_READINGS = 6  # values that a warning shows


def read_requirements(elaborator: Elaborator) -> tuple[Requirement, ...]:
    """Conditions of all instances, and limits of joints. Errors are collected."""
    found = [elaborator.guard(_read, elaborator, scope, statement) for scope, statement in elaborator.requirements]
    return (*(item for item in found if item is not None), *elaborator.limits)


def parameter_checks(elaborator: Elaborator, quantities: Mapping[str, Named]) -> Iterator[Requirement]:
    """Yield what a program for all values must find of its parameters before it begins."""
    conditions: dict[str, Expression] = {}
    for words, bound in elaborator.positive:
        if any(quantities[name].role == "parameter" for name in behind(quantities_in(bound), quantities)):
            conditions[words] = select(call("less_equal", ZERO, bound.expression), conditions.get(words, TRUE), ZERO)
    span = elaborator.root.definition.model.name_span
    for words, condition in conditions.items():
        yield Requirement("", bind(condition), words, "", (), span, None, True)


def _read(elaborator: Elaborator, scope: Scope, statement: tree.RequirementSyntax) -> Requirement:
    hint = 'Compare it with something: `require x < 1 mm "small"`.'
    template, condition = read_condition(elaborator, statement.condition, scope, hint)
    read = [(slot.words, elaborator.scalar_at(slot, scope)) for slot in template.slots]
    moving = [(words, scalar) for words, scalar in read if scalar.role not in STATIC_ROLES] or read
    readings = tuple((words, s.reference, str(s.dimension or ONE)) for words, s in moving[:MAXIMUM_READINGS])
    words = " ".join(statement.condition.span.text.split())
    name, stands = scope.path.removesuffix("."), scope.base().stands
    return Requirement(name, condition, words, statement.text, readings, statement.span, stands)
