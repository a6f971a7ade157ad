"""Runs that are stepped together: bit by bit those of runs alone; what needs more than steps is left to runs alone."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import fields
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.batch import pilot
from bondgraph.batch import together as batch
from bondgraph.batch.together import is_together, simulate_together
from bondgraph.compiled_model import CompiledModel
from bondgraph.results.result import Result
from bondgraph.simulation.integrators.compiled import record_layout
from bondgraph.simulation.magnitudes.free_response import item_by_item
from bondgraph.simulation.repetition import simulate
from bondgraph.simulation.run_options import RunOptions, RunRequest
from bondgraph.simulation.settings import _Number, _number, _signed
from compiler.api import native_available

pytestmark = pytest.mark.skipif(not native_available(), reason="there is no machine code")

DUFFING = """
model Duffing {
  parameter m = 1 kg, k: N/m = 100, k3: N/m^3 = 2e4, r: N*s/m = 0.5, F_0 = 1 N, t_0 = 0.1 s, gain: 1 = 1
  Se push   : F = F_0*gain*step(time - t_0)
  1  body
  I  mass   : p = m*v
  C  spring : F = k*x + k3*x^3  { start x = 1 mm }
  R  damper : F = r*v
  push -> body -> mass, spring, damper
  output position = spring.x
  experiment push_it { simulate 0 .. 2 s }
}
"""
VAN_DER_POL = "models/van_der_pol.bg"


@pytest.fixture(autouse=True)
def small_groups(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs are stepped together however few they are."""
    monkeypatch.setattr(batch, "FEWEST", 1)


def parts_of(result: Result) -> dict[str, Any]:
    """All of a result but its time on the clock, bit by bit."""
    found = {f.name: getattr(result, f.name) for f in fields(result) if f.name not in ("wall_time", "checkpoint")}
    end = result.checkpoint
    assert end is not None
    found |= {f"end {f.name}": getattr(end, f.name) for f in fields(end)}
    return {name: value.tobytes() if isinstance(value, np.ndarray) else value for name, value in found.items()}


def together(
    text: str, settings: list[Mapping[str, str | float]], experiment: str = "", **options: Any
) -> list[Result | None]:
    """Results of runs together; each is that of a run alone."""
    model = CompiledModel(bondgraph.load(text).source)
    request = RunRequest(experiment, options=RunOptions(**options))
    results = simulate_together(model, request, settings)
    for point, result in zip(settings, results, strict=True):
        if result is not None:
            assert parts_of(result) == parts_of(simulate(model, request.at(point)))
    return results


def is_whole(results: list[Result | None]) -> bool:
    return all(result is not None for result in results)


@pytest.mark.parametrize(
    ("text", "name", "values"),
    [
        (DUFFING, "k", (80.0, 100.0, 317.0)),
        (DUFFING, "m", (0.2, 1.0, 30.0)),
        ("models/manipulator.bg", "h", (36e-6, 38e-6, 41e-6)),
        (VAN_DER_POL, "eps", (0.1, 1.0, 5.0)),
        ("models/lotka_volterra.bg", "alpha", (0.5, 1.0, 1.1)),
        ("models/reaction.bg", "k_f", (1e-3, 0.1, 20.0)),
        ("models/rectifier.bg", "load", (500.0, 900.0)),
        ("models/rlc.bg", "R", (10.0, 0.01, 1e3, 1e9, 10.0)),
        ("models/rlc.bg", "U", (5.0, 6.0)),
        ("models/dc_motor.bg", "K", (0.01, 0.05)),
        ("models/transformer.bg", "n_1", (100.0, 200.0)),
        ("models/slider_crank.bg", "r", (0.04, 0.03)),
        ("models/pid_dc_motor.bg", "b", (1e-4, 2e-4)),
        ("models/published/robertson.bg", "k1", (0.04, 0.05)),
        ("models/published/hires.bg", "oks", (0.0007, 0.0008)),
    ],
)
def test_runs_together_are_runs_alone(text: str, name: str, values: tuple[float, ...]) -> None:
    assert is_whole(together(text, [{name: value} for value in values]))


def test_magnitudes_of_reactions_are_searched_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """States that get much farther than their rates at the start tell are looked at in parts of the run, those of all runs at once."""
    monkeypatch.delattr(pilot, "_alone")
    for model, name, values in (("published/hires", "oks", (0.0007, 0.0008)), ("pendulum", "mass", (0.9, 1.0))):
        assert is_whole(together(f"models/{model}.bg", [{name: value} for value in values]))


