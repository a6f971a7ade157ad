"""Events of runs against closed forms: their instants to ten times the relative tolerance, and how many there are."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import islice

import numpy as np
import pytest
from scipy.optimize import brentq

import bondgraph
from bondgraph.errors import RunFailed
from bondgraph.results.result import Result
from bondgraph.simulation.integrators.compiled.pilot_run import CompiledPilotRun
from tests.compiling import compiled

RTOL = 1e-8


def run(text: str, to: float, rtol: float = RTOL, points: int = 501, energy: bool = False) -> Result:
    return bondgraph.load(text).simulate(to=to, rtol=rtol, points=points, energy=energy)


def agree(result: Result, expected: Iterator[float], stop: float) -> None:
    """The instants are those expected, none is missing, none too many."""
    found = [e.time for e in result.events]
    exact = [t for t in islice(expected, len(found) + 1) if t <= stop]
    assert len(found) == len(exact)
    np.testing.assert_allclose(found, exact, rtol=10 * result.rtol, atol=10 * result.rtol)


# ---------------------------------------------------------------------- the bouncing ball of the language

BALL = """
model BouncingBall {
  parameter m = 0.1 kg, bounce = 0.8, h = 1 m
  1  ball    { active = not resting }
  I  mass    : p = m*v
  Se weight  : F = -m*9.81 [m/s^2]
  weight -> ball -> mass
  output height = integral(ball.v, h), v = ball.v
  mode resting = false
  when height < 0 m {
    mass.v  = -bounce*mass.v
    resting = abs(mass.v) < 1 [mm/s]
  }
}
"""


def bounces() -> Iterator[float]:
    speed, time = math.sqrt(2 * 9.81), math.sqrt(2 / 9.81)
    while True:
        yield time
        if speed < 1e-3:
            return
        speed *= 0.8
        time += 2 * speed / 9.81


@pytest.mark.machine_code
def test_the_pilot_run_to_the_first_event_is_one_call(monkeypatch: pytest.MonkeyPatch) -> None:
    """Machine code observes the conditions, too: Python asks for the steps of each part of the run at once, and for its last one (it made 650)."""
    calls = []
    go = CompiledPilotRun.go
    monkeypatch.setattr(CompiledPilotRun, "go", lambda steps, *given: calls.append(given) or go(steps, *given))
    assert len(run(BALL, 2).events) == 3
    assert len(calls) <= 12


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-9])
def test_bouncing_ball_to_rest(rtol: float) -> None:
    found = run(BALL, 6, rtol)
    agree(found, bounces(), 6)
    assert found.final("v") == 0
    assert abs(found.final("height")) < 10 * rtol
    assert len(found.notes) == 1 and "`mass.p`" in found.notes[0]  # what is left of its momentum goes into the ground


def test_a_ball_that_never_rests_is_told() -> None:
    with pytest.raises(RunFailed, match=r"at t = 4\.0637\d* s `when height < 0 m` \(text:10\) act again and again"):
        run(BALL.replace("{ active = not resting }", ""), 10)


# ---------------------------------------------------------------------- conditions in laws

CORNER = "model A {{\n signal x = integral({rate}, 0 m)\n output y = x\n}}\n"


def test_no_step_runs_across_a_jump() -> None:
    """x' jumps from 1 to 3 at x = 1: a step across would err by its own length."""
    found = run(CORNER.format(rate="1 [m/s] if x < 1 m else 3 [m/s]"), 2)
    np.testing.assert_allclose(found["y"], np.where(found.time < 1, found.time, 3 * found.time - 2), rtol=1e-12)
    assert found.steps < 40


def test_a_jump_in_an_output_alone_is_no_event() -> None:
    plain = run(CORNER.format(rate="1 [m/s] - x/(1 s)"), 2)
    text = CORNER.format(rate="1 [m/s] - x/(1 s)").replace("y = x", "y = x, high = x > 0.5 m, sharp = sign(x - 0.5 m)")
    assert compiled(text).program.hybrid is None
    found = run(text, 2)
    assert found.steps == plain.steps and (found["y"] == plain["y"]).all()
    np.testing.assert_array_equal(found["high"], found["y"] > 0.5)


def test_without_events_nothing_is_generated() -> None:
    program = compiled(
        "model A {\n C c : q = 1 [F]*u { start u = 1 V }\n R r : u = 1 [ohm]*abs(i)\n 1 j\n j -> c, r\n}\n"
    ).program
    assert program.hybrid is None
    assert "roots" not in program.source and "mode_at" not in program.source


