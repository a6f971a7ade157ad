"""Laws that bend within a step: an error that the nodes of the step do not see is seen between them."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from bondgraph.compiled_scene import TARGETS, chosen_target

TEXT = """model Bounce {
  "A mass of 1 kg between springs of 1 and `stiff` N/m: energy is a (1 m)^2/2 for ever."
  parameter a = 1 m, stiff: N/m = 1e6
  I mass   : p = 1 kg*v
  C spring : F = 0.5*(1 [N/m] + stiff)*x + 0.5*(1 [N/m] - stiff)*abs(x)     { start x = a }
  1(mass) -> spring
  output x = spring.x, v = mass.v
}
"""


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("stiff", [9.0, 1e4, 1e6, 5e6])
def test_no_bounce_makes_energy_by_chance(stiff: float, target: str) -> None:
    """For any phase in which steps meet the kink: eight starts, six bounces each.

    One of these once gave 2e-4; a Jacobian from beyond the kink, left after a bounce, took 1e-3 of the energy in steps whose errors it
    filtered out.
    """
    if target != chosen_target(None):
        pytest.skip("the other way of stepping makes the same decisions")
    model = bondgraph.load(TEXT)
    worst = 0.0
    for a in np.linspace(0.9, 1.1, 8):
        found = model.simulate(settings={"a": float(a), "stiff": stiff}, to=20.0, points=401, target=target)
        x, v = found["x"], found["v"]
        energy = v**2 / 2 + np.where(x > 0, 1.0, stiff) * x**2 / 2
        worst = max(worst, float(np.abs(energy / (a**2 / 2) - 1).max()))
    assert worst < 5e-5
