"""Rests of which a coordinate is free: it is as at the start, in all units, unless a conserved sum says where the model stops."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed
from compiler.api import Source, scene_of
from tests.compiling import LIBRARY, MODELS
from tests.second_opinion.scales import POWERS, in_other_units

FLYWHEELS = """model Pair {
  "Two flywheels joined by a spring with a damper, that turn: nothing tells at which angle they would stop."
  I a : L = 2 [kg*m^2]*omega { start omega = 7 [rad/s] }
  I b : L = 3 [kg*m^2]*omega
  C k : M = 50 [N*m]*phi { start phi = 0.2 rad }
  R r : M = 4 [N*m*s]*omega
  1 A, B : rotation
  0 g : rotation
  A -> a
  B -> b
  A -> g -> B
  g -> 1(k, r)
  signal turn = integral(A.omega, 0.4)
  MTF lift : v2 = (1 mm*cos(turn))*omega1
  A -> lift
  lift -> 1(m)
  I m : p = 1 kg*v { prefer = derivative }
  output angle = turn, twist = k.phi
}"""


@pytest.mark.parametrize("powers", [POWERS[1], POWERS[7]])
@pytest.mark.parametrize("name", ["slider_crank", "crank_linkage"])
def test_a_crank_rests_where_it_starts(name: str, powers: dict[str, int]) -> None:
    """It turns at 60 rad/s, without drag: at rest it stands at its start, phi = 0.3 rad."""
    path = MODELS / f"{name}.bg"
    own = bondgraph.load(path)
    scene = scene_of(Source("model", path.read_text("utf-8"), path), LIBRARY, (own.name, None), None, {})
    text, factors = in_other_units(scene.text, powers)
    found = bondgraph.load(text, model=scene.model).equilibrium()
    piston = 0.04 * math.cos(0.3) + 0.13 * math.sqrt(1 - (0.04 * math.sin(0.3) / 0.13) ** 2)
    assert found["x"] / factors.of_unit("m") == pytest.approx(piston, rel=1e-11) and found["omega"] == 0


def test_a_part_of_a_family_moves_and_the_rest_settles() -> None:
    """The twist of the spring goes to zero, the angle stays."""
    found = bondgraph.load(FLYWHEELS).equilibrium()
    assert found["angle"] == pytest.approx(0.4, rel=1e-12) and abs(found["twist"]) < 1e-12


def test_a_large_model_stays_at_its_start_too() -> None:
    """52 wheels on springs with dampers, whose derivatives are sparse: the angle that a lift reads was where the search had left it, far away."""
    text = """model Shaft {
      for i in 1..52 {
        1 node[i] : rotation
        I wheel[i] : L = 2 [kg*m^2]*omega { start omega = i*0.1 [rad/s] }
        node[i] -> wheel[i]
      }
      for i in 1..51 {
        C k[i] : M = 50 [N*m]*phi
        R r[i] : M = 4 [N*m*s]*omega
        node[i] -> 0(1(k[i], r[i])) -> node[i+1]
      }
      signal turn = integral(node[1].omega, 0.4)
      MTF lift : v2 = (1 mm*cos(turn))*omega1
      node[1] -> lift -> 1(m)
      I m : p = 1 kg*v { prefer = derivative }
      output angle = turn, twist = k[1].phi
    }"""
    found = bondgraph.load(text).equilibrium()
    assert found["angle"] == pytest.approx(0.4, rel=1e-12) and abs(found["twist"]) < 1e-12


@pytest.mark.parametrize("resistance", [1e-6, 1.0, 1e9])
def test_a_conserved_sum_says_where_charges_rest(resistance: float) -> None:
    """1 uF at 3 V is joined to 2 uF: both rest at 1 V, as q1 + q2 = const. says, wherever else they could rest."""
    text = f"model A {{ C a : u = q/(1 uF) {{ start u = 3 V }}\n C b : u = q/(2 uF)\n R r : u = {resistance!r} ohm*i\n 1 w\n w -> a, r, b\n output y = a.u }}"
    assert bondgraph.load(text).equilibrium()["y"] == pytest.approx(1.0, rel=1e-12)


CART = """model Crane {{
  "A cart on a free rail with a pendulum whose pin rubs."
  multibody crane : planar {{
    gravity = (0, -9.81 [m/s^2])
    body cart {{ mass = 2 kg, at = (0, 0) }}
    body bob {{ mass = 1 kg, inertia = 0.1 [kg*m^2], at = (0, -1 m) }}
    slide rail : ground to cart {{ along = 0, start x = 0.7 m{0} }}
    hinge pin : cart to bob {{ at = (0, 0), start phi = {1} }}
  }}
  R rub : M = 0.1 [N*m*s]*omega
  crane.pin -> rub
  {2}
  output place = crane.rail.x, twist = crane.pin.phi
}}"""
PAIR = """model Pair {
  "Two bodies on a pin with a spring and a damper; nothing holds them."
  multibody two : planar {
    body a { mass = 2 kg, inertia = 0.3 [kg*m^2] }
    body b { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (1 m, 0) }
    free f : ground to a { start x = 2 m, start phi = 0.7 }
    hinge pin : a to b { at = (0.5 m, 0), start phi = 1.1 }
  }
  C k : M = 3 [N*m]*phi
  R r : M = 0.5 [N*m*s]*omega
  two.pin -> k, r
  output place = two.f.phi, twist = two.pin.phi
}"""
TORQUE = "Se drive : M = 1 N*m\n  drive -> crane.pin"


@pytest.mark.parametrize(
    ("text", "twist"),
    [(CART.format("", 0.3, ""), 0.0), (CART.format("", 3.0, TORQUE), math.asin(1 / 9.81)), (PAIR, 0.0)],
)
def test_what_starts_without_motion_does_not_drift(text: str, twist: float) -> None:
    """The momentum is that of the start, none; steps of the search do not keep it, as it depends on the pose."""
    found = bondgraph.load(text).equilibrium()
    assert found["place"] == pytest.approx(0.7, rel=1e-12) and found["twist"] == pytest.approx(twist, abs=1e-12)
    assert not found.steady


@pytest.mark.parametrize("text", [CART.format(", start x.v = 0.1 [m/s]", 0.3, ""), CART.format("", 0.3, "Se push : F = 1 N\n  push -> crane.rail")])  # fmt: skip
def test_a_cart_that_moves_or_is_pushed_has_no_rest(text: str) -> None:
    with pytest.raises(RunFailed, match="no equilibrium was found"):
        bondgraph.load(text).equilibrium()


def test_a_branch_goes_along_its_parameter_where_a_place_is_free() -> None:
    """Not along the family of rests: it ended where it began, without a word. The torque holds the bob at asin(M/(m g l)), up to a fold."""
    text = CART.format("", 0.3, "input torque = 0 N*m\n  MSe drive : M = torque\n  drive -> crane.pin")
    branch = bondgraph.load(text).continuation("torque", 0, 12.0)
    assert [(s.kind, s.value) for s in branch.special] == [("fold", pytest.approx(9.81, rel=1e-9))]
    assert len(branch) > 20 and abs(branch["place"] - 0.7).max() < 1e-12
    assert abs(9.81 * np.sin(branch["twist"]) - branch["torque"]).max() < 1e-9


def test_a_branch_of_two_flywheels_winds_their_spring() -> None:
    drives = (
        "parameter torque = 0 [N*m]\n  Se one : M = torque\n  Se other : M = -torque\n  one -> A\n  other -> B\n  I a"
    )
    text = FLYWHEELS.replace("I a", drives, 1).replace("{ start omega = 7 [rad/s] }", "")
    branch = bondgraph.load(text).continuation("torque", 0, 10.0)
    assert branch["twist"][-1] == pytest.approx(0.2, rel=1e-9) and abs(branch["angle"] - 0.4).max() < 1e-12