def test_some_runs_go_on_with_another_method() -> None:
    """Explicit steps, Radau's, and those that find out on the way, in one batch."""
    results = together(VAN_DER_POL, [{"eps": 10.0**k} for k in range(-1, 5)], to="60 s")
    solvers = {result.solver for result in results if result is not None}
    assert len(solvers) > 1
    assert any("Radau" in solver for solver in solvers) and any("Dormand" in solver for solver in solvers)


def test_what_decides_segments_and_signals_makes_groups() -> None:
    """Instants, heights and gains of a step: equal ones have their segments in common, and all are right."""
    points = [{"t_0": t, "F_0": f, "gain": g} for t in (0.1, 0.3) for f in (1.0, 2.0) for g in (1.0, 0.5)]
    assert is_whole(together(DUFFING, points))


def test_conditions_on_parameters_are_those_of_each_run() -> None:
    """Runs with another truth of a condition beside time are not of the same segments."""
    text = DUFFING.replace("F_0*gain*step(time - t_0)", "F_0 if time > t_0 and gain > 0.7 else F_0/2")
    results = together(text, [{"gain": value} for value in (1.0, 0.9, 0.5, 0.2)])
    ends = [result.final("position") for result in results if result is not None]
    assert ends


CHOPPED = """
model Chopped {
  parameter V = 24 V, f = 1 kHz, duty = 0.5, R = 2 ohm, L = 1 mH, a: ohm/A^2 = 0.01
  Se bridge : u = V*pwm(time, 1/f, duty)
  I  coil   : lambda = L*i
  R  wire   : u = R*i + a*i^3
  bridge -> 1(coil, wire)
  output i = coil.i
  experiment switch_on { simulate 0 .. 5 ms }
}
"""


@pytest.mark.parametrize("text", [CHOPPED, CHOPPED.replace(" + a*i^3", "")], ids=["nonlinear", "linear"])
@pytest.mark.parametrize(("name", "values"), [("duty", (0.5, 0.45, 0.4, 0.47, 1.0)), ("f", (1e3, 1.1e3)), ("R", (2.0, 3.0))])  # fmt: skip
def test_edges_of_pulses_are_those_of_each_run(text: str, name: str, values: tuple[float, ...]) -> None:
    """Edges that recur are in the key of a group, and those that rounding sets apart from a reported instant lie on it, as in runs alone."""
    results = together(text, [{name: value} for value in values])
    assert is_whole(results)
    ends = [result.final("i") for result in results if result is not None]
    assert len(set(ends)) == len(ends)


PAIR = """
model Pair {
  parameter A = 2 F, B = 3 F, swing = 1
  signal n = 1 + swing*sin(time/1 s)
  0 left, right : electric
  C a : q = A*u { start u = 1 V }
  C b : q = B*u
  R leak : i = 0.01 [1/ohm]*u + 0.01 [A/V^3]*u^3
  MTF t : u1 = n*u2
  left -> t -> right
  left -> a, leak
  right -> b
  output ua = a.u, ub = b.u
  experiment turn { simulate 0 .. 6 s }
}
"""


def test_dependent_storages_are_watched_in_each_run() -> None:
    """Runs in which other states should go on are made alone; the others have the largest values of both storages."""
    results = together(PAIR, [{"swing": swing} for swing in (0.9, 0.5, 0.1, 1e5, 0.2)])
    assert [result is None for result in results] == [False, False, False, True, False]


def test_texts_are_numbers() -> None:
    results = together(DUFFING, [{"k": "100 [N/m]"}, {"k": "0.1 [N/mm]"}, {"k": 100.0}, {"k": "80 [N/m]"}])
    assert is_whole(results)
    first, second, third, _ = (result.values.tobytes() for result in results if result is not None)
    assert first == second == third


def test_texts_of_numbers_with_one_unit_are_read_once() -> None:
    """Ninety-nine lengths as texts cost one reading of their unit, and are the numbers that their digits say."""
    _signed.cache_clear()
    for i in range(1, 100):
        assert _number(f"{i}.25 um") == _Number(float(Fraction(100 * i + 25, 10**8)), "um")
        assert _number(f"-{i}.25e-3 [N/m]") == _Number(-float(Fraction(100 * i + 25, 10**5)), "N/m")
    assert _signed.cache_info().misses == 2
    assert [_number(text) for text in ("-3 degC", "3 um*2", "3 umm", "3. um", "x")] == [None] * 5
    assert _number("-0") == _Number(0.0, "") and _number("2") == _Number(2.0, "1")


