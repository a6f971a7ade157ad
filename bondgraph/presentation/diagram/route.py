"""Routing of lines that are not straight: bonds that close a ring, signals between nodes.

Shortest path on a grid, in length and bends, around occupied cells; bonds may be crossed in their middle, at a cost.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .overlap import LANE, Point, Rectangles, bounds, lane

STEP = 6.0
END = 14.0  # px at the end of a bond
CLEAR = 2.0  # px around occupied rectangles
BEND = 5.0  # cost of a bend, in steps
CROSSING = 14.0
AROUND = 10  # steps of free space around all parts
FREE, LYING, STANDING, HARD = 0, 1, 2, 3  # bits: a horizontal bond, a vertical bond, both: nothing may pass
Rectangle = tuple[float, float, float, float]
State = tuple[int, int, int]  # column, row, heading


class Ground:
    """Occupied cells of a grid, to which every way found is added.

    Nothing passes through hard cells; the middles of bonds are crossed, at right angles, at a cost.
    """

    def __init__(self, whole: Rectangles) -> None:
        left, top, right, bottom = bounds(whole)
        self.left, self.top = left - AROUND * STEP, top - AROUND * STEP
        self.columns = math.ceil((right - left) / STEP) + 2 * AROUND + 1
        self.rows = math.ceil((bottom - top) / STEP) + 2 * AROUND + 1
        self.cells = bytearray(self.columns * self.rows)
        self.table = np.frombuffer(self.cells, np.uint8).reshape(self.rows, self.columns)

    def block(self, items: Rectangles, how: int) -> None:
        """Occupy the cells of some rectangles."""
        for left, top, right, bottom in items.tolist():
            rows = self._inside(top - CLEAR - self.top, bottom + CLEAR - self.top, self.rows)
            columns = self._inside(left - CLEAR - self.left, right + CLEAR - self.left, self.columns)
            self.table[rows, columns] |= how

    @staticmethod
    def _inside(low: float, high: float, count: int) -> slice:
        return slice(max(0, math.ceil(low / STEP)), max(0, min(count, math.floor(high / STEP) + 1)))

    def take(self, way: Sequence[Point], width: float = LANE) -> None:
        """Add a way; its ends, with strokes and half arrows, are hard."""
        for start, end in pairwise(way):
            level, upright = abs(start[1] - end[1]) < 0.5, abs(start[0] - end[0]) < 0.5
            self.block(lane(start, end, width), LYING if level else STANDING if upright else HARD)
        for end, towards in ((way[0], way[1]), (way[-1], way[-2])):
            share = min(1.0, END / math.dist(end, towards))
            middle = tuple(a + share * (b - a) for a, b in zip(end, towards, strict=True))
            self.block(lane(end, (middle[0], middle[1]), width), HARD)

    def cell(self, point: Point) -> tuple[int, int]:
        """Return the cell nearest to a point."""
        return round((point[0] - self.left) / STEP), round((point[1] - self.top) / STEP)

    def how(self, cell: tuple[int, int]) -> int:
        """Return the state of a cell; cells outside the grid are hard."""
        column, row = cell
        inside = 0 <= column < self.columns and 0 <= row < self.rows
        return self.cells[row * self.columns + column] if inside else HARD

    def point(self, column: int, row: int) -> Point:
        """Return the middle of a cell."""
        return self.left + column * STEP, self.top + row * STEP


def all_routed(
    ground: Ground, ways: Mapping[int, Callable[[], tuple[Point, ...] | None]], rounds: int, width: float = LANE
) -> dict[int, tuple[Point, ...]]:
    """Return the ways found and add them to the ground: each is searched in every round, from the second on around all others."""
    free, found = bytes(ground.cells), dict[int, tuple[Point, ...]]()
    around = dict[int, dict[int, tuple[Point, ...]]]()  # all other ways, when each was searched last
    for number, search in [*ways.items()] * rounds:
        others = {n: way for n, way in found.items() if n != number}
        if around.get(number) == others:
            continue
        around[number] = others
        ground.cells[:] = free
        for way in others.values():
            ground.take(way, width)
        found[number] = search() or found.get(number, ())
        if not found[number]:
            del found[number]
    ground.cells[:] = free
    for way in found.values():
        ground.take(way, width)
    return found


def routed(ground: Ground, foot: Point, start: Point, end: Point, tip: Point) -> tuple[Point, ...] | None:
    """Return a way from `foot` over `start` and `end` to `tip`, its first and last part straight; None if there is none."""
    first = (*ground.cell(start), _heading(foot, start))
    last = (*ground.cell(end), _heading(end, tip))
    cells = _shortest(ground, [first], {last})
    if cells is None:
        return None
    corners = _corners([foot, *(ground.point(*c[:2]) for c in cells), tip])[1:-1]
    slanted = [all(abs(a - b) > 0.5 for a, b in zip(*pair, strict=True)) for pair in ((foot, start), (end, tip))]
    way = _aligned(
        start if slanted[0] else foot, corners, end if slanted[1] else tip, _heading(foot, start), _heading(end, tip)
    )
    return (*((foot,) if slanted[0] else ()), *way, *((tip,) if slanted[1] else ()))


@dataclass(frozen=True, slots=True)
class Gate:
    """Exit of a signal from a letter or box: a point of the border, the cell outside, the heading from there on."""

    foot: Point
    cell: tuple[int, int]
    heading: int
    corner: bool


def between(ground: Ground, source: Rectangle, target: Rectangle) -> tuple[Point, ...] | None:
    """Return a way for a signal from the border of one rectangle to that of another, at any free place; None if there is none."""
    feet = {(*gate.cell, gate.heading): gate for gate in _gates(ground, source)}
    goals = {(*gate.cell, (gate.heading + 2) % 4): gate for gate in _gates(ground, target)}
    cells = _shortest(ground, list(feet), set(goals), tight=True)
    if cells is None:
        return None
    first, last = feet[cells[0]], goals[cells[-1]]
    points = [ground.point(*c[:2]) for c in cells]
    if first.corner and last.corner and len(points) == 1:
        return (first.foot, points[0], last.foot)
    start, end = points[0] if first.corner else first.foot, points[-1] if last.corner else last.foot
    corners = _corners([start, *points[first.corner :][: -1 if last.corner else None], end])[1:-1]
    way = _aligned(start, corners, end, cells[0][2], cells[-1][2])
    return (*((first.foot,) if first.corner else ()), *way, *((last.foot,) if last.corner else ()))


def _gates(ground: Ground, rectangle: Rectangle) -> list[Gate]:
    """Return the exits of a signal from a rectangle: on free sides; if there are none, at corners, between two bonds."""
    left, top, right, bottom = rectangle
    x, y = (left + right) / 2, (top + bottom) / 2
    asides = [0.0] if right - left < 30 else [0.0, (left - right) / 4, (right - left) / 4]
    found = []
    for heading, (u, v) in enumerate(HEADINGS):
        for aside in asides if v else [0.0]:
            foot = (x + aside if v else (right if u > 0 else left), (bottom if v > 0 else top) if v else y)
            steps = [ground.cell((foot[0] + k * STEP * u, foot[1] + k * STEP * v)) for k in (2, 3)]
            if not any(map(ground.how, steps)):
                found.append(Gate(foot, steps[-1], heading, False))
    if found:
        return found
    for u, v in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        foot = (right - 2 if u > 0 else left + 2, bottom - 2 if v > 0 else top + 2)
        for far in (7.0, 9.0, 12.0):
            cell = ground.cell((foot[0] + far * u, foot[1] + far * v))
            if not ground.how(cell):
                found += [Gate(foot, cell, 0 if u > 0 else 2, True), Gate(foot, cell, 1 if v > 0 else 3, True)]
                break
    return found


HEADINGS = ((1, 0), (0, 1), (-1, 0), (0, -1))


def _heading(start: Point, end: Point) -> int:
    """Return the nearest of the four headings to that of a short way."""
    x, y = end[0] - start[0], end[1] - start[1]
    return (0 if x > 0 else 2) if abs(x) >= abs(y) else (1 if y > 0 else 3)


def _shortest(
    ground: Ground, starts: Sequence[State], goals: Collection[State], tight: bool = False
) -> list[State] | None:
    """Return the cells of a cheapest way from one of the starts to one of the goals, each with its heading (A*, Manhattan distance).

    `tight`: no hard cell may be passed, not even at the ends. Costs and states are flat numbers: most of the time is spent here.
    """
    if not starts or not goals:
        return None
    columns = ground.columns
    ends_of = [] if tight else [s[:2] for s in (*starts, *goals)]
    prices = (_prices(ground, ends_of, LYING), _prices(ground, ends_of, STANDING))
    rest = _rest(ground, goals)
    steps = (1, columns, -1, -columns)
    turns = tuple(
        tuple((t % 4, steps[t % 4], BEND * (t != h), prices[t % 2]) for t in (h, h + 1, h + 3)) for h in range(4)
    )
    ends = {4 * (row * columns + column) + heading for column, row, heading in goals}
    costs, before = [math.inf] * (4 * len(rest)), dict[int, int]()
    waiting = []
    for column, row, heading in starts:
        state = 4 * (row * columns + column) + heading
        costs[state] = 0.0
        waiting.append((float(rest[state >> 2]), state))
    heapq.heapify(waiting)
    while waiting:
        bound, state = heapq.heappop(waiting)
        if state in ends:
            return [_unpacked(s, columns) for s in _followed(before, state)]
        cell, cost = state >> 2, costs[state]
        if bound > cost + rest[cell]:
            continue  # found again, at a lower cost
        for towards, step, bend, entry in turns[state & 3]:
            place = cell + step
            price = entry[place]
            if price:
                after, dearer = 4 * place + towards, cost + price + bend
                if dearer < costs[after]:
                    costs[after], before[after] = dearer, state
                    heapq.heappush(waiting, (dearer + rest[place], after))
    return None


def _unpacked(state: int, columns: int) -> State:
    row, column = divmod(state >> 2, columns)
    return column, row, state & 3


def _prices(ground: Ground, ends: Sequence[tuple[int, int]], along: int) -> list[float]:
    """Return the cost of entering each cell horizontally (`along` LYING) or vertically (STANDING), 0 where that is not possible.

    Not possible are hard cells, cells of a bond in the same direction, and the outermost cells; the ends are always free.
    """
    columns, rows = ground.columns, ground.rows
    prices: list[float] = np.array(
        (1.0, 0.0, 1.0 + CROSSING, 0.0) if along == LYING else (1.0, 1.0 + CROSSING, 0.0, 0.0)
    )[np.frombuffer(ground.cells, np.uint8)].tolist()
    for column, row in ends:
        prices[row * columns + column] = 1.0
    prices[:columns] = prices[-columns:] = [0.0] * columns
    prices[::columns] = prices[columns - 1 :: columns] = [0.0] * rows
    return prices


def _rest(ground: Ground, goals: Collection[State]) -> list[int]:
    """Return for each cell the least number of steps to the rectangle around the goals."""
    low, high = [min(g[i] for g in goals) for i in (0, 1)], [max(g[i] for g in goals) for i in (0, 1)]
    x, y = np.arange(ground.columns), np.arange(ground.rows)
    across = np.maximum(np.maximum(low[0] - x, x - high[0]), 0)
    down = np.maximum(np.maximum(low[1] - y, y - high[1]), 0)
    listed: list[int] = np.add.outer(down, across).ravel().tolist()
    return listed


def _followed(before: Mapping[int, int], state: int) -> list[int]:
    way = [state]
    while state in before:
        state = before[state]
        way.append(state)
    return way[::-1]


def _corners(points: Sequence[Point]) -> list[Point]:
    """Return a way without the points at which it goes straight on."""
    kept = list(points[:1])
    for before, here, after in zip(points, points[1:], points[2:], strict=False):
        if _heading(before, here) != _heading(here, after):
            kept.append(here)
    return [*kept, points[-1]]


def _aligned(foot: Point, corners: list[Point], tip: Point, out: int, into: int) -> tuple[Point, ...]:
    """Return the corners moved off the grid so that the first part meets `foot` and the last `tip`, at right angles."""
    if corners:
        x, y = corners[0]
        corners[0] = (x, foot[1]) if out % 2 == 0 else (foot[0], y)
        x, y = corners[-1]
        corners[-1] = (x, tip[1]) if into % 2 == 0 else (tip[0], y)
    return (foot, *corners, tip)
