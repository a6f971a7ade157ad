"""Samples and events whose values reach nothing while a junction is off go on all the same: once it is on, they count."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bondgraph

FIRST, PERIOD = math.asin(0.5) / 12, 2 * math.pi / 12
CHANGES = {
    "every 0.45 { u = 1 + time }": lambda t: 1 + 0.45 * math.floor(t / 0.45 + 1e-9),
    "when sin(12*time) > 0.5 { u = u + 1 }": lambda t: 1.0 + math.floor((t - FIRST) / PERIOD),
    "when time > 0.7 { u = 2 }": lambda t: 2.0 if t > 0.7 else 0.0,
    "when store.q > 0.25 { u = 1.5 }": lambda t: 1.5 if t > 0.25 else 0.0,
}


@pytest.mark.few(8)
@pytest.mark.parametrize("gate", ["time > 0.5", "store.q > 0.5", "not time < 1.1", "time > 0.5 and time < 1.4"])
@pytest.mark.parametrize("change", CHANGES)
def test_what_events_set_goes_on_while_it_reaches_nothing(change: str, gate: str) -> None:
    """The drive pushes a damper through a gate; a store, filled by 1 per second, stands beside it. The flow is the drive while the gate is on."""
    text = f"""plain model Gate {{
  Sf fill : f = 1
  C store : e = q
  fill -> store
  mode u = 0
  {change}
  MSe drive : e = u
  1 j
  R rest : e = f
  1 gate {{ active = {gate} }}
  drive -> j
  j -> gate -> rest
  output flow = j.f
}}"""
    result = bondgraph.load(text).simulate(None, to=2, points=42)
    at = {"time > 0.5": (0.5, 9.0), "store.q > 0.5": (0.5, 9.0), "not time < 1.1": (1.1, 9.0)}.get(gate, (0.5, 1.4))
    for time, flow in zip(result.time, result["flow"], strict=True):
        if min(abs(time - t) for t in (*at, 0.25, 0.45, 0.7, 0.9, 1.35, 1.8)) > 1e-6:
            expected = CHANGES[change](time) if at[0] < time < at[1] else 0.0
            np.testing.assert_allclose(flow, expected, atol=1e-7)
