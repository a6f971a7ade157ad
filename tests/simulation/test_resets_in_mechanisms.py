"""Events that set coordinates and rates of mechanisms: loops stay closed on their branch, what is set holds, and rates move no pose."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed

CRANK = """model M {{
  multibody s : planar {{
    body crank  {{ inertia = 0.05 [kg*m^2] }}
    body rod    {{ mass = 1 kg, inertia = 0.01 [kg*m^2], at = (0.1 m, 0) }}
    body piston {{ mass = 1 kg, at = (0.4 m, 0) }}
    hinge h : ground to crank  {{ at = (0, 0), start phi = 0.9, start phi.omega = 2 rad/s }}
    hinge p : crank to rod     {{ at = (0.1 m, 0) }}
    hinge q : rod to piston    {{ at = (0.4 m, 0) }}
    slide r : ground to piston {{ along = (1, 0), at = (0.4 m, 0) }}
  }}
  when time > 0.1 s {{ {sets} }}
  output phi = s.h.phi, omega = s.h.phi.omega, x = s.r.x, v = s.r.x.v, rod = s.rod.x.v
  experiment go {{ simulate 0 .. 0.2 s {{ points = 3 }} }}
}}
"""


def piston(phi: Any) -> tuple[Any, Any]:
    """Way of the piston from where it is drawn, on the side where it is drawn, and its derivative."""
    along = np.sqrt(0.3**2 - (0.1 * np.sin(phi)) ** 2)
    return 0.1 * np.cos(phi) + along - 0.4, -0.1 * np.sin(phi) * (1 + 0.1 * np.cos(phi) / along)


@pytest.mark.parametrize(
    ("sets", "name", "value"),
    [
        ("s.h.phi.omega = 5 rad/s", "omega", 5),  # the projection took 2.96
        ("s.r.x.v = -0.3 [m/s]", "v", -0.3),
        ("s.rod.x.v = -0.3 [m/s]", "rod", -0.3),  # the crank jumped by 0.2 rad
        ("s.h.phi.omega = 0 rad/s", "omega", 0),
        ("s.h.phi = 4 rad", "phi", 4),  # the piston went behind the shaft
        ("s.h.phi = -2 rad; s.h.phi.omega = -3 rad/s", "omega", -3),
        ("s.r.x = -0.15 m", "x", -0.15),
        ("s.h.phi = s.h.phi - 2*pi", "phi", None),
    ],
)
def test_a_slider_crank(sets: str, name: str, value: float | None) -> None:
    run = bondgraph.load(CRANK.format(sets=sets)).simulate(target="numpy")
    if value is not None:
        assert run[name][1] == pytest.approx(value, rel=1e-9, abs=1e-12)
    way, slope = piston(run["phi"][1:])
    np.testing.assert_allclose(run["x"][1:], way, atol=1e-12)
    np.testing.assert_allclose(run["v"][1:], slope * run["omega"][1:], atol=1e-12)
    if "phi =" not in sets and "x =" not in sets:
        before = bondgraph.load(CRANK.format(sets="s.h.phi.omega = 2 rad/s")).simulate(target="numpy")
        assert run["phi"][1] == pytest.approx(before["phi"][1], rel=1e-9)


@pytest.mark.parametrize("sets", ["s.r.x = -0.5 m", "s.h.phi.omega = 5 rad/s; s.r.x.v = 0.1 [m/s]"])
def test_what_a_loop_cannot_take_is_refused(sets: str) -> None:
    with pytest.raises(RunFailed, match="events cannot set `s") as error:
        bondgraph.load(CRANK.format(sets=sets)).simulate(target="numpy")
    assert error.value.code == "BR775"


def test_one_component_of_a_spin_in_space() -> None:
    """The others stay, and so does the pose: a ball turned on about a fixed axis before, and does about another one after."""
    text = """model M {
  multibody s : spatial {
    body b { mass = 1 kg, inertia = 1 [kg*m^2]*(1, 1, 1), start rx.omega = 1 rad/s, start ry.omega = 2 rad/s, start rz.omega = 3 rad/s }
  }
  when time > 1 s { s.b.rx.omega = -5 rad/s }
  output x = s.b.rx.omega, y = s.b.ry.omega, z = s.b.rz.omega, turn = s.b.attitude.w
  experiment go { simulate 0 .. 1 s { points = 2 } }
}
"""
    run = bondgraph.load(text).simulate(target="numpy")
    np.testing.assert_allclose([run[n][-1] for n in "xyz"], [-5, 2, 3], rtol=1e-6)
    assert run["turn"][-1] == pytest.approx(math.cos(math.sqrt(14) / 2), abs=1e-6)


def test_the_rate_of_a_tip_of_an_open_chain_moves_no_hinge() -> None:
    text = """model M {
  multibody s : planar {
    body upper  { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (0.5 m, 0) }
    body fore   { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (1.5 m, 0) }
    hinge base  : ground to upper { at = (0, 0), start phi = 0.5 }
    hinge elbow : upper to fore   { at = (1 m, 0), start phi = 0.7 }
    frame tip   : fore { at = (2 m, 0) }
  }
  when time > 1 s { s.tip.x.v = 1 [m/s] }
  output base = s.base.phi, elbow = s.elbow.phi, v = s.tip.x.v
  experiment go { simulate 0 .. 1 s { points = 2 } }
}
"""
    run = bondgraph.load(text).simulate(target="numpy")
    np.testing.assert_allclose([run[n][-1] for n in ("base", "elbow", "v")], [0.5, 0.7, 1], rtol=1e-9)
