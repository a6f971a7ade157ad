"""Units of models with events in another tool: closed forms, our own runs, instants, states in the middle of events, refusals at run time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph
from compiler.errors import CompilationFailed
from tests.event_models import BALL, CHAIN, HEATER, bounces, height, servo
from tests.exchange.unit_files import FMICallException, exported, instance, run

pytestmark = pytest.mark.machine_code
KINDS = ("ModelExchange", "CoSimulation")
SERVO = servo(" offset 3 ms delay 2 ms jitter 4 ms seed 3")
ENDLESS = {
    "rounding of terms that cancel": "plain model A { mode n = 0\n signal x = integral(y, 0), y = integral(-x, 1)\n when (x + y)^2 - x^2 - y^2 - 2*x*y > 0 { n = n + 1 }\n output a = n }",
    "Events accumulate": BALL.replace(" if -e*mass.v >= v_min else 0 [m/s]", "").replace("1 if -e*mass.v >= v_min else 0", "1"),
    "cause each other": CHAIN.replace("when u > 1", "when x > 2.5 and b > 0").replace("b = -x }", "b = -1 }\n when x > 2.5 and b < 0 { b = 1 }"),
    "compares has no value": "plain model A { mode n = 0\n signal x = integral(1, 0)\n when x < 0.2 and sqrt(0.7 - x) > 0.1 { n = 1 }\n when sqrt(1.5 - x) > 2 { n = 2 }\n output a = n }",
    "set one quantity": CHAIN.replace("when u > 1", "when x > 2.5 { b = 7 }\n when 2*x > 5"),
    "neither hold nor fail": BALL.replace("weight -> body -> mass", "R f : F = 20 N*sign(v)\n weight -> body -> mass, f").replace("1 kg*v\n", "1 kg*v { start v = 5 [m/s] }\n"),
}  # fmt: skip


def after_events(found: Any) -> Any:
    """The last row of each instant."""
    return found[np.append(np.diff(found["time"]) > 0, True)]


@pytest.mark.parametrize("fmi", ["2", "3"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_bouncing_ball_follows_its_closed_form(kind: str, fmi: str, tmp_path: Path) -> None:
    exported(BALL, tmp_path, fmi=fmi)
    for e, v_min in ((0.7, 0.1), (0.5, 0.4)):
        found = run(tmp_path, kind, rtol=1e-9, start_values={"e": e, "v_min": v_min}, output=["h", "v"])
        rows = after_events(found)
        assert np.abs(rows["h"] - height(rows["time"], e, v_min)).max() < (1e-12 if kind == "CoSimulation" else 1e-7)
        assert rows["v"][-1] == rows["h"][-1] == 0.0
        if kind == "ModelExchange":
            instants = found["time"][1:][np.diff(found["time"]) == 0]
            for time, _ in bounces(e, v_min, 3.0):
                assert np.abs(instants - time).min() < 1e-6  # CVode's, which adds up


@pytest.mark.parametrize("early", [False, True])
def test_an_importer_handles_the_events_of_co_simulation(early: bool, tmp_path: Path) -> None:
    """FMI 3.0: where steps may end early they do so at each bounce and each top, where the speed changes its sign; else the unit lets them act."""
    exported(BALL, tmp_path, fmi="3")
    found = run(tmp_path, "CoSimulation", rtol=1e-9, output=["h", "v"], use_event_mode=True, early_return_allowed=early)
    rows = after_events(found)
    assert np.abs(rows["h"] - height(rows["time"], 0.7, 0.1)).max() < 1e-12
    instants = found["time"][1:][np.diff(found["time"]) == 0]
    below = np.array([time for time, _ in bounces(0.7, 0.1, 3.0)])
    wanted = np.sort([*below, *(below[1:] + below[:-1]) / 2]) if early else []
    assert instants == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_plateaus_at_zero_count_as_in_a_run(kind: str, tmp_path: Path) -> None:
    """x = sin(t) in 0 … 10: an indicator that is zero for a while must have changed its sign."""
    counts = {"max(x, 0) > 0": 2, "max(x, 0) == 0": 2, "min(x, 0.5) >= 0.5": 2, "min(x, 0.5) < 0.5": 3, "max(x - 0.5, 0) > 0": 2, "linear(x, (-1.1, -0.5, 0.2, 1.1), (0, 0.3, 0.3, 1)) > 0.3": 2}  # fmt: skip
    modes = ", ".join(f"n{i} = 0" for i in range(len(counts)))
    acts = "\n".join(f"when {condition} {{ n{i} = n{i} + 1 }}" for i, condition in enumerate(counts))
    names = [f"c{i}" for i in range(len(counts))]
    outputs = ", ".join(f"c{i} = n{i}" for i in range(len(counts)))
    exported(
        f"plain model A {{ signal x = integral(v, 0), v = integral(-x, 1)\n mode {modes}\n{acts}\n output {outputs} }}",
        tmp_path,
    )
    found = run(tmp_path, kind, stop_time=10.0, output_interval=0.05, output=names)
    assert [found[name][-1] for name in names] == list(counts.values())


def test_a_unit_tells_importers_of_laws_that_may_be_narrow(tmp_path: Path) -> None:
    """In co-simulation a bell of a state has its area; the description says that an importer's own steps may pass it."""
    text = 'plain model A {{ "Passes."\n signal x = integral(1, 0), y = integral({law}, 0)\n output last = y }}'
    assert exported(text.format(law="x"), tmp_path).description == "Passes."
    assert "model exchange" in exported(text.format(law="exp(-(x*x - 7.4*x + 3.7^2)/1e-3^2)"), tmp_path).description
    found = run(tmp_path, "CoSimulation", stop_time=6.0, output_interval=3.0, output=["last"])
    assert found["last"][-1] == pytest.approx(1e-3 * np.sqrt(np.pi), rel=1e-4)


