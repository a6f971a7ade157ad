"""DOP853: its order, tolerance, choice and replacement by another method; in machine code or in Python, as available."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import UsageError
from bondgraph.simulation.integrators import dop853
from tests.compiling import MODELS, limit_steps

PAIR, RADAU = "Dormand-Prince 8", "Radau IIA 5"

# A central force 1/r^2, in the plane: an orbit of eccentricity 0.3 that takes 2 pi s. x = cos E - e, y = sqrt(1 - e^2) sin E, E - e sin E = t.
ORBIT = """plain model Orbit {
  signal r = sqrt(x^2 + y^2)
  signal x = integral(u, 0.7), y = integral(v, 0)
  signal u = integral(-x/r^3, 0), v = integral(-y/r^3, sqrt(1.3/0.7))
  output a = x, b = y
}"""


def orbit(times: Any) -> tuple[Any, Any]:
    anomaly = times.copy()
    for _ in range(60):
        anomaly = anomaly - (anomaly - 0.3 * np.sin(anomaly) - times) / (1 - 0.3 * np.cos(anomaly))
    return np.cos(anomaly) - 0.3, math.sqrt(1 - 0.09) * np.sin(anomaly)


def error_of_orbit(**settings: Any) -> tuple[float, bondgraph.Result]:
    found = bondgraph.load(ORBIT).simulate(to=20, points=41, **settings)
    x, y = orbit(found.time)
    return max(np.abs(found["a"] - x).max(), np.abs(found["b"] - y).max()), found


def test_coefficients_satisfy_the_conditions_of_their_order() -> None:
    """b' c^k = 1/(k+1) up to order 8, row sums, and both error estimates without terms of lower order."""
    a = np.zeros((16, 16))
    for i in range(16):
        for k in range(dop853.STARTS[i], dop853.STARTS[i + 1]):
            a[i, dop853.FROM[k]] = dop853.A[k]
    c = np.array(dop853.C)
    np.testing.assert_allclose(a.sum(axis=1), c, atol=1e-14)
    b, inner = a[12, :12], c[:12]
    for k in range(8):
        assert b @ inner**k == pytest.approx(1 / (k + 1), abs=1e-14)
        assert b @ (a[:12, :12] @ inner**k) == pytest.approx(1 / ((k + 1) * (k + 2)), abs=1e-14 if k < 7 else 1)
    for weights, order in ((dop853.E5, 5), (dop853.E3, 3)):
        found = [abs(np.array(weights) @ inner**k) for k in range(order + 1)]
        assert max(found[:order]) < 1e-14 and found[order] > 1e-6


