"""Linear systems among expressions: a node with all operands of a system, whose solution is read by items.

`solve` has n rows of n entries, then n right sides. `banded` has n, the numbers of diagonals below and above the main one, the
entries of these by rows (0 outside of the matrix), then the right sides: the cost of a chain of resistors grows with its length.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple, TypeVar

from .expression import ZERO, Apply, Expression, Number

SYSTEMS = frozenset({"solve", "banded"})
LEAST = 12  # unknowns from which on a band is looked for
NARROW = 0.4  # of the entries of a matrix: a band with more of them is not narrow
LEADING = 3  # operands of a `banded` node before its entries

Thing = TypeVar("Thing")


class Shape(NamedTuple):
    """Number of unknowns of a system, and the widths of its band."""

    unknowns: int
    lower: int
    upper: int

    @property
    def width(self) -> int:
        """Number of entries in a row."""
        return self.lower + self.upper + 1


def size_of(node: Apply) -> int:
    """Number of unknowns of a system."""
    return shape_of(node).unknowns


def shape_of(node: Apply) -> Shape:
    """Shape of a system; the band of a dense one is the whole matrix."""
    if node.operator == "banded":
        return banded_shape([x.value for x in node.operands[:LEADING] if isinstance(x, Number)])
    count = dense_count(len(node.operands))
    return Shape(count, count - 1, count - 1)


def dense_count(operands: int) -> int:
    """Number of unknowns of a dense system with this number of operands."""
    return int(((1 + 4 * operands) ** 0.5 - 1) / 2 + 0.5)


def banded_shape(head: Sequence[float]) -> Shape:
    """Shape from the first operands of a `banded` node."""
    count, lower, upper = (int(x) for x in head[:LEADING])
    return Shape(count, lower, upper)


def entries_of(node: Apply) -> tuple[list[dict[int, Expression]], tuple[Expression, ...]]:
    """Rows of the matrix by column, and the right sides."""
    count, _, _ = shape = shape_of(node)
    if node.operator == "solve":
        rows = [dict(enumerate(node.operands[i * count : (i + 1) * count])) for i in range(count)]
        return rows, node.operands[count * count :]
    places = _places(shape)
    banded = [{j: node.operands[p] for j, p in row.items()} for row in places]
    return banded, node.operands[LEADING + count * shape.width :]


def with_rights(node: Apply, rights: Sequence[Expression]) -> Apply:
    """The same system with other right sides."""
    return Apply(node.operator, (*node.operands[: -size_of(node)], *rights))


def dense(shape: Shape, operands: Sequence[Thing], nothing: Thing) -> list[Thing]:
    """Operands of a dense system from those of a `banded` node (or from values or places for these); `nothing` outside of the band."""
    count = shape.unknowns
    full = [nothing] * (count * count)
    for i, row in enumerate(_places(shape)):
        for j, place in row.items():
            full[i * count + j] = operands[place]
    return [*full, *operands[LEADING + count * shape.width :]]


@lru_cache(maxsize=64)
def _places(shape: Shape) -> list[dict[int, int]]:
    """Operands of each row, by column."""
    return [
        {
            j: LEADING + i * shape.width + j - i + shape.lower
            for j in range(max(0, i - shape.lower), min(shape.unknowns, i + shape.upper + 1))
        }
        for i in range(shape.unknowns)
    ]


class BandLayout(NamedTuple):
    """Order of unknowns and equations in which a matrix is a band."""

    order: tuple[int, ...]
    shape: Shape


def band_of(rows: Sequence[Sequence[int]]) -> BandLayout | None:
    """Order in which a matrix with these columns in each row is a narrow band; None if there is none.

    By the reverse order of Cuthill and McKee (ACM 1969), breadth first from an end.
    """
    count = len(rows)
    if count < LEAST:
        return None
    beside: list[set[int]] = [set() for _ in rows]
    for i, row in enumerate(rows):
        for j in row:
            if i != j:
                beside[i].add(j)
                beside[j].add(i)
    layouts = [_layout(rows, order) for order in (range(count), _outwards(beside))]
    best = min(layouts, key=lambda layout: layout.shape.width)
    return best if best.shape.width + best.shape.lower <= NARROW * count else None


def _layout(rows: Sequence[Sequence[int]], order: Sequence[int]) -> BandLayout:
    place = {variable: position for position, variable in enumerate(order)}
    gaps = [place[j] - place[i] for i, row in enumerate(rows) for j in row]
    return BandLayout(tuple(order), Shape(len(rows), max(0, -min(gaps, default=0)), max(0, max(gaps, default=0))))


def _outwards(beside: Sequence[set[int]]) -> list[int]:
    order: list[int] = []
    left = dict.fromkeys(sorted(range(len(beside)), key=lambda i: len(beside[i])))
    while left:
        first = _reached(_reached([next(iter(left))], beside, left)[-1:], beside, left)
        for i in first:
            del left[i]
        order += first
    return order[::-1]


def _reached(begin: list[int], beside: Sequence[set[int]], left: dict[int, None]) -> list[int]:
    """Vertices connected with the beginning, level by level, those with few neighbours first."""
    order, seen = list(begin), set(begin)
    for i in order:  # grows
        further = sorted((j for j in beside[i] if j in left and j not in seen), key=lambda j: (len(beside[j]), j))
        seen.update(further)
        order += further
    return order


def solutions(
    matrix: Sequence[dict[int, Expression]], right: Sequence[Expression], layout: BandLayout | None
) -> list[Expression]:
    """Unknowns of a system; rows of the matrix by column."""
    count = len(right)
    if layout is None:
        node = Apply("solve", (*(row.get(j, ZERO) for row in matrix for j in range(count)), *right))
        return [Apply("item", (node, Number(float(i)))) for i in range(count)]
    order, (_, lower, upper) = layout
    entries: list[Expression] = []
    for i, variable in enumerate(order):
        for j in range(i - lower, i + upper + 1):
            entries.append(matrix[variable].get(order[j], ZERO) if 0 <= j < count else ZERO)
    head = (Number(float(x)) for x in (count, lower, upper))
    node = Apply("banded", (*head, *entries, *(right[i] for i in order)))
    place = {variable: position for position, variable in enumerate(order)}
    return [Apply("item", (node, Number(float(place[i])))) for i in range(count)]
