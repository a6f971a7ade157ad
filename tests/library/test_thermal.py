"""Thermal parts: heat against Newton's law of cooling, entropy against the second law."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed
from tests.library.bench import exact, near, run


def test_body_cools_to_the_surroundings() -> None:
    found = run(
        "thermal", "HeatCapacity, Conductor, Ambient",
        """
        HeatCapacity body { heat_capacity = 50 [J/K], T_0 = 90 degC }
        Conductor film { G = 0.4 [W/K] }
        Ambient air { temperature = 20 degC }
        0 surface
        surface -> body.heat
        surface -> film.a
        film.b -> outside
        0 outside
        air.heat -> outside
        output T = body.temperature, Q = film.heat_flow, got = air.heat_flow
        """,
        600, energy=True,
    )  # fmt: skip
    excess = 70 * np.exp(-0.4 / 50 * found.time)
    near(found["T"], 293.15 + excess)
    near(found["Q"], 0.4 * excess, scale=0.4 * 363)
    near(found["got"], -0.4 * excess, scale=0.4 * 363)
    assert found.energy is not None
    near(found.energy.stored, -50 * (70 - excess[-1]), scale=50 * 363)
    near(found.energy.dissipated, 0, scale=50 * 363)  # conduction loses no heat


def test_two_bodies_share_their_heat_and_make_entropy() -> None:
    found = run(
        "thermal", "HeatCapacity, Conductor",
        """
        HeatCapacity hot  { heat_capacity = 30 [J/K], T_0 = 400 K }
        HeatCapacity cold { heat_capacity = 70 [J/K], T_0 = 300 K }
        Conductor contact { G = 5 [W/K] }
        0 left, right
        left -> hot.heat
        left -> contact.a
        contact.b -> right -> cold.heat
        output T1 = hot.temperature, T2 = cold.temperature, S = hot.body.S + cold.body.S
        """,
        100,
    )  # fmt: skip
    mean = (30 * 400 + 70 * 300) / 100
    decay = 100 * np.exp(-5 * (1 / 30 + 1 / 70) * found.time)
    near(found["T1"], mean + 0.7 * decay)
    near(found["T2"], mean - 0.3 * decay)
    near(found.final("S") - found["S"][0], 30 * math.log(mean / 400) + 70 * math.log(mean / 300), scale=30)
    assert np.all(np.diff(found["S"]) > -1e-9)


def test_radiation_between_two_surfaces() -> None:
    found = run(
        "thermal", "Radiator, Ambient, HeatCapacity, Conductor",
        """
        Ambient sky { temperature = 200 K }
        HeatCapacity plate { heat_capacity = 1000 [J/K], T_0 = 600 K }
        Radiator face { area = 0.3 [m^2], emissivity = 0.8 }
        0 here, there
        here -> plate.heat
        here -> face.a
        face.b -> there
        sky.heat -> there
        output T = plate.temperature, Q = face.heat_flow
        """,
        400,
    )  # fmt: skip
    exact(found["Q"], 0.8 * 5.670374419e-8 * 0.3 * (found["T"] ** 4 - 200.0**4))
    # dT/dt = -k (T^4 - Ts^4): the integral of 1/(T^4 - Ts^4) is known.
    k, s = 0.8 * 5.670374419e-8 * 0.3 / 1000, 200.0
    t = found["T"]

    def primitive(x: np.ndarray) -> np.ndarray:
        return (np.log((x - s) / (x + s)) - 2 * np.arctan(x / s)) / (4 * s**3)

    near((primitive(t[0]) - primitive(t)) / k, found.time)


HEATER = """
    import Resistor from electric
    Se supply : u = 10 V
    HeatedResistor wire { R_0 = 5 ohm, alpha = %g [1/K] }
    HeatCapacity body { heat_capacity = 20 [J/K] }
    Conductor film { G = 0.5 [W/K] }
    Ambient air { temperature = 20 degC }
    0 surface, outside
    supply -> wire.pins
    wire.heat -> surface -> body.heat, film.a
    film.b -> outside
    air.heat -> outside
    output T = body.temperature, P = wire.heat_flow, i = wire.current
"""


def test_heated_resistor_warms_up() -> None:
    found = run("thermal", "HeatedResistor, HeatCapacity, Conductor, Ambient", HEATER % 0, 200, energy=True)
    near(found["T"], 293.15 + 10**2 / 5 / 0.5 * (1 - np.exp(-0.5 / 20 * found.time)))
    exact(found["P"], np.full(101, 20.0))
    assert found.energy is not None
    stored = 20 * (found.final("T") - 293.15)
    near(found.energy.stored, stored, scale=20 * 293)
    near(found.energy.residual, 0, scale=found.energy.supplied)


def test_heated_resistor_of_copper_limits_itself() -> None:
    """u^2/(R0 (1 + alpha d)) = G d: a quadratic equation for the rise d."""
    found = run("thermal", "HeatedResistor, HeatCapacity, Conductor, Ambient", HEATER % 0.0039, 1500)
    rise = (-1 + math.sqrt(1 + 4 * 0.0039 * 10**2 / 5 / 0.5)) / (2 * 0.0039)
    near(found.final("T"), 293.15 + rise)
    near(found.final("i"), 10 / (5 * (1 + 0.0039 * rise)))


def test_two_bodies_cannot_share_one_temperature() -> None:
    """Neither start can be forgotten: the run says that they contradict each other, by name."""
    body = """
        HeatCapacity a { T_0 = 300 K }
        HeatCapacity b { T_0 = 400 K }
        0 node
        node -> a.heat, b.heat
        Se air : T = 300 K
        R film : S_dot = 1e-3 [W/K^2]*T
        air -> 1(film) -> node
        output T = b.temperature
    """
    with pytest.raises(RunFailed, match=r"`b.body`.*`a.body.S`"):
        run("thermal", "HeatCapacity", body, 1)


@pytest.mark.parametrize("temperature", ["-40 degC", "300 K"])
def test_ambient_takes_any_temperature(temperature: str) -> None:
    found = run(
        "thermal", "Ambient, HeatCapacity, Conductor",
        """
        Ambient air
        HeatCapacity body { heat_capacity = 1 [J/K] }
        Conductor film
        0 outside, inside
        air.heat -> outside -> film.a
        film.b -> inside -> body.heat
        output T = body.temperature
        """,
        40, settings={"air.temperature": temperature},
    )  # fmt: skip
    near(found.final("T"), 233.15 if "degC" in temperature else 300.0)


def test_an_exchanger_of_equal_streams_has_slopes_and_no_cancelling_terms() -> None:
    model = bondgraph.load("""import HeatExchanger from thermal
    model A {
      parameter C_a: W/K = 250
      Se hot : T = 350 K
      Se cold : T = 300 K
      HeatExchanger part { C_a = C_a, C_b = 250 [W/K], UA = 300 [W/K] }
      hot -> part.a
      part.b -> cold
      output heat = part.heat_flow
    }""")
    rest = model.equilibrium()["heat"]
    assert rest == pytest.approx(50 * 250 * 300 / 550, rel=1e-14)
    near_it = model.equilibrium(settings={"C_a": 250 + 1e-6})["heat"]  # the slope is 50 K (N/(1 + N))^2/2
    assert near_it - rest == pytest.approx(25e-6 * (300 / 550) ** 2, rel=1e-4)
    assert "7.438" in str(model.sensitivity(("C_a",), of="equilibrium", outputs=("heat",)))
