"""Functional mock-up units of closed mechanisms, of what rolls, and of models with nonlinear loops, against closed forms and our own run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph
from compiler.errors import CompilationFailed
from tests.exchange.unit_files import FMICallException, exported, instance, run

pytestmark = pytest.mark.machine_code
MODELS = Path(__file__).resolve().parents[2] / "models"
KINDS, VERSIONS = ("ModelExchange", "CoSimulation"), ("2", "3")
PAIR = """model Parallelogram {
  parameter long = 1 m, apart = 2 m, mass = 2 kg, begin = 3 [1/s]
  input pull: N = 0
  multibody bars : planar {
    gravity = (0, -9.81 [m/s^2])
    body left  { mass = 0.1 kg, inertia = 0.01 [kg*m^2], at = (0, long/2) }
    body right { mass = 0.1 kg, inertia = 0.01 [kg*m^2], at = (2 m, long/2) }
    body rod   { mass = mass, inertia = 1 [kg*m^2], at = (1 m, long) }
    hinge a : ground to left  { at = (0, 0), start phi.omega = -begin }
    hinge b : left to rod     { at = (0, long) }
    hinge c : rod to right    { at = (2 m, long) }
    hinge d : right to ground { at = (apart, 0) }
  }
  MSe drive : M = -long*pull
  drive -> bars.a
  output turn = bars.a.phi, omega = bars.a.omega, level = bars.rod.phi, load = bars.d.reaction.y
  experiment fall { simulate 0 .. 0.3 s }
}"""
THREE = PAIR.replace(
    "    hinge a :", "    body third { mass = 0.1 kg, inertia = 0.01 [kg*m^2], at = (1 m, long/2) }\n    hinge a :"
).replace(
    "    hinge b :",
    "    hinge e : ground to third { at = (1 m, 0) }\n    hinge f : third to rod { at = (1 m, long) }\n    hinge b :",
)
CONTROLLED = """  mode torque = 0 [N*m], loads = 0
  every 35 ms { torque = 1 [N*m]*sin(40*time/1 s) }
  when bars.rod.y < 0.95 m { loads = loads + 1 }
  MSe drive : M = -long*pull + torque - (stiff*1 [N*m*s]*bars.a.omega if bars.a.phi < -0.5 else 0 [N*m])
"""
ROLLING = """model Rolling {
  parameter slope = 0.3 rad, r = 0.2 m, m = 1 kg, g = 9.81 [m/s^2]
  multibody plane : planar {
    gravity = (g*sin(slope), -g*cos(slope))
    body hub { mass = m, inertia = m*r^2/2, at = (0, r) }
    free way : ground to hub { at = (0, r) }
    wheel rim : ground to hub { radius = r, normal = (0, 1) }
  }
  output x = plane.hub.x, turn = plane.hub.phi
  experiment go { simulate 0 .. 1 s }
}"""
LOOP = """plain model Loop {
  parameter most = 10
  input drive = 0
  MSe s : e = 1 + drive
  R a : e = f + f^3
  R b : f = e + e^3
  C c : e = q { start q = 0.25 }
  1 one
  0 node
  s -> one -> a, node
  node -> b, c
  require a.f < most
  output x = c.q, flow = a.f
  experiment go { simulate 0 .. 2 }
}"""
SPIN = """model Spin {
  multibody space : spatial {
    body top { mass = 1 kg, inertia = (1 [kg*m^2], 2 [kg*m^2], 3 [kg*m^2]) }
    free way : ground to top { start rx.omega = 3 [1/s], start ry.omega = 0.1 [1/s] }
  }
  output x = space.top.attitude.x
  experiment go { simulate 0 .. 3 s }
}"""


def fallen(found: Any) -> np.ndarray:
    """Energy of the parallelogram, which begins upright with 3 rad/s: 0 along its motion."""
    inertia = 2 * (0.01 + 0.1 * 0.25) + 2.0
    potential = (2 * 0.1 * 0.5 + 2.0) * 9.81 * (np.cos(found["turn"]) - 1)
    return 0.5 * inertia * (found["omega"] ** 2 - 9.0) + potential


@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_closed_mechanism_keeps_its_energy_and_its_loop(fmi: str, tmp_path: Path) -> None:
    exported(PAIR, tmp_path, fmi=fmi)
    own = bondgraph.load(PAIR).simulate(rtol=1e-9)
    for kind in KINDS:
        found = run(tmp_path, kind, rtol=1e-9, output_interval=0.03)
        assert np.abs(fallen(found)).max() < 2e-5
        assert np.abs(found["level"]).max() < 1e-13 and np.ptp(found["turn"]) > 1
        for name in ("turn", "load"):
            values = np.asarray(own[name])[:: len(own.time) // 10]
            assert np.abs(found[name] - values).max() < 1e-5 * np.abs(values).max()


def test_a_singular_pose_ends_co_simulation_and_steps_of_others_pass_it(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The flat parallelogram may go on as one or as an antiparallelogram."""
    exported(PAIR, tmp_path)
    with pytest.raises(FMICallException):
        run(tmp_path, "CoSimulation", stop_time=1.0, output_interval=0.01)
    assert "singular pose" in "".join(capfd.readouterr())
    passed = run(tmp_path, "ModelExchange", rtol=1e-7, stop_time=1.0, output_interval=0.1)  # as our own run
    assert np.abs(fallen(passed)).max() < 1e-3 and np.abs(passed["level"]).max() < 1e-13 and passed["turn"][-1] < -5


