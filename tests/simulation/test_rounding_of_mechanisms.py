"""Magnitudes of what rests: coordinates of mechanisms that only rounding moves, and states that move late."""

from __future__ import annotations

import math

import pytest

import bondgraph

DRAWN = """model M {
  multibody s : spatial {
    gravity = (6 [m/s^2], 0.35 [m/s^2], -1 [m/s^2])
    body b { mass = 1.76 kg, inertia = (0.31 [kg*m^2], 0.23 [kg*m^2], 0.24 [kg*m^2], -0.023 [kg*m^2], 0.053 [kg*m^2], 0.014 [kg*m^2]), at = (0.22 m, 0.25 m, 0.27 m), turn = (-0.07, 1.65, -1.13) }
    JOINT { at = (1.1 m, -0.95 m, 0.7 m), turn = (1.1, -0.47, -0.53) }
  }
  output x = s.b.x
}"""
MIRRORED = """model M {
  multibody w : planar {
    gravity = (0, -9.81 [m/s^2])
    body cart { mass = 1 kg }
    slide s : ground to cart { along = 0 }
    body p { mass = 0.3 kg, inertia = 0.01 [kg*m^2], at = (0.3 m, -0.4 m) }
    body q { mass = 0.3 kg, inertia = 0.01 [kg*m^2], at = (-0.3 m, -0.4 m) }
    hinge hp : cart to p { at = (0, 0) }
    hinge hq : cart to q { at = (0, 0) }
  }
  output x = w.cart.x, phi = w.p.phi
}"""
CORNER = """import GroundPoint from mechanics
model Corner {
  multibody w : planar {
    gravity = (0, -9.81 [m/s^2])
    body box { mass = 1 kg, inertia = 0.01 [kg*m^2], at = (0, 0.1 m), start phi = 20 deg }
    frame c : box { at = (0.05 m, 0.05 m) }
  }
  GroundPoint g { height = 0.05 m, k = 1e4 [N/m] }
  w.c.x -> g.x
  w.c.y -> g.y
  output phi = w.box.phi
}"""


@pytest.mark.parametrize("joint", ["planar j : b to ground", "planar j : ground to b", "free j : b to ground"])
def test_a_joint_drawn_in_either_direction(joint: str) -> None:
    """What gravity cancels of a rotation was followed as 1e-20 rad: 2.9 million steps."""
    run = bondgraph.load(DRAWN.replace("JOINT", joint)).simulate(to="0.7 s", rtol=1e-8, points=2)
    assert run.steps < 60


@pytest.mark.parametrize("gravity", ["9.81", "0.01"])
def test_a_cart_that_mirrored_pendulums_leave_at_its_place(gravity: str) -> None:
    run = bondgraph.load(MIRRORED.replace("9.81", gravity)).simulate(to="3 s", rtol=1e-8, points=2)
    assert run.steps < 100 and abs(run.final("x")) < 1e-14


def test_what_turns_late_does_not_grow_without_bound() -> None:
    run = bondgraph.load(CORNER).simulate(to="0.3 s", points=2)
    assert abs(run.final("phi") - 0.349) > 0.1 and not run.notes


@pytest.mark.parametrize("solver", ["rodas", "radau", "explicit"])
@pytest.mark.parametrize(("place", "width"), [(777.77, 1e-3), (50.0, 1e-2), (421.3, 1e-4)])
def test_a_state_that_rests_until_a_bell_of_another_moves_it(solver: str, place: float, width: float) -> None:
    """Its magnitude was what the force could bring in the whole run, 1000 N*s, so that all of 1.8e-3 N*s was within the tolerance."""
    text = f"""model B {{
      signal s = integral(1 [1/s], 0)
      MSe push : F = 1 N*exp(-((s - {place})/{width})^2)
      I m : p = 1 [kg]*v
      R r : F = 1e-3 [N*s/m]*v
      1 j
      push -> j -> m, r
      output p = m.p
    }}"""
    run = bondgraph.load(text).simulate(to="1000 s", points=2, solver=solver)
    moved = width * math.sqrt(math.pi) * math.exp(-1e-3 * (1000 - place))
    assert run.final("p") == pytest.approx(moved, rel=1e-5) or run.warnings
