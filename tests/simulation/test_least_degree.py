"""Orders of sparse factors: elimination in full arrays has entries only in the computed pattern, with hardly any fill-in."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from bondgraph.simulation.integrators.compiled.ordering import on_diagonal, ordered
from bondgraph.simulation.integrators.linear_algebra import least_degree
from tests.benchmarks import large_models
from tests.compiling import ROOT

Edges = list[tuple[int, int]]


def places_of(edges: Edges, count: int) -> tuple[Any, Any]:
    """Both ends of each edge, and the diagonal."""
    rows = np.array([*range(count), *(a for a, _ in edges), *(b for _, b in edges)])
    columns = np.array([*range(count), *(b for _, b in edges), *(a for a, _ in edges)])
    return rows, columns


def order_of(edges: Edges, count: int) -> dict[str, Any]:
    found = on_diagonal(*places_of(edges, count), count, count, False)
    assert found is not None
    return found


def star(count: int) -> Edges:
    return [(0, i) for i in range(1, count)]


def ladder(count: int) -> Edges:
    return [(i, i + 1) for i in range(count - 1)]


def tree(count: int) -> Edges:
    return [((i - 1) // 3, i) for i in range(1, count)]


def mesh(side: int) -> Edges:
    return [(a - 1, b - 1) for a, b in large_models.mesh_edges(side)]


def eliminated(edges: Edges, count: int, place: Any) -> Any:
    """Pattern of the factors below the diagonal."""
    full = np.eye(count, dtype=bool)
    for a, b in edges:
        full[place[a], place[b]] = full[place[b], place[a]] = True
    for k in range(count):
        below = np.flatnonzero(full[k + 1 :, k]) + k + 1
        full[np.ix_(below, below)] = True
    return np.tril(full, -1)


def filled(starts: Any, rows: Any) -> Any:
    """The same from the computed columns, whose rows increase."""
    count = len(starts) - 1
    full = np.zeros((count, count), dtype=bool)
    for column in range(count):
        inside = rows[starts[column] : starts[column + 1]]
        assert (np.diff(inside) > 0).all()
        full[inside, column] = True
    return full


@pytest.mark.parametrize("seed", range(40))
def test_factors_have_room_for_what_elimination_fills_and_no_more(seed: int) -> None:
    draw = np.random.default_rng(seed)
    count = int(draw.integers(1, 50))
    pairs = draw.integers(0, count, (int(draw.integers(0, 4 * count)), 2)).tolist()
    edges = [(a, b) for a, b in pairs if a != b]
    found = order_of(edges, count)
    place = found["row_place"]
    assert sorted(place.tolist()) == list(range(count)) and np.array_equal(place, found["column_place"])
    expected = eliminated(edges, count, place)
    np.testing.assert_array_equal(filled(found["l_start"], found["l_row"]), expected)
    np.testing.assert_array_equal(filled(found["u_start"], found["u_row"]), expected.T)
    for k, wide in enumerate(found["wide"].tolist()):
        for j in range(k + 1, k + wide):  # of one pattern, but for their own rows
            np.testing.assert_array_equal(expected[j + 1 :, k], expected[j + 1 :, j])
            assert expected[k + 1 : j + 1, k].all()


@pytest.mark.parametrize("make", [star, ladder, tree], ids=["star", "ladder", "tree"])
def test_trees_do_not_fill(make: Any) -> None:
    found = order_of(make(400), 400)
    assert len(found["l_row"]) == len(found["u_row"]) == 399


def test_what_has_very_many_neighbours_comes_last() -> None:
    """Each of 900 neighbours would look through it, and find the others."""
    edges = [*star(901), *((i, i + 1) for i in range(1, 900))]
    found = order_of(edges, 901)
    assert found["row_place"][0] == 900
    assert len(found["l_row"]) == 900 + 899


def test_equal_nodes_are_eliminated_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """A mesh with three nodes for each of its own: these wait as one, and go at once."""
    threefold = [(3 * a + i, 3 * b + j) for a, b in mesh(8) for i in range(3) for j in range(3)]
    within = [(3 * a + i, 3 * a + j) for a in range(64) for i in range(3) for j in range(i)]
    weights: list[int] = []
    original = least_degree.join

    def join(q: Any, pivot: int) -> None:
        weights.append(int(q.weight[pivot]))
        original(q, pivot)

    monkeypatch.setattr(least_degree, "join", join)
    found = order_of(threefold + within, 192)
    assert len(weights) <= 64 and max(weights) >= 3
    assert len(found["l_row"]) <= 9 * len(order_of(mesh(8), 64)["l_row"]) + 9 * 64


@pytest.mark.parametrize(
    ("edges", "count"),
    [(mesh(20), 400), ([(a - 1, b - 1) for a, b in large_models.random_edges(600, 300)], 600)],
    ids=["mesh", "random"],
)
def test_fill_is_that_of_other_orders_of_least_degree(edges: Edges, count: int) -> None:
    rows, columns = places_of(edges, count)
    entries = np.where(rows == columns, -1.0 - count, 1.0)
    found, other = order_of(edges, count), ordered(rows, columns, count, count, 1.0, entries)
    assert other is not None
    assert len(found["l_row"]) <= 1.1 * len(other["l_row"])


@pytest.mark.machine_code
def test_machine_code_and_its_source_find_the_same() -> None:
    rows, columns = places_of(mesh(20), 400)
    found, other = on_diagonal(rows, columns, 400, 400), on_diagonal(rows, columns, 400, 400, False)
    assert found is not None and other is not None and found.keys() == other.keys()
    for name in found:
        np.testing.assert_array_equal(found[name], other[name], err_msg=name)


def test_one_sided_patterns_are_taken_where_they_hardly_fill() -> None:
    edges = [*ladder(100), *((i + 30, i) for i in range(0, 60, 20))]
    for one_sided, taken in ((edges, True), (mesh(14), False)):
        count = 1 + max(map(max, one_sided))
        rows, columns = (np.array([*range(count), *(e[k] for e in one_sided)]) for k in (0, 1))
        assert (on_diagonal(rows, columns, count, count, False) is not None) == taken


@pytest.mark.parametrize("diagonal", [0.0, 1e-4])
def test_small_pivots_are_left_to_a_library(diagonal: float) -> None:
    rows, columns = places_of(ladder(50), 50)
    values = 1.0 + 0.01 * np.arange(len(rows)) / len(rows)
    chosen = ordered(rows[50:], columns[50:], 50, 50, diagonal, values[50:])
    assert chosen is not None and not np.array_equal(chosen["row_place"], chosen["column_place"])


@pytest.mark.machine_code
@pytest.mark.parametrize("text", [large_models.rc_ladder(120), large_models.network(large_models.mesh_edges(11), 121)], ids=["ladder", "mesh"])  # fmt: skip
def test_large_models_run_without_scipy(text: str) -> None:
    script = (
        "import sys, bondgraph\nfrom compiler.api import Source\n"
        "result = bondgraph.Model(Source('ladder.bg', sys.stdin.read())).simulate()\n"
        "assert result.steps > 20\nprint('scipy' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], input=text, capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert done.stdout.split() == ["False"]
