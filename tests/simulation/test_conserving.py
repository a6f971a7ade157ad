"""The energy-conserving method: its order, 1e5 periods without a trend, and its refusals."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import UsageError
from tests.compiling import MODELS

NAME = "Gauss 6 with constant energy"

SPRING = """model Duffing {
  I mass   : p = 1 kg*v
  C spring : F = 1 [N/m]*x + 4 [N/m^3]*x^3 { start x = 1 [m] }
  1 body
  body -> mass, spring
  output held = 0.5/1 [kg]*mass.p^2 + 0.5 [N/m]*spring.x^2 + 1 [N/m^3]*spring.x^4, x = spring.x
}"""
CIRCUIT = """model Lossless {
  I coil : lambda = 1 H*i
  C cap  : u = q/(1 F) { start q = 1 C }
  1 loop
  loop -> coil, cap
  output held = 0.5/1 [H]*coil.lambda^2 + 0.5/1 [F]*cap.q^2, x = cap.q
}"""
PENDULUM = """model Pendulum {
  parameter g = 1 [m/s^2]
  multibody swing : planar {
    gravity = (0, -g)
    body bob { mass = 1 kg, at = (1 m, 0 m) }
    hinge pin : ground to bob { at = (0 m, 0 m) }
  }
  output held = 0.5 [kg*m^2]*swing.pin.omega^2 + 1 [kg]*g*swing.bob.y, x = swing.bob.x
}"""
# A body that a force of 1/r^2 draws to the centre, in polar coordinates: angular momentum 1, eccentricity 0.3.
KEPLER = """model Orbit {
  I mass  : p = 1 kg*v { start p = 0 }
  C fall  : energy = 0.5 [J*m^2]/(1 [m] + x)^2 - 1 [J*m]/(1 [m] + x) { start x = -0.230769230769230769 [m] }
  1 away
  away -> mass, fall
  output held = 0.5/1 [kg]*mass.p^2 + 0.5 [J*m^2]/(1 [m] + fall.x)^2 - 1 [J*m]/(1 [m] + fall.x), x = fall.x
}"""
LOSSLESS = {
    "duffing": (SPRING, 3.24),
    "circuit": (CIRCUIT, 2 * math.pi),
    "pendulum": (PENDULUM, 7.42),
    "orbit": (KEPLER, 7.24),
}


def drift(text: str, period: float, periods: float, **settings: Any) -> tuple[float, float]:
    """Largest change of the energy and its trend over the run, both relative; from outputs, not from the solver's own data."""
    found = bondgraph.load(text).simulate(to=period * periods, points=997, solver="energy", **settings)
    assert found.solver.startswith(NAME)
    held = found["held"]
    change = (held - held[0]) / (abs(held[0]) if held[0] else 1.0)
    return float(np.abs(change).max()), abs(float(np.polyfit(found.time / found.time[-1], change, 1)[0]))


@pytest.mark.few(2)
@pytest.mark.parametrize("name", LOSSLESS)
def test_energy_stays(name: str) -> None:
    largest, trend = drift(*LOSSLESS[name], periods=6)
    assert largest < 1e-12 and trend < 1e-12


@pytest.mark.machine_code
@pytest.mark.parametrize(("name", "periods"), [("circuit", 1e5), ("duffing", 1e4), ("pendulum", 1e4), ("orbit", 1e4)])
def test_energy_stays_over_many_periods(name: str, periods: float) -> None:
    largest, trend = drift(*LOSSLESS[name], periods=periods)
    assert largest < 1e-11 and trend < 1e-11


def test_the_order_is_six() -> None:
    """Against a solution to twelve digits: half the step, a 64th of the error; and a tolerance means what it says."""
    exact = bondgraph.load(SPRING).simulate(to=6, points=7, rtol=1e-12, solver="explicit")["x"]
    errors, steps = [], []
    for rtol in (1e-4, 1e-6, 1e-8, 1e-10):
        found = bondgraph.load(SPRING).simulate(to=6, points=7, rtol=rtol, solver="energy")
        errors.append(float(np.abs(found["x"] - exact).max()))
        steps.append(found.steps)
        assert errors[-1] < 100 * rtol
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope == pytest.approx(-6, abs=0.7)


def test_a_quadratic_energy_needs_no_help_and_the_phase_is_right() -> None:
    found = bondgraph.load(CIRCUIT).simulate(to=20, points=201, rtol=1e-10, solver="energy")
    np.testing.assert_allclose(found["x"], np.cos(found.time), atol=1e-8)


def test_an_experiment_may_ask_for_it() -> None:
    text = SPRING.replace("output held", "experiment long { simulate 0 .. 10 s { solver = energy } }\n  output held")
    assert bondgraph.load(text).simulate(points=11).solver.startswith(NAME)


def test_jumps_of_nothing_that_matters_and_work_are_fine() -> None:
    """The audit of the energy, and a source that gives nothing."""
    found = bondgraph.load(SPRING).simulate(to=10, points=11, solver="energy", energy=True)
    assert found.energy is not None and abs(found.energy.stored) < 1e-12 and abs(found.energy.residual) < 1e-12


@pytest.mark.parametrize(
    ("model", "words"),
    [
        ("oscillator.bg", "damper` takes|push` takes"),
        ("quarter_car.bg", "events"),
        ("four_bar.bg", "closed loops"),
        ("lotka_volterra.bg", "nothing in it stores"),
    ],
)
def test_what_is_not_lossless_is_refused_by_name(model: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        bondgraph.load(MODELS / model).simulate(solver="energy")
