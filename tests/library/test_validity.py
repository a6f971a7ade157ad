"""The limits that parts of the library say: the instant at which they are left, against a formula, and silence before."""

from __future__ import annotations

import math

import pytest

from bondgraph.results.records import LimitLeft
from tests.library.bench import run


def left(library: str, parts: str, body: str, to: float) -> tuple[LimitLeft, ...]:
    return run(library, parts, body, to).warnings


def test_a_pipe_becomes_turbulent() -> None:
    """Under a constant pressure the flow grows as 1 - exp(-t R/L); Re = 4 rho Q/(pi d mu) passes 2300 at a time that is known."""
    body = """
    Se pump : P = 1 bar
    Pipe line { length = 10 m, diameter = 20 mm }
    pump -> line.a
    line.b -> sink
    Se sink : P = 0
    output Re = line.reynolds
    """
    (item,) = left("hydraulic", "Pipe", body, 5.0)
    rho, mu, d, length, pressure = 850.0, 0.03, 0.02, 10.0, 1e5
    resistance, inertia = 128 * mu * length / (math.pi * d**4), rho * length / (math.pi * d**2 / 4)
    limit = 2300 * math.pi * d * mu / (4 * rho)
    expected = -inertia / resistance * math.log(1 - limit * resistance / pressure)
    assert item.time == pytest.approx(expected, rel=1e-4)
    assert (item.owner, item.text) == ("line", "laminar flow")
    assert item.values[0][0] == "reynolds" and abs(item.values[0][1]) == pytest.approx(2300, rel=1e-6)


def test_an_accumulator_below_its_precharge() -> None:
    """1 L of oil leaves at 0.1 L/s: empty after 10 s."""
    body = """
    Sf out : Q = -0.1 [L/s]
    Accumulator bladder { V_0 = 5 L, V_oil = 1 L }
    out -> bladder.line
    output P = bladder.pressure
    """
    assert left("hydraulic", "Accumulator", body, 9.99) == ()
    (item,) = left("hydraulic", "Accumulator", body, 11.0)
    assert item.time == pytest.approx(10.0, rel=1e-5)
    assert item.owner == "bladder" and "precharge" in item.text


def test_a_valve_that_is_opened_the_wrong_way() -> None:
    body = """
    Se pump : P = 10 bar
    Se tank : P = 0
    Valve valve { opening = 1 - time/(2 s) }
    pump -> valve.a
    valve.b -> tank
    output Q = valve.flow
    """
    assert left("hydraulic", "Valve", body.replace("1 - time/(2 s)", "0"), 1.0) == ()
    found = left("hydraulic", "Valve", body, 3.0)
    assert [w.owner for w in found] == ["valve"] and found[0].time == pytest.approx(2.0, rel=1e-6)


def test_a_cylinder_that_is_driven_to_its_end() -> None:
    """100 cm^3 behind a piston of 10 cm^2 are gone after 0.1 m: 1 s at 0.1 m/s."""
    body = """
    Reservoir oil_a, oil_b
    Cylinder ram
    Sf drive : v = -0.1 [m/s]
    oil_a.line -> ram.a
    oil_b.line -> ram.b
    ram.rod -> drive
    output x = ram.way
    """
    found = left("hydraulic", "Cylinder, Reservoir", body, 1.05)
    assert [w.owner for w in found] == ["ram"] and "room" in found[0].text
    assert found[0].time == pytest.approx(100e-6 / 10e-4 / 0.1, rel=1e-6)


def test_a_film_says_that_its_sides_are_exchanged_and_that_the_plates_touch() -> None:
    body = """
    Sf drive : v = 1 [um/s]
    C way : F = 1e-9 [N/m]*x
    SqueezeFilm film { length = 50 um, width = 100 um, gap = 2 um, closed = way.x }
    1 plate
    drive -> plate -> film.ends, way
    output x = way.x
    """
    first, second = left("mems", "SqueezeFilm", body, 2.5)
    assert first.time == 0.0 and first.condition == "width <= length"
    assert {n: v for n, v, _ in first.values} == {"width": pytest.approx(1e-4), "length": pytest.approx(5e-5)}
    assert second.time == pytest.approx(1.99, rel=1e-6)


def test_a_flexure_that_turns_too_far() -> None:
    body = """
    Flexure leaf { k_phi = 1 [N*m], k_x = 1 [N/m], k_y = 1 [N/m] }
    Sf x, y : v = 0
    Sf turn : omega = 10 [deg/s]
    splitter hand(x, y, phi)
    x -> hand.x
    y -> hand.y
    turn -> hand.phi
    hand => leaf.ends
    output phi = leaf.spring.phi
    """
    (item,) = left("mems", "Flexure", body, 3.0)
    assert item.time == pytest.approx(2.0, rel=1e-6) and item.owner == "leaf"


def test_a_resistor_that_would_become_negative() -> None:
    """alpha = -0.01/K: nothing is left of it at 120 degC."""
    body = """
    Se source : u = 1 V
    HeatedResistor wire { alpha = -0.01 [1/K] }
    Se sink : T = 20 degC + 60 [K/s]*time
    source -> wire.pins
    wire.heat -> sink
    output i = wire.current
    """
    (item,) = left("thermal", "HeatedResistor", body, 1.69)
    assert item.time == pytest.approx(100 / 60, rel=1e-6) and item.text == "a resistance"


@pytest.mark.parametrize(("library", "part", "body", "empty"), [
    ("hydraulic", "Tank", "Tank part { area = 2 [m^2], level_0 = 1 m }\n Sf out : Q = -1 [m^3/s]\n out -> part.bottom\n output x = part.level", 2.0),
    ("pneumatic", "GasVolume", "GasVolume part { V = 1 L, P_0 = 2 bar }\n Sf out : f = -1 [g/s]\n out -> part.line\n output x = part.mass",
     2e5 * 1e-3 / (287.06 * 293.15) / 1e-3),
    ("mems", "ParallelPlate", "Se u : u = 0\n ParallelPlate part\n Sf move : v = 1 [um/s]\n u -> part.pins\n part.plate -> move\n output x = part.way", 2.0),
    ("mems", "CombCapacitor", "Se u : u = 0\n CombCapacitor part\n Sf move : v = -10 [um/s]\n u -> part.pins\n part.shuttle -> move\n output x = part.way", 2.0),
])  # fmt: skip
def test_nothing_is_left(library: str, part: str, body: str, empty: float) -> None:
    """An empty tank, an empty vessel, plates that touch, fingers that have left each other: at instants that are known."""
    assert left(library, part, body, 0.99 * empty) == ()
    (item,) = left(library, part, body, 1.2 * empty)
    assert item.owner == "part" and item.time == pytest.approx(empty, rel=1e-4)
