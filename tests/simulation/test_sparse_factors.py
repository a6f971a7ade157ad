"""Sparse factors: columns of one pattern are taken together, and give the bits of one after the other."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.simulation.integrators.compiled.ordering import on_diagonal, ordered
from bondgraph.simulation.integrators.linear_algebra.sparse import (
    FINE,
    complex_back,
    complex_factors,
    real_back,
    real_factors,
)
from tests.benchmarks import large_models
from tests.compiling import Running, compiled

SHIFT, TURN = 3.0e5, 2.0e5


def jacobian() -> tuple[Any, Any, int, Any]:
    side = 9
    made = Running(compiled(large_models.network(large_models.mesh_edges(side), side * side)))
    program = made.program
    entries = program.jacobian_entries(*made.arguments(0.0, None, None))
    return *program.pattern, side * side, entries


def pattern(alone: bool, diagonal: bool = True) -> SimpleNamespace:
    rows, columns, count, entries = jacobian()
    pattern = rows, columns, count, count
    fields = on_diagonal(*pattern, False) if diagonal else ordered(*pattern, SHIFT, entries)
    assert fields is not None
    assert fields["wide"].max() >= 4
    if alone:
        fields["wide"][:] = 1
    room = ("diagonal", "scale", "diagonal_re", "diagonal_im", "scale_complex", "x", "xi", "y", "yi")
    given = {name: np.zeros(count) for name in room} | fields
    return SimpleNamespace(n=count, ready=1, small=1e-3, tolerant=0, **given)


@pytest.mark.parametrize("diagonal", [True, False], ids=["from the pattern", "by the library"])
def test_factors_solve_the_system(diagonal: bool) -> None:
    rows, columns, count, entries = jacobian()
    dense = np.zeros((count, count))
    dense[rows, columns] = -entries
    right = np.sin(np.arange(count))
    p = pattern(False, diagonal)
    assert real_factors(p, SHIFT, entries) == FINE
    assert complex_factors(p, SHIFT, TURN, entries) == FINE
    x, re, im = right.copy(), right.copy(), np.cos(right)
    expected = np.linalg.solve(dense + (SHIFT + 1j * TURN) * np.eye(count), re + 1j * im)
    real_back(p, x)
    complex_back(p, re, im)
    np.testing.assert_allclose(x, np.linalg.solve(dense + SHIFT * np.eye(count), right), rtol=1e-10)
    np.testing.assert_allclose(re + 1j * im, expected, rtol=1e-10)


def test_columns_together_give_the_bits_of_one_after_the_other() -> None:
    entries = jacobian()[3]
    together, alone = pattern(False), pattern(True)
    for p in (together, alone):
        real_factors(p, SHIFT, entries)
        complex_factors(p, SHIFT, TURN, entries)
    for name in (
        "lower",
        "upper",
        "diagonal",
        "lower_re",
        "lower_im",
        "upper_re",
        "upper_im",
        "diagonal_re",
        "diagonal_im",
    ):
        np.testing.assert_array_equal(getattr(together, name), getattr(alone, name))


@pytest.mark.parametrize("target", ["numpy", pytest.param("native", marks=pytest.mark.machine_code)])
def test_a_mesh_keeps_its_charge(target: str) -> None:
    """Without leaks and feed the mean of all voltages stays, and all go there."""
    text = large_models.network(large_models.mesh_edges(11), 121, leak="0 [A/V]*u")
    text = text.replace("R feed : u = 10 ohm*i", "R feed : i = 0 [A/V]*u")
    result = bondgraph.load(text).simulate(to="20 ms", points=3, target=target)
    mean = np.mean([float(large_models.start(i)) for i in range(1, 122)])
    assert result.final("first") == pytest.approx(mean, rel=1e-6)
    assert result.final("last") == pytest.approx(mean, rel=1e-6)
