"""Value that an event, a start or a sampling sets: of the unit and kind of its target."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

from ...algebra.expression import ONE as TRUE
from ...algebra.expression import ZERO, select
from ...algebra.formula import Bound, Formula
from ...graph.units import ONE
from ...syntax import tree
from ..expressions.lists import fitted, parts_of, shape_of, shaped, sort_of
from ..expressions.template import Typed
from ..names.errors import WrongType
from ..names.scope import Items, Scalar, Scope
from ..names.statement_errors import Wrong, suggestion, wrong_unit
from .elaborate import Elaborator


def _in_numbers(value: tree.ExpressionSyntax, choices: tuple[str, ...]) -> tree.ExpressionSyntax:
    """A value of a mode that is one of several words, with numbers for these. Raises `Wrong`."""
    if isinstance(value, tree.ChoiceSyntax):
        first, other = (_in_numbers(v, choices) for v in (value.value, value.otherwise))
        return replace(value, value=first, otherwise=other)
    word = value.words if isinstance(value, tree.PathSyntax) else ""
    if word not in choices:
        hint = suggestion(word, choices, f"It can be: {', '.join(choices)}.")
        raise Wrong(WrongType(value.span, f"One of {', '.join(choices)}", f"`{value.span.words}`", hint))
    return tree.Literal(value.span, 1, Fraction(1 + choices.index(word)), None)


def read_value(
    elaborator: Elaborator, value: tree.ExpressionSyntax, scope: Scope, target: Scalar, what: str, static: bool = False
) -> Bound:
    """New value of a target: for a mode that is a truth a condition (1 or 0), else a number of its unit. Raises `Wrong`."""
    (bound,) = read_values(elaborator, value, scope, target, what, static)
    return bound


def read_values(
    elaborator: Elaborator, value: tree.ExpressionSyntax, scope: Scope, found: Scalar | Items, what: str, static: bool = False
) -> list[Bound]:  # fmt: skip
    """New values of the items of a list or matrix, or of a single target. Raises `Wrong`."""
    targets = found.items if isinstance(found, Items) else (found,)
    words = found.choices if isinstance(found, Scalar) else ()
    template = elaborator.template(_in_numbers(value, words) if words else value, scope)
    parts = parts_of(template.value)
    alike = shaped(parts[:1] * len(targets), found.columns) if isinstance(found, Items) else parts[0]
    if shape_of(fitted(template.value, alike)) != shape_of(alike):
        raise Wrong(WrongType(value.span, sort_of(alike).capitalize(), sort_of(template.value)))
    for target, typed in zip(targets, parts, strict=True):
        _check_kind(value, scope, target, typed, what)
    if static:
        elaborator.require_static(template, scope, what)
    numbers = (
        Formula(len(template.slots), select(t.expression, TRUE, ZERO)) if t.truth else f
        for t, f in zip(parts, template.formulas, strict=True)
    )
    return [elaborator.bind(template, formula, scope) for formula in numbers]


def _check_kind(value: tree.ExpressionSyntax, scope: Scope, target: Scalar, typed: Typed, what: str) -> None:
    """Raise `Wrong` for a condition in place of a number, or a wrong unit."""
    if target.truth != typed.truth:
        kinds = ("A condition", "a number") if target.truth else ("A number", "a condition")
        example = "true" if target.truth else "1 if c else 0"
        raise Wrong(WrongType(value.span, kinds[0], kinds[1], f"{what} is {kinds[0].lower()}: `… = {example}`."))
    wanted = target.dimension or ONE
    if not scope.plain and typed.dimension not in (None, wanted):
        raise wrong_unit(what, wanted, value, typed.dimension)
