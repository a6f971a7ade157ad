"""Linear systems as operators: what is read from a node is the system that it was made of, dense or as a band."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from compiler.algebra.expression import ZERO, Apply, Expression, Number, Symbol
from compiler.algebra.systems import (
    LEADING,
    Shape,
    _outwards,
    band_of,
    banded_shape,
    dense,
    dense_count,
    entries_of,
    shape_of,
    size_of,
    solutions,
    with_rights,
)


def numbers(values: np.ndarray) -> list[Expression]:
    return [Number(float(v)) for v in values.ravel()]


def rows_of(matrix: np.ndarray) -> list[dict[int, Expression]]:
    return [{j: Number(float(row[j])) for j in np.flatnonzero(row).tolist()} for row in matrix]


def band_matrix(count: int, lower: int, upper: int) -> np.ndarray:
    random = np.random.default_rng(count)
    i, j = np.indices((count, count))
    return np.where((j - i <= upper) & (i - j <= lower), random.uniform(1, 2, (count, count)), 0.0)


def solved(node: Apply) -> np.ndarray:
    """Solution of the system of a node, by numpy."""
    rows, rights = entries_of(node)
    matrix = np.zeros((len(rows), len(rows)))
    for i, row in enumerate(rows):
        for j, x in row.items():
            assert isinstance(x, Number)
            matrix[i, j] = x.value
    return np.linalg.solve(matrix, [x.value for x in rights if isinstance(x, Number)])


def read(items: list[Expression]) -> np.ndarray:
    """Unknowns in the order of the items, all of which read one node."""
    found = []
    for item in items:
        assert isinstance(item, Apply) and item.operator == "item"
        node, place = item.operands
        assert isinstance(node, Apply) and isinstance(place, Number)
        found.append(solved(node)[int(place.value)])
    return np.array(found)


@pytest.mark.parametrize("count", range(1, 40))
def test_the_number_of_operands_gives_the_number_of_unknowns(count: int) -> None:
    assert dense_count(count * count + count) == count
    node = Apply("solve", (ZERO,) * (count * count + count))
    assert shape_of(node) == Shape(count, count - 1, count - 1) and size_of(node) == count


def test_the_shape_of_a_band() -> None:
    assert Shape(9, 2, 4).width == 7
    assert banded_shape([9.0, 2.0, 4.0, 5.0]) == Shape(9, 2, 4)
    node = Apply("banded", tuple(map(Number, [9.0, 2.0, 4.0, *range(9 * 7 + 9)])))
    assert shape_of(node) == Shape(9, 2, 4) and size_of(node) == 9


@pytest.mark.parametrize(
    ("count", "lower", "upper"), [(1, 0, 0), (2, 1, 1), (6, 1, 2), (7, 0, 3), (5, 3, 0), (4, 3, 3)]
)
def test_entries_of_a_band_and_the_same_as_a_dense_system(count: int, lower: int, upper: int) -> None:
    matrix, right = band_matrix(count, lower, upper), np.arange(1.0, count + 1)
    width = lower + upper + 1
    band = np.zeros((count, width))
    for d in range(-lower, upper + 1):
        for i in range(count):
            if 0 <= i + d < count:
                band[i, lower + d] = matrix[i, i + d]
    head = (Number(float(count)), Number(float(lower)), Number(float(upper)))
    node = Apply("banded", (*head, *numbers(band), *numbers(right)))
    rows, rights = entries_of(node)
    assert rights == tuple(numbers(right)) and len(head) == LEADING
    assert rows == [{j: Number(matrix[i, j]) for j in range(count) if -lower <= j - i <= upper} for i in range(count)]
    assert dense(shape_of(node), node.operands, ZERO) == [*numbers(matrix), *numbers(right)]
    whole = Apply("solve", tuple(dense(shape_of(node), node.operands, ZERO)))
    assert entries_of(whole) == ([dict(enumerate(numbers(row))) for row in matrix], tuple(numbers(right)))


@pytest.mark.parametrize("operator", ["solve", "banded"])
def test_other_right_sides(operator: str) -> None:
    head = (Number(2.0), Number(1.0), Number(1.0)) if operator == "banded" else ()
    entries = [Symbol(f"m{i}") for i in range(6 if head else 4)]
    node = Apply(operator, (*head, *entries, Symbol("p"), Symbol("q")))
    assert with_rights(node, (Symbol("r"), ZERO)) == Apply(operator, (*head, *entries, Symbol("r"), ZERO))


@pytest.mark.parametrize(("count", "lower", "upper"), [(3, 2, 2), (14, 1, 1), (20, 2, 3), (20, 0, 4), (25, 3, 1)])
@pytest.mark.parametrize("shuffled", [False, True])
def test_unknowns_of_a_matrix(count: int, lower: int, upper: int, shuffled: bool) -> None:
    """Whatever the order of equations and unknowns: the items are the solution by numpy."""
    matrix = band_matrix(count, lower, upper) + 9 * np.eye(count)
    order = np.random.default_rng(5).permutation(count) if shuffled else np.arange(count)
    matrix, right = matrix[np.ix_(order, order)], np.cos(np.arange(count))
    layout = band_of([np.flatnonzero(row).tolist() for row in matrix])
    items = solutions(rows_of(matrix), numbers(right), layout)
    (node,) = {item.operands[0] for item in items if isinstance(item, Apply)}
    assert isinstance(node, Apply) and node.operator == ("solve" if layout is None else "banded")
    assert shuffled or (layout is None) == (count < 12)
    np.testing.assert_allclose(read(items), np.linalg.solve(matrix, right), rtol=1e-12)
    if layout is not None:
        assert sorted(layout.order) == list(range(count))
        i, j = np.nonzero(matrix[np.ix_(layout.order, layout.order)])
        assert layout.shape == Shape(count, max((i - j).max(), 0), max((j - i).max(), 0)), "as narrow as it is"


def columns(count: int, lower: int, upper: int) -> list[list[int]]:
    return [[j for j in range(count) if i - lower <= j <= i + upper] for i in range(count)]


@pytest.mark.parametrize(
    ("count", "lower", "upper", "narrow"),
    [
        (11, 1, 1, False), (11, 0, 0, False), (12, 1, 1, True), (12, 2, 2, False), (20, 2, 3, True), (20, 3, 2, False), (20, 0, 7, True), (20, 0, 8, False), (15, 1, 3, True), (15, 2, 3, False), (12, 0, 0, True), (13, 1, 0, True),
    ],
)  # fmt: skip
def test_a_narrow_band_is_two_fifths_of_the_matrix_with_what_an_exchange_of_rows_adds(
    count: int, lower: int, upper: int, narrow: bool
) -> None:
    layout = band_of(columns(count, lower, upper))
    assert (layout is not None) == narrow
    if layout is not None:
        assert layout.shape == Shape(count, lower, upper)


def test_a_chain_in_any_order_is_found() -> None:
    order = np.random.default_rng(2).permutation(30).tolist()
    rows: list[list[int]] = [[] for _ in order]
    for a, b in pairwise(order):
        rows[a] += [a, b]
        rows[b] += [a, b]
    layout = band_of(rows)
    assert layout is not None and layout.shape == Shape(30, 1, 1) and list(layout.order) in (order, order[::-1])


def test_a_matrix_with_a_full_row_and_column_is_no_band() -> None:
    assert band_of([[0, i] if i else list(range(20)) for i in range(20)]) is None


def test_the_reverse_order_of_cuthill_and_mckee() -> None:
    """Breadth first from an end, few neighbours first, reversed; by hand."""
    assert _outwards([{1}, {0, 2}, {1, 3}, {2}]) == [0, 1, 2, 3]
    assert _outwards([{2}, {2}, {0, 1, 3}, {2, 4}, {3}]) == [1, 0, 2, 3, 4], "a fork at the far end"
    assert _outwards([{1, 2, 3}, {0, 3}, {0}, {0, 1, 4}, {3}]) == [2, 0, 1, 3, 4], "a ring with two ends"
    assert _outwards([{1, 2, 3}, {0}, {0, 4, 5}, {0, 6}, {2}, {2}, {3}]) == [6, 3, 1, 0, 4, 2, 5], "a tree"
    assert _outwards([set(), {2}, {1}]) == [1, 2, 0], "two parts"
