"""Derivatives of linear models and frequency responses by parameters: closed forms, else differences of high order."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.commands import commands
from bondgraph.errors import RunFailed, UsageError
from tests.analysis.test_sensitivity import PLATE, difference
from tests.compiling import MODELS

OSCILLATOR = """
model A {
  parameter m = 2 kg, k = 50 [N/m], r = 3 [N*s/m]
  input push = 7 N
  I mass : p = m*v
  C spring : F = k*x
  R damper : F = r*v
  MSe hand : F = push
  hand -> 1(mass, spring, damper)
  output x = spring.x
}
"""


def test_a_response_in_closed_form() -> None:
    """G = 1 / (k - m w^2 + i w r): its derivatives are -G^2, w^2 G^2 and -i w G^2."""
    found = bondgraph.load(OSCILLATOR).sensitivity_of_response(low=0.1, high=10, points=30)
    w, g = 2 * np.pi * found.response.frequencies, found.response.of("push", "x")
    np.testing.assert_allclose(g, 1 / (50 - 2 * w**2 + 3j * w), rtol=1e-12)
    for name, wanted in (("k", -(g**2)), ("m", w**2 * g**2), ("r", -1j * w * g**2)):
        np.testing.assert_allclose(found.of("push", "x", name), wanted, rtol=1e-11)
    place = found.parameters.index("r")
    resonance = int(np.abs(g).argmax())
    assert found.relative[resonance, 0, 0, place] == pytest.approx(-1, abs=0.1)
    np.testing.assert_allclose(found.phase[:, 0, 0, place], np.degrees((-1j * w * g).imag), rtol=1e-10)


def test_a_linear_model_in_closed_form() -> None:
    found = bondgraph.load(OSCILLATOR).sensitivity_of_linearization()
    values = dict(zip(found.quantities, found.values.tolist(), strict=True))
    assert values == {
        "A[mass.p, mass.p]": -1.5, "A[mass.p, spring.x]": -50.0, "A[spring.x, mass.p]": 0.5, "B[mass.p, push]": 1.0, "C[x, spring.x]": 1.0,
    }  # fmt: skip
    for quantity, parameter, wanted in (
        ("A[mass.p, mass.p]", "m", 0.75), ("A[mass.p, mass.p]", "r", -0.5), ("A[mass.p, spring.x]", "k", -1), ("A[spring.x, mass.p]", "m", -0.25),
        ("A[mass.p, spring.x]", "m", 0), ("B[mass.p, push]", "m", 0),
    ):  # fmt: skip
        assert found.of(quantity, parameter) == pytest.approx(wanted, abs=1e-14)
    assert found.units["A[mass.p, mass.p]"] == "1/s" and found.units["C[x, spring.x]"] == "1"


def test_the_pose_at_rest_moves_too() -> None:
    """A nonlinear loop at rest under a voltage: all that moves with the gap, against differences."""
    model = bondgraph.load(PLATE)
    found = model.sensitivity_of_linearization("g", inputs="volt")
    told = model.sensitivity_of_response("g", "volt", "x", 100.0, 1e5, 20)
    frequencies = told.response.frequencies

    def at(gap: float) -> tuple[dict[str, float], np.ndarray]:
        linear = model.linearize(("volt",), settings={"g": gap})
        whole = np.block([[linear.A, linear.B], [linear.C, linear.D]])
        rows, columns = (*linear.states, *linear.outputs), (*linear.states, *linear.inputs)
        n = len(linear.states)
        entries = {
            f"{('A' if j < n else 'B') if i < n else ('C' if j < n else 'D')}[{rows[i]}, {columns[j]}]": whole[i, j]
            for i in range(len(rows))
            for j in range(len(columns))
        }
        from bondgraph.analysis.response import transfer

        return entries, transfer(linear, 2j * np.pi * frequencies)[:, linear.outputs.index("x"), 0]

    for name in found.quantities:
        wanted = difference(lambda g, name=name: at(g)[0][name], 3e-6, 1e-9)
        assert found.of(name, "g") == pytest.approx(wanted, rel=1e-7, abs=1e-9 * abs(at(3e-6)[0][name]) / 3e-6), name
    wanted = difference(lambda g: at(g)[1], 3e-6, 1e-9)
    np.testing.assert_allclose(told.of("volt", "x", "g"), wanted, rtol=1e-7)


def test_loops_of_joints() -> None:
    """Rates keep the constraints: a four-bar on a spring answers a torque, and how that moves with a link; its A is a choice of coordinates."""
    model = bondgraph.load(CLOSED)
    found = model.sensitivity_of_response(("L", "k"), "torque", "angle", 0.1, 20.0, 12)
    frequencies = found.response.frequencies
    for name, at in (("L", 0.3), ("k", 5.0)):

        def moved(value: float, name: str = name) -> np.ndarray:
            from bondgraph.analysis.response import transfer

            linear = model.linearize(("torque",), ("angle",), settings={name: value})
            return transfer(linear, 2j * np.pi * frequencies)[:, 0, 0]

        np.testing.assert_allclose(found.of("torque", "angle", name), difference(moved, at, 1e-3 * at), rtol=2e-6)
    with pytest.raises(UsageError, match="closing joints tie coordinates"):
        model.sensitivity_of_linearization("k", "torque")


CLOSED = """
model Closed {
  parameter L: m = 0.3, k: N*m = 5, r: N*m*s = 0.2
  input torque = 0.1 [N*m]
  multibody m : planar {
    gravity = (0, -9.81 [m/s^2])
    body crank { mass = 1 kg, inertia = 0.01 [kg*m^2], at = (0, 0.15 m) }
    body coupler { mass = 2 kg, inertia = 0.02 [kg*m^2], at = (0.25 m, 0.35 m) }
    body rocker { mass = 1 kg, inertia = 0.01 [kg*m^2], at = (0.5 m, 0.2 m) }
    hinge one : ground to crank { at = (0, 0) }
    hinge two : crank to coupler { at = (0, L) }
    hinge three : coupler to rocker { at = (0.5 m, 0.4 m) }
    hinge four : ground to rocker { at = (0.5 m, 0) }
  }
  C spring : M = k*phi
  R damper : M = r*omega
  MSe motor : M = torque
  1 turning
  motor -> turning -> m.one
  turning -> spring, damper
  output angle = m.one.phi
}
"""


def test_what_cannot_be_asked() -> None:
    model = bondgraph.load(OSCILLATOR)
    with pytest.raises(UsageError, match="there is no `r2` in this sensitivity; there is m"):
        model.sensitivity_of_response("m", low=1, high=2, points=2).of("push", "x", "r2")
    free = bondgraph.load(OSCILLATOR.replace("r = 3 [N*s/m]", "r = 0 [N*s/m]"))
    with pytest.raises(RunFailed, match="an undamped mode answers without bound"):
        free.sensitivity_of_response("m", low=5 / (2 * np.pi), high=10, points=2)


def test_on_the_command_line() -> None:
    model = str(MODELS / "manipulator.bg")
    arguments = [
        "sensitivity",
        model,
        "--input",
        "fx",
        "--output",
        "x",
        "--by",
        "h",
        "--of",
        "response",
        "--over",
        "1 Hz .. 1 kHz",
        "--points",
        "20",
    ]
    done = CliRunner().invoke(commands, arguments)
    assert done.exit_code == 0 and "percent per percent" in done.stdout
    told = json.loads(CliRunner().invoke(commands, [*arguments, "--json"]).stdout)
    assert told["schema"] == "bondgraph-response-sensitivity/1"
    (first, *_) = told["responses"]
    assert len(first["slopes"]["h"]) == len(told["frequencies"]) == len(first["values"])
    both = CliRunner().invoke(commands, [*arguments, "--of", "modes"])
    assert both.exit_code == 2 and "--of response stands alone" in both.stderr
    linear = json.loads(
        CliRunner().invoke(commands, ["sensitivity", str(MODELS / "rlc.bg"), "--of", "linearize", "--json"]).stdout
    )
    assert any(name.startswith("A[") for name in linear["quantities"])
