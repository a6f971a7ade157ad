"""Tree layout: straight bonds at right angles, power from left to right, the branches of a node around it.

The layout goes from the leaves to the root. A branch is completed for each direction in which it can grow; the node tries assignments of branches
to sides and pushes each branch outwards until nothing touches. So nothing overlaps by construction. (Libraries were considered: layered layouts
bend bonds and do not know the four sides of a letter, force layouts know no right angles; a textbook's picture needs both.)
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import permutations
from typing import Any

from compiler.api import ELEMENTS

from .blocks import DOWN, LEFT, RIGHT, UP, Block, Draft, Growth, TreeBranch
from .box import box_around
from .diagram_model import DiagramLine, DiagramNode
from .glyphs import GAP, half_width, letter_and_label, reach, shortest
from .overlap import Rectangles, Vector, bounds, corridor, joined, lane, moved, push, touches

SIDES = (RIGHT, DOWN, LEFT, UP)
CORNERS = ((0.7, 0.7), (0.7, -0.7), (-0.7, 0.7), (-0.7, -0.7))
BETWEEN = ((0.4, 0.9), (0.4, -0.9), (-0.4, 0.9), (-0.4, -0.9), (0.9, 0.4), (0.9, -0.4), (-0.9, 0.4), (-0.9, -0.4))
# Preferred sides of an element at the end of a bond, best first.
_BY_LETTER = {"R": RIGHT, "D": DOWN, "L": LEFT, "U": UP}
LIKES: Mapping[str, tuple[Vector, ...]] = {
    **{word: tuple(_BY_LETTER[side] for side in row.places) for word, row in ELEMENTS.items() if row.places},
    "": (UP, DOWN, LEFT, RIGHT),
}
# costs in px: of a turn, of power from the right, of a side that is not preferred
TURN, AGAINST, DISLIKE = 30.0, 24.0, 8.0


Arrangement = Sequence[tuple[TreeBranch, Vector]]
# node, space and branches, each with the number of its own part -> number, and the part in each direction
Parts = dict[tuple[Any, ...], tuple[int, dict[Vector, Block]]]


def grow_tree(
    nodes: Sequence[DiagramNode],
    lines: Sequence[DiagramLine],
    branches: Mapping[int, Sequence[TreeBranch]],
    root: int,
    roomy: float = 0.0,
    earlier: Parts | None = None,
) -> Block:
    """Return the positions of all descendants of a root, which is at the origin.

    `earlier`: completed parts of trees of the same nodes and lines, to which those of this tree are added.
    """
    order = [root]
    for node in order:
        order += [b.child for b in branches[node]]
    tree = Growth(nodes, lines, branches, {}, roomy)
    numbers = dict[int, int]()
    for node in reversed(order[1:]):
        key = (node, roomy, *((b, numbers[b.child]) for b in branches[node]))
        numbers[node], part = (earlier or {}).get(key) or (len(earlier or ()), {})
        tree.finished[node] = part
        if not part:
            part |= {along: _grow(tree, node, along) for along in SIDES}
            part |= {along: _slanted(tree, node, along) for along in (*CORNERS, *BETWEEN)}
        if earlier is not None:
            earlier[key] = numbers[node], part
        for branch in branches[node]:
            del tree.finished[branch.child]
    return _grow(tree, root, None)


def _grow(tree: Growth, node: int, along: Vector | None) -> Block:
    if tree.nodes[node].shape == "box":
        return box_around(tree, node, along)
    best, worth = None, math.inf
    for least, sides in _by_price(tree, _arrangements(tree, node, along)):
        if least >= worth:
            break  # the remaining arrangements cost more even without pushing
        block = _arranged(tree, sides, node, along)
        if best is None or round(block.worth, 3) < worth:
            best, worth = block, round(block.worth, 3)
    assert best is not None
    return best


def _by_price(tree: Growth, arrangements: Iterator[Arrangement]) -> list[tuple[float, Arrangement]]:
    """Return arrangements with the least cost of each, cheapest first."""
    priced = []
    for sides in arrangements:
        blocks = [tree.part(b, s) for b, s in sides]
        least = sum(b.cost + b.reach for b in blocks) + sum(
            _price(tree.child(b), b, s) + shortest(tree.child(b)) for b, s in sides
        )
        wide = [bounds(b.taken) for b in blocks]
        size = 0.15 * max((w[2] - w[0] for w in wide), default=0.0) + 0.25 * max(
            (w[3] - w[1] for w in wide), default=0.0
        )
        priced.append((least + size, sides))
    return sorted(priced, key=lambda item: item[0])


def _slanted(tree: Growth, node: int, along: Vector) -> Block:
    """Return a part at the end of a slanted bond, grown to the right or to the left."""
    own = tree.nodes[node]
    if tree.branches[node] or own.shape == "box":
        block = tree.finished[node][RIGHT if along[0] > 0 else LEFT]
        far = max((abs(x) for x in bounds(block.taken[:1])), default=0.0) if own.shape == "box" else 0.0
        return replace(block, cost=block.cost + 60, reach=max(far, block.reach))
    taken, label = letter_and_label(own, along, alone=True)
    return Block({node: (0.0, 0.0)}, {node: label}, {}, {}, taken, 0.0, reach(own, along))


# ---------------------------------------------------------------- which goes where


def _arrangements(tree: Growth, node: int, along: Vector | None) -> Iterator[Arrangement]:
    """Yield assignments of branches to sides: heavy ones in every order, the ends of bonds at their preferred sides."""
    free = [s for s in SIDES if along is None or s != (-along[0], -along[1])]
    own, branches = tree.nodes[node], tree.branches[node]
    heavy = [b for b in branches if b.heavy]
    light = sorted(
        (b for b in branches if not b.heavy), key=lambda b: (not b.likes, tree.child(b).letter in ("I", "C"))
    )
    through = own.shape == "element" and sum(tree.child(b).shape != "signal" for b in branches) == (
        2 if along is None else 1
    )
    named = bool(own.label)  # a label is left above
    open_to = [s for s in (*CORNERS, *BETWEEN) if not (named and s[0] < 0 and s[1] < 0)]
    for sides in permutations(free, min(len(heavy), len(free))):
        if any(b.side in free and b.side != s for b, s in zip(heavy, sides, strict=False)):
            continue
        taken: list[tuple[TreeBranch, Vector]] = list(zip(heavy, sides, strict=False))
        left, slanted = [s for s in free if s not in sides], list(open_to)
        for branch in (*light, *heavy[len(free) :]):
            likes = [s for s in _likes(tree.child(branch), branch) if s in left]
            ahead = along if along is not None or not sides else (-sides[0][0], -sides[0][1])
            if ahead in left and through and tree.child(branch).shape != "signal":
                likes = [ahead]  # straight on behind a transformer and its like
            side = likes[0] if likes else slanted.pop(0) if slanted else RIGHT
            if likes:
                left.remove(side)
            taken.append((branch, side))
        yield sorted(taken, key=lambda item: (item[0].heavy, item[0].side is not None, item[1] not in SIDES))


def _likes(node: DiagramNode, branch: TreeBranch) -> Sequence[Vector]:
    """Return the preferred sides of the end of a bond, best first."""
    return branch.likes or LIKES.get(node.letter, SIDES)


def _price(node: DiagramNode, branch: TreeBranch, side: Vector) -> float:
    """Return the cost of a branch at a side."""
    power = side[0] if branch.outwards else -side[0]
    if branch.heavy:
        return TURN * (side[1] != 0) + AGAINST * (power < 0)
    likes = _likes(node, branch)
    return DISLIKE * (likes.index(side) if side in likes else 3)


def _arranged(tree: Growth, sides: Arrangement, node: int, along: Vector | None) -> Block:
    """Return a letter with its branches at given sides, each as near as possible without contact."""
    letter = tree.nodes[node]
    own, label = letter_and_label(letter, along, alone=all(tree.child(b).shape == "signal" for b, _ in sides))
    behind = corridor(along, reach(letter, along)) if along is not None and sides else own[:0]
    draft = Draft({node: (0.0, 0.0)}, {node: label}, {}, joined(own, behind))
    for branch, side in sides:
        block = tree.part(branch, side)
        start = _foot(letter, side)
        least = start + max(branch.least, shortest(tree.child(branch))) + tree.roomy * branch.heavy + GAP + block.reach
        x, y = side
        # slanted bonds separate from the others there
        free = start if not (x and y) else max(start, 14.5 / min(abs(x), abs(y)))
        distance = _clear(draft.taken, block, side, free, least)
        draft.cost += 5000.0 * (distance == math.inf)
        distance = least if distance == math.inf else distance
        foot, tip = (x * start, y * start), (x * (distance - block.reach - GAP), y * (distance - block.reach - GAP))
        draft.add(block.at(x * distance, y * distance), lane((x * free, y * free), tip))
        draft.ends[branch.line, node], draft.ends[branch.line, branch.child] = foot, tip
        draft.cost += distance + _price(tree.child(branch), branch, side)
    back = reach(letter, along) if along is not None else half_width(letter)
    return draft.block(range(len(own), len(own) + len(behind)), back)


def _foot(node: DiagramNode, side: Vector) -> float:
    """Return the distance from the middle of a letter at which a bond begins."""
    x, y = side
    return reach(node, side) + GAP if not (x and y) else min(22.0, 14.5 / min(abs(x), abs(y)))


def _clear(taken: Rectangles, block: Block, side: Vector, start: float, least: float) -> float:
    """Return the distance at which neither a part nor its bond touches occupied space; infinite if there is none.

    What the bond touches, a longer one touches, too.
    """
    x, y = side
    distance = push(taken, block.taken, side, least)
    tip = distance - block.reach - GAP
    bond = lane((x * start, y * start), (x * tip, y * tip))
    own = moved(block.taken[1:], x * distance, y * distance)
    return math.inf if touches(taken[1:], bond, 1.0) or touches(own, bond, 1.0) else distance
