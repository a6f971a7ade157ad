"""Conditions on numbers that only a run knows, against numpy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import pytest

from compiler.algebra.expression import Expression, Number, Symbol, evaluate
from compiler.algebra.formula import Bound, Formula
from compiler.semantics.resolution.conditions import (
    Condition,
    apart,
    known_or_later,
    not_parallel,
    not_zero,
    takes_energy,
)
from compiler.source import Source, Span

SEEDS = range(6)
SPAN = Span(Source("t.bg", ""), 0, 0)


def values(condition: Condition, numbers: Sequence[float]) -> list[float]:
    """The expressions of a condition, over symbols, at these numbers."""
    found = condition([Symbol(i) for i in range(len(numbers))])
    return [evaluate(x, lambda i: float(numbers[i])) for x in found]


@pytest.mark.parametrize("seed", SEEDS)
def test_one_of_several_numbers_differs_from_zero(seed: int) -> None:
    numbers = np.random.default_rng(seed).normal(size=seed + 1)
    assert values(not_zero, numbers) == pytest.approx([float(numbers @ numbers)], rel=1e-14)
    assert values(not_zero, np.zeros(seed + 1)) == [-1e-300]


@pytest.mark.parametrize("seed", SEEDS)
def test_the_sine_of_two_directions_is_greater_than_a_share(seed: int) -> None:
    a, b = np.random.default_rng(seed).normal(size=(2, 3))
    expected = np.sum(np.cross(a, b) ** 2) - 0.3**2 * (a @ a) * (b @ b)
    assert values(not_parallel(0.3), [*a, *b]) == pytest.approx([expected], rel=1e-13)
    (parallel,) = values(not_parallel(1e-3), [*a, *(-2 * a)])
    assert parallel == pytest.approx(-1e-6 * 4 * (a @ a) ** 2, rel=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_two_points_are_farther_from_each_other_than_a_share_of_their_distance_from_the_origin(seed: int) -> None:
    a, b = np.random.default_rng(seed).normal(size=(2, 3))
    expected = (a - b) @ (a - b) - 0.3**2 * (a @ a + b @ b)
    assert values(apart(0.3), [*a, *b]) == pytest.approx([expected], rel=1e-13)
    assert values(apart(0.3), [0.0] * 6) == [-1e-300] == values(not_parallel(0.3), [0.0] * 6)


@pytest.mark.parametrize("seed", SEEDS)
def test_no_principal_minor_of_a_tensor_is_negative(seed: int) -> None:
    rng = np.random.default_rng(seed)
    xx, yy, zz, xy, xz, yz = numbers = rng.normal(size=6)
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    size = abs(xx) + abs(yy) + abs(zz)
    rows = ([0], [1], [2], [0, 1], [0, 2], [1, 2], [0, 1, 2])
    expected = [np.linalg.det(tensor[np.ix_(r, r)]) + 0.01 * size ** len(r) for r in rows]
    assert values(takes_energy(0.01), numbers) == pytest.approx(expected, rel=1e-12, abs=1e-14)


def test_a_tensor_of_three_numbers_is_diagonal() -> None:
    assert values(takes_energy(0.0), [2.0, 3.0, 5.0]) == pytest.approx([2, 3, 5, 6, 10, 15, 30], rel=1e-15)


class Resolver:
    """Values of parameters by name; None for one that only a run knows."""

    def __init__(self, **known: float | None) -> None:
        self.known = known
        self.positive: list[tuple[str, Bound]] = []
        self.for_all_values = False

    def value_of(self, bound: Bound, span: Span, decides: bool) -> float | None:
        assert span is SPAN and decides is False
        found = self.known[bound.arguments[0]]
        return None if found is None else 2 * found


def bounds(*names: str) -> list[Bound]:
    return [Bound(Formula(1, Number(2.0) * Symbol(0)), (name,)) for name in names]


def test_known_numbers_are_returned_and_unknown_ones_become_conditions_of_the_run() -> None:
    known = Resolver(a=3.0, b=0.0)
    assert known_or_later(cast(Any, known), bounds("a", "b"), SPAN, "length", not_zero) == [6.0, 0.0]
    assert known.positive == []
    known.for_all_values = True
    assert known_or_later(cast(Any, known), bounds("a", "b"), SPAN, "length", not_zero) == [6.0, 0.0]
    assert [words for words, _ in known.positive] == ["length"]
    later = Resolver(a=3.0, b=None)
    assert known_or_later(cast(Any, later), bounds("a", "b"), SPAN, "length", not_zero) is None
    ((words, bound),) = later.positive
    given = {"a": 3.0, "b": 5.0}
    found: Expression = bound.expression
    assert words == "length" and evaluate(found, given.__getitem__) == 4 * 9 + 4 * 25