def test_the_order_of_steps_and_of_the_polynomial_between(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps of one size: the error of a run falls with its 8th power, that of the polynomial inside of one step with the 8th of its length."""
    ends, inside = [], []
    for size in (0.5, 0.25):
        limit_steps(monkeypatch, size)
        found = bondgraph.load(ORBIT).simulate(to=6, points=97, rtol=1e-1, atol=1e3, solver="explicit")
        x, y = orbit(found.time)
        away = np.hypot(found["a"] - x, found["b"] - y)
        ends.append(away[-1])
        inside.append(away.max())
    assert math.log2(ends[0] / ends[1]) == pytest.approx(8, abs=0.8)
    assert math.log2(inside[0] / inside[1]) > 7


@pytest.mark.parametrize("solver", ["explicit", pytest.param("radau", marks=pytest.mark.machine_code)])
def test_the_error_is_proportional_to_the_tolerance(solver: str) -> None:
    tolerances = [1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10]
    errors = [error_of_orbit(rtol=t, solver=solver)[0] for t in tolerances]
    slope = np.polyfit(np.log(tolerances), np.log(errors), 1)[0]
    assert 0.7 < slope < 1.4 and errors[-1] < 2e-7


def test_it_is_chosen_where_nothing_is_stiff_and_saves_work() -> None:
    mine, found = error_of_orbit(rtol=1e-8)
    other, radau = error_of_orbit(rtol=1e-8, solver="radau")
    assert found.solver.startswith(PAIR) and radau.solver.startswith(RADAU)
    assert mine < 3 * other and found.evaluations["derivative"] < 0.6 * radau.evaluations["derivative"]


VAN_DER_POL = """plain model Relaxing {{
  signal x = integral(y, 2), y = integral({mu}*(1 - x^2)*y - x, 0)
  output a = x
}}"""


@pytest.mark.parametrize(("mu", "to"), [(1000, 1500), (1e4, 1e4)])
def test_stiff_models_go_by_radau(mu: float, to: float) -> None:
    found = bondgraph.load(VAN_DER_POL.format(mu=mu)).simulate(to=to, points=11)
    assert found.solver.startswith(RADAU) and found.steps < 2000


def test_the_manipulator_and_its_fast_modes_go_by_radau() -> None:
    """Modes of MHz that nothing damps and nothing moves: no trial leaves them ringing."""
    found = bondgraph.load(MODELS / "manipulator.bg").simulate()
    assert found.solver.startswith(RADAU) and found.steps < 200


BECOMES_STIFF = """plain model Becomes {
  signal grip = 1e6*smoothstep5(time, 5, 6)
  signal x = integral(v, 1), v = integral(-x - 1e-9*x^3 - grip*(v - cos(time)), 0)
  output a = x, b = v
}"""


def test_what_becomes_stiff_on_the_way_is_left_to_radau_from_there_on() -> None:
    found = bondgraph.load(BECOMES_STIFF).simulate(to=20, points=41, rtol=1e-6)
    first, _, second = found.solver.partition(" and ")
    assert first.startswith(PAIR) and second.startswith(RADAU) and found.steps < 1000
    late = found.time > 7
    np.testing.assert_allclose(found["b"][late], np.cos(found.time[late]), atol=1e-4)
    alone = bondgraph.load(BECOMES_STIFF).simulate(to=20, points=41, rtol=1e-6, solver="radau")
    assert alone.solver.startswith(RADAU) and " and " not in alone.solver
    np.testing.assert_allclose(found["a"], alone["a"], atol=1e-4)


def test_who_asks_for_it_gets_it_and_stability_is_kept() -> None:
    """Asked for, it makes no other step than its own: as many as stability asks for, and no more."""
    text = "plain model Fast { signal x = integral(-1000*(x - cos(time)), 0); output a = x }"
    found = bondgraph.load(text).simulate(to=10, points=11, solver="explicit")
    assert found.solver.startswith(PAIR) and " and " not in found.solver
    assert 10 * 1000 / 6.4 < found.steps < 1.3 * 10 * 1000 / dop853.STABLE
    exact = (1e6 * np.cos(found.time) + 1e3 * np.sin(found.time)) / (1e6 + 1)  # and what dies out within 0.01 s
    np.testing.assert_allclose(found["a"][1:], exact[1:], atol=3e-6)


def test_a_pulse_between_two_steps_is_seen() -> None:
    text = """plain model Struck {
  signal x = integral(v, 1), v = integral(-x + 50*exp(-((time - 31)/0.02)^2), 0)
  output a = x
}"""
    found = bondgraph.load(text).simulate(to=40, points=41, solver="explicit")
    push = 50 * 0.02 * math.sqrt(math.pi) * math.exp(-(0.01**2))  # the pulse's part of the frequency 1
    exact = np.cos(found.time) + np.where(found.time > 31, push * np.sin(found.time - 31), 0)
    np.testing.assert_allclose(found["a"][found.time != 31], exact[found.time != 31], atol=1e-4)


def test_jumps_in_time_are_hit_exactly() -> None:
    text = "plain model Pushed { signal x = integral(v, 0), v = integral(step(time - 1/3) - 0.1*x^3, 0); output a = v }"
    found = bondgraph.load(text).simulate(to=1, points=3001, rtol=1e-9)
    assert found.solver.startswith(PAIR)
    assert np.abs(found["a"][found.time < 1 / 3]).max() == 0
    after = found.time > 1 / 3
    np.testing.assert_allclose(found["a"][after][:100], (found.time[after] - 1 / 3)[:100], atol=1e-9)


def test_events_are_found_as_exactly_as_by_radau() -> None:
    """A ball that bounces: heights and instants have a closed form."""
    text = """model Ball {
  signal v = integral(-10 [m/s^2], 0 [m/s]), h = integral(v, 1 m)
  when h < 0 m { v = -0.5*v }
  output y = h
}"""
    for solver in ("explicit", "radau", "rodas"):
        found = bondgraph.load(text).simulate(to=1, points=11, solver=solver)
        fall = math.sqrt(0.2)
        expected = [fall, 2 * fall, 2.5 * fall][: len(found.events)]
        assert len(found.events) == 2 and [e.time for e in found.events] == pytest.approx(expected[:2], rel=1e-12)


def test_work_adds_up_to_what_is_stored() -> None:
    balance = bondgraph.load(MODELS / "oscillator.bg").simulate(energy=True, rtol=1e-8, solver="explicit").energy
    assert balance is not None and abs(balance.residual) < 1e-7 * balance.supplied


# ---------------------------------------------------------------------- asking for a solver
def run_of(solver: str) -> Callable[[], bondgraph.Result]:
    text = ORBIT.replace("output a", f"experiment e {{ simulate 0 .. 1 {{ solver = {solver} }} }}\n  output a")
    return lambda: bondgraph.load(text).simulate()


def test_an_experiment_names_its_solver_and_a_call_another() -> None:
    assert run_of("radau")().solver.startswith(RADAU) and run_of("explicit")().solver.startswith(PAIR)
    model = bondgraph.load(MODELS / "duffing.bg")
    assert model.simulate(solver="radau", to=1).solver.startswith(RADAU)
    assert bondgraph.load(MODELS / "rlc.bg").simulate(solver="exponential").solver == "matrix exponential"
    assert bondgraph.load(MODELS / "rlc.bg").simulate(solver="explicit", to="1 ms").solver.startswith(PAIR)


@pytest.mark.parametrize(("solver", "word"), [("exponential", "linear"), ("explicit", "loops"), ("magic", "no solver")])
def test_what_cannot_be_done_is_refused(solver: str, word: str) -> None:
    with pytest.raises(UsageError, match=word):
        bondgraph.load(MODELS / "four_bar.bg").simulate(solver=solver)


def test_a_word_that_is_no_solver_is_told_with_its_place() -> None:
    from compiler.errors import CompilationFailed

    with pytest.raises(CompilationFailed) as failed:
        run_of("radu")()
    (told,) = failed.value.diagnostics
    assert told.code == "BG101" and "radau" in told.hint  # type: ignore[attr-defined]


@pytest.mark.parametrize(("turns", "solver"), [(100, "Dormand-Prince 8"), (10_000, "Radau IIA 5")])
@pytest.mark.parametrize("rate", [1e-6, 0.1, 1.0, 1e5])
def test_the_choice_knows_no_unit_of_time(turns: float, solver: str, rate: float) -> None:
    """A decay is stiff by its rate times the length of the run, whatever each of them is."""
    text = f"plain model Decay {{\n  signal x = integral(-{rate}*(x + 0.1*x^3), 1)\n  output y = x\n}}\n"
    found = bondgraph.load(text).simulate(to=turns / rate, points=3)
    assert found.solver.startswith(solver), found.solver


@pytest.mark.machine_code
def test_a_law_that_no_explicit_method_passes_says_what_does() -> None:
    """An orifice beside a stiff volume: at zero its slope is infinite."""
    text = """plain model Orifice {
      C t : q = 1e-6*e
      Sf s : f = 0.02*(0.1 - time)
      R o : f = 0.01*sign(e)*sqrt(abs(e))
      s -> 0(t, o)
      output f = o.f
    }"""
    model = bondgraph.load(text)
    with pytest.raises(bondgraph.RunFailed, match=r"explicit.*name `radau`"):
        model.simulate(to=0.15, solver="explicit")
    found = model.simulate(to=0.15, points=16, solver="radau")
    np.testing.assert_allclose(found["f"][1:], 0.02 * (0.1 - found.time[1:]), atol=1e-6)
