"""Frequency response: closed forms, python-control where it is installed, and the model itself under harmonic excitation."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import bondgraph
from bondgraph.analysis.response import first_harmonic
from bondgraph.errors import UsageError
from tests.compiling import MODELS

OSCILLATOR = """
model A {
  parameter m = 2 kg, k = 50 [N/m], r = 3 [N*s/m]
  I mass : p = m*v
  C spring : F = k*x
  R damper : F = r*v
  1 body : translation
  body -> mass, spring, damper
  output x = spring.x
}
"""
DRIVEN = OSCILLATOR.replace("body -> mass", "input f = 3 N\n  MSe push : F = f\n  push -> body -> mass")


def test_a_first_harmonic_and_what_moves_beside_it() -> None:
    """Im((3 + 4i) exp(i w t)) has an amplitude of 5; a tone of 0.5 beside it is a tenth."""
    time = np.arange(600) / 200.0
    values = 3 * np.sin(4 * np.pi * time) + 4 * np.cos(4 * np.pi * time) + 0.5 * np.sin(12 * np.pi * time) + 7
    value, share = first_harmonic(time, values, 2.0)
    assert (value, share) == (pytest.approx(3 + 4j, rel=1e-12), pytest.approx(0.1, rel=1e-12))


def test_oscillator() -> None:
    """1/(k - m w^2 + i r w), at every frequency, resonance included."""
    found = bondgraph.load(DRIVEN).response("f", "x")
    w = 2 * np.pi * found.frequencies
    assert found.of("f", "x") == pytest.approx(1 / (50 - 2 * w**2 + 3j * w), rel=1e-12)
    peak = np.sqrt(50 / 2) * np.sqrt(1 - 2 * (3 / (2 * np.sqrt(100))) ** 2) / (2 * np.pi)
    assert found.frequencies[found.magnitude[:, 0, 0].argmax()] == pytest.approx(peak, rel=0.02)
    assert found.unit("f", "x") == "m/N" and found.phase[-1, 0, 0] < -170


def test_direct_current_is_the_slope_of_the_equilibrium() -> None:
    """Far below all modes the manipulator's x over fx is the slope of its positions of rest."""
    model = bondgraph.load(MODELS / "manipulator.bg")
    still = model.response("fx", "x", 1e-3, 1e-2, 2, settings={"fx": "20 uN"}).of("fx", "x")[0]
    above, below = (model.equilibrium(settings={"fx": f})["x"] for f in (20.02e-6, 19.98e-6))
    assert still.real == pytest.approx((above - below) / 0.04e-6, rel=1e-6) and abs(still.imag) < 1e-6 * still.real


def test_harmonic_excitation_finds_the_same() -> None:
    """The motor with its inertia: 12 V plus a sine; and a hardening spring, whose response is linear for small forces alone."""
    motor = bondgraph.load(MODELS / "dc_motor.bg")
    for frequency in (10.0,):
        measured = motor.excite("volt", "speed", frequency, 1.0)
        exact = motor.response("volt", "speed", frequency, 2 * frequency, 2).of("volt", "speed")[0]
        assert measured.value == pytest.approx(exact, rel=1e-6) and measured.distortion < 1e-5
    hard = bondgraph.load(DRIVEN.replace("F = k*x", "F = k*x + 4000 [N/m^3]*x^3"))
    exact = hard.response("f", "x", 0.9, 1.0, 2).of("f", "x")[0]
    small, large = (hard.excite("f", "x", 0.9, a, rtol=1e-7) for a in (1e-2, 1.0))
    assert small.value == pytest.approx(exact, rel=1e-4)
    assert abs(large.value / exact - 1) > 1e-3 and large.distortion > 1e-3 > small.distortion


def test_against_python_control() -> None:
    control = pytest.importorskip("control")
    linear = bondgraph.load(MODELS / "manipulator.bg").linearize(("fx", "fy"), ("x", "phi"))
    found = bondgraph.load(MODELS / "manipulator.bg").response(("fx", "fy"), ("x", "phi"), 100, 10e3, 50)
    for f, value in zip(found.frequencies, found.values, strict=True):
        wanted = np.atleast_2d(control.evalfr(linear.to_control(), 2j * np.pi * f))
        assert np.abs(value - wanted).max() <= 1e-9 * np.abs(wanted).max()