@pytest.mark.parametrize(
    "wrong", [{"k": 0.0}, {"k": "2 kg"}, {"k": "k3*(1 [m^2])"}, {"m": 2.0}, {"k": float("nan")}, {}]
)
def test_other_settings_are_left_to_runs_alone(wrong: Mapping[str, str | float]) -> None:
    first, second, third = together(DUFFING, [{"k": 90.0}, wrong, {"k": 110.0}])
    assert first is not None and third is not None
    assert second is None


def test_negative_masses_are_left_to_runs_alone() -> None:
    """A run alone refuses it by name."""
    model = bondgraph.load("models/manipulator.bg")
    first, second = simulate_together(model, RunRequest(), [{"h": 38e-6}, {"h": -38e-6}])
    assert first is not None and second is None


def test_runs_without_an_end_are_left_to_runs_alone() -> None:
    """A spring that pulls away: one run fails, with its message, and the others are whole."""
    text = DUFFING.replace("k3*x^3", "k3*x^3 - 1e6 [N/m^5]*x^5").replace("0 .. 2 s", "0 .. 20 s")
    many = bondgraph.load(text).simulate_many([{"k": 100.0}, {"k": -1e5}, {"k": 90.0}])
    with pytest.raises(bondgraph.RunFailed) as alone:
        bondgraph.load(text).simulate(settings={"k": -1e5})
    assert str(many.failures[1]) == str(alone.value)
    assert np.isfinite(many["position"][[0, 2]]).all()


def test_rates_that_steps_miss_are_left_to_runs_alone() -> None:
    """A law that is as steep as a root in one of two runs: that run warns."""
    model = bondgraph.load("""plain model Volume {
      parameter width = 1
      C t : q = e
      Sf s : f = sin(3*time)
      R o : f = e/(e^2 + width)^0.375
      s -> 0(t, o)
      output e = t.e
      experiment short { simulate 0 .. 2 { rtol = 1e-3 } }
    }""")
    first, second = simulate_together(CompiledModel(model.source), RunRequest(), [{"width": 1.0}, {"width": 1e-60}])
    assert first is not None and second is None


@pytest.mark.parametrize(
    "options", [{"energy": True}, {"solver": "radau"}, {"check": True}, {"error": True}, {"accuracy": 1e-4}, {"bandwidth": "1 kHz"}, {"target": "numpy"}]
)  # fmt: skip
def test_more_than_steps_is_left_to_runs_alone(options: dict[str, Any]) -> None:
    model = bondgraph.load(DUFFING)
    assert is_together(model, RunRequest(), {"k": 90.0})
    assert not is_together(model, RunRequest(options=RunOptions(**options)), {"k": 90.0})


@pytest.mark.parametrize("options", [{"rtol": 1e-9}, {"atol": 1e-7}, {"points": 2}, {"points": 3000}, {"to": "50 ms"}])
def test_options_of_steps(options: dict[str, Any]) -> None:
    assert is_whole(together(DUFFING, [{"k": 90.0}, {"k": 110.0}], **options))


