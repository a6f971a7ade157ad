"""Completed parts of a tree layout: boxes, branches, and the positions of all that belongs to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from .diagram_model import DiagramLine, DiagramNode
from .overlap import Point, Rectangles, Vector, bounds, joined, moved

RIGHT, DOWN, LEFT, UP = (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)


@dataclass(frozen=True, slots=True)
class Boxed:
    """A box, and the position of its name."""

    left: float
    top: float
    right: float
    bottom: float
    title: tuple[float, float]

    def at(self, x: float, y: float) -> Boxed:
        """Return the same box at another position."""
        title = (self.title[0] + x, self.title[1] + y)
        return Boxed(self.left + x, self.top + y, self.right + x, self.bottom + y, title)

    def port_text(self, text: str, x: float, y: float) -> tuple[str, float, float, str]:
        """Return the name of a port inside the border, next to its position: text, x, y of the baseline, anchor."""
        if x <= self.left or x >= self.right:
            right = x >= self.right
            return text, self.right - 6 if right else self.left + 6, y + 4, "end" if right else "start"
        return text, x, self.bottom - 6 if y >= self.bottom else self.top + 14, "middle"


@dataclass(frozen=True, slots=True)
class Block:
    """A completed part, with the origin at the end of the bond that carries it."""

    places: Mapping[int, Point]  # node -> its middle
    labels: Mapping[int, tuple[str, float, float, str]]
    boxes: Mapping[int, Boxed]
    ends: Mapping[tuple[int, int], Point]  # line, node -> its point on the node's border
    taken: Rectangles  # the rectangle of the root comes first
    cost: float
    reach: float = 0.0  # from the origin to the border of the root, against the direction of growth

    @property
    def worth(self) -> float:
        """Cost of the part and of its size; a smaller one is better."""
        left, top, right, bottom = bounds(self.taken)
        return self.cost + 0.15 * (right - left) + 0.25 * (bottom - top)

    def at(self, x: float, y: float) -> Block:
        """Return the same part at another position."""
        return Block(
            {n: (a + x, b + y) for n, (a, b) in self.places.items()},
            {n: (t, a + x, b + y, s) for n, (t, a, b, s) in self.labels.items()},
            {n: b.at(x, y) for n, b in self.boxes.items()},
            {k: (a + x, b + y) for k, (a, b) in self.ends.items()},
            moved(self.taken, x, y), self.cost, self.reach,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class TreeBranch:
    """A bond from a node to a child."""

    line: int
    child: int
    outwards: bool  # True if the arrow points to the child
    heavy: bool  # True if the child has branches
    likes: tuple[Vector, ...] = ()  # for a bond that is routed later: sides, the one nearest to its other end first
    side: Vector | None = None  # the only side at which it may leave
    least: float = 0.0  # length


@dataclass(frozen=True, slots=True)
class Growth:
    """A tree that grows from its leaves. `finished`: for each root its completed part in each direction; `roomy`: more space, in px."""

    nodes: Sequence[DiagramNode]
    lines: Sequence[DiagramLine]
    branches: Mapping[int, Sequence[TreeBranch]]
    finished: dict[int, dict[Vector, Block]]
    roomy: float

    def part(self, branch: TreeBranch, side: Vector) -> Block:
        """Return the completed part of a branch that grows to a side."""
        return self.finished[branch.child][side]

    def child(self, branch: TreeBranch) -> DiagramNode:
        return self.nodes[branch.child]


@dataclass(slots=True)
class Draft:
    """A part under construction."""

    places: dict[int, Point]
    labels: dict[int, tuple[str, float, float, str]]
    boxes: dict[int, Boxed]
    taken: Rectangles
    ends: dict[tuple[int, int], Point] = field(default_factory=dict)
    cost: float = 0.0

    def add(self, block: Block, *more: Rectangles) -> None:
        """Add a completed part."""
        self.places |= block.places
        self.labels |= block.labels
        self.boxes |= block.boxes
        self.ends |= block.ends
        self.taken = joined(self.taken, block.taken, *more)
        self.cost += block.cost

    def block(self, corridor: range, reach: float) -> Block:
        """Return the completed part, without the rectangles of the bond that carries it."""
        taken = np.delete(self.taken, corridor, axis=0)
        return Block(self.places, self.labels, self.boxes, self.ends, taken, self.cost, reach)
