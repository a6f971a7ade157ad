"""Functions defined in a model: checks of their names and places, and of the names that they read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from fractions import Fraction
from typing import Any

from ...source import Source, Span
from ...syntax import tree
from ..names.errors import DuplicateName, ReservedName
from ..names.scope import RESERVED, Array, Entry, Pending, Scalar, Scope, functions_in
from ..names.statement_errors import Wrong

READABLE = ("parameter", "constant")
_RADIANS = Span(Source("", "rad/s"), 0, 5)
RATE_OF_ANGLE = tree.Literal(
    _RADIANS, 0, Fraction(1), tree.Unit(_RADIANS, (), Fraction(1))
)  # stands for a law's own `omega`

# Names, with what is written for them, and those around where that is written.
Written = tuple[Mapping[str, tree.ExpressionSyntax], "Written | None"]


def check_function(scope: Scope, function: tree.FunctionSyntax, block: Iterable[tree.SyntaxNode]) -> None:
    """Check that a function of a model, or of a `for` in it, has a name that is used nowhere else. Raises `Wrong`."""
    if function.name in RESERVED:
        raise Wrong(ReservedName(function.span, function.name))
    around = scope.outer.function(function.name) if scope.outer is not None else None
    other = functions_in(block)[function.name] if around is None else around[0]
    other = scope.definition.file.functions.get(function.name, other)
    if other is not function:
        raise Wrong(DuplicateName(function.span, function.name, other.span))
    before = scope.find(function.name)
    if before is not None:
        first = before.item.span if isinstance(before, Pending) else getattr(before, "span", function.span)
        raise Wrong(DuplicateName(function.span, function.name, first))


def may_read(entry: Entry | None) -> bool:
    """Return True if a function of the model may read this entry: a parameter, a constant, an index of a `for`, or an array of them."""
    if isinstance(entry, Array):
        return all(may_read(item) for item in entry.items.values())
    if isinstance(entry, Scalar):
        return entry.role == "index"
    return isinstance(entry, Pending) and entry.role in READABLE


def opened(node: Any, written: Written | None) -> Any:
    """Return a part of the text with what is written for names in their places, which is read with the names around the call."""
    match node:
        case tree.PathSyntax() if written is not None and (node.words in written[0] or node.head in written[0]):
            put = written[0].get(node.words, written[0].get(node.head))
            return replace(put, span=node.span) if put is RATE_OF_ANGLE else opened(put, written[1])
        case tree.SyntaxNode() if written is not None:
            return replace(node, **{f.name: opened(getattr(node, f.name), written) for f in fields(node)})
        case tuple():
            return tuple([opened(part, written) for part in node])
    return node
