"""Data stored with a program for its next run depend on the program alone: no run influences another."""

from __future__ import annotations

import gc
import json
import sys
import weakref
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("llvmlite")

import bondgraph
from bondgraph.results.later import Later
from bondgraph.simulation.integration import method
from bondgraph.simulation.integrators import exponential
from bondgraph.simulation.integrators.compiled import run as compiled
from bondgraph.simulation.integrators.compiled.ordering import on_diagonal, ordered
from bondgraph.simulation.integrators.compiled.pilot_run import CompiledPilotRun, CompiledPilotStep
from bondgraph.simulation.integrators.compiled.record_layout import RecordArray, form_of
from bondgraph.simulation.integrators.linear_algebra.sparse import FINE, Pattern
from bondgraph.simulation.integrators.outcomes import REDUNDANT
from bondgraph.simulation.magnitudes.free_response import balance
from bondgraph.simulation.magnitudes.pilot_run import PilotRun
from bondgraph.simulation.phases import solution, start, tolerances
from bondgraph.simulation.run import PlannedRun
from tests.benchmarks import large_models
from tests.compiling import MODELS
from tests.event_models import BALL
from tests.library.test_ideal_switching import CUK

pytestmark = pytest.mark.machine_code

GROWING = "1e-3 [A/V^3]*u^3"
LADDER = large_models.rc_ladder(150).replace("model Ladder {", "model Ladder {\n  parameter g = 1 [A/V^3]")
CASES: list[tuple[str | Path, dict[str, str], dict[str, str]]] = [
    (MODELS / "four_bar.bg", {}, {}),
    (MODELS / "rectifier.bg", {}, {"C": "20 uF"}),
    (MODELS / "crane.bg", {}, {}),
    (LADDER.replace(GROWING, "g*u^3"), {}, {"g": "1e-6 [A/V^3]"}),
]


@pytest.mark.parametrize("case", range(len(CASES)), ids=["four bars", "rectifier", "crane", "ladder"])
def test_no_run_shows_in_another(case: int) -> None:
    text, one, other = CASES[case]

    def values(model: bondgraph.Model, settings: dict[str, str], **how: Any) -> Any:
        return model.simulate(settings=settings, points=20, **how).values

    model, alone = bondgraph.load(text), bondgraph.load(text)
    first = values(model, one)
    values(model, other, solver="radau", rtol=1e-4)
    np.testing.assert_array_equal(values(model, other), values(alone, other))
    np.testing.assert_array_equal(values(model, one), first)


def told(result: Any) -> tuple[Any, ...]:
    """All that a run gives, but for its time on the clock."""
    return (
        result.values.tobytes(), result.steps, dict(result.evaluations), result.notes, result.warnings, result.solver, result.events,
        json.dumps(result.checkpoint.to_json()), result.energy,
    )  # fmt: skip


SAME = [
    "manipulator", "published/transistor_amplifier", "published/robertson", "quarter_car", "duffing", "pendulum", "rectifier", "four_bar", "crane",
    "end_stops", "rlc", "car",
]  # fmt: skip