@pytest.mark.parametrize("runs", [1, 2, 5])
def test_runs_with_many_points_are_stepped_some_at_once(runs: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Memory is that of so many runs as are stepped at once: here of states x and p and one output at 501 instants."""
    monkeypatch.setattr(batch, "MOST_NUMBERS", 3 * 501 * runs)
    sizes: list[int] = []
    plain = batch.batch_magnitudes

    def measured(scene: Any, some: Any, course: Any) -> Any:
        sizes.append(len(some))
        return plain(scene, some, course)

    monkeypatch.setattr(batch, "batch_magnitudes", measured)
    assert is_whole(together(DUFFING, [{"k": 80.0 + i} for i in range(7)]))
    assert sum(sizes) == 7 and max(sizes) == runs


def test_matrices_without_inverse_do_not_hold_up_the_others() -> None:
    """Of a stack: those with an inverse are solved together, with equal bits; NaN stands for the others."""
    random, asked = np.random.default_rng(1), list[int]()
    matrices, sides = random.standard_normal((40, 3, 3)), random.standard_normal((40, 3, 1))
    matrices[::4, 2] = 0.0

    def solve(*stacks: Any) -> Any:
        asked.append(stacks[0].ndim)
        return np.linalg.solve(*stacks)

    found = item_by_item(solve, matrices, sides)
    for number, (matrix, side) in enumerate(zip(matrices, sides, strict=True)):
        alone = np.full((3, 1), np.nan) if number % 4 == 0 else np.linalg.solve(matrix, side)
        assert found[number].tobytes() == alone.tobytes()
    assert asked == [3, 3]


def test_runs_part_where_decisions_differ() -> None:
    """Time constants of nine decades: the matrix exponential of some runs is not accurate enough, and they are made alone."""
    points: list[Mapping[str, str | float]] = [{"R": 10.0**k, "C": 10.0 ** (-k / 2)} for k in range(-6, 7)]
    results = together("models/rlc.bg", points)
    assert sum(result is not None for result in results) >= 3


@pytest.mark.parametrize("name", ["four_bar", "end_stops"])
def test_events_and_loops_are_left_to_runs_alone(name: str) -> None:
    model = bondgraph.load(f"models/{name}.bg")
    parameter, quantity = next((n, q) for n, q in model.parameters.items() if q.value)
    assert simulate_together(model, RunRequest(), [{parameter: quantity.value}]) == [None]


def test_pilot_runs_that_give_up_are_made_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pilot, "_alone", lambda *given: None)
    model = bondgraph.load("models/published/robertson.bg")
    points = [{"k1": 0.04 * (1 + 0.1 * i)} for i in range(4)]
    for result, point in zip(simulate_together(model, RunRequest(), points), points, strict=True):
        alone = bondgraph.load("models/published/robertson.bg").simulate(settings=point)
        assert result is not None and result.checkpoint is not None and alone.checkpoint is not None
        assert result.checkpoint.to_json() == alone.checkpoint.to_json()
        assert (result.values.tobytes(), result.steps) == (alone.values.tobytes(), alone.steps)


@pytest.mark.parametrize(("path", "name", "value"), [("manipulator", "h", 37e-6), ("published/robertson", "k1", 0.04)])
def test_python_does_not_act_between_runs(path: str, name: str, value: float) -> None:
    """Of forty more runs each makes few calls of Python: a run alone makes 2 500. The matrices of one model have inverses, of the other none."""
    model = bondgraph.load(f"models/{path}.bg")

    def calls(count: int) -> int:
        made = 0

        def count_one(frame: Any, event: str, argument: Any) -> None:
            nonlocal made
            made += event == "call"

        settings = [{name: value * (1 + 1e-4 * i)} for i in range(count)]
        sys.setprofile(count_one)
        try:
            results = simulate_together(model, RunRequest(), settings)
        finally:
            sys.setprofile(None)
        assert is_whole(results)
        return made

    calls(2)
    assert (calls(42) - calls(2)) / 40 < 60


def test_machine_code_takes_several_runs_in_a_call(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between them no thread waits for the interpreter."""
    model, made, plain = bondgraph.load("models/manipulator.bg"), 0, record_layout.called

    def called(name: str, *kinds: Any) -> Any:
        def call(*given: Any) -> Any:
            nonlocal made
            made += 1
            return plain(name, *kinds)(*given)

        return call

    def calls(count: int) -> int:
        nonlocal made
        made = 0
        assert is_whole(simulate_together(model, RunRequest(), [{"h": 37e-6 + 1e-9 * i} for i in range(count)]))
        return made

    monkeypatch.setattr(record_layout, "called", called)
    calls(1)  # machine code of the method is linked at its first step
    assert calls(1) == calls(record_layout.UNINTERRUPTED) < calls(record_layout.UNINTERRUPTED + 1)


@pytest.mark.parametrize("workers", [1, 2])
def test_many_runs_and_sweeps_step_together(workers: int) -> None:
    model = bondgraph.load(DUFFING)
    many = model.simulate_many([{"k": 80.0 + i} for i in range(30)], workers=workers)
    sweep = model.sweep({"k": [80.0, 81.0]}, of="simulate", experiment="push_it", workers=workers)
    for i in (0, 1, 29):
        alone = model.simulate(settings={"k": 80.0 + i})
        assert many[i].values.tobytes() == alone.values.tobytes()
        assert many[i].checkpoint is not None
    assert [point.run.final("position") for point in sweep.points] == [
        many[0].final("position"),
        many[1].final("position"),
    ]


def test_what_parameters_alone_break_is_told_by_runs_alone() -> None:
    """A limit on parameters costs no run its steps together with others; only the run that breaks it is made alone, with its warning."""
    text = DUFFING.replace("  experiment", '  require r >= 0 "damping takes power"\n  experiment')
    settings: list[Mapping[str, str | float]] = [{"r": r} for r in (0.5, 0.1, -0.5, 1.0)]
    results = together(text, settings)
    assert [r is None for r in results] == [False, False, True, False]
    (told,) = simulate(CompiledModel(bondgraph.load(text).source), RunRequest("", settings[2])).warnings
    assert told.condition == "r >= 0" and told.values == (("r", -0.5, "N*s/m"),)
