"""The table of units: scales are exact until the last step, and the symbols mean what engineers mean."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from compiler.graph.units import (
    AMPERE,
    JOULE,
    KELVIN,
    KILOGRAM,
    METRE,
    MOLE,
    NEWTON,
    ONE,
    PASCAL,
    SECOND,
    UNITS,
    VOLT,
    WATT,
    Dimension,
)
from tests.compiling import compiled, mistake, numbers, units_of


def si(text: str) -> float:
    """A quantity in SI, through the whole compiler."""
    return numbers(f"model A {{\n  parameter a = {text}\n  output y = a\n}}\n")["y"]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("38 um", 38e-6),
        ("1.95 um", 1.95e-6),
        ("0.1 um", 0.1e-6),
        ("4.05 um", 4.05e-6),
        ("39.8 ug", 39.8e-9),
        ("2.108492 ug", 2.108492e-9),
        ("158 GPa", 158e9),
        ("1 ms", 1e-3),
        ("0.3 nm", 0.3e-9),
        ("7 pF", 7e-12),
        ("0.7 fs", 0.7e-15),
        ("3 kohm", 3000.0),
        ("2 MHz", 2e6),
        ("5 cm", 0.05),
        ("5 dm", 0.5),
        ("3 mm", 3e-3),
        ("3 kg", 3.0),
        ("3 g", 3e-3),
        ("1013 hPa", 101300.0),
        ("2.5e-5 [N*s/m]", 2.5e-5),
        ("2.94e-17 [kg*m^2]", 2.94e-17),
        ("8.8541878128e-12 [F/m]", 8.8541878128e-12),
        ("12 [mm^2]", 12e-6),
        ("50 [cm^3]", 50e-6),
        ("7 [N/mm]", 7000.0),
        ("19400 [V/um^(1/2)]", 19400e3),
        ("3 [um/ms]", 3e-3),
        ("1 bar", 1e5),
        ("150 bar", 150e5),
        ("7 mbar", 700.0),
        ("1 atm", 101325.0),
        ("2 L", 2e-3),
        ("3 [L/min]", 3e-3 / 60),
        ("1 min", 60.0),
        ("1 h", 3600.0),
        ("1 day", 86400.0),
        ("10 percent", 0.1),
        ("3 ppm", 3e-6),
        ("2 t", 2000.0),
        ("1 inch", 0.0254),
        ("5 eV", 5 * 1.602176634e-19),
        ("3 Hz", 3.0),
        ("20 degC", 293.15),
        ("-273.15 degC", 0.0),
        ("300 K", 300.0),
        ("1 rad", 1.0),
        ("2 mrad", 2e-3),
    ],
)
def test_one_rounding_at_the_end(text: str, value: float) -> None:
    """The same double as its decimal in SI, bit by bit: `38 um` is 38e-6, not 38*1e-6."""
    assert si(text) == value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("180 deg", math.pi),
        ("90 deg", math.pi / 2),
        ("120 deg", 2 * math.pi / 3),
        ("1 rev", 2 * math.pi),
        ("60 rpm", 2 * math.pi),
        ("3000 rpm", 100 * math.pi),
    ],
)
def test_angles(text: str, value: float) -> None:
    assert si(text) == pytest.approx(value, rel=4e-16)


def test_hertz_counts_cycles_and_rpm_turns() -> None:
    """Hz is 1/s, so `2*pi*f*t` keeps its 2 pi; rpm is an angular rate."""
    assert UNITS["Hz"].to_si(Fraction(50)) == 50.0
    assert UNITS["rpm"].to_si(Fraction(60)) == pytest.approx(2 * math.pi, rel=1e-15)
    assert UNITS["Hz"].dimension == UNITS["rpm"].dimension == ONE / SECOND


@given(
    st.fractions(min_value=-1000, max_value=1000, max_denominator=10**6),
    st.sampled_from(["um", "mm", "bar", "kN", "ug", "GPa", "ms", "inch"]),
)
def test_prefixes_round_once(number: Fraction, symbol: str) -> None:
    """The nearest double to the exact product."""
    exact = number * UNITS[symbol].number
    assert UNITS[symbol].to_si(number) == float(exact)


@given(st.floats(-1e6, 1e6, allow_subnormal=False), st.sampled_from(["um", "deg", "rpm", "degC", "bar", "mN", "h"]))
def test_there_and_back(value: float, symbol: str) -> None:
    scale = UNITS[symbol]
    assert scale.from_si(scale.to_si(Fraction(value))) == pytest.approx(value, rel=1e-12, abs=1e-9)


@pytest.mark.parametrize(
    ("symbol", "dimension"),
    [
        ("N", KILOGRAM * METRE / SECOND**2), ("J", JOULE), ("W", JOULE / SECOND), ("V", WATT / AMPERE), ("ohm", VOLT / AMPERE), ("S", AMPERE / VOLT),
        ("F", AMPERE * SECOND / VOLT), ("H", VOLT * SECOND / AMPERE), ("C", AMPERE * SECOND), ("Wb", VOLT * SECOND), ("T", VOLT * SECOND / METRE**2),
        ("Pa", NEWTON / METRE**2), ("bar", PASCAL), ("L", METRE**3), ("degC", KELVIN), ("deg", ONE), ("mol", MOLE), ("eV", JOULE), ("percent", ONE),
    ],
)  # fmt: skip
def test_dimensions(symbol: str, dimension: Dimension) -> None:
    assert UNITS[symbol].dimension == dimension


@pytest.mark.parametrize(
    ("symbol", "number"),
    [
        ("m", 1),
        ("Pa", 1),
        ("min", 60),
        ("h", 3600),
        ("cd", 1),
        ("t", 1000),
        ("T", 1),
        ("mm", Fraction(1, 1000)),
        ("ppm", Fraction(1, 10**6)),
    ],
)
def test_symbols_that_could_be_two(symbol: str, number: Fraction | int) -> None:
    """`Pa` is no peta-year, `min` no milli-inch, `T` is tesla and `t` the tonne; a symbol alone beats prefix and symbol."""
    assert UNITS[symbol].number == number


@pytest.mark.parametrize(
    "symbol",
    [
        "kN",
        "mN",
        "uN",
        "nN",
        "MN",
        "um",
        "nm",
        "km",
        "ug",
        "mg",
        "us",
        "ns",
        "GPa",
        "MPa",
        "kPa",
        "uF",
        "pF",
        "nF",
        "mH",
        "kV",
        "mA",
        "kHz",
        "GHz",
        "kJ",
        "kW",
        "MW",
        "mmol",
        "mohm",
        "Mohm",
        "mT",
    ],
)
def test_usual_prefixed_units_exist(symbol: str) -> None:
    assert symbol in UNITS


@pytest.mark.parametrize(
    "symbol",
    [
        "Ns",
        "sec",
        "mu",
        "micro",
        "hN",
        "dN",
        "cN",
        "kdeg",
        "mmin",
        "kbarr",
        "degR",
        "lbs",
        "Ω",
        "kkg",
        "mh",
        "kpsi",
        "feet",
    ],
)
def test_what_is_no_unit(symbol: str) -> None:
    """A closed list: a spelling that means nothing is not guessed."""
    assert symbol not in UNITS


def test_a_unit_of_several_symbols_stands_in_brackets() -> None:
    """`3 N*m` is three newtons times the model's m."""
    text = "model A {\n  parameter m = 4 kg\n  output y = 3 N*m\n  output z = 3 [N*m]\n}\n"
    assert units_of(compiled(text)) == {"y": "kg^2*m/s^2", "z": "N*m"}
    assert numbers(text) == {"y": 12.0, "z": 3.0}


