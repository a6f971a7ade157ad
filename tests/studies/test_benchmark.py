"""Work and precision of solvers: errors beside a known solution, the recommendation, other programs over the same equations."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.commands import commands
from bondgraph.errors import UsageError
from bondgraph.studies.work_precision import WorkPoint, WorkPrecision
from tests.compiling import MODELS

SWING = """model Swing {
  I m : p = 1 kg*v
  C s : F = 4 [N/m]*x { start x = 1 m }
  1(m) -> s
  output x = s.x, v = m.v
  experiment go { simulate 0 .. 3 s { points = 31 } }
}
"""


@pytest.fixture(scope="module")
def swing() -> WorkPrecision:
    return bondgraph.load(SWING).benchmark(rounds=1)


def test_errors_are_those_of_the_known_solution(swing: WorkPrecision) -> None:
    model = bondgraph.load(SWING)
    for point in swing.points:
        if point.peer or point.error < 1e-10:
            continue
        found = model.simulate(solver=point.solver, rtol=point.rtol)
        assert point.errors["x"] == pytest.approx(np.abs(found["x"] - np.cos(2 * found.time)).max(), rel=1e-3)
        assert point.steps == found.steps and point.evaluations == sum(found.evaluations.values())


def test_every_solver_and_tolerance(swing: WorkPrecision) -> None:
    own = {p.solver for p in swing.points if not p.peer}
    assert own == {"exponential", "explicit", "radau", "radau13", "rodas", "energy"}
    assert {"scipy DOP853", "scipy Radau", "scipy LSODA", "scipy BDF"} <= {p.solver for p in swing.points if p.peer}
    assert len([p for p in swing.points if p.solver == "radau"]) == 10
    assert swing.agreement < 1e-11 and len(swing.references) == 2
    for solver in swing.solvers:
        errors = [p.error for p in swing.points if p.solver == solver and not p.failure]
        assert errors[-1] < 1e-6 and errors[0] < 1


@pytest.mark.parametrize(
    ("package", "peer"), [("scipy", "scipy DOP853"), ("sksundae", "SUNDIALS CVODE"), ("casadi", "CasADi CVODES")]
)
def test_other_programs_solve_the_same_equations(swing: WorkPrecision, package: str, peer: str) -> None:
    pytest.importorskip(package)
    errors = [p.error for p in swing.points if p.solver == peer]
    assert len(errors) == 10 and errors[0] < 1 and errors[-1] < 1e-7
    assert all(p.peer and p.evaluations > 0 and not p.failure for p in swing.points if p.solver == peer)


def test_the_recommendation_has_the_wanted_error(swing: WorkPrecision) -> None:
    best = swing.recommended
    assert best is not None and not best.peer and best.error <= swing.error
    found = bondgraph.load(SWING).simulate(solver=best.solver, rtol=best.rtol)
    assert np.abs(found["x"] - np.cos(2 * found.time)).max() <= swing.error
    assert f"solver = {best.solver}, rtol = {best.rtol:g}" in swing.summary()


def points(*rows: tuple[str, float, float, float]) -> tuple[WorkPoint, ...]:
    return tuple(
        WorkPoint(solver, rtol, error, seconds, peer=solver.startswith("scipy"))
        for solver, rtol, error, seconds in rows
    )


def test_what_is_recommended_of_given_points() -> None:
    rows = points(
        ("a", 1e-3, 1e-4, 1.0),
        ("a", 1e-4, 9e-7, 2.0),
        ("b", 1e-5, 1e-8, 2.3),
        ("b", 1e-6, 1e-9, 2.5),
        ("scipy c", 1e-4, 1e-9, 0.1),
    )
    found = WorkPrecision("M", None, ("x", "y"), 1e-9, rows, {}, 1e-6)
    assert found.recommended == rows[2]  # within a fifth of the fastest, and more accurate
    assert WorkPrecision("M", None, ("x", "y"), 1e-6, rows, {}, 1e-6).recommended is None
    assert WorkPrecision("M", None, ("x", "y"), 1e-12, rows, {}, 1e-10).recommended is None
    assert "differ by" in WorkPrecision("M", None, ("x", "y"), 1e-6, rows, {}, 1e-6).sentence


def test_solvers_that_cannot_are_named_with_the_reason() -> None:
    found = bondgraph.load(MODELS / "drag.bg").benchmark(rounds=1, peers=False)
    assert "exponential" in found.refused and "energy" in found.refused
    assert not set(found.refused) & set(found.solvers) and found.recommended is not None


def test_events_are_not_given_to_other_programs() -> None:
    text = SWING.replace("output x", "mode n = 0\n  when s.x > 0.5 m { n = n + 1 }\n  output count = n, x")
    found = bondgraph.load(text).benchmark(rounds=1)
    assert not any(p.peer for p in found.points) and "events" in found.refused["scipy"]


def test_what_cannot_be_run_is_refused() -> None:
    with pytest.raises(UsageError, match="how long"):
        bondgraph.load(SWING.replace("experiment go { simulate 0 .. 3 s { points = 31 } }", "")).benchmark()
    with pytest.raises(UsageError, match="wanted error"):
        bondgraph.load(SWING).benchmark(error=0)


def test_the_command(tmp_path: Path) -> None:
    path, picture = tmp_path / "swing.bg", tmp_path / "w.png"
    path.write_text(SWING, encoding="utf-8")
    words = ["benchmark", str(path), "--rounds", "1", "--alone", "--error", "1e-8", "--to", "2 s"]
    told = CliRunner().invoke(commands, [*words, "--plot", str(picture)])
    assert told.exit_code == 0 and "For an error of 1e-08: solver = " in told.output and picture.stat().st_size > 10_000
    data = json.loads(CliRunner().invoke(commands, [*words, "--json"]).output)
    assert data["schema"] == "bondgraph-benchmark/1" and data["experiment"] == "go" and data["error"] == 1e-8
    chosen = [
        p
        for p in data["points"]
        if (p["solver"], p["rtol"]) == (data["recommended"]["solver"], data["recommended"]["rtol"])
    ]
    assert chosen[0]["error"] <= 1e-8 and chosen[0]["errors"].keys() == {"x", "v"}


def test_a_run_that_takes_too_long_ends_a_solver_and_no_later_round(monkeypatch: pytest.MonkeyPatch) -> None:
    from bondgraph.studies import benchmark
    from bondgraph.studies.time_limit import TooLong

    model = bondgraph.load(SWING)
    reference, calls = model.simulate(), list[float]()

    def run(rtol: float) -> bondgraph.Result:
        calls.append(rtol)
        if rtol < 1e-5 or len(calls) == 5:
            raise TooLong("stopped after 20 s")
        return reference

    found = benchmark._measured({"other": run}, reference, 2, lambda words: None)
    assert calls == [1e-3, 1e-4, 1e-5, 1e-6, 1e-3]
    assert [(p.rtol, bool(p.failure)) for p in found] == [(1e-3, False), (1e-4, False), (1e-5, False), (1e-6, True)]
