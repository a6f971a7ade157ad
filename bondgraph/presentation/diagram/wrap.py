"""Long chains in rows of a page's width: back and forth, each row below the one before, all bonds still straight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from .blocks import DOWN, LEFT, RIGHT, Block, TreeBranch
from .diagram_model import DiagramNode
from .overlap import MARGIN, Vector, bounds

LATEST = 1.25  # of a row's length: a row ends between two instances if it can

Branches = Mapping[int, Sequence[TreeBranch]]


def wrapped(
    nodes: Sequence[DiagramNode], branches: Branches, block: Block, root: int, rows: int
) -> dict[int, list[TreeBranch]]:
    """Return the branches of a tree, those on its longest way with the sides at which it goes on in its row or to the next."""
    left, top, right, bottom = bounds(block.taken)
    parents = {b.child: (parent, b) for parent, around in branches.items() for b in around if b.heavy}
    spine = [max([root, *parents], key=lambda n: abs(block.places[n][0] - block.places[root][0]))]
    while spine[-1] in parents:
        spine.append(parents[spine[-1]][0])
    steps = {
        n: max(abs(a - b) for a, b in zip(block.places[n], block.places[parents[n][0]], strict=True))
        for n in spine[:-1]
    }
    first, last = sorted(block.places[n][0] for n in (root, spine[0]))
    length = (sum(steps.values()) + first - left + right - last) / rows
    sides, drops, way, done = dict[int, Vector](), dict[int, float](), RIGHT, first - left
    for child, step in reversed(steps.items()):
        within = nodes[child].inside and nodes[child].inside == nodes[parents[child][0]].inside
        done += step
        sides[child] = way
        if done > length * (LATEST if within else 1.0):
            sides[child], drops[child], done, way = DOWN, bottom - top + MARGIN, 0.0, LEFT if way == RIGHT else RIGHT
    return {
        n: [replace(b, side=sides.get(b.child), least=drops.get(b.child, 0.0)) for b in around]
        for n, around in branches.items()
    }