@pytest.mark.parametrize("fmi", ["2", "3"])
def test_communication_points_are_instants_but_for_rounding(fmi: str, tmp_path: Path) -> None:
    """0.1 + 0.2 is an ulp behind the sample at 0.3: neither that way nor what follows it is too short for a step."""
    text = "plain model A { parameter k = 2\n mode a = 3*k, b = 1\n signal x = integral(a, k)\n when x > 5*k { a = -a }\n every 0.3 { b = b + 1 }\n output y = x, z = b }"
    exported(text, tmp_path, fmi=fmi)
    with instance(tmp_path) as (unit, place):
        time = 0.0
        for step in (*[0.1] * 13, 1e-16, 1e-15, 3e-14, 0.1, *[0.1] * 6):
            unit.doStep(time, step)
            time += step
            y, z = unit.getReal([place["y"], place["z"]])
            assert y == pytest.approx(min(2 + 6 * time, 18 - 6 * time), abs=1e-12)
            assert z == 2 + int((time + 1e-12) / 0.3)


@pytest.mark.parametrize("early", [False, True])
def test_samples_at_communication_points_are_events_of_the_importer(early: bool, tmp_path: Path) -> None:
    exported("plain model Stair { mode n = 0\n every 1 { n = n + 1 }\n output y = n }", tmp_path, fmi="3")
    with instance(tmp_path, eventModeUsed=True, earlyReturnAllowed=early) as (unit, place):
        assert unit.updateDiscreteStates()[4:] == (True, 1.0)
        unit.enterStepMode()
        assert unit.doStep(0.0, 1.0) == (True, False, False, 1.0)
        assert unit.getReal([place["y"]]) == [1.0]
        unit.enterEventMode()
        assert unit.updateDiscreteStates()[4:] == (True, 2.0)
        assert unit.getReal([place["y"]]) == [2.0]
        unit.enterStepMode()
        assert unit.doStep(1.0, 1.5) == ((True, False, True, 2.0) if early else (False, False, False, 2.5))
        assert unit.getReal([place["y"]]) == [2.0 if early else 3.0]
        unit.doStep(2.0 if early else 2.5, 0.25)  # one that does not let the event act
        assert unit.getReal([place["y"]]) == [3.0]


def test_clocks_tick_where_samples_act(tmp_path: Path) -> None:
    """Of two blocks, each at its own instants, once, the first at the start; the importer reads them before it lets the unit act."""
    text = "plain model Two { mode a = 0, b = 0\n every 0.25 { a = a + 1 }\n every 0.5 offset 0.125 { b = b + 1 }\n output x = a, y = b }"
    found = exported(text, tmp_path, fmi="3")
    clocks = [v for v in found.modelVariables if v.type == "Clock"]
    assert [(c.name, c.causality, c.intervalVariability) for c in clocks] == [("every[1]", "output", "triggered"), ("every[2]", "output", "triggered")]  # fmt: skip
    references, ticks, time = [c.valueReference for c in clocks], [], 0.0
    with instance(tmp_path, eventModeUsed=True, earlyReturnAllowed=True) as (unit, place):
        while time < 1.0:
            ticks.append((time, *unit.getClock(references)))
            unit.updateDiscreteStates()
            assert unit.getClock(references) == [False, False]
            unit.enterStepMode()
            with pytest.raises(FMICallException):
                unit.getClock(references)
            time = unit.doStep(time, 1.0)[3]
            unit.enterEventMode()
        with pytest.raises(FMICallException):
            unit.getClock([place["x"]])
        assert unit.getReal([place["x"], place["y"]]) == [4.0, 2.0]
    assert ticks == [(k / 8, k % 2 == 0, k % 4 == 1) for k in (0, 1, 2, 4, 5, 6)]


