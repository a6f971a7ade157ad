"""Functions defined in a model: checks of their names and places, and of the names that they read."""

from __future__ import annotations

from collections.abc import Iterable

from ...syntax import tree
from ..names.errors import DuplicateName, ReservedName
from ..names.scope import RESERVED, Array, Entry, Pending, Scalar, Scope, functions_in
from ..names.statement_errors import Wrong

READABLE = ("parameter", "constant")


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
