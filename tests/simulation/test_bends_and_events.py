"""Events on what a law bends at: the slope of `abs(v)` has the condition `v < 0` too, and an event on it happens all the same."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph

LAWS = {
    "0.3*v*abs(v)": lambda v: 0.3 * v * abs(v),
    "0.3*v*(1 + abs(v))": lambda v: 0.3 * v * (1 + abs(v)),
    "0.3*v + 0.2*max(v, 0)": lambda v: 0.3 * v + 0.2 * max(v, 0.0),
    "0.3*v + 0.2*min(v, 0)": lambda v: 0.3 * v + 0.2 * min(v, 0.0),
    "0.3*v if v > 0 else 0.6*v": lambda v: 0.3 * v if v > 0 else 0.6 * v,
    "0.1*v + 0.2*abs(v)*v^3": lambda v: 0.1 * v + 0.2 * abs(v) * v**3,
}
CONDITIONS = {"mass.f < 0": -1, "mass.f <= 0": -1, "0 < mass.f": 1, "one.f > 0": 1}


@pytest.mark.few(8)
@pytest.mark.parametrize("condition", CONDITIONS)
@pytest.mark.parametrize("law", LAWS)
def test_an_event_happens_where_a_law_bends(law: str, condition: str) -> None:
    """Each passage of the velocity is counted, at the instants of an integration by scipy."""
    text = f"""plain model Bend {{
  1 one
  I mass : p = f {{ start p = 1 }}
  C spring : e = 4*q
  R damper : e = {law.replace("v", "f")}
  one -> mass, spring, damper
  mode n = 0
  when {condition} {{ n = n + 1 }}
  output x = spring.q, count = n
}}"""
    result = bondgraph.load(text).simulate(None, to=6, points=3, rtol=1e-8)

    def rates(t: float, y: np.ndarray) -> list[float]:
        return [y[1], -4 * y[0] - LAWS[law](y[1])]

    def passage(t: float, y: np.ndarray) -> float:
        return float(y[1])

    passage.direction = CONDITIONS[condition]  # type: ignore[attr-defined]
    witness = solve_ivp(rates, (0, 6), [0.0, 1.0], events=passage, rtol=1e-10, atol=1e-12, max_step=0.05)
    counted = [e.time for e in result.events if e.time > 0]
    np.testing.assert_allclose(counted, witness.t_events[0], atol=1e-6)


@pytest.mark.parametrize(
    "law", ["0.8*f*(1 + abs(f))", "0.8*f*abs(f)", "0.8*f + 0.4*max(f, 0)", "0.8*f + 0.4*min(f, 0)"]
)
def test_a_valve_closes_where_a_law_bends(law: str) -> None:
    """A check valve beside a drag holds the flow at zero after its first half wave."""
    text = f"""plain model Check {{
  1 line
  Se push : e = 1
  I mass : p = 0.7*f
  C spring : e = 2*q
  R drag : e = {law}
  push -> line -> mass, spring, drag
  mode open = false
  0 gap {{ active = not open }}
  line -> gap
  when not open and gap.e > 0 {{ open = true }}
  when open and line.f < 0 {{ open = false }}
  output flow = line.f, q = spring.q
}}"""
    result = bondgraph.load(text).simulate(None, to=4, points=201)
    assert len(result.events) == 2
    behind = result.time > result.events[1].time
    assert np.abs(result["flow"][behind]).max() < 1e-9
    assert result["flow"].min() > -1e-9
    assert np.ptp(result["q"][behind]) < 1e-9


@pytest.mark.parametrize("solver", ["automatic", "explicit", "radau"])
def test_the_rate_of_a_curve_jumps_at_an_event(solver: str) -> None:
    """`der` of straight lines over a state is a step function: its integral is the curve. Where `abs` of it bent at the jump, a step of the explicit
    method ended there with the rate of the other side, and was wrong inside by 0.08 at any tolerance."""
    text = """plain model M {
  signal p = integral(1, 0), f = linear(p, (0, 1, 2, 6), (0, 2, 1, 5))
  output y = integral(der(f), 0), way = integral(abs(der(f)), 0)
}"""
    result = bondgraph.load(text).simulate(to=5, points=41, rtol=1e-6, solver=solver)
    np.testing.assert_allclose(result["y"], np.interp(result.time, [0, 1, 2, 6], [0, 2, 1, 5]), atol=1e-9)
    np.testing.assert_allclose(result["way"], np.interp(result.time, [0, 1, 2, 6], [0, 2, 3, 7]), atol=1e-9)