@pytest.mark.parametrize("unit", ["[J/degC]", "[degC^2]", "[m*degC]"])
def test_an_absolute_temperature_stands_alone(unit: str) -> None:
    found = mistake(f"model A {{\n  parameter c = 2 {unit}\n  output y = c\n}}\n", "BG102")
    assert "K" in found.help


def test_a_root_of_a_unit_must_be_rational() -> None:
    assert si("3 [km^(1/3)]") == pytest.approx(30.0, rel=1e-15)
    mistake("model A {\n  parameter c = 2 [km^(1/2)]\n  output y = c\n}\n", "BG102")


@pytest.mark.parametrize(
    ("dimension", "name"),
    [(NEWTON, "N"), (NEWTON / METRE, "N/m"), (NEWTON * SECOND / METRE, "N*s/m"), (METRE / SECOND**2, "m/s^2"), (ONE, "1"), (ONE / SECOND, "1/s"),
     (KILOGRAM * METRE**2, "kg*m^2"), (METRE**Fraction(1, 2), "m^(1/2)"), (ONE / METRE**Fraction(3, 2), "1/m^(3/2)"), (JOULE, "N*m")],
)  # fmt: skip
def test_a_dimension_is_written_as_an_engineer_would(dimension: Dimension, name: str) -> None:
    assert str(dimension) == name
