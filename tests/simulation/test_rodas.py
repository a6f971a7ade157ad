"""Rodas5P: the conditions of its order, its convergence, published digits, the same steps on both back-ends, and its refusals."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import UsageError
from bondgraph.simulation.integrators import exponential, rodas
from tests.compiling import MODELS, limit_steps
from tests.published.test_stiff_problems import PUBLISHED

NAME = "Rodas5P"
Tree = tuple["Tree", ...]  # what hangs below a root


def matrices() -> tuple[Any, Any, Any, Any]:
    """In the form of the book, with products by J: alpha, gamma; weights of the step, and of the one that the estimate compares with."""
    count = rodas.STAGES
    coupling, argument = np.zeros((count, count)), np.zeros((count + 1, count))
    below = [(i, j) for i in range(count) for j in range(i)]
    for (i, j), value in zip(below, rodas.COUPLING, strict=True):
        coupling[i, j] = value
    for (i, j), value in zip(below, rodas.A, strict=False):
        argument[i, j] = value
    for i in range(rodas.WRITTEN, count + 1):
        argument[i] = argument[i - 1] + np.eye(count)[i - 1]
    gamma = np.linalg.inv(np.eye(count) / rodas.GAMMA - coupling)
    return argument[:count] @ gamma, gamma, argument[count] @ gamma, argument[count - 1] @ gamma


def trees(order: int) -> Iterator[Tree]:
    """All rooted trees of so many nodes, each once."""

    def forests(nodes: int, largest: tuple[int, Tree]) -> Iterator[Tree]:
        if nodes == 0:
            yield ()
        for size in range(min(nodes, largest[0]), 0, -1):
            for tree in trees(size):
                if (size, tree) <= largest:
                    for rest in forests(nodes - size, (size, tree)):
                        yield (tree, *rest)

    yield from forests(order - 1, (order, ((((((),),),),),)))


def size_of(tree: Tree) -> int:
    return 1 + sum(size_of(t) for t in tree)


def density(tree: Tree) -> int:
    return size_of(tree) * math.prod(density(t) for t in tree)


def weights(tree: Tree, alpha: Any, beta: Any) -> Any:
    """Of the stages (Hairer and Wanner, Solving ODEs II, section IV.7): a node with one branch reads it with beta, with more with alpha."""
    inner = [weights(t, alpha, beta) for t in tree]
    if not inner:
        return np.ones(len(alpha))
    return beta @ inner[0] if len(inner) == 1 else np.prod([alpha @ x for x in inner], axis=0)


def test_coefficients_satisfy_the_conditions_of_their_orders() -> None:
    """All 17 trees up to order 5; those up to order 4 by the estimate's method and by the polynomial anywhere; and it is stiffly accurate."""
    alpha, gamma, step, lower = matrices()
    beta = alpha + gamma
    np.testing.assert_allclose(alpha.sum(axis=1), rodas.C, atol=2e-13)
    np.testing.assert_allclose(gamma.sum(axis=1), rodas.D, atol=2e-13)
    np.testing.assert_allclose(beta[-1], step, atol=1e-13)
    assert [len(list(trees(n))) for n in range(1, 6)] == [1, 1, 2, 4, 9]
    rows = np.array(rodas.WITHIN).reshape(3, -1) @ gamma
    for order in range(1, 6):
        for tree in trees(order):
            found = weights(tree, alpha, beta)
            assert step @ found == pytest.approx(1 / density(tree), abs=2e-13)
            if order == 5:
                continue
            assert lower @ found == pytest.approx(1 / density(tree), abs=2e-13)
            for s in (0.2, 0.5, 0.9):
                within = s * (step + (1 - s) * (rows[0] + s * (rows[1] + (1 - s) * rows[2])))
                assert within @ found == pytest.approx(s**order / density(tree), abs=1e-12)
    assert max(abs(lower @ weights(t, alpha, beta) - 1 / density(t)) for t in trees(5)) > 1e-4


DRIVEN = """plain model Driven {
  signal x = integral(x*cos(time), 1), y = integral(-y^2*(1 + x - exp(sin(time))), 1)
  output a = x, b = y
}"""


