"""Starts of a turn in space about one or two axes: the others stay as drawn, or follow where a loop decides them."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed

INCLINED = """model M {{
  multibody s : spatial {{
    body bar   {{ mass = 1 kg, inertia = 0.1 [kg*m^2]*(1, 1, 1), at = (0.5 m, 0, 0.25 m){body} }}
    body block {{ mass = 1 kg, inertia = 0.1 [kg*m^2]*(1, 1, 1), at = (1 m, 0, 0.5 m) }}
    ball foot    : ground to bar   {{ at = (0, 0, 0){joint} }}
    ball head    : bar to block    {{ at = (1 m, 0, 0.5 m) }}
    planar table : ground to block {{ at = (1 m, 0, 0.5 m), turn = (0, -atan(0.5), 0) }}
  }}
  output rx = s.bar.rx, ry = s.bar.ry, rz = s.bar.rz, wx = s.bar.rx.omega, wy = s.bar.ry.omega, wz = s.bar.rz.omega
  output x = s.block.x, z = s.block.z
  experiment go {{ simulate 0 .. 1 ms {{ points = 2 }} }}
}}
"""


def test_a_body_drawn_turned_keeps_what_is_not_given() -> None:
    text = """model M {
  multibody s : spatial { body b { mass = 1 kg, inertia = 1 [kg*m^2]*(1, 1, 1), turn = (0, 0, 30 deg), start rx = 10 deg } }
  output rx = s.b.rx, rz = s.b.rz
  experiment go { simulate 0 .. 1 ms { points = 2 } }
}
"""
    run = bondgraph.load(text).simulate(target="numpy")
    np.testing.assert_allclose([run["rx"][0], run["rz"][0]], np.radians([10, 30]), rtol=1e-12)


def test_a_ball_that_rolls_and_spins_about_given_axes() -> None:
    """It was refused, as if the turn about the other axes were given as well."""
    text = """model M {
  multibody s : spatial {
    body b { mass = 1 kg, inertia = 4e-3 [kg*m^2]*(1, 1, 1), at = (0, 0, 0.1 m), start x.v = 0.2 [m/s], start rz.omega = 3 rad/s, start rx.omega = 1 rad/s }
    wheel w : ground to b { radius = 0.1 m }
  }
  output vx = s.b.x.v, vy = s.b.y.v, wx = s.b.rx.omega, wy = s.b.ry.omega, wz = s.b.rz.omega
  experiment go { simulate 0 .. 1 ms { points = 2 } }
}
"""
    run = bondgraph.load(text).simulate(target="numpy")
    np.testing.assert_allclose([run[n][0] for n in ("vx", "vy", "wx", "wy", "wz")], [0.2, -0.1, 1, 2, 3], rtol=1e-9)


@pytest.mark.parametrize("place", ["body", "joint"])
def test_a_turn_on_an_inclined_plane(place: str) -> None:
    """The head stays on z = x/2 with its given turn about z, and its velocity on it with the given rate; the search of the poses ended in a defect."""
    given = {"body": "", "joint": "", place: ", start rz = 30 deg, start rz.omega = 2 rad/s"}
    run = bondgraph.load(INCLINED.format(**given)).simulate(target="numpy")
    assert math.degrees(run["rz"][0]) == pytest.approx(30, rel=1e-9)
    assert run["z"][0] == pytest.approx(run["x"][0] / 2, rel=1e-9)
    assert run["x"][0] < 0.95 and run["wz"][0] ** 2 + run["wx"][0] ** 2 + run["wy"][0] ** 2 > 1


def test_a_whole_turn_that_no_loop_allows() -> None:
    given = {"body": "", "joint": ", start rx = 20 deg, start ry = 0, start rz = 30 deg"}
    with pytest.raises(RunFailed, match=r"cannot be closed with the starts of `s\.foot"):
        bondgraph.load(INCLINED.format(**given)).simulate(target="numpy")