def test_a_stage_of_two_corners_at_one_instant() -> None:
    rate = "(1 [m/s] if x < 1 m else 2 [m/s]) + (0 [m/s] if 2*x < 2 m else 1 [m/s])"
    found = run(CORNER.format(rate=rate), 2)
    np.testing.assert_allclose(found["y"], np.where(found.time < 1, found.time, 3 * found.time - 2), rtol=1e-12)


RUBBED = """model A {{
  I m : p = 1 kg*v {{ start v = 1 [m/s] }}
  R rub : F = 2 N*sign(v)
  Se push : F = {push} N
  1 b
  push -> b -> m, rub
  output v = b.v
}}
"""


def test_friction_that_slides_along_zero_is_told() -> None:
    """Held by less than it could hold: neither sign nor zero is the friction that it takes."""
    with pytest.raises(
        RunFailed, match=r"at t = 0\.666666667 s the condition in `rub` \(text:3\) cannot hold and cannot fail"
    ):
        run(RUBBED.format(push=0.5), 2)
    assert run(RUBBED.format(push=0.5), 0.4).final("v") == pytest.approx(0.4, rel=1e-12)


def test_friction_alone_ends_at_rest() -> None:
    found = run(RUBBED.format(push=0), 2)
    np.testing.assert_allclose(found["v"], np.maximum(1 - 2 * found.time, 0.0), atol=1e-9)


def test_a_touch_between_two_steps_is_seen() -> None:
    """x = 1 - (t - 1)^2/... touches 0.999 for a short while: the condition holds for 0.063 s of 40 s."""
    text = """model A {
  signal v = integral(2 [m/s^2] - 2 [m/s^2]*time/(10 s), 0 [m/s])
  signal x = integral(v, 0 m)
  mode count = 0
  when v > 9.9999 [m/s] { count = count + 1 }
  output c = count, y = x
}"""
    found = run(text, 40)
    assert found.final("c") == 1
    # v = 2 t - t^2/10 = 10 - (t - 10)^2/10
    agree(found, iter([10 - math.sqrt(1e-3)]), 40)


# ---------------------------------------------------------------------- when and mode

RELAY = """model Relay {
  parameter rate = 1 [1/s]
  mode up = true
  signal x = integral(rate if up else -rate, 0)
  when x > 1  { up = false }
  when x < -1 { up = true }
  output y = x, turned = not up
}"""


def test_relay_with_hysteresis() -> None:
    found = run(RELAY, 20)
    agree(found, (1.0 + 2 * i for i in range(99)), 20)
    triangle = np.abs((found.time + 1) % 4 - 2) * -1 + 1
    np.testing.assert_allclose(found["y"], triangle, atol=1e-10)


def test_thermostat() -> None:
    text = """model Thermostat {
  parameter C = 1000 [J/K], G = 2 [W/K], P = 100 W, T_env: K = 280
  mode heating = false
  signal T = integral(((P if heating else 0 W) - G*(T - T_env))/C, T_env)
  when T < 293 K { heating = true }
  when T > 295 K { heating = false }
  output temperature = T
}"""

    def instants() -> Iterator[float]:
        yield 0.0  # what is true at the start becomes true there
        time = 500 * math.log(50 / 35)
        while True:
            yield time
            time += 500 * math.log(15 / 13)
            yield time
            time += 500 * math.log(37 / 35)

    agree(run(text, 3000), instants(), 3000)


def test_stick_slip() -> None:
    """A mass on a belt: sticks until the spring pulls with F_s, slides with F_d."""
    text = """model StickSlip {
  parameter m = 1 kg, k = 1 [N/m], F_s = 1 N, F_d = 0.5 N
  mode sticks = true
  Sf belt     : v = 0.1 [m/s]
  1 drive, body
  0 point     : translation
  1 contact   : translation { active = not sticks }
  C spring    : F = k*x
  I mass      : p = m*v
  Se friction : F = -F_d
  belt -> drive -> 0(1(spring)) -> body -> mass, point
  point -> contact
  friction -> contact
  when sticks and point.F > F_s { sticks = false }
  when not sticks and contact.v < 0 [m/s] { sticks = true }
  output x = spring.x, v = body.v
}"""
    slide = 2 * (math.pi - math.atan(5))

    def instants() -> Iterator[float]:
        time = 0.0
        while True:
            time += 10
            yield time
            time += slide
            yield time

    found = run(text, 200)
    agree(found, instants(), 200)
    cycle = found.time % (10 + slide)
    sliding = cycle > 10
    exact = 0.5 + 0.5 * np.cos(cycle - 10) + 0.1 * np.sin(cycle - 10)
    np.testing.assert_allclose(found["x"], np.where(sliding, exact, 0.1 * cycle), atol=1e-6)
    assert not found["v"][~sliding].any()


