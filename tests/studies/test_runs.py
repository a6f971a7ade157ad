"""Many runs at once: each equals a single run to the last bit, in order, for any kind of workers; a failure stays with its settings."""

from __future__ import annotations

import gc
import pickle
import threading
import tracemalloc
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.compiled_scene import chosen_target
from bondgraph.studies import local_workers, workers
from bondgraph.studies.workers import Workers
from tests.compiling import MODELS

TEXT = """
model A {
  parameter m = 1 kg, k: N/m = 100, r: N*s/m = 0.5
  input push = 0 N
  1 body
  I mass : p = m*v
  C spring : F = k*x + 2e4 [N/m^3]*x^3 { start x = 10 mm }
  R damper : F = r*v
  MSe drive : F = push
  drive -> body -> mass, spring, damper
  output x = spring.x, v = body.v
  experiment e { simulate 0 .. 1 s { points = 51 } }
}
"""
SETTINGS: list[dict[str, str | float]] = [{"m": 0.5 + 0.1 * i, "k": 80.0 + i, "push": f"{i} N"} for i in range(11)]


@contextmanager
def executor_of(kind: str) -> Iterator[Executor | None]:
    if kind == "own":
        yield None
        return
    with ThreadPoolExecutor(3) if kind == "threads" else ProcessPoolExecutor(2, get_context("spawn")) as executor:
        yield executor


@pytest.mark.parametrize("target", ["native", "numpy"])
@pytest.mark.parametrize("kind", ["own", "threads", "processes"])
def test_each_is_what_it_is_by_itself(kind: str, target: str) -> None:
    if target == "native" and chosen_target(None) != "native":
        pytest.skip("there is no LLVM, or it is hidden")
    if kind == "processes" and target == "numpy":
        pytest.skip("seconds")
    with executor_of(kind) as executor:
        found = bondgraph.load(TEXT).simulate_many(
            SETTINGS, target=target, workers=executor if executor is not None else 2
        )
    assert len(found) == len(SETTINGS) and found.failures == {} and found.settings == tuple(SETTINGS)
    assert found["x"].shape == (11, 51) and found.unit("x") == "m" and len(found.time) == 51
    for number in (0, 3, 10):
        alone = bondgraph.load(TEXT).simulate(settings=SETTINGS[number], target=target)
        np.testing.assert_array_equal(found[number].values, alone.values)
        np.testing.assert_array_equal(found["v"][number], alone["v"])
        assert found[number].steps == alone.steps and found.final("x")[number] == alone.final("x")
    assert len(set(found.final("x"))) == 11


def test_one_worker_and_many_find_the_same() -> None:
    one, two = (bondgraph.load(TEXT).simulate_many(SETTINGS, workers=n) for n in (1, 2))
    np.testing.assert_array_equal(one["x"], two["x"])


@pytest.mark.parametrize("count", [1, 2])
def test_what_fails_stays_with_its_settings(count: int) -> None:
    """An explosion, a unit that does not fit, a negative number of steps: the others go on, in their places."""
    blows_up = TEXT.replace("F = r*v", "F = r*v^3/(1 [m^2/s^2])")
    given = [{"r": 0.1}, {"r": -1e9}, {"r": "1 kg"}, {"r": 0.2}, {"no_such": 1.0}, {"r": 0.3}]
    found = bondgraph.load(blows_up).simulate_many(given, workers=count)
    kinds = {1: bondgraph.RunFailed, 2: bondgraph.CompilationFailed, 4: bondgraph.CompilationFailed}
    assert list(found.failures) == list(kinds) and all(isinstance(found.failures[i], kinds[i]) for i in kinds)
    assert "no_such" in str(found.failures[4]) and "t =" in str(found.failures[1])
    assert list(np.isnan(found.final("x"))) == [False, True, True, False, True, False]
    assert np.isnan(found["x"][1]).all() and repr(found) == "<Ensemble of 6 runs, 3 of them failed>"
    with pytest.raises(bondgraph.CompilationFailed, match="no_such"):
        found[4]
    alone = bondgraph.load(blows_up).simulate(settings={"r": 0.3})
    np.testing.assert_array_equal(found[5].values, alone.values)


