"""Ideal valves with a gate: a closed one keeps them from conducting, but not from conducting on; rectifiers agree with their closed forms."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from scipy.optimize import brentq

import bondgraph

W, T = 100 * math.pi, 0.02
HALF_WAVE = """import IdealThyristor from electric
model HalfWave {
  parameter R: ohm = 10, L: mH = 50, alpha: ms = 3, width: ms = 0.5
  Se s : u = 100 V*sin(2*pi*50 Hz*time)
  IdealThyristor t { gate = max(pulse(time, alpha, alpha + width), pulse(time, alpha + 20 ms, alpha + 20 ms + width)) }
  R r : u = R*i
  I l : lambda = L*i
  s -> 1(t.pins, r, l)
  output i = l.i
}"""
BRIDGE = """model Valve {
  input gate = 0
  parameter first = 0
  port pins: electric
  mode on = first > 1/2
  1 line : electric
  0 gap : electric { active = not on }
  pins -> line -> gap
  when not (on or gap.u <= 0 V or gate < 1/2) { on = true }
  when on and line.i < 0 A { on = false }
}
model Bridge {
  parameter alpha: ms = 3, i_0: A = 0, E: V = 0, before = 1
  Se s : u = 100 V*sin(2*pi*50 Hz*time)
  Se earth : u = 0 V
  signal even = pulse(mod(time, 20 ms), alpha, alpha + 0.1 ms), odd = pulse(mod(time + 10 ms, 20 ms), alpha, alpha + 0.1 ms)
  Valve t1 { gate = even }
  Valve t4 { gate = even }
  Valve t2 { gate = odd; first = before }
  Valve t3 { gate = odd; first = before }
  0 a, b, p, m : electric
  1 load, feed
  LOAD
  s -> feed -> a
  b -> feed
  earth -> b
  a -> 1(t1.pins) -> p
  b -> 1(t2.pins) -> p
  m -> 1(t3.pins) -> a
  m -> 1(t4.pins) -> b
  p -> load -> m
}"""
COIL = """R r : u = 10 ohm*i
  I l : lambda = 200 mH*i { start i = i_0 }
  Se battery : u = E
  load -> r, l, battery
  output i = l.i"""
SOURCE_OF_CURRENT = """Sf sink : i = 5 A
  load -> sink
  I l : lambda = 2 mH*i { start i = -5 A }
  feed -> l
  output i = l.i"""


@cache
def model(text: str) -> bondgraph.Model:
    return bondgraph.load(text)


@pytest.mark.parametrize(
    ("resistance", "inductance", "alpha", "width"),
    [(10, 50, 3, 0.5), (1, 100, 1, 0.5), (10, 0.01, 8, 0.5), (10, 50, 12, 0.5), (10, 50, 12, 9), (5, 20, 0, 2)],
)
def test_a_coil_goes_on_to_its_extinction_angle(
    resistance: float, inductance: float, alpha: float, width: float
) -> None:
    """Fired under a backward voltage it waits, as long as the gate is open. The angle solves a transcendental equation."""
    settings = {"R": resistance, "L": inductance * 1e-3, "alpha": alpha * 1e-3, "width": width * 1e-3}
    found = model(HALF_WAVE).simulate(settings=settings, to=2 * T, points=201, rtol=1e-9)
    lag, rate = math.atan2(W * settings["L"], resistance), resistance / settings["L"]
    peak = 100 / math.hypot(W * settings["L"], resistance)
    fires = settings["alpha"] if alpha < 10 else T if alpha + width > 20 else math.inf

    def current(t: float) -> float:
        return peak * (math.sin(W * t - lag) - math.sin(W * fires - lag) * math.exp(-rate * (t - fires)))

    exact = np.zeros(201)
    if fires < math.inf:
        grid = np.linspace(fires, fires + T, 1001)[1:]
        place = next(k for k, t in enumerate(grid) if current(t) < 0)
        lasts = brentq(current, grid[place - 1], grid[place]) - fires
        exact = [current(fires + s) if t > fires and (s := (t - fires) % T) < lasts else 0.0 for t in found.time]
    np.testing.assert_allclose(found["i"], exact, atol=1e-6 * peak)


@pytest.mark.parametrize(("alpha", "battery"), [(3, 0), (7.5, -120)])
def test_a_bridge_in_continuous_conduction(alpha: float, battery: float) -> None:
    """It begins on the periodic motion, in the pair that conducts with closed gates: the mean voltage is 2 U/pi cos(alpha), below zero as an inverter."""
    a, lag, decay = alpha * 1e-3, math.atan2(W * 0.2, 10), math.exp(-T / 2 / 0.02)
    peak, own = 100 / math.hypot(W * 0.2, 10), -battery / 10
    first = own - 2 * peak * math.sin(W * a - lag) / (1 - decay) + peak * math.sin(W * a - lag)

    def current(t: float) -> float:
        since = (t - a) % (T / 2)
        free = (first - own - peak * math.sin(W * a - lag)) * math.exp(-since / 0.02)
        return own + peak * math.sin(W * (a + since) - lag) + free

    settings = {"alpha": a, "E": battery, "i_0": current(0)}
    found = model(BRIDGE.replace("LOAD", COIL)).simulate(settings=settings, to=1.25 * T, points=126, rtol=1e-9)
    np.testing.assert_allclose(found["i"], [current(t) for t in found.time], atol=1e-6)
    mean = 10 * np.trapezoid(found["i"][25:], found.time[25:]) / T + battery
    assert mean == pytest.approx(2 * 100 / math.pi * math.cos(W * a), rel=1e-3)


def test_a_bridge_commutates_beyond_its_pulses() -> None:
    """Behind a coil all four conduct until the current has turned, long after the gates have closed."""
    found = model(BRIDGE.replace("LOAD", SOURCE_OF_CURRENT)).simulate(to=T, points=201, rtol=1e-9)
    since = [(t - 0.003) % (T / 2) for t in found.time]
    turned = [
        5 - max(10 - 100 / (W * 0.002) * (math.cos(W * 0.003) - math.cos(W * (0.003 + s))) if s < 0.003 else 0, 0)
        for s in since
    ]
    exact = [c if 0.003 <= t < 0.013 else -c for t, c in zip(found.time, turned, strict=True)]
    np.testing.assert_allclose(found["i"], exact, atol=1e-6)
    assert sum(e.owner == "t2" for e in found.events) == 2


def test_closed_gates_do_not_begin_to_conduct_for_a_source_of_current() -> None:
    with pytest.raises(bondgraph.RunFailed, match=r"no set of conducting and blocking valves.*open the gate"):
        model(BRIDGE.replace("LOAD", SOURCE_OF_CURRENT)).simulate(settings={"before": 0}, to=T)


OWN_GATE = """import Resistor, IdealThyristor from electric
model OwnGate {
  Se s : u = 10 V*sin(2*pi*50 Hz*time)
  Resistor one { R = 100 ohm }
  Resistor other { R = 100 ohm }
  0 n : electric
  s -> n
  IdealThyristor valve { gate = 1 if GATE > 5 else 0 }
  BODY
  output i = valve.current
}"""
COMBINATION, SHORT, BOTH = (
    "n -> 1(one.pins, other.pins, valve.pins)",
    "n -> 1(one.pins) -> 0(other.pins, valve.pins)",
    "IdealThyristor lead { gate = 1 if time > 2 ms else 0 }\n  n -> 1(one.pins, lead.pins)\n  n -> 1(other.pins, valve.pins)",
)


@pytest.mark.parametrize(
    ("gate", "body", "level", "ohms"),
    [
        ("valve.voltage/1 V", COMBINATION, 0.5, 200),
        ("2*other.pins.u/1 V", SHORT, 0.5, 100),
        ("100*lead.current/1 A", BOTH, 0.5, 100),
    ],
)
def test_a_gate_may_read_what_its_valve_changes(gate: str, body: str, level: float, ohms: float) -> None:
    """A breakover diode, a crowbar, and a valve that another one lets fire at the same instant, from 2 ms on: conducting needs no open gate."""
    found = model(OWN_GATE.replace("GATE", gate).replace("BODY", body)).simulate(to=1.5 * T, points=31, rtol=1e-9)
    phase = found.time % T
    fired = (phase * W > math.asin(level)) & ((found.time > 0.0019) | ("lead" not in gate))
    sine = np.sin(W * found.time)
    np.testing.assert_allclose(found["i"], np.where(fired & (phase < T / 2), 10 / ohms * sine, 0), atol=1e-12)


BY_HAND = """  mode cK = false
  1 lineK : electric
  0 gapK : electric { active = not cK }
  FROM -> lineK -> TO
  lineK -> gapK
  when not cK and gapK.u > 0 V and SIGN s.u > 5 V { cK = true }
  when cK and lineK.i < 0 A { cK = false }