def test_an_event_of_time_is_exact_and_reads_what_was_before() -> None:
    text = """model A {
  mode a = 1, b = 2
  signal x = integral(1 [1/s], 0)
  when time > 0.3 s { a = b; b = a; x = x + 1 }
  output y = x, both = 10*a + b
}"""
    found = run(text, 1, points=11)
    assert [e.time for e in found.events] == [0.3]
    np.testing.assert_array_equal(found["both"], np.where(found.time < 0.3, 12.0, 21.0))
    np.testing.assert_allclose(found["y"], found.time + (found.time >= 0.3), rtol=1e-14)


def test_events_that_cause_each_other_in_turn() -> None:
    text = """model A {
  mode a = 0, b = 0
  signal x = integral(1 [1/s], 0)
  when x > 1 { a = 1 }
  when a > 0 { b = a + 1; x = 10 }
  when b > 1 { a = a + 5 }
  output y = a + b, z = x
}"""
    found = run(text, 2)
    assert found.final("y") == 8
    assert found.final("z") == pytest.approx(11, rel=1e-9)
    assert [e.condition for e in found.events] == ["x > 1", "a > 0", "b > 1"]


@pytest.mark.parametrize(
    ("events", "told"),
    [
        ("when x > 1 { a = 1 }\n  when 2*x > 2 { a = 2 }", r"`when x > 1` \(text:4\) and `when 2\*x > 2` \(text:5\) set `a` at one instant"),
        ("when x > 1 or a == 2 { a = 1 }\n  when a == 1 { a = 2 }\n  when a == 2 { a = 3 }\n  when a == 3 { a = 1 }", "cause each other without end"),
        ("when x > 1 { a = 1/(x - x) }", r"the new value of `a` \(text:4\) is not finite"),
    ],
)  # fmt: skip
def test_what_has_no_meaning_is_told_with_its_instant(events: str, told: str) -> None:
    text = f"model A {{\n  mode a = 0\n  signal x = integral(1 [1/s], 0)\n  {events}\n  output y = x + a\n}}\n"
    with pytest.raises(RunFailed, match=told) as failed:
        run(text, 2)
    assert "at t = 1 s" in str(failed.value)


def test_a_dependent_storage_takes_the_others_along() -> None:
    """Two masses on one shaft of a gear: one is computed from the other, and may be set as well."""
    text = """model A {
  I one : L = 2 [kg*m^2]*omega { start omega = 1 [rad/s] }
  I two : L = 3 [kg*m^2]*omega
  TF gear : omega2 = 2*omega1
  1 a, b
  a -> one
  a -> gear -> b -> two
  when time > 1 s { two.omega = 6 [rad/s] }
  output w1 = a.omega, w2 = b.omega
}"""
    found = run(text, 2, points=5)
    np.testing.assert_allclose(found["w1"], [1, 1, 3, 3, 3], rtol=1e-9)
    np.testing.assert_allclose(found["w2"], [2, 2, 6, 6, 6], rtol=1e-9)


# ---------------------------------------------------------------------- switched junctions


def test_rectifier_with_an_ideal_diode() -> None:
    text = """import IdealDiode from electric
model Rectifier {
  parameter U = 10 V, f = 50 Hz, R = 100 ohm, C = 1 mF
  Se source : u = U*sin(2*pi*f*time)
  0 anode, cathode
  IdealDiode diode
  C buffer : q = C*u
  R load : u = R*i
  source -> anode -> 1(diode.pins) -> cathode -> buffer, load
  output u = cathode.u, i = diode.current
}"""
    w, rc = 100 * math.pi, 0.1
    off = (math.pi - math.atan(w * rc)) / w  # where C u' + u/R vanishes
    period = 0.02

    def decayed(t: float, start: float) -> float:
        return math.sin(w * start) * math.exp(-(t - start) / rc)

    def instants() -> Iterator[float]:
        yield 0.0
        start = off
        while True:
            yield start
            low = math.floor(start / period) * period + period
            yield brentq(lambda t, s=start: math.sin(w * t) - decayed(t, s), low, low + period / 4, xtol=1e-15)
            start += period

    found = run(text, 0.2, points=2001)
    agree(found, instants(), 0.2)
    last = (np.floor((found.time - off) / period)) * period + off
    free = 10 * np.sin(w * last) * np.exp(-(found.time - last) / rc)
    exact = np.where(found.time < off, 10 * np.sin(w * found.time), np.maximum(free, 10 * np.sin(w * found.time)))
    np.testing.assert_allclose(found["u"], exact, atol=1e-6)


