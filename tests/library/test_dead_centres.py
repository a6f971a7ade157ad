"""Dry friction on what a crank moves to and fro: at a dead centre it cannot stick, as no force at the piston stops the crank there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bondgraph

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