def test_starts_and_parameters_that_open_a_loop_are_refused(tmp_path: Path) -> None:
    exported(PAIR, tmp_path)
    for values in ({"bars.a.phi": 0.1}, {"begin": 2.0}):
        with pytest.raises(FMICallException), instance(tmp_path, values=values):
            pass
    turned = {"bars.a.phi": -0.1, "bars.b.phi": 0.1, "bars.d.phi": 0.1, "bars.a.phi.omega": 0.0, "bars.b.phi.omega": 0.0, "bars.d.phi.omega": 0.0}  # fmt: skip
    with instance(tmp_path) as (unit, place):
        turned = {name: value for name, value in turned.items() if name in place}
    with instance(tmp_path, values=turned | {"mass": 3.0}) as (unit, place):
        unit.doStep(0.0, 0.1)
        assert unit.getReal([place["level"]])[0] == pytest.approx(0.0, abs=1e-14)
        unit.setReal([place["apart"]], [2.1])
        with pytest.raises(FMICallException):
            unit.doStep(0.1, 0.1)


def test_a_constraint_that_followed_from_the_others_must_go_on_to_do_so(tmp_path: Path) -> None:
    """Of three cranks the middle one stands below its pin, where the one row of it that takes part is closed, too."""
    exported(THREE, tmp_path)
    turned = {"bars.a.phi": -0.5, "bars.b.phi": 0.5, "bars.d.phi": 0.5, "bars.e.phi": -0.5}
    turned |= {f"{name}.omega": 0.0 for name in turned}
    with instance(tmp_path, values=turned) as (unit, _):
        unit.doStep(0.0, 0.1)
    with pytest.raises(FMICallException), instance(tmp_path, values=turned | {"bars.e.phi": 0.5 - np.pi}):
        pass


@pytest.mark.parametrize(("text", "fmi"), [(PAIR, "3"), (THREE, "2"), (LOOP, "2"), (LOOP, "3"), (SPIN, "2")])
def test_slopes_lead_through_constraints_and_loops(text: str, fmi: str, tmp_path: Path) -> None:
    description = exported(text, tmp_path, fmi=fmi)
    states = [v.derivative for v in description.modelVariables if v.derivative is not None]
    with instance(tmp_path, "CoSimulation") as (unit, place):
        unit.doStep(0.0, 0.2)
        point = unit.getReal([place[v.name] for v in states])
    with instance(tmp_path, "ModelExchange") as (unit, place):
        unit.enterContinuousTimeMode()
        unit.setTime(0.2)
        columns = [place[v.name] for v in [*states, *(v for v in description.modelVariables if v.causality == "input")]]
        rows = [place[u.variable.name] for u in [*description.derivatives, *description.outputs]]
        at = [*point, *([0.3] * (len(columns) - len(states)))]

        def values(x: Any) -> np.ndarray:
            unit.setReal(columns, list(x))
            return np.array(unit.getReal(rows))

        for column in range(len(at)):
            step = 1e-5 * (np.arange(len(at)) == column)
            difference = (values(at + step) - values(at - step)) / 2e-5
            values(at)
            along = np.array(unit.getDirectionalDerivative(rows, [columns[column]], [1.0]))
            assert along == pytest.approx(difference, rel=1e-6, abs=1e-7 * np.abs(difference).max() + 1e-9)
            if fmi == "3":
                sums = unit.getAdjointDerivative(rows, [columns[column]], list(range(len(rows))), 1)
                assert sums[0] == pytest.approx(along @ np.arange(len(rows)), rel=1e-12, abs=1e-12)


def test_states_of_closed_mechanisms_and_loops_are_brought_back_bit_by_bit(tmp_path: Path) -> None:
    for text, name in ((PAIR, "load"), (LOOP, "flow")):
        (folder := tmp_path / name).mkdir()
        exported(text, folder, fmi="3")
        with instance(folder) as (unit, place):
            unit.doStep(0.0, 0.1)
            state = unit.getFMUState()
            saved = unit.serializeFMUState(state)
            unit.doStep(0.1, 0.05)
            wanted = unit.getReal([place[name]])
            for other in (state, unit.deserializeFMUState(saved)):
                unit.setFMUState(other)
                unit.doStep(0.1, 0.05)
                assert unit.getReal([place[name]]) == wanted
                unit.freeFMUState(other)