def test_charge_is_shared_and_kept() -> None:
    text = """import Switch from electric
model Two {
  C one : q = 1 mF*u { start u = 10 V }
  C two : q = 3 mF*u { start u = 2 V }
  R drain : u = 1 kohm*i
  0 a, b
  Switch s { closed = 1 if time > 1 s else 0 }
  a -> one
  a -> 1(s.pins) -> b
  b -> two, drain
  output u1 = a.u, u2 = b.u, charge = one.q + two.q
}"""
    found = run(text, 3, points=301)
    before = found.time < 1
    u2 = 2 * np.exp(-found.time / 3)
    common = (10 + 3 * 2 * math.exp(-1 / 3)) / 4 * np.exp(-(found.time - 1) / 4)
    np.testing.assert_allclose(found["u1"], np.where(before, 10, common), rtol=1e-9)
    np.testing.assert_allclose(found["u2"], np.where(before, u2, common), rtol=1e-9)
    assert any("`one.q`" in note for note in found.notes) and any("`two.q`" in note for note in found.notes)


def test_a_clutch_keeps_momentum_and_frees_what_it_held() -> None:
    text = """import Clutch from mechanics
model Drive {
  I fly  : L = 2 [kg*m^2]*omega { start omega = 30 [rad/s] }
  I load : L = 1 [kg*m^2]*omega
  R drag : M = 0.5 [N*m*s]*omega
  1 a, b
  Clutch c { engaged = 1 if time > 1 s and time < 2 s else 0 }
  a -> fly, c.a
  c.b -> b -> load, drag
  output w1 = a.omega, w2 = b.omega
}"""
    found = run(text, 3, points=7)
    together, alone = 20 * np.exp(-0.5 / 3 * np.array([0, 0.5, 1])), np.exp(-0.5 * np.array([0, 0.5, 1]))
    np.testing.assert_allclose(found["w1"], [30, 30, *together, together[2], together[2]], rtol=1e-9)
    np.testing.assert_allclose(found["w2"], [0, 0, *together[:2], *(together[2] * alone)], rtol=1e-9, atol=1e-12)


def test_a_program_for_each_mode_is_compiled_once() -> None:
    model = bondgraph.load(BALL)
    model.simulate(to=6)
    before = len(model._compilations)
    model.simulate(to=6)
    assert len(model._compilations) == before


# ---------------------------------------------------------------------- sampled signals


def test_a_sampled_controller() -> None:
    """A lag of 0.1 s behind a controller that acts every 10 ms: an exact recursion from sample to sample."""
    text = """model Sampled {
  parameter T_s = 10 ms, K = 2
  mode u = 0, sum = 0
  signal x = integral((u - x)/(0.1 s), 0)
  every T_s {
    u   = K*(1 - x) + sum
    sum = sum + 0.5*(1 - x)
  }
  output y = x, command = u
}"""
    found = run(text, 0.5, points=51)
    x, u, total, expected = 0.0, 0.0, 0.0, []
    for _ in range(51):
        u, total = 2 * (1 - x) + total, total + 0.5 * (1 - x)
        expected.append((x, u))
        x = math.exp(-0.1) * x + (1 - math.exp(-0.1)) * u
    np.testing.assert_allclose(np.stack([found["y"], found["command"]], axis=1), expected, rtol=1e-12)
    assert not found.events  # samples are no surprises


def test_samples_and_events_at_one_instant() -> None:
    text = """model A {
  mode count = 0, even = 0, late = 0
  signal x = integral(1 [1/s], 0)
  every 0.25 s { count = count + 1 }
  every 0.5 s { even = even + 1 }
  when count > 2 { late = x }
  output c = count, e = even, l = late
}"""
    found = run(text, 1, points=5)
    assert found["c"].tolist() == [1, 2, 3, 4, 5]
    assert found["e"].tolist() == [1, 1, 2, 2, 3]
    assert found["l"].tolist() == pytest.approx([0, 0, 0.5, 0.5, 0.5], rel=1e-14)


# ---------------------------------------------------------------------- delays