@pytest.mark.parametrize(("text", "end"), [(HEATER, 60.0), (SERVO, 1.0)])
def test_outputs_are_those_of_a_run(text: str, end: float, tmp_path: Path) -> None:
    """Located conditions, conditions on time, samples with offset, delay and jitter, whole numbers of states and of time."""
    exported(text, tmp_path)
    mine = bondgraph.load(text).simulate(to=end, points=41, rtol=1e-11)
    for kind, tolerance in zip(KINDS, (1e-6, 1e-9), strict=True):
        found = after_events(run(tmp_path, kind, rtol=1e-9, stop_time=end, output_interval=end / 40))
        at = np.searchsorted(found["time"], mine.time - 1e-9 * end)
        assert len(at) == 41
        for name in mine.names:
            assert np.abs(found[name][at] - mine[name]).max() < tolerance * np.abs(mine[name]).max(), (kind, name)


def test_windows_that_a_step_holds_many_of_are_counted(tmp_path: Path) -> None:
    """x = sin(t), y = cos(t): each window on the way, of 1e-3 of the distance between them."""
    exported(
        "plain model A { mode n = 0, m = 0\n signal x = integral(y, 0), y = integral(-x, 1)\n when cos(1000*y) > 0.99999 { n = n + 1 }\n when sin(3000*x) > 0.99999 { m = m + 1 }\n output a = n, b = m }",
        tmp_path,
    )
    found = run(tmp_path, "CoSimulation", rtol=1e-8, stop_time=1.0, output_interval=0.1, output=["a", "b"])[-1]
    numbers = np.arange(1000)
    falling, rising = 2 * np.pi * numbers / 1000, (2 * np.pi * numbers + np.pi / 2) / 3000
    assert found["a"] == ((falling > np.cos(1)) & (falling < 1)).sum()
    assert found["b"] == (rising < np.sin(1)).sum()


@pytest.mark.parametrize("law", ["sign(P)*sqrt(abs(P)/1 Pa)", "sqrt(P/1 Pa) if P > 0 Pa else -sqrt(-P/1 Pa)"])
def test_a_root_that_a_stiff_volume_carries_through_zero_is_passed(law: str, tmp_path: Path) -> None:
    """A flow a t: V = B t^2 with 2 B = a - k sqrt(B/c) behind zero, and -B t^2 before it, with 2 B = k sqrt(B/c) - a."""
    a, k, c = 2e-4, 1e-7, 1e-12
    before, behind = (float(min(np.roots([2, side * k / c**0.5, -side * a]).real, key=abs)) ** 2 for side in (-1, 1))
    exported(
        f"""model Volume {{
          Sf pump : Q = {a} [m^3/s^2]*(time - 0.5 s)
          C volume : P = V/{c} [m^3/Pa] {{ start V = {-before / 4!r} [m^3] }}
          R o : Q = {k} [m^3/s]*({law})
          0 n : hydraulic
          pump -> n
          n -> volume, o
          output V = volume.V
        }}""",
        tmp_path,
    )
    found = run(tmp_path, "CoSimulation", stop_time=1.0, output_interval=0.1, output=["V"])
    late = found["time"] - 0.5
    np.testing.assert_allclose(found["V"], np.where(late > 0, behind, -before) * late**2, rtol=0, atol=1e-6 * behind)


def test_description_of_what_events_change(tmp_path: Path) -> None:
    found = exported(SERVO, tmp_path)
    by_name = {v.name: v for v in found.modelVariables}
    assert [by_name[n].variability for n in ("phi", "u", "volt")] == ["continuous", "discrete", "discrete"]
    assert [by_name[n].variability for n in ("target", "period")] == ["tunable", "tunable"]
    assert (by_name["volt"].causality, by_name["volt"].initial, by_name["volt"].start) == ("local", "exact", "0.0")
    assert found.numberOfEventIndicators == 2  # a whole number of a state has two conditions
    reads = {u.variable.name: [v.name for v in u.dependencies] for u in found.outputs}
    assert reads == {"phi": ["angle"], "u": ["rotor.L", "angle"], "stairs": ["state.stairs"]}
    assert exported(BALL, tmp_path).numberOfEventIndicators == 2