@pytest.mark.few(6)
@pytest.mark.parametrize("name", SAME)
def test_a_second_call_finds_nothing_again(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Magnitudes, consistent starts and methods are those of the first call, also of one with other settings between them."""
    calls: list[str] = []

    def count(owner: Any, function: str) -> None:
        original = getattr(owner, function)

        def counted(*given: Any) -> Any:
            calls.append(function)
            return original(*given)

        monkeypatch.setattr(owner, function, counted)

    for owner, function in ((PilotRun, "peak"), (start, "consistent_start"), (method, "_examined")):
        count(owner, function)
    model = bondgraph.load(MODELS / f"{name}.bg")
    first = model.simulate()
    assert "consistent_start" in calls
    parameter, value = next((n, p.value) for n, p in model.parameters.items() if p.value)
    other = model.simulate(settings={parameter: 1.01 * value}, rtol=1e-5, points=7)
    calls.clear()
    again = model.simulate()
    assert calls == []
    assert told(again) == told(first)
    fresh = bondgraph.load(MODELS / f"{name}.bg").simulate(settings={parameter: 1.01 * value}, rtol=1e-5, points=7)
    assert told(fresh) == told(other)
    half, whole = model.simulate(to=0.5 * first.time[-1]), float(first.time[-1])
    assert told(model.simulate(start=half, to=whole)) == told(model.simulate(start=half, to=whole))
    assert told(model.simulate()) == told(first)


@pytest.mark.parametrize("name", ["duffing", "quarter_car", "four_bar"])
def test_an_interpreted_run_shows_in_no_other(name: str) -> None:
    model = bondgraph.load(MODELS / f"{name}.bg")
    whole = float(model.simulate(points=2).time[-1])
    first, native = (told(model.simulate(to=0.05 * whole, target=target)) for target in ("numpy", "native"))
    model.simulate(to=0.1 * whole, rtol=1e-4, target="numpy")
    assert told(model.simulate(to=0.05 * whole, target="numpy")) == first
    assert told(model.simulate(to=0.05 * whole, target="native")) == native


def test_threads_share_what_was_found() -> None:
    """Runs of several settings at once, more than are kept, are those of one after the other."""
    model = bondgraph.load(MODELS / "quarter_car.bg")
    loads = [{"m": 250.0 + 5 * i} for i in range(11)]
    alone = [told(bondgraph.load(MODELS / "quarter_car.bg").simulate(settings=s)) for s in loads]
    with ThreadPoolExecutor(4) as threads:
        found = threads.map(lambda s: told(model.simulate(settings=s)), 4 * loads)
    assert [*found] == 4 * alone


def test_shared_values_are_not_written() -> None:
    model = bondgraph.load(MODELS / "quarter_car.bg")
    model.simulate()
    (compiled_scene,) = model._prepared.values()
    (values,) = compiled_scene.program.kept["run values"].values()

    def arrays() -> list[bytes]:
        modes = [s.mode for course in values.answers["timeline"].values() for s in course.segments]
        signals = [a for s in values.answers["signals"].values() for a in (s.allowed, s.times, s.values)]
        assert modes and signals
        return [np.asarray(a).tobytes() for a in (values.parameters, values.inputs, values.constants, *modes, *signals)]

    before = arrays()
    model.simulate(rtol=1e-9)
    model.simulate(energy=False, solver="radau")
    assert arrays() == before


def test_exponentials_of_a_sampled_model_are_found_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Segments between samples have one matrix: its scales, its exponentials and the trust in them are those of the first."""
    text = (
        "plain model Sampled {\n mode u = 0\n signal x = integral(v, 1)\n signal v = integral(-3*x - v + u, 0)\n"
        " every 0.1 { u = -2*x }\n output y = x\n}\n"
    )
    computed: list[int] = []
    original = exponential.exponential
    monkeypatch.setattr(exponential, "exponential", lambda matrix: computed.append(len(matrix)) or original(matrix))
    for cache in (exponential._exponential, exponential._balance):
        cache.cache_clear()
    model = bondgraph.load(text)
    first = told(model.simulate(None, to=5))
    assert len(computed) < 12 and exponential._balance.cache_info().misses == 1
    computed.clear()
    assert told(model.simulate(None, to=5)) == first
    assert computed == []
    exponential._exponential.cache_clear()
    assert told(bondgraph.load(text).simulate(None, to=5)) == first


def test_what_is_delayed_is_found_again() -> None:
    """Delayed signals are values of a run, not of its parameters."""
    text = "plain model Late {\n parameter T = 0.3\n signal x = integral(-2*delay(x, T) - x^3, 1)\n output y = x\n}\n"
    model = bondgraph.load(text)
    first = told(model.simulate(None, to=4))
    model.simulate(None, {"T": 0.4}, to=4)
    assert told(model.simulate(None, to=4)) == first == told(bondgraph.load(text).simulate(None, to=4))


def matrix_of(count: int, diagonal: float) -> tuple[Any, Any, Any]:
    """Places and numbers of a grid, `diagonal` on its diagonal. The other entries of a row add up to at most 4."""
    side = round(count**0.5)
    edges = [(i, i + 1) for i in range(count - 1) if (i + 1) % side] + [(i, i + side) for i in range(count - side)]
    rows, columns = ([*range(count), *(e[k] for e in edges), *(e[1 - k] for e in edges)] for k in (0, 1))
    generator = np.random.default_rng(3)
    return np.array(rows), np.array(columns), np.where(np.equal(rows, columns), -diagonal, generator.uniform(0.5, 1, len(rows)))  # fmt: skip


def test_a_diagonal_with_gaps_gives_no_order() -> None:
    rows, columns, _ = matrix_of(100, 5.0)
    assert on_diagonal(rows[1:], columns[1:], 0, 100, False) is None  # nothing is known of the first row's diagonal
    assert on_diagonal(rows[1:], columns[1:], 1, 100, False) is not None  # it is a state's


def test_numbers_that_allow_for_no_such_order_get_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    monkeypatch.setattr(compiled, "ordered", lambda *a: asked.append(a[3]) or ordered(*a))
    for diagonal in (5.0, 1e-4):
        rows, columns, entries = matrix_of(100, diagonal)
        model = bondgraph.load(
            large_models.network([(i + 1, j + 1) for i, j in zip(rows, columns, strict=True) if i < j], 100)
        )
        program = model.compiled_scene(model.scene(), False, "native").program
        order = compiled.Ordered(program, 1e-3)
        places = dict(zip(zip(rows.tolist(), columns.tolist(), strict=True), entries, strict=True))
        assert order.choose(1e-9, np.array([places[i, j] for i, j in zip(*program.pattern, strict=True)]))
    assert asked == [100]


def test_records_share_nothing() -> None:
    model = bondgraph.load(MODELS / "duffing.bg")
    program = model.compiled_scene(model.scene(), False, "native").program
    one, other = (compiled.Ordered(program, small).values for small in (1e-3, 0.5))
    one["x"][:] = 1.0
    assert other["x"].tolist() == [0.0] * len(program.states.names) and (one["small"], other["small"]) == (1e-3, 0.5)
    assert not np.shares_memory(one["x"], one["y"])
    with pytest.raises(KeyError, match="small"):
        RecordArray(form_of(Pattern, program, "nothing known", dict), {})


def test_balanced_by_machine_code_and_by_its_source() -> None:
    generator = np.random.default_rng(1)
    matrix = (
        generator.normal(size=(12, 12))
        * 10.0 ** generator.uniform(-9, 9, (12, 1))
        / 10.0 ** generator.uniform(-9, 9, 12)
    )
    matrix[3] = matrix[:, 5] = 0.0
    (one, scale), (other, same) = balance(matrix, True), balance(matrix, False)
    np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(scale, same)
    np.testing.assert_array_equal(one, matrix * scale / scale[:, None])
    assert (np.log2(scale) == np.round(np.log2(scale))).all()
    norms = [np.linalg.norm(np.delete(one, (3, 5), a), axis=1 - a) for a in (0, 1)]
    ratios = np.delete(norms[0], (3, 5)) / np.delete(norms[1], (3, 5))
    assert np.abs(np.log2(ratios)).max() < 2.0


def test_what_swings_is_looked_at_in_equal_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Speeds that pass through zero seem to grow: they do not ask for shorter steps while they stay within what was there."""
    tries: list[int] = []
    original = CompiledPilotRun.go

    def go(steps: CompiledPilotRun, source: str, run: Any, pace: Any, begun: float, mode: Any) -> int:
        answer = original(steps, source, run, pace, begun, mode)
        tries.append(pace.taken)
        return answer

    monkeypatch.setattr(CompiledPilotRun, "go", go)
    bondgraph.load(MODELS / "manipulator.bg").simulate("push_x", points=2)
    assert 50 < max(tries) < 70


def test_machine_code_projects_pilot_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its steps of a closed mechanism are, bit by bit, those after each of which Python projects."""
    found: list[Any] = []
    calls: list[str] = []
    search, original = tolerances.nominal_magnitudes, CompiledPilotRun.go
    monkeypatch.setattr(tolerances, "nominal_magnitudes", lambda *a: found.append(search(*a)) or found[-1])

    def go(loop: CompiledPilotRun, source: str, run: Any, pace: Any, *others: Any) -> int:
        calls.append(source)
        if len(found):
            loop.most, loop._record.projecting, before = 1, 0, pace.time
        answer = original(loop, source, run, pace, *others)
        return REDUNDANT if len(found) and answer == FINE and pace.time > before else answer

    monkeypatch.setattr(CompiledPilotRun, "go", go)
    for many in (False, True):
        calls.clear()
        bondgraph.load(MODELS / "four_bar.bg").simulate(to=0.02, points=2)
        assert (len(calls) > 50) == many
    np.testing.assert_array_equal(found[0].values, found[1].values)


def test_pilot_runs_from_one_state_share_their_records(monkeypatch: pytest.MonkeyPatch) -> None:
    text = """model Falling {
      I mass : p = 1 kg*v
      R drag : F = 1e-9 [N*s^2/m^2]*v*abs(v)
      Se weight : F = 10 N
      weight -> 1(mass, drag)
      output v = mass.v
      experiment fall { simulate 0 .. 100 s }
    }"""
    made: list[int] = []
    looks: list[Any] = []
    begin, peak = CompiledPilotStep.__init__, PilotRun.peak
    monkeypatch.setattr(CompiledPilotStep, "__init__", lambda *given: (made.append(1), begin(*given))[1])

    def alone(run: PilotRun, *given: Any) -> Any:
        found = peak(run, *given)
        other = PilotRun(run.constraints, np.zeros(1), run.smallest)
        looks.append((found, peak(other, *given)))
        return found

    monkeypatch.setattr(PilotRun, "peak", alone)
    bondgraph.load(text).simulate(points=2)
    assert len(looks) > 2 and len(made) == len(looks) + 1
    for shared, own in looks:
        np.testing.assert_array_equal(shared, own)


def test_outputs_of_many_modes_are_one_call(monkeypatch: pytest.MonkeyPatch) -> None:
    model = bondgraph.load(BALL)
    calls: list[Any] = []
    original = solution.PhaseSolution.output
    monkeypatch.setattr(solution.PhaseSolution, "output", lambda *given: calls.append(1) or original(*given))
    at_once = model.simulate()
    assert len(calls) <= 2
    monkeypatch.setattr(solution, "MANY_CHANGES", np.inf)
    one_by_one = model.simulate()
    assert len(calls) > len(at_once.events) / 2 > 2
    np.testing.assert_array_equal(at_once.values, one_by_one.values)


def called_in(run: Callable[[], object]) -> list[str]:
    """Names of the functions of Python that are called in a run."""
    called: list[str] = []
    sys.setprofile(lambda frame, event, _: called.append(frame.f_code.co_name) if event == "call" else None)
    try:
        run()
    finally:
        sys.setprofile(None)
    return called


@pytest.mark.parametrize(
    ("model", "parameter", "value", "same", "other"),
    [
        ("models/published/transistor_amplifier.bg", "R", 9e3, 320, 1150), ("models/slider_crank.bg", "m", 0.8, 200, 900),
        ("tests/acceptance/defects/elastic_ball.bg", "h", 1.0, 860, 2500),
    ],
)  # fmt: skip
def test_calls_of_a_run(model: str, parameter: str, value: float, same: int, other: int) -> None:
    """Python evaluated the loops of the amplifier 1700 times in Newton's iterations, and the storages of the slider-crank 120 times in its pilot run."""
    loaded = bondgraph.load(model)
    loaded.simulate(settings={parameter: value})
    for _ in range(2):
        loaded.simulate(settings={parameter: 1.01 * value})
    assert len(called_in(lambda: loaded.simulate(settings={parameter: 1.01 * value}))) < same
    called = called_in(lambda: loaded.simulate(settings={parameter: 1.02 * value}))
    assert called.count("evaluate") < 100
    assert type(vars(loaded.simulate(settings={parameter: value}))["events"]) is Later
    assert len(called) < other


def test_calls_of_an_exact_segment() -> None:
    """Around its products of matrices each of 200 segments made 130 calls, many of them of what numpy writes in Python."""
    model = bondgraph.load(MODELS / "step_down.bg")
    short, long = (partial(model.simulate, to=f"{ms} ms", points=250 * ms + 1) for ms in (1, 2))
    short(), long()
    assert len(called_in(long)) - len(called_in(short)) < 115 * 200


@pytest.mark.parametrize(
    "name",
    ["slider_crank", "published/transistor_amplifier", "../tests/acceptance/defects/smoothstep_into_mass"],
    ids=["explicit", "with loops", "exact, then by steps"],
)
def test_runs_that_begin_alike_share_no_results(name: str) -> None:
    """A phase is left to the next run with its workspace; what is read late, and what a reader writes, is that of one run."""
    model = bondgraph.load(MODELS / f"{name}.bg")
    alone = told(bondgraph.load(MODELS / f"{name}.bg").simulate())
    late, spoiled = model.simulate(), model.simulate()
    spoiled.values[:], spoiled.time[:] = 7.0, 7.0
    assert spoiled.checkpoint is not None
    with ThreadPoolExecutor(3) as threads:
        assert [told(r) for r in threads.map(lambda _: model.simulate(), range(6))] == 6 * [alone]
    half = model.simulate(points=7)
    assert told(model.simulate(start=half, to=1.5 * float(half.time[-1]))) == told(
        model.simulate(start=half, to=1.5 * float(half.time[-1]))
    )
    (plan,) = {
        id(x): x for x in model.kept.values() if isinstance(x, PlannedRun) and len(x.instants) != 7 and x.left
    }.values()
    (phase,) = plan.left.values()
    assert phase.stepper is not None and phase.values is None and len(phase.trajectory.states) == 0
    watched = weakref.ref(phase)
    del phase
    gc.disable()
    plan.left.clear()
    gc.enable()
    assert watched() is None
    assert told(late) == alone


def test_calls_of_each_switching_instant() -> None:
    """A phase takes over segments, conditions and workspaces from the last one of its program."""
    loaded = bondgraph.load(CUK)
    loaded.simulate(to=1e-3, points=20)
    called = called_in(partial(loaded.simulate, to=1e-3, points=20))
    last = [place for place, name in enumerate(called) if name == "_continued"][-20:]
    assert last[-1] - last[0] < 19 * 570  # they were 800


def test_numbers_are_looked_at_again_if_they_are_others() -> None:
    model = bondgraph.load(MODELS / "slider_crank.bg")
    first = told(model.simulate(settings={"m": 0.8}))
    for refused in ("0.8 s", float("nan")):
        with pytest.raises(bondgraph.CompilationFailed):
            model.simulate(settings={"m": refused})
    assert told(model.simulate(settings={"m": "800 g"})) == told(model.simulate(settings={"m": 0.8})) == first