@pytest.mark.parametrize("rtol", [1e-5, 1e-8])
def test_a_delay_differential_equation(rtol: float) -> None:
    """x' = -x(t - 1), x = 1 before: a polynomial of one more degree in each unit of time."""
    text = "model A {\n signal x = integral(-delay(x, 1 s)/(1 s), 1)\n output y = x, late = delay(x, 0.5 s)\n}\n"

    def exact(t: float) -> float:
        return sum((-1) ** j * max(t - j + 1, 0) ** j / math.factorial(j) for j in range(int(max(t, 0)) + 2))

    found = run(text, 8, rtol, points=161)
    np.testing.assert_allclose(found["y"], [exact(t) for t in found.time], atol=50 * rtol)
    np.testing.assert_allclose(found["late"], [exact(t - 0.5) for t in found.time], atol=50 * rtol)


def test_a_jump_arrives_late_and_sharp() -> None:
    text = """model A {
  signal s = 1 if time > 1 s else 0
  signal x = integral(delay(s, 0.3 s)/(1 s), 0)
  output y = x, z = delay(s, 0.25 s)
}"""
    found = run(text, 3, points=25)
    np.testing.assert_allclose(found["y"], np.maximum(found.time - 1.3, 0), atol=1e-12)
    np.testing.assert_allclose(found["z"], np.where(found.time < 1.25, 0.0, 1.0), atol=1e-13)


def test_a_relay_that_hears_late() -> None:
    text = """model Late {
  mode up = true
  signal x = integral(1 [1/s] if up else -1 [1/s], 0)
  signal heard = delay(x, 0.1 s)
  when heard > 1 { up = false }
  when heard < -1 { up = true }
  output y = x
}"""
    agree(run(text, 20), (1.1 + 2.2 * i for i in range(99)), 20)


def test_a_delay_across_a_switch() -> None:
    """The history goes along when another program goes on."""
    text = """import Switch from electric
model A {
  Se battery : u = 10 V
  Switch s { closed = 1 if time > 1 s else 0 }
  R r : u = 100 ohm*i
  C c : q = 10 mF*u
  battery -> 1(s.pins, r, c)
  output u = c.u, late = delay(c.u, 0.5 s)
}"""
    found = run(text, 4, points=41)

    def charged(t: np.ndarray) -> np.ndarray:
        return 10 * (1 - np.exp(-np.maximum(t - 1, 0)))

    np.testing.assert_allclose(found["u"], charged(found.time), atol=1e-6)
    np.testing.assert_allclose(found["late"], charged(found.time - 0.5), atol=1e-6)


# ---------------------------------------------------------------------- energy


def test_the_balance_knows_what_events_take() -> None:
    found = run(BALL, 2, energy=True)
    assert found.energy is not None
    taken = {e.name: e.dissipated for e in found.energy.elements}
    # three bounces within 2 s, each takes 36 % of the kinetic energy
    assert taken["when"] == pytest.approx(0.1 * 9.81 * (1 - 0.64**3), rel=1e-9)
    assert abs(found.energy.residual) < 1e-9


def test_the_balance_knows_what_impulses_take() -> None:
    text = """import Clutch from mechanics
model Drive {
  I fly  : L = 2 [kg*m^2]*omega { start omega = 30 [rad/s] }
  I load : L = 1 [kg*m^2]*omega
  1 a, b
  Clutch c { engaged = 1 if time > 1 s else 0 }
  a -> fly, c.a
  c.b -> b -> load
  output w1 = a.omega
}"""
    found = run(text, 2, energy=True)
    assert found.energy is not None
    assert {e.name: e.dissipated for e in found.energy.elements}["active"] == pytest.approx(900 - 600, rel=1e-9)
    assert found.energy.stored == pytest.approx(-300, rel=1e-9)
    assert abs(found.energy.residual) < 1e-6


@pytest.mark.machine_code  # the search in the loop is the same without
def test_a_tank_behind_two_valves_is_full_and_stays_so() -> None:
    """Roots of the pressures: sqrt(1 - q) falls linearly to zero, in finite time; there neither sign holds, and nothing flows."""
    text = """plain model Tank {
      Se supply : e = 1
      1 pipe
      R first : f = sign(e)*sqrt(abs(e))
      R second : f = 2*sign(e)*sqrt(abs(e))
      C tank : e = q
      supply -> pipe -> first, second, tank
      output f = pipe.f, q = tank.q
    }"""
    found = bondgraph.load(text).simulate(to=4, points=41, rtol=1e-8)
    left = np.maximum(1 - found.time / (2 * np.sqrt(1.25)), 0.0)
    assert found["q"] == pytest.approx(1 - left**2, abs=1e-6)
    assert found["f"] == pytest.approx(left / np.sqrt(1.25), abs=1e-4)