def test_what_is_wrong_in_all_is_told_at_once() -> None:
    model = bondgraph.load(TEXT)
    for wrong in (
        {"rtol": 2.0},
        {"to": "3 kg"},
        {"points": 1},
        {"workers": 0},
        {"target": "nothing"},
        {"workers": 1.5},
        {"workers": "2"},
        {"workers": float("nan")},
        {"points": 2.5},
        {"points": "11"},
    ):
        with pytest.raises(bondgraph.UsageError):
            model.simulate_many(SETTINGS, **wrong)  # type: ignore[arg-type]


def test_threads_that_share_a_model_may_forget_what_another_keeps(monkeypatch: pytest.MonkeyPatch) -> None:
    """A thread keeps its own result, even if others have just removed it from the cache."""
    from bondgraph import compiled_model as compiled
    from bondgraph.simulation.segments import run_values

    class Racing(dict[object, object]):
        """Another thread is always first."""

        def pop(self, key: object, *default: object) -> object:
            super().pop(key, None)
            return super().pop(key, *default)

    things = Racing({i: i for i in range(compiled.MOST_KEPT)})
    compiled.keep(things, "new", "thing", compiled.MOST_KEPT)
    assert len(things) == compiled.MOST_KEPT and things["new"] == "thing" and 0 not in things
    monkeypatch.setattr(compiled, "keep", lambda things, key, thing, most: things.clear())
    monkeypatch.setattr(run_values, "keep", lambda things, key, thing, most: things.clear())
    assert len(bondgraph.load(TEXT).simulate_many(SETTINGS, workers=1)) == len(SETTINGS)


def test_nothing_to_run() -> None:
    found = bondgraph.load(TEXT).simulate_many([])
    assert len(found) == 0 and list(found) == []
    with pytest.raises(bondgraph.RunFailed, match="none of 0 runs"):
        found["x"]
    swept = bondgraph.load(TEXT).sweep({"m": []})
    assert len(swept) == 0 and swept.table().shape == (0, 1) and "0 points" in swept.summary()


def test_settings_that_decide_more_than_numbers() -> None:
    """Each length of the chain is a program of its own; the numbers are not."""
    chain = "model B {\n  parameter n = 2, r: N*s/m = 4\n  Se pull : F = 1 N\n  1 top : translation\n  pull -> top\n  for i in 1..n { R drag[i] : F = r*v\n    top -> drag[i] }\n  output v = top.v\n}\n"
    found = bondgraph.load(chain).simulate_many([{"n": n, "r": r} for n in (1, 3) for r in (1.0, 2.0)], to=1, points=2)
    np.testing.assert_allclose(found.final("v"), [1, 1 / 2, 1 / 3, 1 / 6], rtol=1e-14)


@pytest.mark.parametrize("count", [1, 2])
def test_progress(count: int) -> None:
    told: list[tuple[int, int]] = []
    bondgraph.load(TEXT).simulate_many(
        SETTINGS, workers=Workers(count, progress=lambda done, total: told.append((done, total)))
    )
    assert [total for _, total in told] == [11] * len(told) and told[-1] == (11, 11)
    assert sorted(told) == told and len(set(told)) == len(told)


def test_whoever_has_threads_is_not_copied(monkeypatch: pytest.MonkeyPatch) -> None:
    """A copy of a process has only one of its threads; locks of the others would stay shut."""
    stop = threading.Event()
    other = threading.Thread(target=stop.wait)
    other.start()
    try:
        assert not local_workers.can_be_copied()
    finally:
        stop.set()
        other.join()


def test_an_interruption_ends_it() -> None:
    def stop(done: int, total: int) -> None:
        if done > 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match=r"interrupted when \d+ of 220 were done"):
        bondgraph.load(TEXT).simulate_many(SETTINGS * 20, workers=Workers(2, progress=stop))
    assert workers._MODELS == {}


