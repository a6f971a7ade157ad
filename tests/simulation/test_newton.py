"""Errors that Newton's iteration within a step of Radau must not leave, and the bound of its error estimate."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import bondgraph
from bondgraph.simulation.integrators import radau
from bondgraph.simulation.integrators.compiled.advance import begin, one_step
from bondgraph.simulation.integrators.linear_algebra.factors import ComplexFactors, Factors
from bondgraph.simulation.integrators.methods import RADAU
from bondgraph.simulation.integrators.projection.projection import NormalEquations, ProjectionWorkspace
from bondgraph.simulation.integrators.steps import radau_step
from bondgraph.simulation.integrators.steps.evaluation import renew
from bondgraph.simulation.integrators.steps.radau_step import LEAST, factorise_stages_of, use_stages
from bondgraph.simulation.integrators.steps.step_control import filtered_norm
from bondgraph.simulation.integrators.tolerances import LOOSE, allowed_estimate, creeping_tolerance, newton_tolerance
from bondgraph.simulation.integrators.workspace import IntegratorWorkspace
from compiler.api import zeros_of
from tests.compiling import MODELS


def workspace(rates: Callable[..., None], entries: Callable[..., None]) -> IntegratorWorkspace:
    """Two states from zero by Radau's method, with the diagonal of a Jacobian."""
    nothing = {
        "int": lambda: 0,
        "float": lambda: 0.0,
        "Floats": lambda: np.zeros(6),
        "Ints": lambda: np.zeros(6, dtype=int),
    }
    values = {name: nothing.get(kind, lambda: None)() for name, kind in IntegratorWorkspace.__annotations__.items()}
    held = object.__new__(ProjectionWorkspace)
    held.positions, held.multipliers = object.__new__(NormalEquations), 0
    held.positions.rows = held.constraints = 0
    places, ones = np.array([0, 1]), np.ones(2)
    return IntegratorWorkspace(**values | {
        "method": RADAU, "derivative": rates, "entries": entries, "closed": held, "n": 2, "differential": 2, "entry_count": 2, "rows": places, "columns": places,
        "magnitude": ones, "per_unit": ones, "ratio": ones, "relative": 1e-3, "absolute": 1e-3 * ones, "state": np.zeros(2), "jacobian": np.zeros(2),
        "newton_tolerance": newton_tolerance(1e-3, 1.0), "first_newton_tolerance": newton_tolerance(1e-3, 1.0), "allowed_estimate": allowed_estimate(1e-3),
        "creeping_tolerance": creeping_tolerance(1e-3), "longest": np.inf, "usual": np.inf, "stop": 1.0, "until": 1.0,
        "real": Factors(**zeros_of(Factors, n=2)), "complex": ComplexFactors(**zeros_of(ComplexFactors, n=2)), "norms": np.zeros(8), "sizes": np.zeros(8),
    })  # fmt: skip


def test_a_number_that_creeps_beside_large_changes_is_no_solution(monkeypatch: pytest.MonkeyPatch) -> None:
    """The Jacobian slows one state as if its law were 1e5 times as steep; it hardly moves beside another that moves by 100."""

    def rates(time: float, *given: np.ndarray) -> None:
        given[-1][:2] = 100.0, 1.0

    def steep(time: float, *given: np.ndarray) -> None:
        given[-1][:2] = -3.0, -1e5

    solver = workspace(rates, steep)
    begin(solver)
    solver.size = 0.1
    factorised: list[float] = []
    monkeypatch.setattr(
        radau_step, "factorise_stages_of", lambda s, size: factorised.append(size) or factorise_stages_of(s, size)
    )
    for _ in range(5):
        if one_step(solver):
            break
    assert solver.state[1] == pytest.approx(solver.time, abs=2e-3)
    assert solver.factorisations == 2 * len(factorised)  # one real matrix and one complex


def test_an_estimate_is_filtered_twice_at_the_start_and_after_a_rejection() -> None:
    """x' = -L x: once through the real matrix leaves e = -L x/(mu/h + L), twice -L (x + e)/(mu/h + L); an error within the tolerance is filtered once."""
    stiffness, size = 1e4, 0.01

    def rates(time: float, *given: np.ndarray) -> None:
        given[-1][:2] = -stiffness * given[0][0], 0.0

    def entries(time: float, *given: np.ndarray) -> None:
        given[-1][:2] = -stiffness, 0.0

    def norm(state: float, last_size: float, rejected: bool) -> float:
        solver = workspace(rates, entries)
        solver.state[0] = state
        begin(solver)
        solver.last_size, solver.new[0] = last_size, state
        renew(solver)
        use_stages(solver, LEAST)
        factorise_stages_of(solver, size)
        return filtered_norm(solver, rejected)

    once = norm(1.0, size, False)
    assert once > 1.0
    error = -stiffness / (radau.MU_REAL / size + stiffness)
    for last_size, rejected in ((0.0, False), (size, True), (0.0, True)):
        assert norm(1.0, last_size, rejected) == pytest.approx(once * (1 + error), rel=1e-9)
    assert norm(1e-6, 0.0, True) == norm(1e-6, size, False) < 1.0


def test_loose_tolerances_ask_more_of_the_estimate() -> None:
    """error ~ estimate^(5/4): the fourth of five powers of ten at 1e-1 below, none at tight tolerances."""
    assert allowed_estimate(LOOSE) == allowed_estimate(1e-12) == 1.0
    assert allowed_estimate(1e5 * LOOSE) == pytest.approx(0.1)


def test_a_first_step_errs_no_more_than_others() -> None:
    """A slider-crank: an error of the first step remained as an error of phase; the force erred by 66 tolerances."""
    model = bondgraph.load(MODELS / "crank_linkage.bg")
    exact = model.simulate(rtol=1e-7, points=41)
    found = model.simulate(rtol=1e-4, points=41)
    assert np.abs(found["force"] - exact["force"]).max() < 1e-3 * np.abs(exact["force"]).max()


def test_concentrations_hold_loose_tolerances() -> None:
    """Robertson's: b rises as if it went to 1, and turns at 4e-5, where it decays by its square 1e9 times as fast; at 1e-3 the run failed."""
    text = (MODELS / "published" / "robertson.bg").read_text(encoding="utf-8")
    model = bondgraph.load(text[: text.index("  experiment")] + "}\n")
    exact = model.simulate(to=1e5, points=2, rtol=1e-7)
    for rtol in (1e-3, 1e-4):
        found = model.simulate(to=1e5, points=2, rtol=rtol)
        assert abs(found.final("y1") - exact.final("y1")) < 3 * rtol
        assert not found.notes


def test_a_run_tells_what_tolerances_have_let_loose() -> None:
    """Over 1e11 s a concentration of 2e-8 is beside zero at 1e-4, and below zero nothing holds the equations."""
    text = (MODELS / "published" / "robertson.bg").read_text(encoding="utf-8")
    model = bondgraph.load(text[: text.index("  experiment")] + "}\n")
    found = model.simulate(to=1e11, points=2, rtol=1e-4)
    assert abs(found.final("y1")) < 1e-3 or any("times what a look ahead saw" in note for note in found.notes)
