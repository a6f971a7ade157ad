"""Functions defined in a model: checks of their names and places, and of the names that they read."""

from __future__ import annotations

from ...syntax import tree
from ..names.errors import DuplicateName, ReservedName, Unsupported
from ..names.scope import RESERVED, Array, Entry, Pending, Scope
from ..names.statement_errors import Wrong

READABLE = ("parameter", "constant")


def check_function(scope: Scope, function: tree.FunctionSyntax) -> None:
    """Check that a function is defined at the top level of its model, under a name that is used nowhere else. Raises `Wrong`."""
    if scope.outer is not None:
        raise Wrong(Unsupported(function.span, "A function in a `for`", "Define it once, outside of the `for`."))
    if function.name in RESERVED:
        raise Wrong(ReservedName(function.span, function.name))
    definition = scope.definition
    same = next(
        s for s in definition.model.statements if isinstance(s, tree.FunctionSyntax) and s.name == function.name
    )  # fmt: skip
    other = definition.file.functions.get(function.name, same)
    if other is not function:
        raise Wrong(DuplicateName(function.span, function.name, other.span))
    before = scope.entries.get(function.name)
    if before is not None:
        first = before.item.span if isinstance(before, Pending) else getattr(before, "span", function.span)
        raise Wrong(DuplicateName(function.span, function.name, first))


def may_read(entry: Entry | None) -> bool:
    """Return True if a function of the model may read this entry: a parameter, a constant, or an array of them."""
    if isinstance(entry, Array):
        return all(may_read(item) for item in entry.items.values())
    return isinstance(entry, Pending) and entry.role in READABLE