def test_motor_by_its_transfer_function() -> None:
    """Speed of the load over voltage: K/((L s + R)(J s + b) + K^2)/N, with J and b of the load seen through the gear."""
    model = bondgraph.load(MODELS / "dc_motor.bg")
    found = model.response("volt", "speed", 0.1, 1000, 20)
    p = {n: q.value for n, q in model.parameters.items()}
    s = 2j * np.pi * found.frequencies
    inertia, bearing = p["J"] + p["J_load"] / p["N"] ** 2, p["b"] / p["N"] ** 2
    wanted = p["K"] / ((p["L"] * s + p["R"]) * (inertia * s + bearing) + p["K"] ** 2) / p["N"]
    assert found.of("volt", "speed") == pytest.approx(wanted, rel=1e-11)


def test_json_and_plot(tmp_path: Path) -> None:
    found = bondgraph.load(DRIVEN).response(points=20)
    told = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert told["schema"] == "bondgraph-response/1" and len(told["responses"][0]["values"]) == len(told["frequencies"])
    pytest.importorskip("matplotlib")
    found.plot(tmp_path / "bode.svg")
    assert "phase" in (tmp_path / "bode.svg").read_text(encoding="utf-8")


def test_refused() -> None:
    with pytest.raises(UsageError, match="leads from an input"):
        bondgraph.load(OSCILLATOR).response()
    with pytest.raises(UsageError, match="upwards from above zero"):
        bondgraph.load(DRIVEN).response(low=10, high=1)
    with pytest.raises(UsageError, match="never settles"):
        bondgraph.load(DRIVEN).excite("f", "x", 1.0, 1.0, settings={"r": 0.0})
    with pytest.raises(UsageError, match="`r` is no input"):
        bondgraph.load(DRIVEN).excite("r", "x", 1.0, 1.0)


LATE = """model A {{
  input w = 1 V
  {signal}
  MSe s : u = w - {gain!r}*({late})
  R r : u = 1e3 [ohm]*i
  C c : u = q/1 uF
  s -> 1(r) -> c
  output y = c.u
}}"""


class TestDelays:
    @pytest.mark.parametrize("ask", ["equilibrium", "modes", "linearize", "response", "sensitivity"])
    def test_they_are_refused_with_their_line(self, ask: str) -> None:
        made = bondgraph.load(LATE.format(signal="", gain=0.5, late="delay(c.u, 1 ms)"))
        arguments = (["w"], ["y"]) if ask == "response" else ()
        with pytest.raises(
            UsageError,
            match=r"^\S*:4: the `delay` of `c.u` .*`2\*z - x` with `signal z = integral\(2\*\(x - z\)/T, x0\)`",
        ):
            getattr(made, ask)(*arguments)

    @pytest.mark.parametrize("gain", [0.2, 0.9])
    @pytest.mark.parametrize("lag", [1e-6, 1e-4, 1e-3])
    def test_the_advice_works(self, gain: float, lag: float) -> None:
        """1/(1 + s tau + k exp(-s T)) within the third power of w T, at a hundredth to a fifth of 1/T."""
        text = LATE.format(signal=f"signal z = integral(2*(c.u - z)/({lag!r} s), 0 V)", gain=gain, late="2*z - c.u")
        found = bondgraph.load(text)
        assert found.equilibrium()["y"] == pytest.approx(1 / (1 + gain), rel=1e-9)
        high = 0.2 / lag / (2 * np.pi)
        response = found.response(["w"], ["y"], high / 20, high, points=5)
        s = 2j * np.pi * np.array(response.frequencies)
        exact = 1 / (1 + s * 1e-3 + gain * np.exp(-s * lag))
        assert (np.abs(response.of("w", "y") / exact - 1) < np.abs(s * lag) ** 3 / 6).all()
