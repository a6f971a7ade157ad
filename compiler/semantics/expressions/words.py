"""Comparisons of what is no number: choices with their words, and texts."""

from __future__ import annotations

from ...algebra.expression import Expression, Number, call
from ...graph.units import ONE
from ...syntax import tree
from ..names.errors import WrongType
from ..names.statement_errors import Wrong, suggestion
from .template import Typed

Sides = tuple[Typed | None, Typed | None]


def compare_words(node: tree.Comparison, sides: Sides) -> Typed:
    """Return the comparison of a choice with one of its words or with another choice of the same words, or that of two texts.

    `sides`: the choices and texts in it; None for a side that is neither. Raises `Wrong`.
    """
    choices = next((side.choices for side in sides if side is not None and side.choices), ())
    numbers = _numbers(node, sides, choices) if choices else _equal(node, sides)
    if node.operator not in ("==", "!="):
        hint = f"It is compared by `==` and `!=`: `{node.left.span.words} == {node.right.span.words}`."
        raise Wrong(WrongType(node.span, "A comparison of choices or texts", f"`{node.operator}`", hint))
    same = call("equal", *numbers)
    return Typed(same if node.operator == "==" else call("not", same), ONE, truth=True)


def _numbers(node: tree.Comparison, sides: Sides, choices: tuple[str, ...]) -> list[Expression]:
    """Return the numbers of both sides among the words of a choice."""
    numbers: list[Expression] = []
    for side, written in zip(sides, (node.left, node.right), strict=True):
        word = written.words if isinstance(written, tree.PathSyntax) else ""
        if word in choices and (side is None or sides != (side, side)):
            numbers.append(Number(1.0 + choices.index(word)))
        elif side is not None and side.choices == choices:
            numbers.append(side.expression)
        else:
            hint = suggestion(written.span.words.strip('"'), choices, f"It can be: {', '.join(choices)}.")
            raise Wrong(WrongType(written.span, f"One of {', '.join(choices)}", f"`{written.span.words}`", hint))
    return numbers


def _equal(node: tree.Comparison, sides: Sides) -> list[Expression]:
    """Return two numbers that are equal if two texts are."""
    for side, written in zip(sides, (node.left, node.right), strict=True):
        if side is None:
            hint = 'A text is compared with a text, in quotation marks: `kind == "a"`.'
            raise Wrong(WrongType(written.span, "A text", f"`{written.span.words}`", hint))
    first, second = (None if side is None or side.text is None else side.text.value for side in sides)
    return [Number(1.0), Number(float(first == second))]
