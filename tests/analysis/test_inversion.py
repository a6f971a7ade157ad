"""Inversion at rest: comb voltages for setpoints of the manipulator, and closed forms."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.commands import commands
from bondgraph.errors import RunFailed, UsageError
from tests.compiling import MODELS

PAIRS = ("push1/pull1", "push2/pull2", "push3/pull3")
SPRING = """
model A {
  parameter k = 8 [N/m], c = 2e-6 [N/V^2]
  input push = 0 V, pull = 0 V, load = 0 N
  I mass : p = 1 kg*v
  C spring : F = k*x
  R air : F = 1 [N*s/m]*v
  MSe comb : F = c*(push^2 - pull^2)
  MSe hand : F = load
  1 table : translation
  comb -> table
  hand -> table
  table -> mass, spring, air
  output x = spring.x
}
"""


@pytest.fixture(scope="module")
def manipulator() -> Any:
    return bondgraph.load(MODELS / "manipulator.bg")


SETPOINTS = [(n, s * v) for n in ("x", "y") for v in (4e-6, 8e-6, 12e-6) for s in (1, -1)]
SETPOINTS += [("phi", math.radians(s * v)) for v in (1, 2, 3) for s in (1, -1)]


@pytest.mark.few(9)
@pytest.mark.parametrize(("target", "value"), SETPOINTS)
def test_setpoints_of_the_manipulator(manipulator: Any, target: str, value: float) -> None:
    """To 1e-10 m, found again by the search for rest with these voltages; one of push and pull is zero."""
    wanted = {"x": 0.0, "y": 0.0, "phi": 0.0} | {target: value}
    found = manipulator.invert(wanted, PAIRS)
    rest = manipulator.equilibrium(settings=found.inputs)
    for name, reach in (("x", 1.0), ("y", 1.0), ("phi", 670e-6)):  # phi moves what is farthest out
        assert abs(rest[name] - wanted[name]) * reach < 1e-10
    assert found.stable
    for i in (1, 2, 3):
        assert (
            min(found.inputs[f"push{i}"], found.inputs[f"pull{i}"])
            == 0.0
            <= max(found.inputs[f"push{i}"], found.inputs[f"pull{i}"])
        )


def test_a_pair_and_a_single_input() -> None:
    model = bondgraph.load(SPRING)
    for x in (3e-6, -3e-6):
        found = model.invert({"x": x}, ("push/pull",))
        volt = math.sqrt(8 * abs(x) / 2e-6)
        wanted = (volt, 0.0) if x > 0 else (0.0, volt)
        assert (found.inputs["push"], found.inputs["pull"]) == (
            pytest.approx(wanted[0], rel=1e-12),
            pytest.approx(wanted[1], rel=1e-12),
        )
    assert model.invert({"x": "1 mm"}, ("load",)).inputs["load"] == pytest.approx(8e-3, rel=1e-12)
    back = model.invert({"x": 0.0}, ("push/pull",), settings={"load": "-1 uN"})
    assert back.inputs["push"] == pytest.approx(math.sqrt(0.5), rel=1e-12)


def test_a_single_input_whose_force_goes_with_its_square(tmp_path: Path) -> None:
    """From zero, where its derivative is zero: k x = c push^2, at rest, along a path and in the written model."""
    model = bondgraph.load(SPRING)
    found = model.invert({"x": "2 um"}, ["push"])
    assert found.inputs["push"] == pytest.approx(math.sqrt(8 * 2e-6 / 2e-6), rel=1e-12)
    with pytest.raises(RunFailed, match="no inputs were found that bring `x` there"):
        model.invert({"x": "-2 um"}, ["push"])
    along = model.invert({"x": "2 um*smoothstep9(time, 0 s, 10 s)"}, ["push"], to="10 s", points=101)
    step = np.polynomial.Polynomial([0, 0, 0, 0, 0, 126, -420, 540, -315, 70], domain=[0, 10], window=[0, 1])
    force = 2e-6 * (step.deriv(2) + step.deriv(1) + 8 * step)(along.time)
    np.testing.assert_allclose(along.inputs["push"] ** 2 * 2e-6, force, rtol=0, atol=1e-12 * force.max())
    (tmp_path / "A.bg").write_text(SPRING, encoding="utf-8")
    driven = bondgraph.load(tmp_path / "A.bg").invert(along.wanted, ["push"], to="10 s", points=101)
    driven.to_model(tmp_path / "driven.bg")
    ran = bondgraph.load(tmp_path / "driven.bg").simulate("follow")
    np.testing.assert_allclose(ran["x"], 2e-6 * step(ran.time), rtol=0, atol=1e-6 * 2e-6)


def test_command(tmp_path: Path) -> None:
    file = tmp_path / "spring.bg"
    file.write_text(SPRING, encoding="utf-8")
    arguments = ["invert", str(file), "--want", "x=3 um", "--by", "push/pull"]
    told = json.loads(CliRunner().invoke(commands, [*arguments, "--json"]).stdout)
    assert told["schema"] == "bondgraph-inversion/1"
    assert told["inputs"]["push"] == {"value": pytest.approx(math.sqrt(12), rel=1e-12), "unit": "V"}
    assert "stable" in CliRunner().invoke(commands, arguments).output


CARRIED = {
    "magnet": (
        """model A { input i = 0 A
  MSe magnet : F = -2e-4 [N*m^2/A^2]*i^2/gap^2
  Se weight : F = 0.5 N
  I ball : p = 0.05 kg*v
  signal gap = integral(ball.v, 8 mm)
  weight -> 1(magnet) -> ball
  output g = gap }""",
        {"g": "5 mm"}, ("i",), {"i": math.sqrt(0.5 * 25e-6 / 2e-4)},
    ),
    "arm": (
        """model A { input low = 0 [N*m], high = 0 [N*m]
  multibody w : planar { gravity = (0, -10 [m/s^2])
    body a { mass = 1 kg, inertia = 0.05 [kg*m^2], at = (0.3 m, 0) }
    body b { mass = 0.5 kg, inertia = 0.02 [kg*m^2], at = (0.9 m, 0) }
    hinge h : ground to a { at = (0, 0), start phi = 30 deg }
    hinge k : a to b { at = (0.6 m, 0), start phi = 40 deg }
    frame tip : b { at = (1.2 m, 0) }
  }
  MSe p : M = low
  MSe q : M = high
  p -> w.h
  q -> w.k
  output x = w.tip.x, y = w.tip.y }""",
        {"x": "0.6 m", "y": "0.6 m"}, ("low", "high"), {"low": 6.0, "high": 0.0},
    ),
    "boom": (
        """model A { input force = 0 N
  multibody w : planar { gravity = (0, -10 [m/s^2])
    body boom { mass = 100 kg, inertia = 30 [kg*m^2], at = (1 m, 0) }
    frame a : ground { at = (0.3 m, -0.4 m) }
    frame b : boom { at = (0.6 m, 0) }
    hinge h : ground to boom { at = (0, 0) }
    distance d : a to b
  }
  MSe f : F = force
  f -> w.d
  output length = w.d.d }""",
        {"length": "0.5 m"}, ("force",), {"force": 1000 / 0.48},
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CARRIED)
def test_what_does_not_rest_without_its_input_is_held_from_the_start(case: str) -> None:
    """A ball under a magnet falls without current; an arm hangs straight without torques, where none of small size moves its tip up.

    A boom without force hangs with its cylinder on the other side, where other forces hold the same length.
    """
    text, targets, inputs, expected = CARRIED[case]
    found = bondgraph.load(text).invert(targets, inputs)
    assert {n: abs(v) for n, v in found.inputs.items()} == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert found.outputs == pytest.approx(
        {n: float(v.split()[0]) * (1e-3 if "mm" in v else 1) for n, v in targets.items()}
    )


def test_refused() -> None:
    model = bondgraph.load(SPRING)
    with pytest.raises(UsageError, match="want as many inputs or pairs"):
        model.invert({"x": 1e-6}, ("load", "push"))
    with pytest.raises(UsageError, match="there is no output `y`; outputs are x"):
        model.invert({"y": 1e-6}, ("load",))
    with pytest.raises(RunFailed, match="no inputs were found"):
        model.invert({"x": -1e-6}, ("push",))  # which only pushes one way


@pytest.mark.parametrize("unit", [1.0, 1e-15, 1e9])
@pytest.mark.parametrize("x", [1e-4, 1e-2, -2e-4])
def test_an_input_that_acts_by_itself_and_by_its_square_in_all_units(unit: float, x: float) -> None:
    """z + 10 z^2 = 100 x: in units of femtocoulombs a thousandth of a coulomb would see the square alone."""
    text = f"""model A {{
      input charge = 0 C
      parameter a: N/C = {1 / unit!r}, b: N/C^2 = {10 / unit / unit!r}
      MSe s : F = a*charge + b*charge^2
      C c : F = 100 [N/m]*x
      R r : F = 1 [N*s/m]*v
      s -> 1(c, r)
      output x = c.x
    }}"""
    found = bondgraph.load(text).invert({"x": x}, ["charge"]).inputs["charge"] / unit
    assert found == pytest.approx((math.sqrt(1 + 4000 * x) - 1) / 20, rel=1e-12)
