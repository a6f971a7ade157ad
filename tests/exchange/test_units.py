"""Functional mock-up units in another tool: closed forms, time events, states, slopes, limits, several instances."""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.commands import commands
from bondgraph.errors import RunFailed
from bondgraph.exchange import start
from bondgraph.exchange.runtime.instance import FmuInstance
from bondgraph.simulation.integrators.workspace import IntegratorWorkspace
from compiler.api import record_of
from compiler.errors import CompilationFailed
from tests.exchange.unit_files import FMICallException, exported, instance, run

pytestmark = pytest.mark.machine_code
MODELS = Path(__file__).resolve().parents[2] / "models"
KINDS, VERSIONS = ("ModelExchange", "CoSimulation"), ("2", "3")
# A mass on a spring, pulled by an input from a time on.
SPRING = """model Spring {
  "A mass on a spring."
  parameter m = 2 kg, k: N/m = 8, x_0 = 3 mm, t_0 = 0.5 s
  input pull_by: N = 0
  MSe pull : F = pull_by*step(time - t_0)
  1 body
  I mass : p = m*v
  C spring : F = k*x { start x = x_0 }
  pull -> body -> mass, spring
  output x = spring.x
  output work = 0.5*k*spring.x^2
  experiment swing { simulate 0 .. 3 s; report x in mm }
}
"""
STIFF = """plain model Kinetics {
  Sf a : f = 0
  0 one
  C q : e = q { start q = 1 }
  R slow : f = 0.04*e
  MR fast : f = 1e6*(e - cos(time))
  a -> one -> q, slow, fast
  output u = q.q
  experiment long { simulate 0 .. 10 }
}
"""
REFUSING = """plain model Refusing {
  parameter b = 1, length = 1, period = 1, seed = 1, a = 1, c = 1
  signal x = integral(1 + noise(time, period, seed), sqrt(a))
  output y = linear(mod(x, length), (0, b, 3), (0, 1, 2)), z = x/c
}"""
COUPLED = """model Coupled {
  parameter M = 5e-4
  Se s : u = 1 V
  R r : u = 1 ohm*i
  I coils(a, b) : a.lambda = 1 mH*a.i + 1 H*M*b.i, b.lambda = 0.5 mH*a.i + 2 mH*b.i
  R q : u = 2 ohm*i
  1 l : electric
  1 k : electric
  s -> l -> r, coils.a
  k -> q, coils.b
  output i = coils.a.i
}"""
TURNING = """model Turning {
  parameter load = 1 kg, J = 1 kg*m^2
  multibody M : planar {
    gravity = (0, -9.81 [m/s^2])
    body bar { mass = load, inertia = J, at = (1 m, 0 m) }
    hinge pin : ground to bar { at = (0 m, 0 m) }
  }
  output angle = M.pin.phi
}"""
LIMITED = """plain model Limited {
  Sf a : f = 1
  0 one
  C q : e = linear(q, (0, 1, 2), (0, 3, 4)) { start q = 0.5 }
  R r : f = 0*e
  a -> one -> q, r
  require q.q < 1.2 "it is filled too far"
  output u = q.e
  experiment fill { simulate 0 .. 1 }
}
"""


def swing(time: np.ndarray, m: float, k: float, x_0: float, t_0: float, force: float) -> np.ndarray:
    w, after = math.sqrt(k / m), np.maximum(time - t_0, 0.0)
    return x_0 * np.cos(w * time) + force / k * (1 - np.cos(w * after))


