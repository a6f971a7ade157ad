"""Thresholds far below the magnitudes of what they are compared with: an absolute tolerance must not hide them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bondgraph

# z = 1/(2 e^t - 1), and what counts the time behind z = limit
DECAY = """model Decay {{
  parameter limit = 1e-8
  mode low = false
  signal z = integral(-z*(1 + z)*1 [1/s], 1.0)
  signal w = 5*z
  when z < limit {{ low = true }}
  signal a = integral((1 if low else 0)*1 [1/s], 0)
  signal b = integral((1 if {condition} else 0)*1 [1/s], 0)
  output since = a, below = b
}}"""
CONDITIONS = {"an output": "w < 5*limit", "a power": "z*z < limit*limit", "a sum": "z + limit < 2*limit"}


@pytest.fixture(scope="module", params=CONDITIONS.values(), ids=CONDITIONS)
def decay(request: Any) -> Any:
    return bondgraph.load(DECAY.format(condition=request.param))


@pytest.mark.parametrize("solver", ["radau", "rodas", "explicit"])
def test_a_threshold_below_the_tolerance_is_passed_when_it_is(decay: Any, solver: str) -> None:
    for limit, rtol in ((1e-8, 1e-3), (1e-8, 1e-6), (1e-5, 1e-6), (1e-11, 1e-4)):
        run = decay.simulate(settings={"limit": limit}, to="40 s", points=3, rtol=rtol, solver=solver)
        passed = np.log((1 + limit) / (2 * limit))
        np.testing.assert_allclose([run["since"][-1], run["below"][-1]], 40 - passed, rtol=0, atol=3 * rtol)


def test_a_guard_of_a_law_costs_no_steps() -> None:
    """Where a law goes on over a threshold, as `max` beside a division, there is nothing to be resolved."""
    text = (
        "model Guard {{ signal x = integral((cos(time/1 [s]) - x)*1 [1/s], 0)\n output y = x/max(abs(x), {least})*x }}"
    )
    runs = [bondgraph.load(text.format(least=least)).simulate(to="20 s", solver="radau") for least in ("1e-9", "1e-30")]
    assert runs[0].steps <= runs[1].steps + 2


def test_conditions_of_a_model_without_states() -> None:
    """A loop alone has nothing whose tolerance could hide a threshold."""
    text = "plain model Loop { signal s = 2*sin(time)\n MSe a : e = s\n R r : e = (f + f^3 if f > 1e-9 else f)\n a -> r\n output f = r.f }"
    run = bondgraph.load(text).simulate(to="3 s", points=4)
    np.testing.assert_allclose(run["f"] + np.fmax(run["f"], 0) ** 3, 2 * np.sin(run.time), atol=1e-9)
