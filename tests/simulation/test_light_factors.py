"""Matrices that hardly fill are ordered without a library; others, and those whose diagonal does not serve, are left to it."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from bondgraph.simulation.steps.compiled.light import light_factors
from bondgraph.simulation.steps.compiled.ordering import ordered
from tests.benchmarks import large_models
from tests.compiling import ROOT

Edges = list[tuple[int, int]]


def matrix_of(edges: Edges, count: int, diagonal: float = 3.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places and numbers of what has -1, or a little more, at both ends of each edge."""
    rows = np.array([*range(count), *(a for a, _ in edges), *(b for _, b in edges)])
    columns = np.array([*range(count), *(b for _, b in edges), *(a for a, _ in edges)])
    values = np.where(rows == columns, diagonal, -1.0 - 0.01 * np.arange(len(rows)) / len(rows))
    return rows, columns, values


def star(count: int) -> Edges:
    return [(0, i) for i in range(1, count)]


def ladder(count: int) -> Edges:
    return [(i, i + 1) for i in range(count - 1)]


def tree(count: int) -> Edges:
    return [((i - 1) // 3, i) for i in range(1, count)]


@pytest.mark.parametrize("make", [star, ladder, tree], ids=["star", "ladder", "tree"])
def test_trees_do_not_fill(make: object) -> None:
    count, edges = 200, make(200)  # type: ignore[operator]
    found = light_factors(*matrix_of(edges, count), count)
    assert found is not None
    assert sorted(found.place.tolist()) == list(range(count))
    assert len(found.lower[1]) == len(found.upper[1]) == len(edges)


def test_factors_have_room_for_all_that_elimination_fills() -> None:
    """A ring fills a little: what is eliminated in full arrays, in the order that was found, is nowhere else."""
    count = 30
    rows, columns, values = matrix_of([*ladder(count), (0, count - 1)], count)
    found = light_factors(rows, columns, values, count)
    assert found is not None
    full = np.zeros((count, count))
    full[found.place[rows], found.place[columns]] = values
    for k in range(count):
        full[k + 1 :, k] /= full[k, k]
        full[k + 1 :, k + 1 :] -= np.outer(full[k + 1 :, k], full[k, k + 1 :])
    for (starts, inside), factor in ((found.lower, np.tril(full, -1)), (found.upper, np.triu(full, 1))):
        places = {(int(r), c) for c in range(count) for r in inside[starts[c] : starts[c + 1]]}
        assert {(int(r), int(c)) for r, c in zip(*np.nonzero(factor), strict=True)} <= places
        assert all(np.all(np.diff(inside[starts[c] : starts[c + 1]]) > 0) for c in range(count))


def test_what_fills_is_left_to_a_library() -> None:
    edges = [(a - 1, b - 1) for a, b in large_models.mesh_edges(14)]
    assert light_factors(*matrix_of(edges, 196), 196) is None


@pytest.mark.parametrize("diagonal", [0.0, 1e-4])
def test_small_pivots_are_left_to_a_library(diagonal: float) -> None:
    rows, columns, values = matrix_of(ladder(50), 50, diagonal)
    assert light_factors(rows, columns, values, 50) is None
    chosen = ordered(rows[50:], columns[50:], 50, 50, diagonal, -values[50:])
    assert chosen is not None and not np.array_equal(chosen["row_place"], chosen["column_place"])


def test_nothing_and_infinity_are_refused() -> None:
    rows, columns, values = matrix_of(ladder(10), 10)
    assert light_factors(rows, columns, np.where(rows == 4, 0.0, values), 10) is None
    assert light_factors(rows, columns, np.where(rows == 4, np.inf, values), 10) is None


@pytest.mark.machine_code
def test_a_ladder_runs_without_scipy() -> None:
    text = large_models.rc_ladder(120)
    script = (
        "import sys, bondgraph\nfrom bondgraph.door import Source\n"
        "result = bondgraph.Model(Source('ladder.bg', sys.stdin.read())).simulate()\n"
        "assert result.steps > 20\nprint('scipy' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], input=text, capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert done.stdout.split() == ["False"]
