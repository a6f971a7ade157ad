"""Any failure at one of many points is its answer; it keeps nothing of the run beyond its message."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import (
    MissingPackage,
    NotLossless,
    PointBroken,
    RateNotFinite,
    RunBroken,
    RunInterrupted,
    StepsCollapsed,
)
from bondgraph.simulation import repetition
from bondgraph.studies import experiment, point_failure, runs, scalar_study, workers
from bondgraph.studies.workers import Workers
from tests.studies.test_runs import SETTINGS, TEXT

BROKEN = (MemoryError("30 GB"), np.linalg.LinAlgError("singular"), OverflowError("too large"), RecursionError("deep"))


def breaking(monkeypatch: pytest.MonkeyPatch, broken: dict[float, BaseException]) -> None:
    """Runs at some `k`, each made alone, raise something."""
    plain = repetition.simulate

    def simulate(model: Any, request: Any) -> Any:
        if request.settings["k"] in broken:
            raise broken[request.settings["k"]]
        return plain(model, request)

    monkeypatch.setattr(runs, "simulate", simulate)
    monkeypatch.setattr(experiment, "simulate", simulate)
    monkeypatch.setattr(scalar_study, "simulate", simulate)
    monkeypatch.setattr(workers, "simulate_together", lambda model, run, points: [None] * len(points))


@pytest.mark.parametrize("count", [1, 2])
def test_a_run_that_breaks_ends_no_other(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    breaking(monkeypatch, {80.0 + i: e for i, e in zip((0, 3, 5, 9), BROKEN, strict=True)})
    found = bondgraph.load(TEXT).simulate_many(SETTINGS, workers=count, solver="explicit")  # each alone
    assert list(found.failures) == [0, 3, 5, 9] and np.isfinite(found.final("x")).sum() == 7
    for failed, broken in zip(found.failures.values(), BROKEN, strict=True):
        assert isinstance(failed, bondgraph.RunFailed) and f"({type(broken).__name__}: {broken})" in str(failed)
        assert str(failed).startswith(
            "there is not enough memory" if failed is found.outcomes[0] else "a defect of ours"
        )
    assert "in simulate" in found.failures[3].__notes__[0]  # where it was, for whoever looks for it
    monkeypatch.undo()
    alone = bondgraph.load(TEXT).simulate(settings=SETTINGS[4], solver="explicit")
    np.testing.assert_array_equal(found[4].values, alone.values)


@pytest.mark.parametrize("of", ["simulate", "montecarlo"])
def test_points_of_studies_that_break(of: str, monkeypatch: pytest.MonkeyPatch) -> None:
    model = bondgraph.load(TEXT)
    if of == "simulate":
        breaking(monkeypatch, {82.0: OverflowError("too large")})
        swept = model.sweep({"k": (80.0, 82.0, 84.0)}, ("simulate",), experiment="e")
        assert [bool(p.failure) for p in swept.points] == [False, True, False]
        assert "OverflowError: too large" in (swept.points[1].failure or "")
        return
    monkeypatch.setattr(scalar_study, "operating_point", lambda model, given: 1 / 0)
    with pytest.raises(bondgraph.RunFailed, match=r"defect of ours.*ZeroDivisionError"):
        model.montecarlo({"k": "uniform(50 N/m, 150 N/m)"}, ("modes",), samples=4, indices=0)


def test_what_is_wrong_at_all_points_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    model, given = bondgraph.load(TEXT), [{"k": 80.0 + i} for i in range(3)]
    breaking(monkeypatch, {s["k"]: ZeroDivisionError("by zero") for s in given})
    for call in (
        lambda: model.simulate_many(given, workers=1),
        lambda: model.sweep({"k": (80.0, 81.0)}, "simulate", experiment="e"),
    ):
        with pytest.raises(RunBroken, match="ZeroDivisionError: by zero") as caught:
            call()
        assert "in simulate" in caught.value.__notes__[0]
    for problem in (MissingPackage("BR906", "get it"), FileNotFoundError("data.csv"), KeyboardInterrupt()):
        monkeypatch.undo()
        breaking(monkeypatch, {81.0: problem})
        with pytest.raises(type(problem)):
            model.simulate_many(given, workers=1)


def test_what_broke_goes_from_process_to_process_and_through_a_journal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, given = bondgraph.load(TEXT), [{"k": 80.0 + i} for i in range(3)]
    result = model.simulate()
    broken = RunBroken("BR710", "ZeroDivisionError: no, after t = 0.5 s")
    broken.result = result
    breaking(monkeypatch, {81.0: broken})
    for _ in range(2):
        journal = bondgraph.Journal(tmp_path / "j")
        found = model.simulate_many(given, workers=Workers(1, journal=journal))
        journal.close()
        again: Any = pickle.loads(pickle.dumps(found.outcomes[1]))
        for failed in (again, found.outcomes[1]):
            assert type(failed) is PointBroken and "after t = 0.5 s" in str(failed)
            np.testing.assert_array_equal(failed.result.values, result.values)


def test_a_failure_that_is_kept_holds_nothing_else() -> None:
    """No frames of its run, and of the instants only those that it has."""
    blows_up = bondgraph.load(TEXT.replace("F = r*v", "F = r*v^3/(1 [m^2/s^2])"))
    found = blows_up.simulate_many([{"r": -1e9}, {"r": "1 kg"}, {"no_such": 1.0}], points=10_001, workers=1)
    for failed in found.failures.values():
        assert failed.__traceback__ is None and failed.__context__ is None and failed.__cause__ is None
    result = found.failures[0].result  # type: ignore[attr-defined]
    assert len(result.time) < 100 and result.time.base is None
    assert len(pickle.dumps(found.failures[0])) < 20_000
    for _ in range(2):
        with pytest.raises(bondgraph.RunFailed) as caught:
            found[0]
    assert len(caught.traceback) == 2  # of the last time alone


def test_all_that_goes_wrong_in_runs_goes_from_process_to_process() -> None:
    """With the data of the exception besides its message."""
    result, state = bondgraph.load(TEXT).simulate(), np.array([1.0, 2.0])
    for problem in (
        RunInterrupted("interrupted at t = 1 s"), RunBroken("BR710", "broken"), PointBroken("BR464", "a defect"),
        RateNotFinite("BR781", "no number").at(1.0, state, None), StepsCollapsed("BR786", "none").at(1.0, state, None),
        NotLossless("BR720", "lossy").at(1.0, state, None),
    ):  # fmt: skip
        problem.result = result
        again: Any = pickle.loads(pickle.dumps(problem))
        assert type(again) is type(problem) and str(again) == str(problem)
        np.testing.assert_array_equal(again.result.values, result.values)
        if isinstance(problem, RateNotFinite | StepsCollapsed | NotLossless):
            assert again.time == 1.0 and (again.state == state).all()


def test_why_a_point_does_not_compile_is_a_whole_sentence() -> None:
    for given in ({"k": "1 kg"}, {"no_such": 1.0}):
        with pytest.raises(bondgraph.CompilationFailed) as caught:
            bondgraph.load(TEXT).simulate(settings=given)  # type: ignore[arg-type]
        told = point_failure.why(caught.value)
        assert told == "; ".join(f"{d.code} {d.sentence}" for d in caught.value.diagnostics) and "{" not in told