def test_indicators_depend_on_what_their_conditions_read(tmp_path: Path) -> None:
    """Two tanks, a level watched in each, one of them against an input; a third condition reads both."""
    text = """model Tanks {
      input limit = 1
      signal a = integral((1 - a)/1 s, 0), b = integral((2 - b)/1 s, 0)
      mode n = 0
      when a > limit { n = n + 1 }
      when b > 0.5 { n = n + 1 }
      when a*b > 0.3 { n = n + 1 }
      output count = n
      experiment e { simulate 0 .. 1 s }
    }"""
    found = exported(text, tmp_path, fmi="3")
    reads = [[v.name for v in u.dependencies] for u in found.eventIndicators]
    assert reads == [["a", "limit"], ["b"], ["a", "b"]]


def test_starts_of_discrete_variables_and_parameters_of_conditions(tmp_path: Path) -> None:
    exported(HEATER, tmp_path)
    with instance(tmp_path, values={"heats": 0.0, "T_0": 294.0, "starts": 5.0}) as (unit, place):
        assert unit.getReal([place["heats"], place["n"], place["temperature"]]) == [0.0, 5.0, 294.0]
        unit.doStep(0.0, 1.0)  # 285 + 9 exp(-t/10), to 293 at 10 log(9/8)
        assert unit.getReal([place["temperature"]])[0] == pytest.approx(285 + 9 * np.exp(-0.1), rel=1e-9)
        unit.doStep(1.0, 1.0)
        assert unit.getReal([place["heats"], place["n"]]) == [1.0, 6.0]
        unit.setReal([place["high"]], [290.0])  # it is already hotter
        unit.doStep(2.0, 0.01)
        assert unit.getReal([place["heats"]]) == [0.0]


def test_events_at_the_start_in_a_chain_and_by_an_input(tmp_path: Path) -> None:
    """At the start x = 2 and a = 1, so b = 3, so a = 30: x is 2 + t from there on."""
    exported(CHAIN, tmp_path)
    for kind in KINDS:
        with instance(tmp_path, kind) as (unit, place):
            assert unit.getReal([place[n] for n in ("y", "p", "q")]) == [2.0, 30.0, 3.0]
            if kind == "CoSimulation":
                unit.doStep(0.0, 0.5)
                unit.setReal([place["u"]], [2.0])
                unit.doStep(0.5, 0.25)
                assert unit.getReal([place["y"], place["q"]]) == pytest.approx([2.75, -2.5], rel=1e-12)
            else:
                unit.setReal([place["u"]], [2.0])
                assert unit.newDiscreteStates()[:4] == (False, False, False, False)
                assert unit.getReal([place["q"]]) == [-2.0]


def test_an_event_beyond_a_communication_point_acts_unless_an_input_comes_before(tmp_path: Path) -> None:
    """x = t is to reach 1; from 0.5 on it falls, and rises again from 0.6 on: then it reaches 1 at 1.2. The step from 0.1 on passes all points before."""
    exported(
        "plain model Up { input u = 1\n mode n = 0\n signal x = integral(u, 0)\n when x > 1 { n = time }\n output y = x, at = n }",
        tmp_path,
    )
    for change, acts in ((False, 1.0), (True, 1.2)):
        with instance(tmp_path) as (unit, place):
            for k in range(1, 14):
                unit.doStep((k - 1) / 10, 0.1)
                y, at = unit.getReal([place["y"], place["at"]])
                assert y == pytest.approx(k / 10 - (0.2 if change and k > 5 else 0.0), abs=1e-12)
                assert at == (0.0 if k / 10 < acts else pytest.approx(acts, abs=1e-12)) or abs(k / 10 - acts) < 0.01
                if change and k in (5, 6):
                    unit.setReal([place["u"]], [-1.0 if k == 5 else 1.0])


