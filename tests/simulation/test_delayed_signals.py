"""Delayed signals that steps of the solver do not see: fast sources, bends, conditions on states; and their values before the run."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed

SOLVERS = ["explicit", "radau13"]


@pytest.mark.parametrize(("solver", "rtol"), [("explicit", 1e-8), ("radau", 1e-6), ("radau13", 1e-4)])
def test_a_fast_source_is_delayed_beside_a_slow_state(solver: str, rtol: float) -> None:
    """x is slow until the first delay has passed: its steps are longer than the period of the source."""
    text = """plain model Late {
      signal x = integral(delay(sin(50*time), 1) - x, 1)
      output a = delay(sin(50*time), 1), b = x
    }"""
    found = bondgraph.load(text).simulate(to=2, points=5, solver=solver, rtol=rtol)
    t = np.maximum(found.time - 1, 0)
    driven = (np.sin(50 * t) - 50 * np.cos(50 * t) + 50 * np.exp(-t)) / (1 + 50**2)
    np.testing.assert_allclose(found["a"], np.sin(50 * t), rtol=0, atol=10 * rtol)
    np.testing.assert_allclose(found["b"], np.exp(-found.time) + driven, rtol=0, atol=10 * rtol)


@pytest.mark.parametrize("solver", SOLVERS)
def test_no_step_runs_over_a_delayed_pulse(solver: str) -> None:
    text = """plain model Pulse {
      signal x = integral(delay(exp(-((time - 1.0003)/1e-3)^2), 0.3), 0)
      output a = x
    }"""
    found = bondgraph.load(text).simulate(to=3, points=4, solver=solver, rtol=1e-8)
    np.testing.assert_allclose(found["a"], [0, 0, 1e-3 * math.sqrt(math.pi), 1e-3 * math.sqrt(math.pi)], rtol=1e-5)


def test_a_wave_in_a_line_without_losses_keeps_its_bends() -> None:
    """Joukowsky's pressure Z Q of a valve that shuts, reflected at a tank: P(t) = 2 P_0 - P(t - 2 l/c) + Z (Q(t - 2 l/c) - Q(t)).

    At the start the flow is given at one end and the pressure at the other, so iterations go to and fro between two pressures.
    """
    text = """import WaveLine from hydraulic
    model Hammer {
      Se tank  : P = 5 bar
      WaveLine line { length = 100 m, diameter = 20 mm, rho = 1000 [kg/m^3], bulk = 2 GPa }
      Sf valve : Q = 0.2 [L/s]*ramp(time, 0.2 s, 0.21 s)
      0 end : hydraulic
      tank -> line.a
      line.b -> end -> valve
      output P = end.P
      experiment go { simulate 0 .. 0.6 s { points = 61 } }
    }"""
    c, area = math.sqrt(2e9 / 1000), math.pi * 0.02**2 / 4
    impedance, back = 1000 * c / area, 200 / c

    def flow(t: float) -> float:
        return 2e-4 * min(max((t - 0.2) / 0.01, 0), 1)

    def pressure(t: float) -> float:
        return 5e5 if t < 0.2 else 1e6 - pressure(t - back) + impedance * (flow(t - back) - flow(t))

    found = bondgraph.load(text).simulate()
    np.testing.assert_allclose(found["P"], [pressure(t) for t in found.time], rtol=0, atol=1e-6 * impedance * 2e-4)


def test_a_wave_that_is_rounding_needs_no_polynomials() -> None:
    """Nothing comes back from a load that is matched but for 1e-9: the wave from there is a difference of voltages, and their rounding has no end."""
    text = """import TransmissionLine from electric
    model Line {
      Se source : u = 10 V*ramp(time, 1 ns, 1.5 ns) + 1 V*sin(2*pi*700 MHz*time)*step(time - 20 ns)
      R inner, load : u = 50 ohm*i
      R leak : i = 1e-11 [S]*u
      TransmissionLine line { Z = 50 ohm, tau = 5 ns }
      1 first : electric
      0 end : electric
      source -> first -> inner, line.a
      line.b -> end -> load, leak
      output u = end.u
      experiment go { simulate 0 .. 40 ns { points = 81, rtol = 1e-9 } }
    }"""

    def sent(t: float) -> float:
        wave = math.sin(2 * math.pi * 7e8 * t) if t > 20e-9 else 0.0
        return (10 * min(max((t - 1e-9) / 0.5e-9, 0), 1) + wave) / 2

    found = bondgraph.load(text).simulate()
    np.testing.assert_allclose(found["u"], [sent(t - 5e-9) for t in found.time], rtol=0, atol=2e-8)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_condition_on_a_state_is_delayed(solver: str) -> None:
    """sin(t) is above 1/2 from pi/6 to 5 pi/6, and the delayed condition 0.3 later; no rate reads it within a step."""
    text = """plain model Seen {
      signal x = integral(cos(time), 0)
      signal z = integral(delay(1 if x > 0.5 else 0, 0.3), 0)
      output above = z, stair = delay(floor(4*x), 0.3)
    }"""
    found = bondgraph.load(text).simulate(to=4, points=401, solver=solver, rtol=1e-8)
    t = found.time - 0.3
    above = np.clip(t, math.pi / 6, 5 * math.pi / 6) - math.pi / 6
    np.testing.assert_allclose(found["above"], above, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(found["stair"], np.floor(4 * np.sin(np.maximum(t, 0))))


@pytest.mark.parametrize("gain", [-1.0, -0.999, 0.9999, 0.5])
def test_before_the_run_a_signal_is_what_it_is_at_the_start(gain: float) -> None:
    text = f"plain model Loop {{ signal y = 10 + ({gain})*delay(y, 1); output a = y }}"
    found = bondgraph.load(text).simulate(to=4, points=9)
    np.testing.assert_allclose(found["a"], 10 / (1 - gain), rtol=1e-9)


@pytest.mark.parametrize("gain", [1.0, -2.0, 3.0])
def test_what_grows_before_the_run_is_refused(gain: float) -> None:
    text = f"plain model Loop {{ signal y = 10 + ({gain})*delay(y, 1); output a = y }}"
    with pytest.raises(RunFailed, match="do not settle on each other"):
        bondgraph.load(text).simulate(to=4)


def test_what_moves_after_a_dead_time_does_not_grow_without_bound() -> None:
    """A look ahead sees nothing of it, so its magnitude is what another signal of its unit lends it, which says nothing of growth."""
    text = "model Late {\n  signal y = integral((step(time - 0.1 s) - y)/0.01 s, 0)\n  signal z = integral((20*delay(y, 2 s) - z)/1 s, 0)\n  output last = z\n}\n"
    found = bondgraph.load(text).simulate(to="20 s", points=3)
    begins, share = 2.1, 0.01 / (1 - 0.01)  # after both lags, 20 (1 - (e^-t/1 - 0.01 e^-t/0.01)/0.99)
    assert found["last"][1] == pytest.approx(20 * (1 - (1 + share) * np.exp(-(10 - begins))), rel=1e-6)
    assert found.notes == ()


@pytest.mark.machine_code
def test_machine_code_that_was_asked_for_by_name_and_is_not_there_is_missed_aloud() -> None:
    """What is delayed is filled in by Python: the run is right, and says that it was made in numpy."""
    text = "plain model D { signal x = integral(-delay(x, 1), 1)\n output y = x }"
    found = bondgraph.load(text).simulate(to=1.0, target="native")
    assert float(found["y"][-1]) == pytest.approx(0.0, abs=1e-9)
    assert "there is no machine code of this model" in " ".join(found.notes)
    assert not bondgraph.load(text).simulate(to=1.0).notes
    plain = bondgraph.load(text.replace("delay(x, 1)", "x")).simulate(to=1.0, target="native")
    assert not plain.notes and plain.final("y") == pytest.approx(math.exp(-1), rel=1e-5)


def test_a_condition_is_delayed_as_one() -> None:
    """A charge falls below 1/2 at ln 2; then it is filled by a source that is on from 0.2 s later, until the mode that an event sets 0.1 s after that."""
    text = """plain model Truth {
      mode done = false
      C c : q = e { start e = 1 }
      R r : e = f
      MSf s : f = 1 if delay(low, 0.2) and not done else 0
      0 n
      n -> c, r
      s -> n
      signal low = c.e < 0.5
      when delay(delay(c.e < 0.5, 0.1), 0.2) { done = true }
      output a = c.e, b = delay(low, 0.2)
    }"""
    found = bondgraph.load(text).simulate(to=2, points=41, rtol=1e-8)
    on, off, t = math.log(2) + 0.2, math.log(2) + 0.3, found.time
    first, last = math.exp(-on), 1 - (1 - math.exp(-on)) * math.exp(on - off)
    filled = np.where(t < off, 1 - (1 - first) * np.exp(on - t), last * np.exp(off - t))
    np.testing.assert_allclose(found["a"], np.where(t < on, np.exp(-t), filled), atol=1e-7)
    np.testing.assert_array_equal(found["b"], t > on)


@pytest.mark.parametrize("scale", ["1", "1e9", "1e-9"])
@pytest.mark.parametrize("value", ["x/3 + x/7 - x*(10/21)", "(x + 1) - x - 1", "sin(x)^2 + cos(x)^2 - 1"])
def test_a_delayed_value_may_be_nothing_but_rounding(value: str, scale: str) -> None:
    text = (
        f"plain model D {{\n  signal x = integral(1 - x, 0.2)\n  output y = delay({scale}*({value}), 0.1), z = x\n}}\n"
    )
    found = bondgraph.load(text).simulate(to=1, points=11)
    assert found.steps < 60 and np.abs(found["y"]).max() < 1e-15 * float(scale)
    assert found["z"] == pytest.approx(1 - 0.8 * np.exp(-found.time), rel=1e-6)
