"""A gear on a hinge that closes a loop, a rigid frame with a bar too many, and the sparse solution of many rows."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from bondgraph.simulation.constraints.constraints import Least

GEARED = """model M {{
  multibody m : {kind} {{
    gravity = {g}
    body p {{ mass = 1 kg, inertia = {i}, at = (0.05 m, 0.2 m{z}) }}
    body q {{ mass = 1 kg, inertia = {i}, at = (0.5 m, 0.6 m{z}) }}
    body s {{ mass = 1 kg, inertia = {i}, at = (0.95 m, 0.4 m{z}) }}
    body w {{ mass = 1 kg, inertia = {i}, at = (3 m, 0{z}) }}
    hinge shaft : ground to w {{ at = (3 m, 0{z}){axis} }}
    hinge a : ground to p {{ at = (0, 0{z}){axis} }}
    hinge b : p to q {{ at = (0.1 m, 0.4 m{z}){axis} }}
    hinge c : q to s {{ at = (0.9 m, 0.8 m{z}){axis} }}
    hinge d : ground to s {{ at = (1 m, 0{z}){axis} }}
    gear mesh : {on} to shaft {{ ratio = -3 }}
  }}
  R ra : M = 0.1 [N*m*s]*omega
  R rb : M = 0.1 [N*m*s]*omega
  R rc : M = 0.1 [N*m*s]*omega
  R rw : M = 0.1 [N*m*s]*omega
  m.a -> ra
  m.b -> rb
  m.c -> rc
  m.shaft -> rw
  output a = m.a.phi, c = m.c.phi, w = m.shaft.phi, d = m.s.{turn}
  experiment go {{ simulate 0 .. 0.3 s {{ points = 4, rtol = 1e-9 }} }}
}}
"""
PLANE = {"kind": "planar", "g": "(0, -9.81 [m/s^2])", "i": "0.1 [kg*m^2]", "z": "", "axis": "", "turn": "phi"}
SPACE = {"kind": "spatial", "g": "(0, -9.81 [m/s^2], 0)", "i": "0.1 [kg*m^2]*(1, 1, 1)", "z": ", 0", "axis": ", about = (0, 0, 1)", "turn": "rz"}  # fmt: skip


def test_a_gear_on_a_hinge_that_closes_a_loop() -> None:
    """The plane and space write its acceleration in different ways; the wheel turns by the ratio, and both move alike."""
    plane, space = (bondgraph.load(GEARED.format(**kind, on="d")) for kind in (PLANE, SPACE))
    found = [model.simulate("go", target="numpy") for model in (plane, space)]
    assert np.abs(found[0]["a"]).max() > 0.02, "it moves"
    for run in found:
        assert run["w"] == pytest.approx(-3 * run["d"], abs=1e-9)
    for name in ("a", "c", "w", "d"):
        assert found[1][name] == pytest.approx(found[0][name], abs=1e-6), name


def test_a_rigid_frame_with_a_bar_too_many_stays() -> None:
    """Three bars from the ground to one point: no freedom, and constraints that follow from others."""
    text = """model M {
  multibody m : planar {
    gravity = (0, -9.81 [m/s^2])
    body p { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (0.25 m, 0.5 m) }
    body q { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (0.75 m, 0.5 m) }
    body r { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (0.5 m, 0.5 m) }
    hinge a : ground to p { at = (0, 0) }
    hinge b : ground to q { at = (1 m, 0) }
    hinge c : ground to r { at = (0.5 m, 0) }
    hinge d : p to q { at = (0.5 m, 1 m) }
    hinge e : p to r { at = (0.5 m, 1 m) }
  }
  output x = m.q.x, y = m.q.y
  experiment go { simulate 0 .. 0.1 s { points = 3 } }
}
"""
    found = bondgraph.load(text).simulate(target="numpy")
    assert found["x"] == pytest.approx(0.75, abs=1e-9) and found["y"] == pytest.approx(0.5, abs=1e-9)


@pytest.mark.parametrize("rows", [30, 80])
def test_the_shortest_step_is_that_of_least_squares(rows: int) -> None:
    rng = np.random.default_rng(rows)
    slopes, gap = rng.normal(size=(rows, 2 * rows)) * rng.uniform(0.1, 10, (rows, 1)), rng.normal(size=rows)
    solver = Least(slopes)
    assert solver.factor is not None
    assert solver.solve(gap) == pytest.approx(np.linalg.lstsq(slopes, gap, rcond=None)[0], rel=1e-9, abs=1e-11)