@pytest.mark.parametrize("count", [1, 2])
def test_an_interruption_within_a_run_is_one_of_all(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not of the run that was made by chance, here or by another worker."""
    from bondgraph.errors import RunInterrupted
    from bondgraph.studies import runs

    model, plain = bondgraph.load(TEXT), runs.simulate
    made = list[int]()

    def simulate(*arguments: Any) -> Any:
        if len(made) == 3:
            interrupted = RunInterrupted("interrupted at t = 0.5 s")
            interrupted.result = model.simulate()
            raise interrupted
        made.append(1)
        return plain(*arguments)

    monkeypatch.setattr(runs, "simulate", simulate)
    with pytest.raises(KeyboardInterrupt, match=r"interrupted when \d+ of 220 were done") as caught:
        model.simulate_many(SETTINGS * 20, workers=count)
    assert type(caught.value) is KeyboardInterrupt


def test_memory_grows_with_what_is_kept() -> None:
    """Runs leave their outputs, 51 instants of two, and their notes; no programs, no states."""
    model = bondgraph.load(TEXT)
    sizes = []
    for count in (5, 25):
        tracemalloc.start()
        found: Any = model.simulate_many([{"k": 80.0 + i / count} for i in range(count)], workers=1)
        sizes.append(tracemalloc.get_traced_memory()[0])
        tracemalloc.stop()
        del found
    assert (sizes[1] - sizes[0]) / 20 < 6 * 51 * 2 * 8


def test_what_is_the_same_in_all_travels_once() -> None:
    """Of each further run its numbers go from process to process: instants, outputs, how it ended; names and units are there already."""
    found = bondgraph.load(TEXT).simulate_many(SETTINGS, workers=1)
    assert len({id(run.columns) for run in found}) == 1  # type: ignore[union-attr]
    few, all_of_them = (len(pickle.dumps(list(found)[:count])) for count in (1, 11))
    assert 3 * 51 * 8 < (all_of_them - few) / 10 < 3 * 51 * 8 + 600


@pytest.mark.parametrize("model", ["manipulator.bg", "end_stops.bg"])
def test_a_run_leaves_nothing_to_collect(model: str) -> None:
    """All memory of a run is free at its end: no reference cycle keeps it until a collection."""
    made = bondgraph.load(MODELS / model)
    made.simulate()
    gc.collect()
    gc.disable()
    try:
        made.simulate()
        assert gc.collect() == 0
    finally:
        gc.enable()


def test_problems_go_from_process_to_process() -> None:
    for text, settings in ((TEXT, {"r": "1 kg"}), (TEXT.replace("r*v", "r*v^3/(1 [m^2/s^2])"), {"r": -1e9})):
        with pytest.raises((bondgraph.CompilationFailed, bondgraph.RunFailed)) as caught:
            bondgraph.load(text).simulate(settings=settings)  # type: ignore[arg-type]
        again = pickle.loads(pickle.dumps(caught.value))
        assert type(again) is type(caught.value) and str(again) == str(caught.value)


def test_a_mechanism() -> None:
    """Masses and geometry are arguments, too; that none is negative is checked in each run."""
    model = bondgraph.load(MODELS / "manipulator.bg")
    found = model.simulate_many([{"m_p": 2e-9}, {"m_p": -1.0}, {"a": 171e-6}], to=1e-3, points=11, workers=1)
    assert list(found.failures) == [1] and "negative" in str(found.failures[1])
    alone = bondgraph.load(MODELS / "manipulator.bg").simulate(settings={"a": 171e-6}, to=1e-3, points=11)
    np.testing.assert_array_equal(found[2].values, alone.values)


@pytest.mark.machine_code
def test_a_defect_of_runs_together_is_told_and_costs_no_result(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any) -> None:
        raise ZeroDivisionError("within")

    model = bondgraph.load(TEXT)
    wanted = model.simulate_many(SETTINGS, workers=1)
    monkeypatch.setattr("bondgraph.studies.workers.simulate_together", broken)
    with pytest.warns(RuntimeWarning, match="ZeroDivisionError: within"):
        found = model.simulate_many(SETTINGS, workers=1)
    assert all(found[name].tobytes() == wanted[name].tobytes() for name in wanted[0].names)
