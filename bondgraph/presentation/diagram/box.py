"""Box with its branches: ports in rows along its sides, its name on top, in the size that this needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from .blocks import DOWN, LEFT, RIGHT, UP, Block, Boxed, Draft, Growth, TreeBranch
from .diagram_model import HEAD, TAIL, DiagramLine
from .glyphs import GAP, NAME, PORT, shortest, text_width
from .overlap import NOTHING, Rectangles, Vector, corridor, joined, lane, moved, push, rectangles

TITLE = 40.0  # height of kind and name
SPACE = 8.0  # between the branches of neighbouring ports
ROW = 26.0  # between two ports of a side
PADDING = 12.0
SPARE = np.array((0.0, -1.0, 0.0, 1.0))  # above and below
FRAMES = 30.0  # between parts that may get frames


def port_of(line: DiagramLine, node: int) -> str:
    """Return the name of the port at which a line meets a node."""
    return line.ports[TAIL if line.tail == node else HEAD]


def box_around(tree: Growth, node: int, along: Vector | None) -> Block:
    """Return a box with its branches, with the origin at the end of the bond that carries it (`along`), or at its middle."""
    sides = _sides(tree, node, along)
    widths = _widths(tree.lines, node, sides, along)
    rows = {side: _stacked(tree, sides[side], side, widths[side]) for side in sides}
    half, (above, below) = _size(_like(tree, node), widths, rows, along)
    borders = {LEFT: half, RIGHT: half, UP: above, DOWN: below}
    title = (0.0, -above + 16 + 14 * (bool(sides[UP]) or along == DOWN))
    boxed = Boxed(-half, -above, half, below, title)
    reach = borders[-along[0], -along[1]] if along is not None else 0.0
    far = corridor(along, reach) if along is not None else NOTHING
    draft = Draft({node: (0.0, 0.0)}, {}, {node: boxed}, joined(rectangles([(-half, -above, half, below)]), far))
    for side in (LEFT, RIGHT, UP, DOWN):
        x, y = side
        border = borders[side]
        row = list(zip(sides[side], rows[side], strict=True))
        level = _level(tree, draft.taken, row, side, border)
        for branch, offset in sorted(row, key=lambda item: not item[0].heavy):
            block = tree.part(branch, side)
            foot = (x * (border + GAP), offset) if x else (offset, y * (border + GAP))
            shifted = block.at(*((0.0, offset) if x else (offset, 0.0)))
            nearest = border + shortest(tree.child(branch)) + 2 * GAP + block.reach
            distance = push(draft.taken, shifted.taken, side, level if branch.heavy else nearest)
            tip = distance - block.reach - GAP
            end = (x * tip, offset) if x else (offset, y * tip)
            draft.add(shifted.at(x * distance, y * distance), lane(foot, end))
            draft.ends[branch.line, node], draft.ends[branch.line, branch.child] = foot, end
            draft.cost += distance
    return draft.block(range(1, 1 + len(far)), reach)


def _level(
    tree: Growth, taken: Rectangles, row: Sequence[tuple[TreeBranch, float]], side: Vector, border: float
) -> float:
    """Return the distance of the branches of a side from the middle, so that they are aligned."""
    level = 0.0
    for branch, offset in row:
        block = tree.part(branch, side)
        shifted = moved(block.taken, *((0.0, offset) if side[0] else (offset, 0.0)))
        least = border + max(branch.least, shortest(tree.child(branch))) + 2 * GAP + block.reach
        spare = 14.0 if tree.child(branch).inside else 0.0  # so that a frame has room
        level = max(level, (push(taken, shifted, side, least) + spare) * branch.heavy)
    return level


def _sides(tree: Growth, node: int, along: Vector | None) -> dict[Vector, list[TreeBranch]]:
    """Assign branches to sides: arriving ones left, leaving ones right; the heavier side moves branches to the lighter one, then to top and bottom."""
    taken = None if along is None else (-along[0], -along[1])
    free = [s for s in (LEFT, RIGHT, DOWN, UP) if s != taken]
    sides: dict[Vector, list[TreeBranch]] = {s: [] for s in (LEFT, RIGHT, UP, DOWN)}

    def height(branch: TreeBranch, side: Vector) -> float:
        rectangle = tree.part(branch, side).taken
        return float(rectangle[:, 3].max() - rectangle[:, 1].min()) if side[0] else 0.0

    for branch in tree.branches[node]:
        natural, other = (RIGHT, LEFT) if branch.outwards else (LEFT, RIGHT)
        sides[branch.side if branch.side in free else natural if natural in free else other].append(branch)
    for _ in tree.branches[node]:  # move light elements until the sides are balanced
        loads = {s: sum(height(b, s) for b in sides[s]) for s in (LEFT, RIGHT)}
        full = max((LEFT, RIGHT), key=loads.__getitem__)
        other = LEFT if full == RIGHT else RIGHT
        last = sides[full][-1] if sides[full] else None
        if (
            last is None
            or last.side in free
            or other not in free
            or loads[full] - height(last, full) < loads[other] + height(last, other) - 1
        ):
            break
        sides[other].append(sides[full].pop())
    if taken is not None:
        sides[free[0]] += sides[taken]
        sides[taken] = []
    return sides


def _stacked(tree: Growth, branches: Sequence[TreeBranch], side: Vector, width: float) -> list[float]:
    """Return the positions at which the branches of a side leave it without overlap; symmetric about zero."""
    down: Vector = (0.0, 1.0) if side[0] else (1.0, 0.0)
    offsets: list[float] = []
    taken: Rectangles = NOTHING
    for branch in branches:
        block = tree.part(branch, side).taken
        occupied = taken + SPARE * (FRAMES if tree.child(branch).inside else SPACE)
        least = offsets[-1] + (ROW if side[0] else max(64.0, width + PADDING)) if offsets else 0.0
        offset = push(occupied, block, down, least)
        offsets.append(offset)
        taken = joined(taken, moved(block, down[0] * offset, down[1] * offset))
    middle = (offsets[0] + offsets[-1]) / 2 if offsets else 0.0
    return [o - middle for o in offsets]


def _like(tree: Growth, node: int) -> float:
    """Return the width of the names of a box, and of all boxes of its model: they are drawn alike."""
    own = tree.nodes[node]
    alike = [n for n, x in enumerate(tree.nodes) if x.shape == "box" and x.letter == own.letter]
    names = max(text_width(tree.nodes[n].label, NAME + 1) for n in alike)
    ports = [[text_width(port_of(x, n), PORT) for x in tree.lines if n in x.ends] for n in alike]
    sides = max((sum(sorted(widths)[-2:]) + PADDING * (len(widths) > 1) for widths in ports), default=0.0)
    return max(names, text_width(own.letter, PORT), sides * (len(alike) > 1)) + 2 * PADDING


def _size(
    named: float, widths: Mapping[Vector, float], rows: Mapping[Vector, Sequence[float]], along: Vector | None
) -> tuple[float, tuple[float, float]]:
    """Return half the width, and the heights above and below the middle of the rows."""
    across = max((2 * max(map(abs, rows[s])) + widths[s] + 2 * PADDING for s in (UP, DOWN) if rows[s]), default=0.0)
    half = max(named, widths[LEFT] + widths[RIGHT] + 3 * PADDING, widths[UP], widths[DOWN], across, 72.0) / 2
    above, below = bool(rows[UP]) or along == DOWN, bool(rows[DOWN]) or along == UP
    if not rows[LEFT] and not rows[RIGHT] and along not in (LEFT, RIGHT):
        level = PADDING + TITLE / 2 + 7 * (above and below)  # the names of ports stand in the place of a row
        return float(round(half)), (level, level)
    inner = max((abs(o) for s in (LEFT, RIGHT) for o in rows[s]), default=0.0) + PADDING
    return float(round(half)), (inner + TITLE + 14 * above, inner + 14 * below)


def _widths(
    lines: Sequence[DiagramLine], node: int, sides: Mapping[Vector, Sequence[TreeBranch]], along: Vector | None
) -> dict[Vector, float]:
    """Return the widths of the port names at each side, including that of the bond that carries the box."""
    widths = {s: max((text_width(port_of(lines[b.line], node), PORT) for b in sides[s]), default=0.0) for s in sides}
    if along is not None:
        taken = {b.line for s in sides for b in sides[s]}
        entry = max(
            (text_width(port_of(x, node), PORT) for n, x in enumerate(lines) if node in x.ends and n not in taken),
            default=0.0,
        )
        widths[-along[0], -along[1]] = entry
    return widths
