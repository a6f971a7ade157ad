"""Conditions that are small differences of large states: the tolerance of the states must not decide when they change."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bondgraph

# A valve behind so small a resistance that its flow is far below what the tolerance leaves of the efforts beside it: it closes where C du/dt + u/r = 0.
VALVE = """model Valve {
  parameter R = 1e-7
  mode open = true
  signal s = 325*sin(314.159265358979*time/1 [s])
  signal i = (s - u)/R
  signal u = integral((i if open else 0)/1e-4*1 [1/s] - u/(100*1e-4)*1 [1/s], 0)
  when open and i < 0 { open = false }
  when not open and s > u { open = true }
  output y = u
}"""
CLOSES = (np.pi - np.arctan(np.pi)) / (100 * np.pi)


def voltage(time: Any) -> Any:
    """The voltage without the small resistance, before it opens again at 11.79 ms."""
    after = np.sin(100 * np.pi * CLOSES) * np.exp(-(time - CLOSES) / 0.01)
    return 325 * np.where(time < CLOSES, np.sin(100 * np.pi * time), after)


@pytest.fixture(scope="module")
def valve() -> Any:
    return bondgraph.load(VALVE)


@pytest.mark.parametrize("solver", ["automatic", "rodas"])
@pytest.mark.parametrize("resistance", [1e-5, 1e-7])
@pytest.mark.parametrize("rtol", [1e-4, 1e-6])
def test_a_valve_closes_where_its_flow_ends(valve: Any, solver: str, resistance: float, rtol: float) -> None:
    run = valve.simulate(settings={"R": resistance}, to="11 ms", points=111, rtol=rtol, solver=solver)
    np.testing.assert_allclose(run["y"], voltage(run.time), rtol=0, atol=3 * 325 * rtol)
