"""Least and greatest values of outputs between the reported instants, against closed forms."""

from math import exp, pi, sqrt
from pathlib import Path

import numpy as np
import pytest

import bondgraph
from bondgraph.compiled_scene import TARGETS
from bondgraph.results.archive import read_result

BOTH = [pytest.param(t, marks=pytest.mark.machine_code) if t == "native" else t for t in TARGETS]

RING = """model Ring {
  Se source : u = 1 V
  R r : u = 20 ohm*i
  I l : lambda = 10 mH*i
  C c : u = q/1 uF
  1 j : electric
  source -> j -> r, l, c
  output u = c.u
}"""

MIXED = """plain model Mixed {
  C fast : e = q { start q = 1 }
  C slow : e = q { start q = -1 }
  R a : f = 1e4*e
  R b : f = e
  0 n
  0 m
  n -> fast, a
  m -> slow, b
  output y = fast.q + slow.q
}"""

DUFFING = """plain model Duffing {
  I m : p = f { start p = 1 }
  C k : e = q + 2*q^3
  1 j
  j -> m, k
  output v = m.f, x = k.q, size = abs(k.q)
}"""

BALL = """plain model Ball {
  I m : p = 2*f
  C height : e = 0 { start q = 1 }
  Se weight : e = -20
  1 j
  weight -> j -> m, height
  when height.q < 0 { m.p = -0.8*m.p }
  output h = height.q, v = m.f
}"""

SWITCHED = """plain model Switched {
  mode on = false
  C c : e = q { start q = 1 }
  R r : f = e + e^3
  MSf heat : f = 40*(1 if on else 0)
  0 j
  heat -> j -> c, r
  when c.e < 0.1 { on = true }
  when c.e > 0.5 { on = false }
  output u = c.e
}"""


def extremes(text: str, to: float, **options: object) -> bondgraph.Result:
    """Run over two reported instants."""
    return bondgraph.load(text).simulate(to=to, points=2, extremes=True, **options)


@pytest.mark.parametrize("target", BOTH)
def test_overshoot_of_a_linear_circuit(target: str) -> None:
    run = extremes(RING, 0.02, target=target)
    damping, omega = 1000.0, sqrt(1e8 - 1e6)
    found = run.extremes("u")
    assert run.steps == 1
    assert found.maximum == pytest.approx(1 + exp(-damping * pi / omega), rel=1e-9)
    assert found.maximum_at == pytest.approx(pi / omega, rel=1e-4)
    assert (found.minimum, found.minimum_at) == (0.0, 0.0)


@pytest.mark.parametrize("target", BOTH)
def test_dip_between_modes_that_are_far_apart(target: str) -> None:
    found = extremes(MIXED, 5.0, target=target).extremes("y")
    at = np.log(1e4) / (1e4 - 1)
    assert found.minimum == pytest.approx(exp(-1e4 * at) - exp(-at), rel=1e-7)
    assert found.minimum_at == pytest.approx(at, rel=1e-2)
    assert found.maximum == 0.0


@pytest.mark.parametrize("solver", ["explicit", "radau", "rodas"])
@pytest.mark.parametrize("target", BOTH)
def test_amplitudes_of_a_nonlinear_oscillator(target: str, solver: str) -> None:
    run = extremes(DUFFING, 4.0, target=target, solver=solver, rtol=1e-9)
    amplitude = sqrt((sqrt(1 + 4) - 1) / 2)  # of x^2/2 + x^4/2 = 1/2
    for name, low, high in (("x", -amplitude, amplitude), ("v", -1.0, 1.0), ("size", 0.0, amplitude)):
        found = run.extremes(name)
        assert (found.minimum, found.maximum) == pytest.approx((low, high), abs=2e-8)
    assert run["v"][-1] != 0


@pytest.mark.parametrize("target", BOTH)
def test_both_sides_of_events(target: str) -> None:
    found = extremes(BALL, 1.5, target=target)
    speed = sqrt(20.0)
    v, h = found.extremes("v"), found.extremes("h")
    assert (v.minimum, v.maximum) == pytest.approx((-speed, 0.8 * speed), rel=1e-7)
    assert (v.minimum_at, v.maximum_at) == pytest.approx((2 / speed, 2 / speed), rel=1e-7)
    assert (h.minimum, h.maximum) == pytest.approx((0.0, 1.0), abs=1e-7)


@pytest.mark.parametrize("target", BOTH)
def test_thresholds_of_a_relay(target: str) -> None:
    found = extremes(SWITCHED, 3.0, target=target).extremes("u")
    assert (found.minimum, found.maximum) == pytest.approx((0.1, 1.0), abs=1e-6)


@pytest.mark.parametrize("target", BOTH)
def test_a_model_without_states(target: str) -> None:
    text = (
        "model S { Se s : u = 2 V*sin(7 [rad/s]*time)\n R r : u = 1 ohm*i + 1 [ohm/A^2]*i^3\n s -> r\n output i = r.i }"
    )
    found = extremes(text, 1.0, target=target).extremes("i")
    assert (found.minimum, found.maximum) == pytest.approx((-1.0, 1.0), rel=1e-9)
    assert found.maximum_at == pytest.approx(pi / 14, rel=1e-3)


@pytest.mark.machine_code
@pytest.mark.parametrize("name", ["slider_crank", "crank_linkage"])
def test_strokes_of_closed_linkages(name: str) -> None:
    found = bondgraph.load(f"models/{name}.bg").simulate(points=2, extremes=True).extremes("x")
    assert (found.minimum, found.maximum) == pytest.approx((0.09, 0.17), rel=1e-7)


