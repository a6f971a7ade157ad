"""A spring stores the value of a joint's coordinate in the drawing."""

from __future__ import annotations

import pytest

import bondgraph


def test_rest_and_distance() -> None:
    model = bondgraph.load("""
      model M {
        multibody s : planar {
          body a { mass = 1 kg, inertia = 1 [kg*m^2] }
          body b { mass = 1 kg, inertia = 1 [kg*m^2], at = (1 m, 2 m) }
          slide j : ground to a { along = 0, rest = 5 mm }
          free f : ground to b { at = (1 m, 2 m), rest x = 3 mm, rest phi = 0.1 }
          distance d : a to b
        }
        C k : F = 10 [N/m]*x
        C l(x, y, phi) : energy = 1/2*(10 [N/m])*(x^2 + y^2) + 1 [N*m]*phi^2
        C g : F = 2 [N/m]*x
        s.j -> k
        s.f => l
        s.d -> g
        output x = k.x, q = s.j.x, fx = l.x, sf = s.f.x, turn = l.phi, gd = g.x, dd = s.d.d
      }
    """)
    result = model.simulate(to="1 us")
    found = {n: float(result[n][0]) for n in result.names}
    length = 5**0.5
    assert found == pytest.approx(
        {"x": 0.005, "q": 0.005, "fx": 0.003, "sf": 0.003, "turn": 0.1, "gd": length, "dd": length}, rel=1e-14
    )
