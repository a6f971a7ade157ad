"""Stiff variables are at their place at every requested instant, not only at the ends of steps."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph

FOLLOWS = """plain model Follows {
  parameter small = 1e-6
  Se push  : e = cos(time)
  R  one   : e = f
  R  two   : e = -(1 - small)*f
  C  store : e = q
  push -> 1(one, two) -> store
  output q = store.q
}
"""


@pytest.mark.parametrize("target", ["numpy", pytest.param("native", marks=pytest.mark.machine_code)])
def test_what_follows_at_once_follows_between_the_ends_of_steps(target: str) -> None:
    """small q' = cos t - q: a polynomial through the ends of steps was off by 174 tolerances."""
    found = bondgraph.load(FOLLOWS).simulate(to=6, points=41, rtol=1e-6, solver="radau", target=target)
    inner = found.time > 1e-4
    exact = (np.cos(found.time) + 1e-6 * np.sin(found.time)) / (1 + 1e-12)
    assert np.abs(found["q"] - exact)[inner].max() < 1e-5


@pytest.mark.machine_code
def test_machine_code_brings_the_same_back() -> None:
    model = bondgraph.load(FOLLOWS)
    one, other = (model.simulate(to=6, points=41, solver="radau", target=t) for t in ("numpy", "native"))
    assert (one.steps, one.evaluations) == (other.steps, other.evaluations)
    np.testing.assert_allclose(one["q"], other["q"], rtol=0, atol=1e-9)
