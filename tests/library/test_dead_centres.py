"""Dry friction on what a crank moves to and fro: at a dead centre it cannot stick, as no force at the piston stops the crank there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed

YOKE = """import DryFriction from mechanics
model M {{
  I j   : L = 0.05 [kg*m^2]*omega                 {{ start omega = 20 rad/s }}
  I m   : p = 1 kg*v
  MTF c : v2 = -0.1 m*sin(phi)*omega1
  DryFriction f {{ F_c = 5 N, F_s = {F_s} N, v_s = 0, moving = -1 }}
  1 s, t
  s -> j
  s -> c -> t -> m, f.ends
  signal phi = integral(s.omega, 0.5 rad)
  output angle = phi, omega = s.omega
  experiment go {{ simulate 0 .. 0.6 s {{ rtol = 1e-8, points = 31 }} }}
}}
"""
CRANK = """import DryFriction from mechanics
model M {{
  multibody s : planar {{
    body crank  {{ inertia = 0.05 [kg*m^2] }}
    body rod
    body piston {{ mass = 1 kg, at = (0.4 m, 0) }}
    hinge h : ground to crank  {{ at = (0, 0), start phi = 0.5, start phi.omega = 20 rad/s }}
    hinge p : crank to rod     {{ at = (0.1 m, 0) }}
    hinge q : rod to piston    {{ at = (0.4 m, 0) }}
    slide r : ground to piston {{ along = (1, 0), at = (0.4 m, 0) }}
  }}
  DryFriction f {{ F_c = 5 N, F_s = {F_s} N, v_s = 0, moving = -1 }}
  s.r -> f.ends
  output angle = s.h.phi, omega = s.h.phi.omega
  experiment go {{ simulate 0 .. 0.6 s {{ rtol = 1e-8, points = 31 }} }}
}}
"""


def yoke(phi: Any) -> tuple[Any, Any]:
    """Place of the piston and its derivative by the angle."""
    return 0.1 * np.cos(phi), -0.1 * np.sin(phi)


def crank(phi: Any) -> tuple[Any, Any]:
    along = np.sqrt(0.3**2 - (0.1 * np.sin(phi)) ** 2)
    return 0.1 * np.cos(phi) + along, -0.1 * np.sin(phi) * (1 + 0.1 * np.cos(phi) / along)


@pytest.mark.parametrize(("text", "place", "F_s"), [(YOKE, yoke, 5), (CRANK, crank, 8)], ids=["yoke", "crank"])
def test_the_friction_takes_its_work_and_no_more(text: str, place: Any, F_s: float) -> None:
    """The energy falls by 5 N along the way of the piston, through three dead centres; an impulse stopped the yoke at the first, and ended the crank's run."""
    run = bondgraph.load(text.format(F_s=F_s)).simulate(target="numpy")
    phi, omega = run["angle"], run["omega"]
    assert phi[-1] > 3 * np.pi
    x, slope = place(phi)
    ends = np.floor(
        phi / np.pi
    )  # between dead centres it goes from 0.1 m beside the middle of its way to the other side
    way = 0.2 * ends + np.where(ends % 2 == 0, place(0.0)[0] - x, x - place(np.pi)[0])
    energy = 0.5 * (0.05 + slope**2) * omega**2 + 5 * way
    np.testing.assert_allclose(energy, energy[0], rtol=1e-6)


HELD = """  mode direction = -1
  0  end     : translation
  1  contact : translation     {{ active = direction != 0 }}
  MR surface : F = direction*5 N + 1e-9 [N*s/m]*v
  t -> end -> contact -> surface
  when direction == 0 and abs(end.F) > 5 N {{ direction = 1 if end.F > 0 N else -1 }}
  when {condition} and direction != 0      {{ direction = 0 }}
"""


@pytest.mark.parametrize(
    "condition",
    [
        "direction*contact.v < 0 [m/s]",
        "t.v*surface.F < 0 W",
        "abs(contact.v) < 1 mm/s",
        "sin(phi)*s.omega < 0 [1/s]",
        "contact.v > 0 [m/s] and phi > 0.1",
    ],
)
def test_a_hold_that_no_finite_force_gives_is_refused(condition: str) -> None:
    """It stopped the flywheel behind the dead centre at once."""
    written = YOKE.split("  DryFriction")[0] + HELD + YOKE.split("= -1 }}")[1].replace(", f.ends", "")
    with pytest.raises(RunFailed, match=r"no finite force takes `j.L` from 0\.97") as refused:
        bondgraph.load(written.format(condition=condition)).simulate(target="numpy")
    assert refused.value.code == "BR796" and condition in str(refused.value)


SLIPPING = """model M {{
  I a : L = 1 [kg*m^2]*omega {{ start omega = 100 rad/s }}
  I b : L = 0.01 [kg*m^2]*omega
  1 x, y : rotation
  0 plates : rotation
  mode slips = true
  1 between : rotation {{ active = slips }}
  R friction : M = 5 [N*m] + 1e-3 [N*m*s]*omega
  x -> a
  y -> b
  x -> plates -> y
  plates -> between -> friction
  when between.omega < {least} rad/s {{ slips = false }}
  output omega = b.omega
  experiment go {{ simulate 0 .. 1 s {{ points = 3 }} }}
}}
"""


@pytest.mark.parametrize("least", [0, 1e-3, 5])
def test_a_hold_that_takes_what_is_left_goes_on(least: float) -> None:
    """A clutch locks at any slip: the momentum is shared."""
    run = bondgraph.load(SLIPPING.format(least=least)).simulate(target="numpy")
    np.testing.assert_allclose(run["omega"][-1], 100 / 1.01, rtol=1e-6)


ROCKER = """model M {
  multibody s : planar {
    body crank  { inertia = 0.05 [kg*m^2] }
    body rod
    body rocker { inertia = 0.1 [kg*m^2] }
    hinge h : ground to crank  { at = (0, 0), start phi = 0.5, start phi.omega = 20 rad/s }
    hinge p : crank to rod     { at = (0.1 m, 0) }
    hinge q : rod to rocker    { at = (0.4 m, 0.3 m) }
    hinge r : ground to rocker { at = (0.4 m, 0) }
  }
  mode direction = -1
  0  end     : rotation
  1  contact : rotation        { active = direction != 0 }
  MR surface : M = direction*1 [N*m] + 1e-9 [N*m*s]*omega
  s.r -> end -> contact -> surface
  when direction*contact.omega < 0 [rad/s] { direction = 0 }
  output angle = s.h.phi
  experiment go { simulate 0 .. 20 ms { points = 3 } }
}
"""


def test_a_hold_where_a_rocker_turns_back_is_refused() -> None:
    """Exactly there the hold let the crank pass, and stopped it right after."""
    with pytest.raises(
        RunFailed, match=r"`when direction.* no finite force takes `s\.p\.phi\.omega` from -24"
    ) as refused:
        bondgraph.load(ROCKER).simulate(target="numpy")
    assert refused.value.code == "BR796"
