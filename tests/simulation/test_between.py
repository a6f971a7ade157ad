"""Stiff variables are at their place at every requested instant, not only at the ends of steps."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from tests.compiling import MODELS

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


@pytest.mark.machine_code
def test_what_begins_to_follow_within_a_step_follows_to_its_end() -> None:
    """Diodes that begin to conduct: near the end of such a step both polynomials were wrong alike, and the current was off by 31 tolerances."""
    model = bondgraph.load(MODELS / "rectifier.bg")
    found, exact = (model.simulate(points=20_001, rtol=rtol)["i"] for rtol in (1e-6, 1e-10))
    assert np.abs(found - exact).max() < 10 * 1e-6 * np.abs(exact).max()


@pytest.mark.machine_code
def test_smooth_solutions_keep_the_polynomial_of_higher_order() -> None:
    """The other one was off by 6 tolerances in the force of a mechanism, that of higher order by 1.5."""
    model = bondgraph.load(MODELS / "crank_linkage.bg")
    found, exact = (model.simulate(rtol=rtol)["force"] for rtol in (1e-6, 1e-10))
    assert np.abs(found - exact).max() < 2 * 1e-6 * np.abs(exact).max()