# A tank behind a valve that a mode opens, a pump that a level switches on, and a store with a loss.
TANKS = """plain model Tanks {
  parameter low = 0.3, high = 0.8, r = 2
  mode fills = 1, opens = 1
  when one.q > high { fills = 0 }
  when one.q < low { fills = 1 }
  every 3.5 { opens = 1 - opens }
  Se pump : e = 6
  C one : e = q { start q = 0.5 }
  C two : e = 2*q
  R feed : e = 3*f
  R pipe : e = r*f
  R wall : e = 4*f
  1 inlet { active = fills > 0.5 }
  0 near
  1 between { active = opens > 0.5 }
  0 far
  pump -> inlet -> feed, near
  near -> one, between
  between -> pipe
  between -> far -> two, wall
  output x = one.q, y = two.q, through = pipe.f
  experiment day { simulate 0 .. 12 { points = 121 } }
}"""


VALVE = """import IdealDiode from electric
model Half {
  Se source : u = 10 V*sin(2*pi*50 Hz*time)
  R load : u = 100 ohm*i
  IdealDiode part
  source -> 1(load, part.pins)
  output u = load.u
}"""


@pytest.mark.parametrize("kind", KINDS)
def test_switched_junctions_are_modes_of_one_system(kind: str, tmp_path: Path) -> None:
    """A run changes its program seven times on the way; the unit has all four sets of equations."""
    mine = bondgraph.load(TANKS).simulate(rtol=1e-9)
    exported(TANKS, tmp_path)
    found = after_events(run(tmp_path, kind, rtol=1e-9, output_interval=0.1))
    rows = np.isin(np.round(found["time"], 9), np.round(mine.time, 9))
    for name in ("x", "y", "through"):
        assert found[name][rows] == pytest.approx(mine[name], abs=1e-6 if kind == "ModelExchange" else 1e-8)


def test_states_in_the_middle_of_events_are_brought_back_bit_by_bit(tmp_path: Path) -> None:
    """Also those of samples: both runs go on from a copy and from a file as they went on before."""
    for text, names in ((BALL, ("h", "v", "falls")), (SERVO, ("phi", "u", "stairs"))):
        (tmp_path / text[6:9]).mkdir()
        exported(text, tmp_path / text[6:9])
        with instance(tmp_path / text[6:9]) as (unit, place):
            values = [place[n] for n in names]
            unit.doStep(0.0, 0.5)
            state = unit.getFMUState()
            saved = unit.serializeFMUState(state)
            trace = [unit.doStep(0.5 + 0.1 * i, 0.1) or tuple(unit.getReal(values)) for i in range(15)]
            assert len(set(trace)) > 5
            for brought in (state, unit.deserializeFMUState(saved)):
                unit.setFMUState(brought)
                assert [unit.doStep(0.5 + 0.1 * i, 0.1) or tuple(unit.getReal(values)) for i in range(15)] == trace


def test_instances_with_events_do_not_touch_each_other(tmp_path: Path) -> None:
    exported(BALL, tmp_path)
    times = 0.1 * np.arange(1, 21)
    with instance(tmp_path, values={"e": 0.7}) as (one, place), instance(tmp_path, values={"e": 0.4}) as (two, _):
        found = []
        for time in times:
            for unit in (one, two):
                unit.doStep(time - 0.1, 0.1)
            found.append([unit.getReal([place["h"]])[0] for unit in (one, two)])
    for e, own in zip((0.7, 0.4), np.array(found).T, strict=True):
        assert np.abs(own - height(times, e, 0.1)).max() < 1e-10


def test_indicators_cross_zero_at_events_only(tmp_path: Path) -> None:
    """Where an event has left the ball at the floor, or behind it by rounding, the indicator is beyond zero, and keeps its sign while the ball rises."""
    import ctypes

    exported(BALL, tmp_path)

    def indicators() -> list[float]:
        values = (ctypes.c_double * 2)()
        unit.fmi2GetEventIndicators(unit.component, values, 2)
        return list(values)

    def put(h: float, v: float) -> None:
        values = (ctypes.c_double * 2)(v, h)
        unit.fmi2SetContinuousStates(unit.component, values, 2)

    with instance(tmp_path, "ModelExchange") as (unit, place):
        unit.newDiscreteStates()
        unit.enterContinuousTimeMode()
        for behind in (0.0, 1e-15, 1e-9):
            put(0.2, -2.0)
            before = indicators()
            put(-behind - 1e-12, -2.0)
            assert before[0] * indicators()[0] < 0
            unit.enterEventMode()
            assert unit.newDiscreteStates()[3]
            left = indicators()
            put(1e-12, 1.4)
            assert all(a * b > 0 for a, b in zip(left, indicators(), strict=True))
            assert unit.getReal([place["h"]])[0] == 1e-12
            unit.enterContinuousTimeMode()