"""


def test_gates_of_a_bridge_by_hand_read_its_source() -> None:
    """The conditions are parted into those of the valves and their gates; what a blocked bridge lets float is a function of time with bounds."""
    legs = [("a", "p", ""), ("b", "p", "-"), ("m", "a", "-"), ("m", "b", "")]
    valves = "".join(
        BY_HAND.replace("K", str(k)).replace("FROM", a).replace("TO", b).replace("SIGN ", sign)
        for k, (a, b, sign) in enumerate(legs)
    )
    text = f"""model Bridge {{
      Se s : u = 10 V*sin(2*pi*50 Hz*time)
      Se earth : u = 0 V
      0 a, b, p, m : electric
      1 load, feed
      R r : u = 10 ohm*i
      I l : lambda = 20 mH*i
      s -> feed -> a
      b -> feed
      earth -> b
      p -> load -> m
      load -> r, l
    {valves}  output i = l.i
    }}"""
    found = model(text).simulate(to=2 * T, points=81, rtol=1e-9)
    lag, peak, first = math.atan2(W * 0.02, 10), 10 / math.hypot(W * 0.02, 10), math.asin(0.5) / W
    begins = 0.0
    exact = np.zeros(81)
    for k in range(4):
        since = found.time - first - k * T / 2
        own = begins - peak * math.sin(W * first - lag)
        here = (since > 0) & (since <= T / 2)
        exact[here] = (peak * np.sin(W * (first + since) - lag) + own * np.exp(-since / 0.002))[here]
        begins = peak * math.sin(W * (first + T / 2) - lag) + own * math.exp(-T / 2 / 0.002)
    np.testing.assert_allclose(found["i"], exact, atol=1e-9)
    assert not found.notes
