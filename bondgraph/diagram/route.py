"""Ways for what is not straight: bonds that close a ring, signals from node to node.

A shortest way on a grid, in length and bends, around what is taken; bonds may be crossed in their middle, at a price.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence

from .room import Point, Rectangles, bounds, lane

STEP = 6.0
CLEAR = 2.0  # px around what is taken
BEND = 5.0  # in steps
CROSSING = 14.0
AROUND = 10  # steps of free ground around everything
FREE, SOFT, HARD = 0, 1, 2


class Ground:
    """What is taken, on a grid; it fills with every way that is found."""

    def __init__(self, taken: Rectangles) -> None:
        left, top, right, bottom = bounds(taken)
        self.left, self.top = left - AROUND * STEP, top - AROUND * STEP
        self.columns = math.ceil((right - left) / STEP) + 2 * AROUND + 1
        self.rows = math.ceil((bottom - top) / STEP) + 2 * AROUND + 1
        self.cells = bytearray(self.columns * self.rows)
        self.block(taken, HARD)

    def block(self, items: Rectangles, how: int) -> None:
        """Take the cells of some rectangles."""
        for left, top, right, bottom in items.tolist():
            first, last = self._inside(left - CLEAR - self.left, right + CLEAR - self.left, self.columns)
            for row in range(*self._inside(top - CLEAR - self.top, bottom + CLEAR - self.top, self.rows)):
                for place in range(row * self.columns + first, row * self.columns + last):
                    self.cells[place] = max(self.cells[place], how)

    @staticmethod
    def _inside(low: float, high: float, count: int) -> tuple[int, int]:
        return max(0, math.ceil(low / STEP)), min(count, math.floor(high / STEP) + 1)

    def take(self, way: Sequence[Point]) -> None:
        """A way that has been found is taken; its middle can be crossed."""
        for start, end in zip(way, way[1:], strict=False):
            self.block(lane(start, end), HARD)

    def cell(self, point: Point) -> tuple[int, int]:
        """The cell nearest to a point."""
        return round((point[0] - self.left) / STEP), round((point[1] - self.top) / STEP)

    def point(self, column: int, row: int) -> Point:
        """The middle of a cell."""
        return self.left + column * STEP, self.top + row * STEP


def routed(ground: Ground, foot: Point, start: Point, end: Point, tip: Point) -> tuple[Point, ...] | None:
    """A way from `foot` over `start` and `end` to `tip`, its first and last part straight; None if there is none."""
    first, last = ground.cell(start), ground.cell(end)
    cells = _shortest(ground, first, last, _heading(foot, start), _heading(end, tip))
    if cells is None:
        return None
    corners = _corners([ground.point(*c) for c in cells])[1:-1]
    slanted = [all(abs(a - b) > 0.5 for a, b in zip(*pair, strict=True)) for pair in ((foot, start), (end, tip))]
    way = _aligned(
        start if slanted[0] else foot, corners, end if slanted[1] else tip, _heading(foot, start), _heading(end, tip)
    )
    return (*((foot,) if slanted[0] else ()), *way, *((tip,) if slanted[1] else ()))


HEADINGS = ((1, 0), (0, 1), (-1, 0), (0, -1))


def _heading(start: Point, end: Point) -> int:
    """Which of the four headings is nearest to that of a short way."""
    x, y = end[0] - start[0], end[1] - start[1]
    return (0 if x > 0 else 2) if abs(x) >= abs(y) else (1 if y > 0 else 3)


def _shortest(
    ground: Ground, first: tuple[int, int], last: tuple[int, int], out: int, into: int
) -> list[tuple[int, int]] | None:
    """The cells of a cheapest way that leaves and arrives with given headings (A*, Manhattan distance)."""
    start = (*first, out)
    costs, before = {start: 0.0}, dict[tuple[int, int, int], tuple[int, int, int]]()
    waiting = [(float(abs(first[0] - last[0]) + abs(first[1] - last[1])), 0, start)]
    count = 0
    while waiting:
        _, _, state = heapq.heappop(waiting)
        column, row, heading = state
        if (column, row) == last and heading == into:
            return _followed(before, state)
        for turn in (0, 1, 3):
            towards = (heading + turn) % 4
            x, y = column + HEADINGS[towards][0], row + HEADINGS[towards][1]
            if not (0 <= x < ground.columns and 0 <= y < ground.rows):
                continue
            how = ground.cells[y * ground.columns + x]
            if how == HARD and not (_near((x, y), first) or _near((x, y), last)):
                continue
            cost = costs[state] + 1 + BEND * (turn != 0) + CROSSING * (how == SOFT)
            after = (x, y, towards)
            if cost < costs.get(after, math.inf):
                costs[after], before[after] = cost, state
                count += 1
                heapq.heappush(waiting, (cost + abs(x - last[0]) + abs(y - last[1]), count, after))
    return None


def _near(cell: tuple[int, int], place: tuple[int, int]) -> bool:
    return abs(cell[0] - place[0]) <= 2 and abs(cell[1] - place[1]) <= 2


def _followed(
    before: dict[tuple[int, int, int], tuple[int, int, int]], state: tuple[int, int, int]
) -> list[tuple[int, int]]:
    way = [state[:2]]
    while state in before:
        state = before[state]
        way.append(state[:2])
    return way[::-1]


def _corners(points: Sequence[Point]) -> list[Point]:
    """A way without the points at which it goes straight on."""
    kept = list(points[:1])
    for before, here, after in zip(points, points[1:], points[2:], strict=False):
        if _heading(before, here) != _heading(here, after):
            kept.append(here)
    return [*kept, points[-1]]


def _aligned(foot: Point, corners: list[Point], tip: Point, out: int, into: int) -> tuple[Point, ...]:
    """The corners moved off the grid so that the first part meets `foot`, the last `tip`, at right angles."""
    if corners:
        x, y = corners[0]
        corners[0] = (x, foot[1]) if out % 2 == 0 else (foot[0], y)
        x, y = corners[-1]
        corners[-1] = (x, tip[1]) if into % 2 == 0 else (tip[0], y)
    return (foot, *corners, tip)