@pytest.mark.machine_code
@pytest.mark.parametrize("name", ["rectifier", "lotka_volterra", "step_down", "rc_driven"])
def test_few_instants_find_what_many_show(name: str) -> None:
    model = bondgraph.load(f"models/{name}.bg")
    few, many = model.simulate(points=2, extremes=True), model.simulate(points=30_001)
    for output in few.names:
        found, shown = few.extremes(output), many.extremes(output)
        size = max(abs(shown.minimum), abs(shown.maximum))
        assert found.minimum <= shown.minimum + 1e-7 * size
        assert found.maximum >= shown.maximum - 1e-7 * size


@pytest.mark.machine_code
@pytest.mark.parametrize("name", ["manipulator", "duffing", "step_down"])
def test_the_search_changes_no_number(name: str) -> None:
    model = bondgraph.load(f"models/{name}.bg")
    plain, searched = model.simulate(points=11), model.simulate(points=11, extremes=True)
    assert (plain.values == searched.values).all()
    assert plain.steps == searched.steps


def test_a_run_in_two_parts_and_its_file(tmp_path: Path) -> None:
    model = bondgraph.load(DUFFING)
    whole = model.simulate(to=4.0, points=9, extremes=True)
    first = model.simulate(to=2.0, points=5, extremes=True)
    second = model.simulate(to=4.0, points=9, extremes=True, start=first)
    for name in whole.names:
        assert second.extremes(name).maximum == pytest.approx(whole.extremes(name).maximum, rel=1e-5)
    whole.to_npz(tmp_path / "r.npz")
    assert read_result(tmp_path / "r.npz").searched == whole.searched
    assert not model.simulate(to=4.0, points=9, start=first).searched


def test_what_is_told() -> None:
    model = bondgraph.load(RING)
    shown, searched = model.simulate(to=0.02, points=3), model.simulate(to=0.02, points=3, extremes=True)
    assert "minimum and maximum are those of the 3 reported instants" in shown.summary()
    assert "reported instants" not in searched.summary()
    assert f"{1 + exp(-1000 * pi / sqrt(99e6)):.6g}" in searched.summary()
    told = searched.to_json()
    assert told["extremes"] == "solution"
    assert told["outputs"]["u"]["maximum"] == searched.extremes("u").maximum
    assert shown.to_json()["extremes"] == "reported instants"


def test_too_many_turns_are_told() -> None:
    text = "plain model T { I m : p = f { start p = 1 }\n C k : e = 1e12*q\n 1 j\n j -> m, k\n output v = m.f }"
    run = extremes(text, 1.0)
    assert run.extremes("v").maximum == 1.0
    assert run.extremes("v").minimum == pytest.approx(-1.0, rel=1e-9)
    assert any("turns too often" in note for note in run.notes)


@pytest.mark.parametrize("target", BOTH)
def test_a_model_in_which_nothing_moves(target: str) -> None:
    found = extremes(
        "model Ring { Se s : u = 5 V\n R r : u = 10 ohm*i\n s -> r\n output i = r.i }", 1.0, target=target
    ).extremes("i")
    assert (found.minimum, found.maximum) == (0.5, 0.5)


def test_a_ringing_that_has_long_decayed() -> None:
    """An instant that comes 25 to 25 000 time constants later is exact, too; what rang before is found."""
    ring = bondgraph.load(RING.replace("u = 1 V", "u = 0 V").replace("u = q/1 uF", "u = q/1 uF { start u = 1 V }"))
    omega = sqrt(1e8 - 1e6)
    for to, points in ((0.025, 2), (0.15, 3), (1.0, 11), (25.0, 2)):
        run = ring.simulate(to=to, points=points, extremes=True, solver="exponential")
        assert run.extremes("u").minimum == pytest.approx(-exp(-1000 * pi / omega), rel=1e-9)
        assert not run.notes


@pytest.mark.parametrize("law", ["f", "f + 0.1*f^3"])
def test_an_output_with_a_pole_has_no_bound(law: str, tmp_path: Path) -> None:
    """It had the value where the search ended, from 1e5 to 1e15. A peak of 1e-4 of a step and a logarithm keep theirs, or what is found of it."""
    text = f"plain model Poles {{\n  C k : e = q {{ start q = 1 }}\n  I i : p = {law}\n  1(k) -> i\n"
    text += "  output a = 1/k.q, b = 1/(time - 0.31234), c = 1/(k.q - 0.2)^2, d = 1/sqrt(abs(k.q - 0.4)), e = 1/(time - 2.5)^3\n"
    found = bondgraph.load(text + "  output peak = 1/(1e-8 + (k.q - 0.3)^2), l = log(abs(k.q))\n}\n").simulate(
        to=4, points=5, extremes=True, target="numpy"
    )
    found.to_npz(tmp_path / "r.npz")
    for result in (found, read_result(tmp_path / "r.npz")):
        ends = [result.extremes(name) for name in result.names]
        assert [e.minimum == -np.inf for e in ends] == [True, True, False, False, True, False, False]
        assert [e.maximum == np.inf for e in ends] == [True] * 5 + [False] * 2
        assert ends[1].maximum_at == pytest.approx(0.31234) and ends[5].maximum == pytest.approx(1e8)
