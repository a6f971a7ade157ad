"""A box with what hangs on it: ports in rows along its sides, its name on top, as large as that needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .glyphs import GAP, NAME, PORT, shortest
from .lettering import text_width
from .room import NOTHING, Rectangles, Vector, joined, lane, moved, push, rectangles
from .subject import HEAD, TAIL, Line, Node

if TYPE_CHECKING:
    from .tree import Block, Branch

RIGHT, DOWN, LEFT, UP = (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)
TITLE = 40.0  # the height that kind and name take
ROW = 26.0  # between two ports of a side
PADDING = 12.0


@dataclass(frozen=True, slots=True)
class Boxed:
    """A box, and where its name stands."""

    left: float
    top: float
    right: float
    bottom: float
    title: tuple[float, float]

    def at(self, x: float, y: float) -> Boxed:
        """The same box elsewhere."""
        title = (self.title[0] + x, self.title[1] + y)
        return Boxed(self.left + x, self.top + y, self.right + x, self.bottom + y, title)

    def port_text(self, text: str, x: float, y: float) -> tuple[str, float, float, str]:
        """The name of a port inside the border at which it stands: text, x, y of the baseline, anchor."""
        if abs(x - self.left) < 0.6 or abs(x - self.right) < 0.6:
            right = abs(x - self.right) < 0.6
            return text, x - 6 if right else x + 6, y + 4, "end" if right else "start"
        return text, x, y - 6 if abs(y - self.bottom) < 0.6 else y + 14, "middle"


def port_of(line: Line, node: int) -> str:
    """The name of the port at which a line meets a node."""
    return line.ports[TAIL if line.tail == node else HEAD]


def box_around(
    nodes: Sequence[Node], lines: Sequence[Line], branches: Sequence[Branch],
    finished: Mapping[tuple[int, Vector], Block], node: int, along: Vector | None,
) -> Block:  # fmt: skip
    """A box and its branches; seen from where the bond that carries it arrives (`along`), or from its middle."""
    from .tree import Block, Draft

    sides = _sides(branches, finished, along)
    rows = {side: _stacked(sides[side], finished, side) for side in sides}
    half, heights = _size(nodes[node], lines, node, sides, rows, along)
    top, bottom = -heights[0], heights[1]
    box = (-half, top, half, bottom)
    draft = Draft(taken=rectangles([box]))
    for side in (LEFT, RIGHT, UP, DOWN):
        x, y = side
        for branch, offset in zip(sides[side], rows[side], strict=True):
            border = half if x else (bottom if y > 0 else -top)
            block = finished[branch.child, side]
            foot = (x * border, offset) if x else (offset, y * border)
            shifted = block.at(*((0.0, offset) if x else (offset, 0.0)))
            assert draft.taken is not None
            distance = push(draft.taken, shifted.taken, side, border + shortest(nodes[branch.child]) + 2 * GAP + block.reach)
            tip = distance - block.reach - GAP
            end = (x * tip, offset) if x else (offset, y * tip)
            draft.add(shifted.at(x * distance, y * distance), lane(foot, end))
            draft.ends[branch.line, node], draft.ends[branch.line, branch.child] = foot, end
            draft.cost += distance
    assert draft.taken is not None
    title = (0.0, top + 16 + 14 * (bool(sides[UP]) or along == DOWN))
    boxed = Boxed(*box, title)
    made = Block({node: (0.0, 0.0)} | draft.places, draft.labels, {node: boxed} | draft.boxes, draft.ends, draft.taken, draft.cost)
    if along is None:
        return made
    x, y = along
    reach = half if x else (-top if y > 0 else bottom)
    return Block(made.places, made.labels, made.boxes, made.ends, made.taken, made.cost, reach)


def _sides(
    branches: Sequence[Branch], finished: Mapping[tuple[int, Vector], Block], along: Vector | None
) -> dict[Vector, list[Branch]]:
    """What arrives stands left, what leaves stands right; the heavier side gives to the lighter one, then to top and bottom."""
    taken = None if along is None else (-along[0], -along[1])
    free = [s for s in (LEFT, RIGHT, DOWN, UP) if s != taken]
    sides: dict[Vector, list[Branch]] = {s: [] for s in (LEFT, RIGHT, UP, DOWN)}

    def height(branch: Branch, side: Vector) -> float:
        rectangle = finished[branch.child, side].taken
        return float(rectangle[:, 3].max() - rectangle[:, 1].min()) if side[0] else 0.0

    for branch in branches:
        wanted = RIGHT if branch.outwards else LEFT
        sides[wanted if wanted in free else (LEFT if wanted == RIGHT else RIGHT)].append(branch)
    for _ in branches:  # a light element more or less makes the sides equal
        loads = {s: sum(height(b, s) for b in sides[s]) for s in (LEFT, RIGHT)}
        full = max((LEFT, RIGHT), key=loads.__getitem__)
        other = LEFT if full == RIGHT else RIGHT
        last = sides[full][-1] if sides[full] else None
        if last is None or other not in free or loads[full] - height(last, full) < loads[other] + height(last, other) - 1:
            break
        sides[other].append(sides[full].pop())
    if taken is not None:
        spare = [b for b in sides.get(taken, [])]
        sides[taken] = []
        for branch in spare:
            sides[next(s for s in free)].append(branch)
    return sides


def _stacked(branches: Sequence[Branch], finished: Mapping[tuple[int, Vector], Block], side: Vector) -> list[float]:
    """Where the branches of a side leave it, so that they are clear of each other; symmetric about zero."""
    down: Vector = (0.0, 1.0) if side[0] else (1.0, 0.0)
    offsets: list[float] = []
    taken: Rectangles = NOTHING
    for branch in branches:
        block = finished[branch.child, side].taken
        offset = push(taken, block, down, offsets[-1] + (ROW if side[0] else 64.0) if offsets else 0.0)
        offsets.append(offset)
        taken = joined(taken, moved(block, down[0] * offset, down[1] * offset))
    middle = (offsets[0] + offsets[-1]) / 2 if offsets else 0.0
    return [o - middle for o in offsets]


def _size(
    node: Node, lines: Sequence[Line], number: int, sides: Mapping[Vector, Sequence[Branch]], rows: Mapping[Vector, Sequence[float]],
    along: Vector | None,
) -> tuple[float, tuple[float, float]]:
    """Half the width, and the heights above and below the middle of the rows."""

    def widest(side: Vector) -> float:
        return max((text_width(port_of(lines[b.line], number), PORT) for b in sides[side]), default=0.0)

    title = max(text_width(node.label, NAME + 1), text_width(node.letter, PORT)) + 2 * PADDING
    across = max((2 * max(map(abs, rows[s])) + widest(s) + 2 * PADDING for s in (UP, DOWN) if rows[s]), default=0.0)
    half = max(title, widest(LEFT) + widest(RIGHT) + 3 * PADDING, across, 72.0) / 2
    spans = [abs(o) for s in (LEFT, RIGHT) for o in rows[s]]
    inner = max(spans, default=0.0) + PADDING
    return float(round(half)), (inner + TITLE + 14 * (bool(rows[UP]) or along == DOWN), inner + 14 * (bool(rows[DOWN]) or along == UP))

