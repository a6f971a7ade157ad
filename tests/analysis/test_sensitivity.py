"""Sensitivities: closed forms to rounding, and differences of high order where there are none."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.analysis.sensitivity import balanced_step
from bondgraph.errors import UsageError
from tests.compiling import MODELS

# A plate pulled by a voltage through a resistor, on a spring: a nonlinear loop of charge, gap and force.
PLATE = """
model A {
  parameter g = 3 um, area = 1 [mm^2], eps = 8.85e-12 [F/m], k = 8 [N/m], m = 20 ug, r = 2e-4 [N*s/m], R = 1 kohm
  input volt = 2 V
  MSe source : u = volt
  R lead : u = R*i
  C plates(q: electric, x: translation) : energy = 1/2*q^2*(g - x)/(eps*area)
  1 plate : translation
  I mass : p = m*v
  C spring : F = k*x
  R air : F = r*v
  source -> 1(lead, plates.q)
  plate -> plates.x, mass, spring, air
  output x = spring.x, stiff = k
}
"""


def difference(function: Callable[[float], Any], at: float, step: float) -> Any:
    """Of fourth order."""
    return (8 * (function(at + step) - function(at - step)) - (function(at + 2 * step) - function(at - 2 * step))) / (
        12 * step
    )


def test_oscillator() -> None:
    text = """
    model A {
      parameter m = 2 kg, k = 50 [N/m], r = 3 [N*s/m], F = 7 N
      I mass : p = m*v
      C spring : F = k*x
      R damper : F = r*v
      Se push : F = F
      push -> 1(mass, spring, damper)
      output x = spring.x
    }
    """.replace("F = 7 N", "load = 7 N").replace("push : F = F", "push : F = load")
    found = bondgraph.load(text).sensitivity()
    f, zeta = math.sqrt(50 / 2) / (2 * math.pi), 3 / (2 * math.sqrt(100))
    assert set(found.parameters) == {"m", "k", "r", "load"}
    for quantity, parameter, wanted in (
        ("x", "k", -7 / 50**2), ("x", "load", 1 / 50), ("x", "m", 0), ("frequency 1", "k", f / 100), ("frequency 1", "m", -f / 4),
        ("frequency 1", "r", 0), ("damping 1", "r", zeta / 3), ("damping 1", "k", -zeta / 100), ("damping 1", "m", -zeta / 4),
    ):  # fmt: skip
        assert found.of(quantity, parameter) == pytest.approx(wanted, rel=1e-12, abs=1e-14), (quantity, parameter)
    assert found.relative[found.quantities.index("frequency 1")].tolist() == pytest.approx(
        [{"m": -0.5, "k": 0.5, "r": 0, "load": 0}[p] for p in found.parameters], abs=1e-13
    )
    assert json.loads(json.dumps(found.to_json(), allow_nan=False))["schema"] == "bondgraph-sensitivity/1"
    assert "percent" in found.summary()
    shown = bondgraph.load(text.replace("output x", "output x: mm"))
    assert " 140 mm " in shown.sensitivity().summary()
    assert "  [mm]/[N]  " in shown.sensitivity_of_run("load", to="1 s", points=2).summary()


def test_the_point_of_rest_moves_the_modes() -> None:
    """Under voltage the electrostatic spring softens: df/dV comes through dx/dV alone and through V itself."""
    model = bondgraph.load(PLATE)
    found = model.sensitivity(("volt", "g"))
    x, volt, g, ea, k = found.values[0], 2.0, 3e-6, 8.85e-18, 8.0
    assert k * x * 2 * (g - x) ** 2 == pytest.approx(ea * volt**2, rel=1e-12)
    assert found.of("x", "volt") == pytest.approx(2 * x * (g - x) / (volt * (g - 3 * x)), rel=1e-10)
    moving = [n for n in found.quantities if n.startswith(("frequency", "damping"))]
    for name, at in (("volt", 2.0), ("g", 3e-6)):

        def numbers(value: float, name: str = name) -> Any:
            modes = [m for m in model.modes(settings={name: value}) if m.frequency > 0]
            return np.array([n for m in modes for n in (m.frequency, m.damping)])

        wanted = difference(numbers, at, 1e-3 * at)
        assert [found.of(n, name) for n in moving] == pytest.approx(wanted, rel=1e-7, abs=1e-9)


def test_through_closing_joints() -> None:
    """A loaded four-bar: bar lengths move the pose, the multipliers and the swinging about it."""
    model = bondgraph.load(MODELS / "four_bar.bg")
    found = model.sensitivity(("coupler",), experiment=None)
    for name, at in zip(found.parameters, found.at, strict=True):

        def numbers(value: float, name: str = name) -> Any:
            (mode,) = model.modes(None, {name: value})
            rest = model.equilibrium(None, {name: value})
            return np.array([rest["angle"], rest["load_y"], mode.frequency, mode.damping])

        wanted = difference(numbers, at, 1e-3 * at)
        got = [found.of(q, name) for q in ("angle", "load_y", "frequency 1", "damping 1")]
        assert got == pytest.approx(wanted, rel=1e-7, abs=1e-9)


def test_what_follows_from_others() -> None:
    """By the quantity alone, with the others constant; by a parameter it depends on, with all that depends on that."""
    text = "model A { parameter a = 3, k: N/m = 2 [N/m]*a^2, m = 2 kg; I mass : p = m*v; C spring : F = k*x; 1 b : translation; b -> mass, spring; output x = spring.x }"
    model = bondgraph.load(text)
    f = math.sqrt(18 / 2) / (2 * math.pi)
    assert model.sensitivity("k", of="modes").of("frequency 1", "k") == pytest.approx(f / 36, rel=1e-12)
    assert model.sensitivity("a", of="modes").of("frequency 1", "a") == pytest.approx(f / 3, rel=1e-12)


def test_refused() -> None:
    with pytest.raises(UsageError, match="`x` is no parameter or input"):
        bondgraph.load(PLATE).sensitivity("x")
    with pytest.raises(UsageError, match="there is no `mass`"):
        bondgraph.load(PLATE).sensitivity("g").of("mass", "g")


def test_what_is_conserved_stays_in_its_own_units() -> None:
    """Rates in any ratio of sizes: x1' = -a x1 + b x2 + 1, x2' = -r x1', so that r x1 + x2 stays."""
    for ratio in (1e-6, 1.0, 1e6):
        A, B = np.array([[-1.0, 2.0], [ratio, -2.0 * ratio]]), np.array([[1.0], [-ratio]])
        found, left = balanced_step(A, B)
        assert found[:, 0] == pytest.approx([1 / (1 + 2 * ratio), -ratio / (1 + 2 * ratio)], rel=1e-12)
        assert left.max() < 1e-12


def test_an_input_that_an_experiment_moves() -> None:
    """The advice works: the value that is given, or the model without the experiment."""
    text = """model A {
      input load = 6 N
      MSe s : F = load
      C c : F = 3 [N/m]*x
      R r : F = 1 [N*s/m]*v
      s -> 1(c, r)
      output x = c.x
      experiment shake { set load = 1 N*sin(1 [rad/s]*time); simulate 0 .. 1 s }
    }"""
    model = bondgraph.load(text)
    with pytest.raises(UsageError, match=r"moves with time: give it a value .* `-e none`"):
        model.sensitivity(["load"], "equilibrium")
    assert model.sensitivity(["load"], "equilibrium", experiment=None).of("x", "load") == pytest.approx(1 / 3)
    assert model.sensitivity(["load"], "equilibrium", settings={"load": 2.0}).of("x", "load") == pytest.approx(1 / 3)
    assert model.invert({"x": 1.0}, ["load"], experiment=None).inputs["load"] == pytest.approx(3.0)
