"""The estimate of a run's error beside the error that a known solution tells, and runs with a wanted accuracy."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.commands import commands
from bondgraph.errors import RunFailed, RunInterrupted, UsageError
from bondgraph.results.records import Column, EventRecord
from bondgraph.results.result import Result
from bondgraph.simulation import repetition
from bondgraph.simulation.repetition import compare, with_error
from bondgraph.simulation.run_options import RunOptions
from tests.compiling import MODELS

SWING = """model Swing {
  input push = 0 N
  MSe f : F = push
  I m : p = 1 kg*v
  C s : F = 4 [N/m]*x { start x = 1 m }
  1 j
  f -> j -> m
  j -> s
  output x = s.x, v = m.v
  experiment go { simulate 0 .. 20 s }
  experiment close { simulate 0 .. 20 s { accuracy = 1e-9, solver = explicit } }
}
"""
# x'' = -x^3 from x = 1 at rest: the lemniscate cosine, of period 7.41629870920549; x has the same value a period later.
CUBIC = """model Cubic {
  I m : p = 1 kg*v
  C s : F = 1 [N/m^3]*x^3 { start x = 1 m }
  1(m) -> s
  output x = s.x
  experiment go { simulate 0 .. 74.1629870920549 s { points = 11 } }
}
"""


def true_error(found: Any) -> float:
    return float(np.abs(found["x"] - np.cos(2 * found.time)).max())


@pytest.mark.few(5)
@pytest.mark.parametrize("solver", ["explicit", "radau", "radau13", "rodas", "energy"])
@pytest.mark.parametrize("rtol", [1e-4, *(pytest.param(r, marks=pytest.mark.machine_code) for r in (1e-6, 1e-8))])
def test_the_error_of_a_known_solution(solver: str, rtol: float) -> None:
    found = bondgraph.load(SWING).simulate(solver=solver, rtol=rtol, error=True)
    assert found.error is not None and not found.error.failure and found.error.rtol == pytest.approx(rtol / 10)
    assert true_error(found) / 3 <= found.error.of("x") <= 3 * true_error(found)


@pytest.mark.machine_code
def test_rounding_of_exact_runs_and_of_the_tightest_tolerance() -> None:
    model = bondgraph.load(SWING)
    for options in ({"solver": "exponential"}, {"solver": "explicit", "rtol": 1e-13}):
        found = model.simulate(error=True, **options)
        assert found.error is not None
        assert true_error(found) / 10 <= found.error.of("x") <= 1e-11


@pytest.mark.machine_code
def test_a_nonlinear_one_over_ten_periods() -> None:
    found = bondgraph.load(CUBIC).simulate(rtol=1e-7, error=True)
    true = np.abs(found["x"] - 1.0).max()
    assert found.error is not None and true / 3 <= found.error.of("x") <= 3 * true


@pytest.mark.machine_code
@pytest.mark.parametrize("name", ["crank_linkage", "drag", "lotka_volterra", "pid_dc_motor", "rectifier", "solenoid"])
def test_models_beside_a_reference(name: str) -> None:
    """At least nine tenths within a factor of 3, and none below a tenth; `tests/benchmarks` has all models."""
    model = bondgraph.load(MODELS / f"{name}.bg")
    found = model.simulate(error=True)
    assert found.error is not None
    true = {row.name: row.difference for row in compare(found, model.simulate(rtol=1e-12), 1e-12).outputs}
    ratios = [found.error.of(key) / error for key, error in true.items() if error > 0]
    assert min(ratios) > 0.1 and np.mean([1 / 3 <= r <= 3 for r in ratios]) >= 0.9


@pytest.mark.machine_code
@pytest.mark.parametrize("accuracy", [1e-3, 1e-6, 1e-9, 1e-11])
def test_a_wanted_accuracy_is_reached(accuracy: float) -> None:
    found = bondgraph.load(SWING).simulate(solver="explicit", accuracy=accuracy)
    assert found.accuracy == accuracy and found.error is not None and found.error.reaches(accuracy)
    assert true_error(found) <= accuracy


@pytest.mark.machine_code
def test_the_accuracy_of_an_experiment_holds_in_sweeps_too() -> None:
    model = bondgraph.load(SWING)
    assert true_error(model.simulate("close")) <= 1e-9
    runs = model.simulate_many([{}, {"push": 0.5}], "close", workers=1)
    assert all(run.error is not None and run.error.reaches(1e-9) for run in runs)
    assert true_error(model.simulate("close", accuracy=1e-4)) > 1e-9


@pytest.mark.machine_code
def test_an_accuracy_that_no_tolerance_gives_is_refused_with_the_nearest_run() -> None:
    text = CUBIC.replace("74.1629870920549", "20000")
    with pytest.raises(RunFailed, match="no tolerance gives the accuracy 1e-12") as failed:
        bondgraph.load(text).simulate(accuracy=1e-12)
    assert failed.value.result is not None and failed.value.result.rtol <= 1e-12


def finished(x: float, rtol: float, events: int, accuracy: float | None) -> Result:
    """A run of one output of magnitude 1, whose error is `x`."""
    times = tuple(EventRecord(k + 0.5, "x > 0", "", "a.bg:1") for k in range(events))
    values = np.array([[0.0], [1.0], [0.5 + x]])
    return Result("A", None, np.arange(3.0), (Column("x", "m"),), values, rtol=rtol, events=times, accuracy=accuracy)


def test_other_events_are_no_estimate() -> None:
    estimated = with_error(finished(1e-3, 1e-4, 2, None), lambda o: finished(0.0, o.rtol or 0.0, 3, None), RunOptions())
    assert (
        estimated.error is not None and "2 events acted in the run and 3 in its repetition" in estimated.error.failure
    )
    assert not estimated.error.reaches(1.0)


def test_tolerances_are_tightened_until_the_error_is_the_wanted_one() -> None:
    """The error of this run is 300 times its tolerance; below 1e-8 the number of events is another. A run that is there is not made again."""
    made: list[float] = []

    def repeat(options: RunOptions) -> Result:
        assert options.rtol is not None
        made.append(options.rtol)
        return finished(300 * options.rtol, options.rtol, 1 + (options.rtol < 1e-8), 1e-7)

    found = with_error(finished(300 * 1e-8, 1e-8, 1, 1e-7), repeat, RunOptions())
    assert found.error is not None and found.error.reaches(1e-7) and found.rtol == pytest.approx(1e-10)
    assert made == pytest.approx([1e-9, 1e-10, 1e-11])


def test_an_interrupted_repetition_keeps_the_finished_run(monkeypatch: pytest.MonkeyPatch) -> None:
    once, runs = repetition.run.simulate_once, []

    def interrupted(*arguments: Any) -> Result:
        if runs:
            raise RunInterrupted("interrupted")
        runs.append(once(*arguments))
        return runs[0]

    monkeypatch.setattr(repetition.run, "simulate_once", interrupted)
    with pytest.raises(RunInterrupted) as stopped:
        bondgraph.load(SWING).simulate(error=True)
    assert stopped.value.result is runs[0] and len(runs[0].time) == 501


def test_a_run_that_goes_on_says_that_its_accuracy_is_not_checked() -> None:
    model = bondgraph.load(SWING)
    found = model.simulate("close", to="2 s", start=model.simulate("close", to="1 s"))
    assert found.error is None and any("accuracy was not checked" in note for note in found.notes)


def test_values_that_are_none() -> None:
    model = bondgraph.load(SWING)
    with pytest.raises(UsageError):
        model.simulate(accuracy=1e-14)
    first = model.simulate(to="1 s")
    with pytest.raises(UsageError, match="goes on from a result"):
        model.simulate(start=first, error=True)
    with pytest.raises(bondgraph.CompilationFailed, match="makes no sense"):
        bondgraph.load(SWING.replace("accuracy = 1e-9", "accuracy = 2")).simulate("close")


def test_the_command(tmp_path: Path) -> None:
    path = tmp_path / "swing.bg"
    path.write_text(SWING, encoding="utf-8")
    told = CliRunner().invoke(commands, ["run", str(path), "--solver", "explicit", "--error"])
    assert told.exit_code == 0 and "error" in told.output.splitlines()[2]
    data = json.loads(CliRunner().invoke(commands, ["run", str(path), "--solver", "explicit", "--json"]).output)
    x = data["error"]["outputs"]["x"]
    assert 0 < x["error"] < 1e-5 and x["magnitude"] == pytest.approx(1.0) and x["unit"] == "m"
    assert data["accuracy"] is None and data["error"]["failure"] is None
    close = json.loads(CliRunner().invoke(commands, ["run", str(path), "-e", "close", "--json"]).output)
    assert close["accuracy"] == 1e-9


def test_many_runs_have_no_table_for_an_asked_estimate(tmp_path: Path) -> None:
    path = tmp_path / "swing.bg"
    path.write_text(SWING.replace("experiment go { ", "experiment go { sweep push = 0 N, 1 N; "), encoding="utf-8")
    told = CliRunner().invoke(commands, ["run", str(path), "--error"])
    assert told.exit_code == 2 and "many runs" in told.stderr
    assert CliRunner().invoke(commands, ["run", str(path), "--json"]).exit_code == 0
