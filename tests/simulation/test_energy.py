"""The energy audit: each element's share, the unexplained remainder, and laws that create energy by name."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from bondgraph.results.records import ElementEnergy, EnergyBalance
from bondgraph.simulation.monitors.energy import unexplained

SWUNG = """
model Swung {
  "A damper that a signal turns into an engine for half of the time."
  I mass   : p = 2 kg*v       { start v = 1 [m/s] }
  C spring : F = 50 [N/m]*x + 20 [N/m^3]*x^3
  signal r = 0.5 [N*s/m]*%s
  MR damper : F = r*v
  1 body
  body -> mass, spring, damper
  output x = spring.x, v = mass.v
}
"""


@pytest.mark.parametrize("target", ["numpy", pytest.param("native", marks=pytest.mark.machine_code)])
def test_a_resistor_that_gives_is_named_with_its_instants(target: str) -> None:
    found = bondgraph.load(SWUNG % "cos(pi*time/1 s)").simulate(
        to=2, points=2001, rtol=1e-9, energy=True, target=target
    )
    (note,) = found.notes
    assert note.startswith("`damper` gives energy where a resistor takes it: from t = 0.501 s on, most of it (")
    assert found.energy is not None
    power = 0.5 * np.cos(np.pi * found.time) * found["v"] ** 2
    taken = float(((power[1:] + power[:-1]) / 2 * np.diff(found.time)).sum())
    shares = {e.name: e for e in found.energy.elements}
    assert shares["damper"].dissipated == pytest.approx(taken, rel=1e-5)
    x, v = found.final("x"), found.final("v")
    assert shares["spring"].stored == pytest.approx(25 * x**2 + 5 * x**4, rel=1e-9)
    assert shares["mass"].stored == pytest.approx(v**2 - 1, rel=1e-9)


def test_a_resistor_that_takes_is_not() -> None:
    assert bondgraph.load(SWUNG % "(1 + cos(pi*time/1 s))").simulate(to=2, energy=True).notes == ()


@pytest.mark.parametrize("model", ["oscillator", "dc_motor", "brake"])
def test_shares_of_the_residual_add_up(model: str) -> None:
    """Work on storages is integrated, their energy is a function of the state: the difference is the error of each."""
    energy = bondgraph.load(f"models/{model}.bg").simulate(energy=True).energy
    assert energy is not None
    turnover = sum(abs(e.supplied) + abs(e.dissipated) + abs(e.stored) for e in energy.elements)
    assert sum(e.residual for e in energy.elements) == pytest.approx(energy.residual, abs=1e-9 * turnover)
    assert all(e.residual == 0 for e in energy.elements if e.kind in ("R", "Se", "Sf"))
    assert max(abs(e.residual) for e in energy.elements) < 1e-5 * turnover


def test_what_a_law_does_not_explain_is_told() -> None:
    elements = (ElementEnergy("field", "C", 1.0, 0.0, 0.0, -0.25), ElementEnergy("mass", "I", 2.0, 0.0, 0.0, 1e-6))
    balance = EnergyBalance(elements, 3.0, 0.0, 0.0, -0.25)
    (told,) = unexplained(balance, 3.0, 1e-6)
    assert told.startswith("`field` creates 0.25 J that its law does not explain")
    still = EnergyBalance((ElementEnergy("field", "C", 0.0, 0.0, 0.0, 0.0),), 0.0, 0.0, 0.0, 0.0)
    assert unexplained(still, 0.0, 1e-6) == []


def test_what_is_on_its_way_in_a_line_is_stored() -> None:
    """10 V through 50 ohm into an open line of 50 ohm: after both ways it holds C u^2/2 with C = tau/Z, as much as the resistor lost."""
    text = """import TransmissionLine from electric
    model Line {
      Se s : u = 10 V*step(time - 1 ns)
      R lead : u = 50 ohm*i
      TransmissionLine line { Z = 50 ohm, tau = 5 ns }
      R load : i = u/1 [Gohm]
      s -> 1(lead) -> line.a
      line.b -> load
    }"""
    found = bondgraph.load(text).simulate(to=22e-9, energy=True)
    assert found.energy is not None and found.notes == ()
    shares = {e.name: e for e in found.energy.elements}
    assert shares["line.near"].kind == "delay" and shares["line.near"].stored == pytest.approx(5e-9, rel=1e-6)
    assert shares["s"].supplied == pytest.approx(1e-8, rel=1e-6) and shares["lead"].dissipated == pytest.approx(
        5e-9, rel=1e-6
    )
    assert found.energy.stored == pytest.approx(5e-9, rel=1e-6) and abs(found.energy.residual) < 1e-15
