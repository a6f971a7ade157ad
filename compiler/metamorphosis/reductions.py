"""Smaller texts: those with one statement, one item or one name less, for the search of the smallest that still shows something."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from ..syntax import tree
from ..syntax.blocks import Statements
from .text_changes import TextScene


def smallest(scene: TextScene, holds: Callable[[TextScene], bool]) -> TextScene:
    """Remove pieces one by one, each for good if `holds` remains true, until none can go or `holds` is false for all."""
    while True:
        before = scene
        for name in scene.outputs[1:]:
            fewer = without_output(scene, name)
            if len(scene.outputs) > 1 and holds(fewer):
                scene = fewer
        place = 0
        while (smaller := _without(scene.statements, place)) is not None:
            reduced = replace(scene, statements=smaller)
            if holds(reduced):
                scene = reduced
            else:
                place += 1
        if scene == before:
            return scene


def without_output(scene: TextScene, name: str) -> TextScene:
    """A text whose output of this name is not compared."""
    return replace(scene, outputs=tuple(n for n in scene.outputs if n != name))


def _without(statements: Statements, place: int) -> Statements | None:
    """The statements without the piece number `place`; None if there are fewer pieces."""
    for number, reduced in enumerate(_reduced(statements)):
        if number == place:
            return reduced
    return None


def _reduced(statements: Statements) -> Iterator[Statements]:
    """All statements with one piece less, the last first: it is read by nothing before it, mostly."""
    for k in range(len(statements) - 1, -1, -1):
        before, node, after = statements[:k], statements[k], statements[k + 1 :]
        yield before + after
        for smaller in _pieces(node):
            yield (*before, smaller, *after)


def _pieces(node: tree.SyntaxNode) -> Iterator[tree.SyntaxNode]:
    """One statement with one piece less."""
    match node:
        case tree.ModelSyntax():
            yield from (replace(node, statements=s) for s in _reduced(node.statements))
            declarations = [s for s in node.statements if isinstance(s, tree.Declaration)]
            for name in [n.name for d in declarations for n in d.names]:
                yield replace(node, statements=tuple(_unbonded(node.statements, name)))
        case tree.LoopSyntax() | tree.MechanismSyntax():
            yield from (replace(node, statements=s) for s in _reduced(node.statements))
        case tree.ConditionalSyntax():
            yield from (replace(node, statements=s) for s in _reduced(node.statements))
            yield from (replace(node, otherwise=s) for s in _reduced(node.otherwise))
        case tree.Experiment():
            yield from (replace(node, steps=s) for s in _reduced(node.steps))
        case tree.Quantities() if len(node.items) > 1 and not node.equations:
            for k in range(len(node.items)):
                yield replace(node, items=node.items[:k] + node.items[k + 1 :])
        case tree.Declaration() if node.attributes:
            yield replace(node, attributes=())


def _unbonded(statements: Statements, name: str) -> Iterator[tree.SyntaxNode]:
    """The statements of a model without an element and its bonds."""
    for s in statements:
        if isinstance(s, tree.Declaration):
            names = tuple(d for d in s.names if d.name != name)
            if names:
                yield replace(s, names=names)
        elif isinstance(s, tree.Bonds):
            groups = [tuple(p for p in (_member(p, name) for p in group) if p is not None) for group in s.places]
            if groups and not groups[0]:
                groups = groups[1:]
            if groups and not groups[-1]:
                groups = groups[:-1]
            if len(groups) > 1 and all(groups):
                yield replace(s, places=tuple(groups), arrows=s.arrows[: len(groups) - 1])
        else:
            yield s


def _member(place: tree.PathSyntax | tree.Nest, name: str) -> tree.PathSyntax | tree.Nest | None:
    """A place of a bond without an element; None if it is that."""
    if isinstance(place, tree.PathSyntax):
        return None if place.head == name else place
    members = tuple(m for m in (_member(m, name) for m in place.members) if m is not None)
    return replace(place, members=members) if members else None