@pytest.mark.parametrize("kind", KINDS)
def test_a_wheel_rolls_down(kind: str, tmp_path: Path) -> None:
    """By 2/3 g sin(slope) along it, without slip."""
    exported(ROLLING, tmp_path)
    found = run(tmp_path, kind, rtol=1e-8)
    assert found["x"] == pytest.approx(9.81 * np.sin(0.3) / 3 * found["time"] ** 2, rel=1e-6, abs=1e-7)
    assert found["turn"] == pytest.approx(-found["x"] / 0.2, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_loop_is_solved_in_the_unit(fmi: str, tmp_path: Path) -> None:
    """In a closed form at the end: what rests solves f + f^3 + e = 1.5 with f = e + e^3."""
    exported(LOOP, tmp_path, fmi=fmi)
    for kind in KINDS:
        found = run(tmp_path, kind, start_values={"drive": 0.5}, stop_time=20.0, rtol=1e-8)
        x, flow = found["x"], found["flow"]
        assert flow + flow**3 + x == pytest.approx(np.full(len(x), 1.5), rel=1e-12)
        assert flow[-1] == pytest.approx(x[-1] + x[-1] ** 3, rel=1e-6)


def test_limits_of_what_unknowns_decide_are_told(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    exported(LOOP, tmp_path)
    run(tmp_path, "CoSimulation", start_values={"most": 0.5})
    assert "requirement" in "".join(capfd.readouterr())


def test_events_switch_what_drives_a_closed_mechanism(tmp_path: Path) -> None:
    """A sampled controller, a brake that holds from an angle on, and a condition on where the rod is."""
    text = PAIR.replace("  MSe drive : M = -long*pull", CONTROLLED).replace("output turn", "output lower = loads, turn").replace("apart = 2 m", "apart = 2 m, stiff = 40")  # fmt: skip
    exported(text, tmp_path, fmi="3")
    own = bondgraph.load(text).simulate(rtol=1e-9)
    assert own["lower"][-1] == 1
    for kind in KINDS:
        found = run(tmp_path, kind, rtol=1e-9, output_interval=0.03)
        same = np.flatnonzero(np.abs(found["time"] / 0.03 - np.round(found["time"] / 0.03)) < 1e-9)
        places = np.round(found["time"][same] / 0.0006).astype(int)
        for name in ("turn", "omega"):
            values = np.asarray(own[name])[places]
            assert len(same) > 10 and np.abs(found[name][same] - values).max() < 2e-6 * np.abs(values).max()
        assert found["load"][-1] == pytest.approx(own["load"][-1], rel=2e-6)
        assert found["lower"][-1] == own["lower"][-1]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (LOOP.replace("  require", "  when c.q > 0.3 { c.q = 0.25 }\n  require"), "beside events"),
        (
            LOOP.replace("C c : e = q { start q = 0.25 }", "R c : f = 2*e").replace("x = c.q", "x = c.e"),
            "without states",
        ),
    ],
)
def test_what_is_still_refused_is_named(text: str, words: str) -> None:
    with pytest.raises(CompilationFailed) as failed:
        bondgraph.load(text).to_fmu("never.fmu")
    assert {d.code for d in failed.value.diagnostics} == {"BG606"}
    assert words in failed.value.diagnostics[0].sentence


# Models of the gallery, and the tolerance of their unit.
GALLERY = dict.fromkeys((
    "coin", "crank_linkage", "four_bar", "six_axes", "rough_pipe", "published/andrews", "published/heavy_top_terze", "published/transistor_amplifier",
    "published/whipple", "thesis/stacked",
), 1e-6) | {"spatial_slider_crank": 1e-8}  # fmt: skip


@pytest.mark.few(0)
@pytest.mark.parametrize("fmi", VERSIONS)
@pytest.mark.parametrize("name", GALLERY)
def test_units_of_the_gallery_give_the_run(name: str, fmi: str, tmp_path: Path) -> None:
    """Co-simulation within 10 tolerances of a run with a far tighter one."""
    model = bondgraph.load(MODELS / f"{name}.bg")
    experiment = next(iter(model.experiments))
    own = model.simulate(experiment, rtol=1e-3 * GALLERY[name])
    exported(MODELS / f"{name}.bg", tmp_path, experiment, fmi)
    stride = 5 if len(own.time) > 100 else 1
    step = stride * (own.time[-1] - own.time[0]) / (len(own.time) - 1)
    found = run(tmp_path, "CoSimulation", rtol=GALLERY[name], output_interval=step, stop_time=float(own.time[-1]))
    for output in found.dtype.names[1:]:
        values = np.asarray(own[output])[::stride]
        assert np.abs(found[output] - values).max() < 10 * GALLERY[name] * np.abs(values).max()
