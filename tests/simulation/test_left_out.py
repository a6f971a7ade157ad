"""What a result says that a bandwidth left out, beside runs that follow every turn: decays, ringings that die or grow, many of them."""

from __future__ import annotations

import pytest

import bondgraph

# A heavy and a light mass (506 Hz) with what a damper between them dissipates.
HEAT = """model Heat {
  parameter r = 1 [N*s/m]
  1 a, b
  0 ab
  I ma : p = 1 kg*v
  I mb : p = 10 [g]*v
  C wall : F = 100 [N/m]*x + 1000 [N/m^3]*x^3
  C link : F = 1e5 [N/m]*x
  R d : F = r*v
  a -> ma, wall
  a -> ab -> 1(link, d)
  ab -> b -> mb
  output xa = wall.x, s = link.x, heat = integral(d.F*d.v, 0 J), power = d.F*d.v
  experiment both { start mb.v = 3 [m/s]; start link.x = 1 mm; start wall.x = 50 mm; simulate 0 .. 3 s; bandwidth 60 Hz }
}"""

# A small condenser that discharges into a large one within microseconds: 4.5 nJ of heat.
CONDENSERS = """model Condensers {
  C small : u = q/(1 nF) {start u = 3 V}
  R r : u = 100 ohm*i
  C big : u = q/(1 uF) + 1e11 [V/C^3]*q^3
  R load : u = 10 kohm*i
  0 a, b
  a -> small
  a -> 1(r) -> b -> big, load
  output us = small.u, ub = big.u, heat = integral(r.u*r.i, 0 J), i = r.i
  experiment go { simulate 0 .. 5 ms }
}"""

# A light mass (506 Hz) whose link to a mass of 1 kg is not linear.
PUSHED = """model Pushed {
  parameter r = 0 [N*s/m], k3 = 1e9 [N/m^3]
  1 a, b
  0 ab
  I ma : p = 1 kg*v
  I mb : p = 10 [g]*v
  C wall : F = 100 [N/m]*x + 1000 [N/m^3]*x^3
  C link : F = 1e5 [N/m]*x + k3*x^3
  R d : F = r*v
  a -> ma, wall
  a -> ab -> 1(link, d)
  ab -> b -> mb
  C far : F = 50 [N/m]*x + 3000 [N/m^3]*x^3
  b -> far
  output xa = wall.x, s = link.x
  experiment off { start link.x = 1 mm; start wall.x = 50 mm; start far.x = 50 mm; simulate 0 .. 3 s; bandwidth 60 Hz }
}"""
FILTERED = PUSHED.replace(
    "output xa",
    "signal wf = integral((200 [1/s] + 1800 [1/s]*smoothstep5(time, 0.1 s, 0.6 s))*(cos(2 [1/s]*time) - wf), 1)\n"
    "  output filtered = wf, xa",
)


# ---------------------------------------------------------------- what decays without a turn
def test_what_decays_is_followed() -> None:
    """3 V on 1 nF are turned into heat, 4.5 nJ; an overdamped pair as well: bit by bit what it is without a bandwidth."""
    for text, hertz, joules, settings in (
        (CONDENSERS, 10e3, 4.5e-9, {}),
        (HEAT, 60, 0.0946, {"r": 300.0}),
    ):
        model = bondgraph.load(text)
        found, usual = (model.simulate(settings=settings, bandwidth=b) for b in (hertz, 1e12))
        told = found.left_out
        assert told is not None and not told.instants and told.faster == 0
        assert "nothing that is faster rings" in told.reason
        assert (found.values == usual.values).all()
        assert found["heat"][-1] == pytest.approx(joules, rel=1e-2)


def test_a_decay_that_gets_faster_than_the_bandwidth() -> None:
    """A filter whose rate crosses it takes nothing from what is told of a ringing elsewhere."""
    plain, filtered = (bondgraph.load(text).simulate().left_out for text in (PUSHED, FILTERED))
    assert plain is not None and filtered is not None and filtered.reason == ""
    assert plain.kept["xa"] > 1e-5 and filtered.kept["xa"] == pytest.approx(plain.kept["xa"], rel=0.3)
