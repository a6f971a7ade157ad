"""Statements within statements: those of loops and of conditional parts, and all nodes of a tree."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from functools import cache
from typing import Any

from .tree import ConditionalSyntax, LoopSyntax, SyntaxNode

Statements = tuple[SyntaxNode, ...]
WITHOUT_NODES = frozenset({"Span", "str", "int", "bool", "Fraction", "Index", "tuple[str, ...]"})  # types of fields


def inner_blocks(statement: SyntaxNode) -> tuple[Statements, ...]:
    """The block of a loop, the branches of an `if`; none for another statement."""
    match statement:
        case LoopSyntax():
            return (statement.statements,)
        case ConditionalSyntax():
            return statement.statements, statement.otherwise
    return ()


def with_inner_blocks(statement: SyntaxNode, change: Callable[[Statements], Statements]) -> SyntaxNode:
    """Return a loop or an `if` with its blocks changed; another statement as it is."""
    match statement:
        case LoopSyntax():
            return replace(statement, statements=change(statement.statements))
        case ConditionalSyntax():
            branches = change(statement.statements), change(statement.otherwise)
            return replace(statement, statements=branches[0], otherwise=branches[1])
    return statement


def flat(statements: Statements) -> Iterator[SyntaxNode]:
    """Statements and those in loops and conditional parts."""
    for statement in statements:
        yield statement
        for block in inner_blocks(statement):
            yield from flat(block)


@cache
def _fields_with_nodes(kind: Any) -> tuple[str, ...]:
    return tuple(f.name for f in fields(kind) if str(f.type).removesuffix(" | None") not in WITHOUT_NODES)


def nodes_in(start: object, beside: type[SyntaxNode] | tuple[()] = ()) -> Iterator[SyntaxNode]:
    """Yield a node, or all nodes of a tuple, and the nodes in them, the last ones first. Indices of paths are not entered, nor nodes of a kind `beside`."""
    stack = [start]
    while stack:
        item = stack.pop()
        if isinstance(item, tuple):
            stack += item
        elif isinstance(item, SyntaxNode) and not isinstance(item, beside):
            yield item
            kind: type = type(item)
            stack += [getattr(item, name) for name in _fields_with_nodes(kind)]