@pytest.mark.parametrize("words", ENDLESS)
def test_events_that_do_not_end_are_errors(words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from fmpy.fmi1 import FMICallException

    exported(ENDLESS[words], tmp_path)
    for kind in KINDS[1:] if "rounding" in words else KINDS:
        with pytest.raises(FMICallException):
            run(tmp_path, kind, rtol=1e-8, stop_time=3.0, output_interval=0.1)
        assert words in capsys.readouterr().out


def test_reference_units_behave_as_documented(tmp_path: Path) -> None:
    """The others that the developers of FMI list; of the types of numbers a unit has real ones alone."""
    stair = "plain model Stair { mode count = 1\n every 1 { count = count + (1 if time > 0.5 else 0) }\n output counter = count\n experiment climb { simulate 0 .. 10; stop when count >= 10 } }"
    exported(stair, tmp_path, "climb")
    for kind in KINDS:
        found = run(tmp_path, kind, output_interval=0.2)
        assert found["time"][-1] == 9.0  # the unit ends the run
        rows = after_events(found)[:-1]
        assert (rows["counter"] == 1 + np.floor(rows["time"] + 1e-9)).all()
    exported(
        "plain model Dahlquist { parameter k = 1\n output x = integral(-k*x, 1)\n experiment decay { simulate 0 .. 10 } }",
        tmp_path,
    )
    found = run(tmp_path, "CoSimulation", start_values={"k": 0.5}, output_interval=0.1)
    assert np.abs(found["x"] - np.exp(-0.5 * found["time"])).max() < 1e-6
    exported(
        "plain model VanDerPol { parameter mu = 1\n signal x1 = integral(mu*(1 - x0^2)*x1 - x0, 0)\n output x0 = integral(x1, 2), y = x1\n experiment swing { simulate 0 .. 20 } }",
        tmp_path,
    )
    found = run(tmp_path, "CoSimulation", rtol=1e-9, output_interval=0.1)
    theirs = solve_ivp(
        lambda _, x: (x[1], (1 - x[0] ** 2) * x[1] - x[0]), (0, 20), (2, 0), "DOP853", rtol=1e-12, atol=1e-12
    )
    assert (found["x0"][-1], found["y"][-1]) == pytest.approx(tuple(theirs.y[:, -1]), abs=1e-7)
    exported(
        "plain model Feedthrough { parameter tunable = 0\n input continuous_in = 0\n output continuous_out = continuous_in + tunable }",
        tmp_path,
    )
    with instance(tmp_path, values={"tunable": 1.0, "continuous_in": 0.5}) as (unit, place):
        assert unit.getReal([place["continuous_out"]]) == [1.5]
        unit.setReal([place["continuous_in"]], [-3.0])
        assert unit.getReal([place["continuous_out"]]) == [-2.0]
        unit.doStep(0.0, 1.0)
        assert unit.getReal([place["continuous_out"]]) == [-2.0]


# Off, the junction shorts the capacitor by what the resistor has: nothing. On, no equation divides by that.
SHORTED = """model Shorted {
  parameter r = 0 ohm
  mode on = true
  Sf s : i = 1 A
  0 z : electric { active = on }
  1 x
  C c : u = q/(1 F)
  R short : u = r*i
  s -> z -> x -> c, short
  when time > 1 s { on = false }
  output u = c.u
}
"""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (BALL.replace("1 body : translation", "1 body : translation { active = falls > 0.5 }"), "`mass.p`, which may jump"),
        (TANKS.replace("active = fills > 0.5", "active = two.f > 0.1"), "`inlet`, whose condition reads what"),
        (TANKS.replace("e = r*f", "e = r*f + f^3"), "switched junctions beside"),
        (SHORTED, "`c.q`, which may jump where `z` is switched off"),
        (VALVE, "ideal valves"),
        (CHAIN.replace("when u > 1", "when u > exp(x)*x^7"), "less than a step"),
        (CHAIN.replace("when u > 1", "when u > 1 and delay(x, 1) > 3"), "delayed signals"),
    ],
)  # fmt: skip
def test_events_that_a_unit_cannot_hold_are_named(text: str, words: str) -> None:
    with pytest.raises(CompilationFailed) as failed:
        bondgraph.load(text).to_fmu("never.fmu")
    assert words in " ".join(d.sentence for d in failed.value.diagnostics)