def test_the_order_of_steps_and_between_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps of one size on rates that move with time: x = exp(sin t), y = 1/(1 + t)."""
    errors = []
    for size in (0.0625, 0.03125):
        limit_steps(monkeypatch, size)
        found = bondgraph.load(DRIVEN).simulate(to=6, points=97, rtol=1e-1, atol=1e3, solver="rodas")
        away = np.hypot(found["a"] - np.exp(np.sin(found.time)), found["b"] - 1 / (1 + found.time))
        errors.append((away[-1], away.max()))
    ends, inside = np.log2(np.array(errors[0]) / np.array(errors[1]))
    assert ends == pytest.approx(5, abs=0.2) and inside > 4.7 and errors[1][1] < 1e-8


@pytest.mark.parametrize("rate", [1e2, 1e5, 1e8])
def test_what_is_stiff_follows_at_once(rate: float) -> None:
    """x' = -rate (x - cos t) - sin t, off the solution at the start: L-stable, so it is on it after a few steps, however stiff; and between their ends too,
    where its polynomial alone errs by 2e-5."""
    text = f"plain model Fast {{ signal x = integral(-{rate}*(x - cos(time)) - sin(time), 1.5); output a = x }}"
    found = bondgraph.load(text).simulate(to=10, points=11, solver="rodas")
    assert found.solver.startswith(NAME) and found.steps < 150
    np.testing.assert_allclose(found["a"][1:], np.cos(found.time[1:]), atol=4e-6)


@pytest.mark.few(5)
@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("name", ["vdpol_mu1000", "robertson", "hires", "transistor_amplifier"])
def test_published_digits(name: str, rtol: float) -> None:
    """Measured: errors of 0.01 to 11 tolerances at these ends, those of Radau 0.005 to 28; the amplifier has the unknowns of an algebraic loop."""
    exact = np.array([float(x) for x in PUBLISHED[name]])
    found = bondgraph.load(MODELS / "published" / f"{name}.bg").simulate(rtol=rtol, solver="rodas")
    values = np.array([found.final(f"y{i + 1}") for i in range(len(exact))])
    assert found.solver.startswith(NAME)
    assert np.abs(values / exact - 1).max() < 20 * rtol


RUNNING = (
    "manipulator.bg", "car.bg", "pendulum.bg", "slider_crank.bg", "van_der_pol.bg", "robot_arm.bg", "solenoid.bg", "rc_ladder.bg",
    "published/robertson.bg",
)  # fmt: skip


@pytest.mark.few(3)
@pytest.mark.machine_code
@pytest.mark.parametrize("name", RUNNING)
def test_both_back_ends_take_the_same_steps(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Laws that bend among them; evaluations, Jacobians and factorisations are counted alike."""
    monkeypatch.setattr(exponential, "linear_form", lambda *_: None)
    model = bondgraph.load(MODELS / Path(name))
    native, numpy = (model.simulate(target=t, energy=True, rtol=1e-4, solver="rodas") for t in ("native", "numpy"))
    assert (native.solver, numpy.solver) == (f"{NAME}, native", f"{NAME}, numpy")
    assert native.steps == numpy.steps and dict(native.evaluations) == dict(numpy.evaluations)
    assert native.steps <= native.evaluations["jacobian"] <= native.evaluations["factorisation"]
    scale = np.abs(numpy.values).max(axis=0) + 1e-300
    assert (np.abs(native.values - numpy.values) / scale).max() < 1e-6


@pytest.mark.machine_code
def test_sparse_factors_take_the_steps_of_dense_ones() -> None:
    """A ladder of 120 cells: the Python source has no order of pivots, and takes dense factors."""
    cells = "plain model Cells { parameter n = 120; Se source : e = sin(time); 0 node[0]; source -> node[0]\n for i in 1..n { 0 node[i]; R r[i] : e = 0.1*f; C c[i] : q = 0.1*e; R l[i] : f = e + e^3; node[i-1] -> 1(r[i]) -> node[i] -> c[i], l[i] }\n output u = c[1].e, v = c[n].e }"  # fmt: skip
    model = bondgraph.load(cells)
    native, numpy = (model.simulate(to=0.5, points=6, target=t, rtol=1e-3, solver="rodas") for t in ("native", "numpy"))
    assert len(model.states) == 120 and native.steps == numpy.steps > 5
    np.testing.assert_allclose(native.values, numpy.values, rtol=1e-8, atol=1e-12)


def test_what_grows_is_not_damped() -> None:
    """From 1e-9 an instability of 1e3/s: a long step of a method that damps would pass over it."""
    text = "plain model Grows { signal x = integral(1000*(x - x^3), 1e-9); output a = x }"
    found = bondgraph.load(text).simulate(to=1, points=11, solver="rodas")
    assert found["a"][1:] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ((MODELS / "four_bar.bg").read_text(encoding="utf-8"), "closed loops hold its states.* name `radau`"),
        ("plain model Late { signal x = integral(-delay(x, 1), 1); output y = x }", "delayed signals.* name `radau`"),
    ],
)
def test_what_it_cannot_step_through_is_refused(text: str, word: str) -> None:
    with pytest.raises(UsageError, match=word):
        bondgraph.load(text).simulate(to=1, solver="rodas")


def test_an_experiment_names_it_and_nothing_else_chooses_it() -> None:
    named = DRIVEN.replace("output", "experiment e { simulate 0 .. 1 { solver = rodas } }\n  output")
    model = bondgraph.load(named)
    assert model.simulate().solver.startswith(NAME)
    assert NAME not in model.simulate(solver="automatic").solver
