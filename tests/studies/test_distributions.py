"""Distributions, correlations and quasi-random points against their formulas."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bondgraph import UsageError
from bondgraph.studies.montecarlo import correlation_matrix, cube, distribution, quantiles, values_of
from compiler.api import Distribution


def sampled(text: str, unit: str = "m", count: int = 1 << 14) -> np.ndarray:
    return values_of(cube(count, 1, 3), [distribution(text, unit, "d")], None)[:, 0]


def test_moments() -> None:
    for text, mean, spread in (
        ("normal(1.95 um, 50 nm)", 1.95e-6, 50e-9), ("lognormal(2 um, 1 um)", 2e-6, 1e-6), ("uniform(1 mm, 3 mm)", 2e-3, 2e-3 / math.sqrt(12)),
        ("triangular(0 m, 1 m, 5 m)", 2.0, math.sqrt((25 + 1 - 5) / 18)),
        ("truncated(normal(0 m, 1 m), -1 m, 1 m)", 0.0, math.sqrt(1 - 2 * math.exp(-0.5) / math.sqrt(2 * math.pi) / 0.6826894921370859)),
    ):  # fmt: skip
        found = sampled(text)
        assert found.mean() == pytest.approx(mean, rel=1e-3, abs=1e-4 * spread), text
        assert found.std() == pytest.approx(spread, rel=4e-3), text
    cut = sampled("truncated(lognormal(1 m, 2 m), 0.5 m, 2 m)")
    assert cut.min() >= 0.5 and cut.max() <= 2.0
    assert np.log(sampled("lognormal(1 m, 0.5 m)")).std() == pytest.approx(math.sqrt(math.log(1.25)), rel=1e-3)


def test_units_and_medians() -> None:
    found = distribution("triangular(0.4, 0.5, 0.6)", "1", "f")
    assert found == Distribution("triangular", (0.4, 0.5, 0.6)) and quantiles(found, np.array([0.5])) == pytest.approx(
        0.5
    )
    assert distribution("normal(130 GPa, 4 [GPa])", "Pa", "E").numbers == (130e9, 4e9)
    assert distribution("uniform(20 degC, 30 degC)", "K", "T").numbers == (293.15, 303.15)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("gauss(1 m, 2 m)", "no distribution; there are normal"), ("normal(1 m)", "normal takes 2 numbers: mean, standard deviation"),
        ("normal(1 kg, 2 m)", "`1 kg` is no quantity in m"), ("normal(1 m, 0 m)", "larger than zero"), ("normal(1 m, -1 m)", "larger than zero"),
        ("uniform(2 m, 1 m)", "is not below"), ("triangular(1 m, 3 m, 2 m)", "by the most likely"), ("lognormal(-1 m, 1 m)", "a mean above zero"),
        ("lognormal(0 m, 1 m)", "a mean above zero"), ("uniform(1 m, 1 m)", "is not below"),
        ("truncated(normal(0 m, 1 m), 50 m, 60 m)", "nothing of the distribution"), ("truncated(normal(0 m, 1 m), 1 m)", "low and high"),
        ("truncated(uniform(0 m, 1 m), 1 m, 0 m)", "is not below"), ("__import__('os')", "no distribution"), ("", "no distribution"),
    ],
)  # fmt: skip
def test_what_is_none(text: str, told: str) -> None:
    with pytest.raises(UsageError, match=told) as caught:
        distribution(text, "m", "d[1]")
    assert str(caught.value).startswith("d[1]:")


def test_a_spread_of_temperature_is_a_difference() -> None:
    with pytest.raises(UsageError, match="write it in K"):
        distribution("normal(20 degC, 2 degC)", "K", "T")


def test_the_copula_keeps_margins_and_ranks() -> None:
    """Spearman's correlation of a Gaussian copula is 6/pi asin(r/2)."""
    from scipy.stats import spearmanr

    given = [
        distribution("lognormal(1 m, 1 m)", "m", "a"),
        distribution("uniform(0 m, 1 m)", "m", "b"),
        distribution("normal(0 m, 1 m)", "m", "c"),
    ]
    matrix = correlation_matrix(("a", "b", "c"), {("a", "b"): 0.8, ("c", "b"): -0.3})
    found = values_of(cube(1 << 14, 3, 0), given, matrix)
    ranks = spearmanr(found).statistic
    for (i, j), r in {(0, 1): 0.8, (1, 2): -0.3, (0, 2): 0.0}.items():
        assert ranks[i, j] == pytest.approx(6 / math.pi * math.asin(r / 2), abs=4e-3)
    assert found[:, 1].mean() == pytest.approx(0.5, abs=1e-3) and np.log(found[:, 0]).std() == pytest.approx(
        math.sqrt(math.log(2)), rel=5e-3
    )
    tied = values_of(cube(256, 2, 0), given[1:2] * 2, correlation_matrix(("a", "b"), {("a", "b"): 1.0}))
    assert tied[:, 0] == pytest.approx(tied[:, 1], abs=1e-12)


def test_correlations_that_cannot_be() -> None:
    names = ("a", "b", "c")
    for pairs, told in (
        ({("a", "b"): 0.9, ("b", "c"): 0.9, ("a", "c"): -0.9}, "contradict each other"), ({("a", "x"): 0.1}, "`x` has no distribution"),
        ({("a", "b"): 1.1}, "not between"), ({("a", "a"): 0.5}, "each pair of two"), ({("a", "b"): 0.1, ("b", "a"): 0.2}, "each pair of two"),
        ({("a", "b"): math.nan}, "not between"),
    ):  # fmt: skip
        with pytest.raises(UsageError, match=told):
            correlation_matrix(names, pairs)


def test_points_are_even_and_the_same_for_a_seed() -> None:
    """Of 2^k points each 2^-k of every axis has one; another seed gives others."""
    points = cube(1024, 5, 7)
    assert all(len(set((points[:, j] * 1024).astype(int))) == 1024 for j in range(5))
    np.testing.assert_array_equal(points, cube(1024, 5, 7))
    np.testing.assert_array_equal(points[:700], cube(700, 5, 7))
    assert abs(points - cube(1024, 5, 8)).max() > 0.1