@pytest.mark.parametrize("fmi", VERSIONS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_closed_form_with_a_time_event_that_a_parameter_moves(kind: str, fmi: str, tmp_path: Path) -> None:
    exported(SPRING, tmp_path, fmi=fmi)
    values = {"pull_by": 0.04, "t_0": 0.9, "k": 12.5, "x_0": 5e-3}
    found = run(tmp_path, kind, rtol=1e-9, start_values=values, output=["x", "work"])
    closed = swing(found["time"], 2.0, 12.5, 5e-3, 0.9, 0.04)
    assert np.abs(found["x"] - closed).max() < (1e-10 if kind == "CoSimulation" else 1e-8)
    assert found["work"] == pytest.approx(0.5 * 12.5 * found["x"] ** 2, rel=1e-12)


def reference(path: Path) -> dict[str, str]:
    """Files of the reference run in a unit, by name."""
    folder = "extra/org.fmi-standard.fmi-ls-ref/"
    with zipfile.ZipFile(path / "unit.fmu") as archive:
        names = [name for name in archive.namelist() if name.startswith(folder)]
        return {name.removeprefix(folder): archive.read(name).decode() for name in names}


@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_reference_run_is_one_of_the_unit_by_itself(fmi: str, tmp_path: Path) -> None:
    exported(SPRING, tmp_path, fmi=fmi)
    files = reference(tmp_path)
    options = dict(line.split(", ") for line in files["Spring_ref.opt"].splitlines())
    assert options == {"StartTime": "0.0", "StopTime": "3.0", "StepSize": "0.0", "RelTol": "1e-06", "OutputIntervalLength": "0.015"}  # fmt: skip
    header, *lines = files["Spring_ref.csv"].splitlines()
    time, x, _ = np.array([line.split(",") for line in lines], float).T
    assert header == '"time","x","work"' and len(time) == 201
    assert np.abs(x - swing(time, 2.0, 8.0, 3e-3, 0.5, 0.0)).max() < 3e-9
    manifest = ElementTree.fromstring(files["fmi-ls-manifest.xml"])
    related = [(item.get("role"), item.get("source")) for item in manifest.findall("Related")]
    assert related == [("result", "Spring_ref.csv"), ("experiment/smoke-test", "Spring_ref.opt")]
    assert manifest.get("{http://fmi-standard.org/fmi-ls-manifest}fmi-ls-name") == "org.fmi-standard.fmi-ls-ref"


def test_a_reference_run_is_that_of_an_experiment_that_is_named(tmp_path: Path) -> None:
    text = SPRING.replace("simulate 0 .. 3 s;", "set pull_by = 0.04 N; simulate 1 s .. 3 s;")
    exported(text, tmp_path)
    assert reference(tmp_path) == {}  # a run without an experiment begins at 0
    exported(text, tmp_path, "swing")
    header, first, *_, last = reference(tmp_path)["Spring_ref.csv"].splitlines()
    assert (header, first, last[:2]) == ('"time","x"', "1,0.003", "3,")
    assert float(last[2:]) == pytest.approx(5e-3 - 2e-3 * math.cos(2 * 2), abs=1e-8)
    exported(text.partition("  experiment")[0] + "}", tmp_path)
    assert reference(tmp_path) == {}  # no time at which it ends


def test_requirements_are_least_and_largest_values(tmp_path: Path) -> None:
    """Where a number is compared with the quantity itself; a start that is beyond it would make the description wrong."""
    limits = '  require m > 0 kg and t_0 <= 2 s "a"\n  require 3 N >= pull_by and pull_by >= -3 N "b"\n  require spring.x < 4 m "c"\n  require x >= -2 m "d"\n'
    others = '  require k < m*5 [N/(m*kg)] "e"\n  require x_0 > 1 m "f"\n  require abs(x) < 3 m or m < 5 kg "g"\n'
    for fmi in VERSIONS:
        found = exported(SPRING.replace("  1 body\n", f"  1 body\n{limits}{others}"), tmp_path, fmi=fmi)
        bounds = {v.name: (v.min, v.max) for v in found.modelVariables if v.min is not None or v.max is not None}
        least = {"m": ("0.0", None), "t_0": (None, "2.0"), "pull_by": ("-3.0", "3.0"), "spring.x": (None, "4.0")}
        assert bounds == least | {"x": ("-2.0", None)}


def test_a_looser_tolerance_is_met_with_a_larger_error(tmp_path: Path) -> None:
    exported(SPRING, tmp_path)
    errors = []
    for rtol in (1e-3, 1e-9):
        found = run(tmp_path, "CoSimulation", rtol=rtol, output_interval=3.0)
        errors.append(np.abs(found["x"] - swing(found["time"], 2.0, 8.0, 3e-3, 0.5, 0.0)).max() / 3e-3)
    assert errors[1] < 1e-9 < 10 * errors[1] or errors[1] < errors[0] < 1e-2


@pytest.mark.parametrize("fmi", VERSIONS)
def test_description_structure_and_units(fmi: str, tmp_path: Path) -> None:
    found = exported(SPRING, tmp_path, fmi=fmi)
    by_name = {v.name: v for v in found.modelVariables}
    assert found.description == "A mass on a spring." and found.variableNamingConvention == "structured"
    assert [by_name[n].variability for n in ("m", "k", "x_0", "t_0")] == ["tunable", "tunable", "fixed", "tunable"]
    assert (by_name["mass.p"].initial, by_name["spring.x"].initial) == ("exact", "calculated")
    assert (by_name["x"].unit, by_name["x"].displayUnit) == ("m", "mm") and by_name["der(mass.p)"].unit == "N"
    assert {u.name: u.baseUnit.s for u in found.unitDefinitions if u.baseUnit}["N/m"] == -2
    assert float(by_name["spring.x"].nominal) > 0
    reads = {
        u.variable.name: ([v.name for v in u.dependencies], u.dependenciesKind)
        for u in [*found.outputs, *found.derivatives]
    }
    assert reads["x"] == (["spring.x"], ["constant"])
    assert reads["work"] == (["spring.x"], ["dependent"])
    assert reads["der(spring.x)"] == (["mass.p"], ["tunable"])
    assert reads["der(mass.p)"] == (["spring.x", "pull_by"], ["tunable", "dependent"])
    experiment = found.defaultExperiment
    assert [float(x) for x in (experiment.startTime, experiment.stopTime, experiment.tolerance)] == [0.0, 3.0, 1e-6]


def test_an_output_that_is_a_state_keeps_its_name(tmp_path: Path) -> None:
    """x' = 2 from 1: the output is called `x`, as its author calls it, and the state behind it gives way."""
    text = "model Way { input v = 2 [m/s]\n output x = integral(v, 1 m), there = v\n experiment go { simulate 0 .. 3 s; report x in mm } }"
    found = exported(text, tmp_path)
    assert {v.name: v.causality for v in found.modelVariables if v.causality != "independent"} == {
        "state.x": "local", "der(state.x)": "local", "v": "input", "x": "output", "there": "output",
    }  # fmt: skip
    assert next(v.displayUnit for v in found.modelVariables if v.name == "x") == "mm"
    assert run(tmp_path, "ModelExchange", output=["x"])["x"][-1] == pytest.approx(7.0, rel=1e-9)


@pytest.mark.parametrize("experiment", [None, "swing"])
def test_magnitudes_of_a_model_at_rest_are_those_of_its_first_experiment(
    experiment: str | None, tmp_path: Path
) -> None:
    """Without inputs nothing moves; with a pull of 0.04 N the spring gives way by 5 mm."""
    text = SPRING.replace("x_0 = 3 mm", "x_0 = 0 mm").replace("{ simulate", "{ set pull_by = 0.04 N; simulate")
    found = {v.name: v for v in exported(text, tmp_path, experiment).modelVariables}
    assert 2e-3 < float(found["spring.x"].nominal) < 2e-2
    assert found["spring.x"].start in (None, "0.0")
    if experiment is None:
        assert float(found["pull_by"].start) == 0.0
        unit = run(tmp_path, "ModelExchange", start_values={"pull_by": 0.04}, rtol=1e-9)
        assert np.abs(unit["x"] - swing(unit["time"], 2.0, 8.0, 0.0, 0.5, 0.04)).max() < 1e-7


@pytest.mark.parametrize("fmi", VERSIONS)
@pytest.mark.parametrize("kind", KINDS)
def test_slopes_are_those_of_the_equations(kind: str, fmi: str, tmp_path: Path) -> None:
    """Along directions, and of sums in FMI 3.0: J v and w J are of one matrix J."""
    exported(SPRING, tmp_path, fmi=fmi)
    with instance(tmp_path, kind, {"pull_by": 0.5, "x_0": 2e-3}) as (unit, place):
        if kind == "CoSimulation":
            unit.doStep(0.0, 0.75)
        rows, columns = [place["der(mass.p)"], place["work"], place["x"]], [place["spring.x"], place["pull_by"]]
        (x,) = unit.getReal([place["spring.x"]])
        after = 1.0 if kind == "CoSimulation" else 0.0
        along = [unit.getDirectionalDerivative(rows, [c], [1.0]) for c in columns]
        assert [list(a) for a in along] == [[-8.0, 8.0 * x, 1.0], [after, 0.0, 0.0]]
        assert list(unit.getDirectionalDerivative(rows, columns, [2.0, 3.0]))[0] == -16.0 + 3.0 * after
        if fmi == "3":
            assert list(unit.getAdjointDerivative(rows, columns, [2.0, 3.0, 5.0], 2)) == [
                -16.0 + 24.0 * x + 5.0,
                2.0 * after,
            ]
            with pytest.raises(FMICallException):
                unit.getAdjointDerivative(rows, [place["k"]], [1.0, 0.0, 0.0], 1)


@pytest.mark.parametrize("fmi", VERSIONS)
def test_casadi_takes_units_with_their_slopes(fmi: str, tmp_path: Path) -> None:
    ca = pytest.importorskip("casadi")
    exported(SPRING, tmp_path, fmi=fmi)
    function = ca.DaeBuilder("spring", str(tmp_path / "unit.fmu")).create("f", ["x", "u"], ["ode", "y"])
    at = ([2e-3, 1e-3], [0.5])  # momentum, position
    assert np.array(function(*at)[0]).ravel() == pytest.approx([-8e-3, 1e-3], rel=1e-14)
    blocks = [np.array(block) for block in function.jacobian()(*at, 0, 0)]
    slopes = np.block([blocks[:2], blocks[2:]])
    assert slopes == pytest.approx(np.array([[0, -8, 0], [0.5, 0, 0], [0, 1, 0], [0, 8e-3, 0]]), rel=1e-14)
    (along, _) = function.reverse(1)(*at, 0, 0, [2.0, 3.0], [5.0, 7.0])
    assert np.array(along).ravel() == pytest.approx([1.5, -16 + 5 + 7 * 8e-3], rel=1e-14)


@pytest.mark.parametrize("fmi", VERSIONS)
def test_states_are_kept_and_brought_back_bit_by_bit(fmi: str, tmp_path: Path) -> None:
    """A state, and one that went through a file, lead to the same bits; also after other steps."""
    exported(SPRING, tmp_path, fmi=fmi)
    with instance(tmp_path, values={"pull_by": 0.1}) as (unit, place):
        names = [place["x"], place["mass.p"]]
        unit.doStep(0.0, 0.3)
        state = unit.getFMUState()
        saved = unit.serializeFMUState(state)
        unit.doStep(0.3, 0.4)
        wanted = unit.getReal(names)
        other = unit.deserializeFMUState(saved)
        assert unit.serializeFMUState(other) == saved
        for number in range(1000 if fmi == "3" else 200):
            unit.setFMUState(other if number % 2 else state)
            unit.doStep(0.3, 0.4)
            assert unit.getReal(names) == wanted
            unit.doStep(0.7, 0.1 + 0.0002 * number)
        unit.freeFMUState(state)
        unit.freeFMUState(other)


def test_instances_in_one_process_do_not_touch_each_other(tmp_path: Path) -> None:
    exported(SPRING, tmp_path)
    settings = ({"k": 8.0, "pull_by": 0.2}, {"k": 50.0, "pull_by": -0.1})

    def alone(values: dict[str, float]) -> list[float]:
        with instance(tmp_path, values=values) as (unit, place):
            return [unit.doStep(0.1 * i, 0.1) or unit.getReal([place["x"]])[0] for i in range(10)]

    wanted = [alone(values) for values in settings]
    with (
        instance(tmp_path, values=settings[0]) as (one, place),
        instance(tmp_path, values=settings[1]) as (two, _),
    ):
        for i in range(10):
            for unit, values in zip((one, two), wanted, strict=True):
                unit.doStep(0.1 * i, 0.1)
                assert unit.getReal([place["x"]])[0] == values[i]


def test_values_that_change_between_steps(tmp_path: Path) -> None:
    """An input and a tunable parameter are set while it runs; then it is reset."""
    exported(SPRING, tmp_path)
    with instance(tmp_path, values={"t_0": 0.0, "x_0": 0.0}, tolerance=1e-10) as (unit, place):
        unit.setReal([place["pull_by"]], [0.08])
        unit.doStep(0.0, 1.0)
        x, p = unit.getReal([place["spring.x"], place["mass.p"]])
        assert x == pytest.approx(0.01 * (1 - math.cos(2.0)), rel=1e-8)
        unit.setReal([place["pull_by"], place["k"]], [0.0, 18.0])
        unit.doStep(1.0, 1.0)
        assert unit.getReal([place["x"]])[0] == pytest.approx(x * math.cos(3.0) + p / 6.0 * math.sin(3.0), rel=1e-8)
        unit.reset()
        unit.setupExperiment(startTime=0.0)
        unit.enterInitializationMode()
        unit.exitInitializationMode()
        assert unit.getReal([place["k"], place["pull_by"], place["x"]]) == [8.0, 0.0, 3e-3]


def steps_of(unit: Any) -> int:
    """The number of steps that a unit has made since it began to integrate."""
    words = ctypes.cast(unit.component, ctypes.POINTER(ctypes.c_int64))
    solver = ctypes.cast(words[record_of(FmuInstance).place("solver")], ctypes.POINTER(ctypes.c_int64))
    return solver[record_of(IntegratorWorkspace).place("steps")]


def test_steps_go_beyond_communication_points_until_something_changes(tmp_path: Path) -> None:
    """Between 300 points a unit makes some 20 steps; an input takes back what it has done beyond, and states of it are the same bits again."""
    exported(SPRING, tmp_path)
    with instance(tmp_path, values={"t_0": 0.0, "pull_by": 0.08, "x_0": 0.0}, tolerance=1e-9) as (unit, place):
        for k in range(300):
            unit.doStep(k * 0.01, 0.01)
            assert unit.getReal([place["x"]])[0] == pytest.approx(0.01 * (1 - math.cos(0.02 * (k + 1))), abs=1e-11)
        assert steps_of(unit) < 40
        state = unit.getFMUState()
        ends = []
        for _ in range(2):
            unit.doStep(3.0, 0.01)
            unit.setReal([place["pull_by"]], [0.0])
            x, p = unit.getReal([place["x"], place["mass.p"]])
            for k in range(100):
                unit.doStep(3.01 + k * 0.01, 0.01)
            ends.append(unit.getReal([place["x"]]))
            unit.setFMUState(state)
        assert ends[0] == pytest.approx([x * math.cos(2.0) + p / 4.0 * math.sin(2.0)], abs=1e-11) and ends[0] == ends[1]


def test_a_stiff_model_is_integrated_by_the_implicit_method(tmp_path: Path) -> None:
    exported(STIFF, tmp_path)
    found = run(tmp_path, "CoSimulation", output_interval=0.5)
    mine = bondgraph.load(STIFF).simulate(rtol=1e-9)
    assert np.interp(found["time"], mine.time, mine["u"]) == pytest.approx(found["u"], abs=1e-5)


def test_limits_of_a_model_are_told(tmp_path: Path) -> None:
    """A requirement is a warning, once; a table that is left is an error, with a sentence in the log."""
    exported(LIMITED, tmp_path)
    from fmpy.fmi2 import defaultCallbacks, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

    told: list[tuple[int, str]] = []
    callbacks = fmi2CallbackFunctions()
    callbacks.logger = fmi2CallbackLoggerTYPE(
        lambda _, name, status, category, text: told.append((status, text.decode()))
    )
    callbacks.allocateMemory, callbacks.freeMemory = defaultCallbacks.allocateMemory, defaultCallbacks.freeMemory
    with instance(tmp_path, callbacks=callbacks) as (unit, place):
        unit.doStep(0.0, 0.5)
        assert told == []
        unit.doStep(0.5, 0.5)
        unit.doStep(1.0, 0.25)
        assert [status for status, _ in told] == [1] and "does not hold any more" in told[0][1]
        assert unit.getReal([place["u"]])[0] == pytest.approx(3.75, rel=1e-9)
        with pytest.raises(FMICallException):
            unit.doStep(1.25, 0.5)
        assert [status for status, _ in told[1:]] == [3] and "is asked outside of its range" in told[1][1]
    with instance(tmp_path, callbacks=callbacks) as (unit, place):  # between points that steps pass, not before
        told.clear()
        for k in range(14):
            unit.doStep(k * 0.1, 0.1)
            assert [status for status, _ in told] == ([1] if k > 6 else []) or k == 6


def test_parameters_that_a_run_refuses_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Places of tables and lengths, a seed, a start and an output without a value; a tensor of inertia, and a field that has no energy."""
    refused = {
        REFUSING: {"b": (3.5, "`linear`"), "length": (0, "`mod`"), "period": (-1, "`noise`"), "seed": (1.5, "`noise`"), "a": (-1, "not finite"), "c": (0, "not finite")},
        COUPLED: {"M": (6e-4, "the field `coils`")},
        TURNING: {"load": (-1, "mass of bar"), "J": (-1, "inertia of bar")},
    }  # fmt: skip
    for number, (text, settings) in enumerate(refused.items()):
        (folder := tmp_path / str(number)).mkdir()
        exported(text, folder)
        for name, (value, words) in settings.items():
            with pytest.raises((CompilationFailed, RunFailed)):
                bondgraph.load(text).simulate(to=1, points=2, settings={name: value})
            with pytest.raises(FMICallException), instance(folder, values={name: value}):
                pass
            assert words in capsys.readouterr().out
        with instance(folder) as (unit, _):
            unit.doStep(0.0, 0.1)


@pytest.mark.parametrize("fmi", VERSIONS)
def test_what_an_importer_must_not_do_is_refused(fmi: str, tmp_path: Path) -> None:
    exported(SPRING, tmp_path, fmi=fmi)
    with instance(tmp_path) as (unit, place):
        others = (
            (lambda: unit.getInteger([0]),) if fmi == "2" else
            (lambda: unit.getInt32([0]), lambda: unit.getFloat64([0], 2), lambda: unit.getClock([0]), unit.enterConfigurationMode)
        )  # fmt: skip
        for call in (
            lambda: unit.getReal([999]), lambda: unit.setReal([place["x"]], [1.0]), lambda: unit.setReal([place["k"]], [math.nan]),
            lambda: unit.doStep(5.0, 0.1), lambda: unit.enterInitializationMode(),
            lambda: unit.getDirectionalDerivative([place["x"]], [place["k"]], [1.0]), *others,
        ):  # fmt: skip
            with pytest.raises(FMICallException):
                call()
        unit.doStep(0.0, 0.1)


@pytest.mark.parametrize("name", ["oscillator", "van_der_pol", "pid_dc_motor", "gyroscope"])
def test_models_give_the_numbers_of_a_run(name: str, tmp_path: Path) -> None:
    path = MODELS / f"{name}.bg"
    model = bondgraph.load(path)
    mine = model.simulate(rtol=1e-9)
    exported(path, tmp_path, mine.experiment or None)
    found = run(tmp_path, "CoSimulation", rtol=1e-7, output_interval=float(mine.time[-1]) / 20)
    for output in mine.names:
        at = np.searchsorted(mine.time, found["time"] - 1e-9)
        size = np.abs(mine[output]).max()
        assert np.abs(found[output] - mine[output][at]).max() < 1e-5 * size, output


@pytest.mark.parametrize("name", ["oscillator", "pid_dc_motor"])
def test_both_versions_give_the_same_bits(name: str, tmp_path: Path) -> None:
    found: dict[str, dict[str, np.ndarray]] = {}
    for fmi in VERSIONS:
        exported(MODELS / f"{name}.bg", tmp_path, next(iter(bondgraph.load(MODELS / f"{name}.bg").experiments)), fmi)
        found[fmi] = {kind: run(tmp_path, kind) for kind in KINDS}
    for kind in KINDS:
        assert len(found["2"][kind]) > 100 and np.array_equal(found["2"][kind], found["3"][kind])


@pytest.mark.parametrize("fmi", VERSIONS)
def test_sources_give_the_same_bits(fmi: str, tmp_path: Path) -> None:
    """Those of a model with events and samples too."""
    if not (compiler := shutil.which("gcc") or shutil.which("cc")):
        pytest.skip("no C compiler")
    events = "  mode hits = 0, kick = 0 N\n  when spring.x > 4 mm { mass.v = -mass.v, hits = hits + 1 }\n  every 70 ms { kick = 0.01 N*sin(9*time/1 s) }\n"
    text = SPRING.replace("  1 body", f"{events}  output count = hits\n  1 body").replace(
        "step(time - t_0)", "step(time - t_0) + kick"
    )
    exported(text, tmp_path, fmi=fmi)
    wanted = {kind: run(tmp_path, kind, start_values={"pull_by": 0.3}) for kind in KINDS}
    assert wanted["CoSimulation"]["count"][-1] > 1
    with zipfile.ZipFile(tmp_path / "unit.fmu") as archive:
        archive.extractall(tmp_path)
    folder = {"2": "linux64", "3": "x86_64-linux"}[fmi]
    library = tmp_path / "binaries" / folder / "Spring.so"
    files = [str(tmp_path / "sources" / name) for name in ("program.c", "fmu.c")]
    flags = ("-std=c11", "-O0", "-fPIC", "-shared", "-ffp-contract=off", "-fvisibility=hidden", "-Werror")
    warnings = ("-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Wno-unused-function", "-Wno-unused-variable")
    subprocess.run([compiler, *flags, *warnings, *files, "-lm", "-o", str(library)], check=True)
    with zipfile.ZipFile(tmp_path / "unit.fmu", "w") as archive:
        archive.write(tmp_path / "modelDescription.xml", "modelDescription.xml")
        archive.write(library, f"binaries/{folder}/Spring.so")
    for kind in KINDS:
        found = run(tmp_path, kind, start_values={"pull_by": 0.3})
        assert all(np.array_equal(found[n], wanted[kind][n]) for n in found.dtype.names)


@pytest.mark.parametrize(
    ("part", "words"),
    [
        ("output late = delay(spring.x, 1 ms)", "delayed signals"),
        ("output mean = mass.p/mass.v", "`mean`, which has no value at the start"),
    ],
)  # fmt: skip
def test_what_a_unit_cannot_hold_is_named(part: str, words: str) -> None:
    text = SPRING.replace("  output work", f"  {part}\n  output work")
    with pytest.raises(CompilationFailed) as failed:
        bondgraph.load(text).to_fmu("never.fmu")
    assert {d.code for d in failed.value.diagnostics} == {"BG606"}
    assert words in failed.value.diagnostics[0].sentence
    assert not Path("never.fmu").exists()


def test_a_model_that_a_run_keeps_sparse_has_dense_matrices_up_to_a_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    text = (MODELS / "rc_ladder.bg").read_text().replace("n = 10", "n = 110")
    mine = bondgraph.load(text).simulate(rtol=1e-8, points=11)
    exported(text, tmp_path, "charge")
    found = run(tmp_path, "CoSimulation", rtol=1e-8, output_interval=2e-3)
    assert found["u_end"] == pytest.approx(mine["u_end"], abs=1e-8)
    monkeypatch.setattr(start, "MOST", 9)
    with pytest.raises(CompilationFailed, match="10 states and unknowns"):
        bondgraph.load(MODELS / "rc_ladder.bg").to_fmu("never.fmu")


def test_the_command_writes_units(tmp_path: Path) -> None:
    (tmp_path / "m.bg").write_text(SPRING, encoding="utf-8")
    out = tmp_path / "m.fmu"
    arguments = ["compile", str(tmp_path / "m.bg"), "-o", str(out), "--platforms", "linux64,linux-aarch64,win64"]
    assert CliRunner().invoke(commands, [*arguments, "--experiment", "swing"]).exit_code == 0
    first = out.read_bytes()
    with zipfile.ZipFile(out) as archive:
        folders = {n.split("/")[1] for n in archive.namelist() if n.startswith("binaries/")}
    assert folders == {"linux64", "aarch64-linux", "win64"}
    assert CliRunner().invoke(commands, [*arguments, "--experiment", "swing"]).exit_code == 0
    assert out.read_bytes() == first  # equal models give equal bytes
    wrong = CliRunner().invoke(commands, [*arguments[:-1], "amiga"])
    assert wrong.exit_code == 2 and "platforms are linux64, linux-aarch64, win64" in wrong.output
    assert CliRunner().invoke(commands, [*arguments, "--fmi", "3"]).exit_code == 0
    with zipfile.ZipFile(out) as archive:
        assert {
            "sources/buildDescription.xml",
            "binaries/x86_64-linux/Spring.so",
            "binaries/x86_64-windows/Spring.dll",
        } < {*archive.namelist()}
    wrong = CliRunner().invoke(commands, [*arguments, "--fmi", "4"])
    assert wrong.exit_code == 2 and "versions are 2, 3" in wrong.output
    wrong = CliRunner().invoke(commands, ["compile", str(tmp_path / "m.bg"), "-o", "m.py", "--platforms", "linux64"])
    assert wrong.exit_code == 2
