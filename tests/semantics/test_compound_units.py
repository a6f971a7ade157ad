"""Units without brackets, and symbols that people type: read as meant where no name can be meant, else as the name, with a note."""

from __future__ import annotations

import pytest

import bondgraph
from compiler.errors import CompilationFailed
from compiler.graph.units import UNITS
from compiler.source import Source
from compiler.syntax.format import format_text
from tests.compiling import compiled, mistake, numbers

EQUAL = [
    ("100 rad/s", "100 [rad/s]"), ("5 N*m", "5 [N*m]"), ("-5 N*m/s^2", "-5 [N*m/s^2]"), ("9.81 m/s^2", "9.81 [m/s^2]"), ("5 m^2", "5 [m^2]"),
    ("5 m^2/s", "5 [m^2/s]"), ("3 m^-1", "3 [1/m]"), ("2*5 kN*m", "10 [kN*m]"), ("5 N * m", "5 [N*m]"), ("4 V/m^0.5", "4 [V/m^(1/2)]"), ("2 kg*m^2/s^3/A", "2 [V]"),
    ("(5 m)^2", "25 [m^2]"), ("-(5 m)^2", "-25 [m^2]"), ("2*(3 km)^2", "18e6 [m^2]"), ("sqrt(9 m^2)", "3 m"), ("1 N*m + 2 N*m", "3 [N*m]"), ("max(1 m/s, 2 km/h)", "1 [m/s]"),
    ("6 m/s*2 s", "12 m"), ("6 m/s/(2 s)", "3 [m/s^2]"), ("5 % * 3 m", "0.15 m"), ("50 %", "0.5"), ("3 µm", "3 um"), ("3 μm", "3 um"), ("4.7 kΩ", "4.7 kohm"), ("4.7 k\u2126", "4.7 kohm"),
    ("2 [kΩ*µF]", "2 ms"), ("2 kΩ*mm", "2 [ohm*m]"), ("3 [%/K]", "0.03 [1/K]"),
    ("1 psi", "6894.757293168361 Pa"), ("1 lbf", "4.4482216152605 N"), ("1 lb", "0.45359237 kg"), ("1 ft", "0.3048 m"), ("1 mile", "1609.344 m"),
    ("1 mph", "0.44704 [m/s]"), ("1 kn", "1852 [m/h]"), ("1 gal", "3.785411784 L"), ("1 hp", "745.69987158227022 W"), ("1 cal", "4.184 J"), ("1 kcal", "4184 J"),
    ("1 kWh", "3.6 MJ"), ("1 Wh", "3600 J"), ("2 mAh", "7.2 C"), ("760 Torr", "1 atm"), ("1 mmHg", "133.322387415 Pa"), ("1 kVA", "1 kW"), ("2 Nm", "2 J"), ("2 mNm", "2 mJ"),
    ("1 kgf", "9.80665 N"), ("1 angstrom", "0.1 [nm]"), ("1 week", "7 day"), ("1 year", "365.25 day"), ("32 degF", "0 degC"), ("212 degF", "100 degC"), ("-40 degF", "-40 degC"),
    ("1 ft*lbf", "1.3558179483314004 J"), ("1 hp/rpm", "745.69987158227022*30/pi*1 [W*s]"),
]  # fmt: skip


@pytest.mark.parametrize(("written", "meant"), EQUAL)
def test_what_is_meant(written: str, meant: str) -> None:
    text = f"model A {{\n  parameter a = {written}, b = {meant}\n  output x = a, y = b\n}}\n"
    found = numbers(text)
    assert found["x"] == pytest.approx(found["y"], rel=1e-14)
    assert not compiled(text).certificate.notes
    again = format_text(Source("text", text))
    assert numbers(again)["x"] == found["x"]


@pytest.mark.parametrize(
    ("declared", "value"),
    [
        ("parameter m = 2 kg", "5 N*m"), ("parameter s = 2", "100 rad/s"), ("signal s = 2", "100 rad/s"), ("for s in 1..1 { signal w[s] = 100 rad/s }", "w[1]"),
        ("function f(m) = 5 N*m", "f(1 [m])"), ("constant m = 2 kg", "5 N*m"), ("I m : p = 2 kg*v", "5 N*m.v"),
    ],
)  # fmt: skip
def test_a_name_of_the_model_comes_first(declared: str, value: str) -> None:
    """A note tells both readings, but for a dotted name, which is no unit."""
    bond = "1 j; j -> m; " if declared.startswith("I") else ""
    text = f"model A {{\n  {declared}\n  {bond}output y = {value}\n}}\n"
    assert any("is read as" in note for note in compiled(text).certificate.notes) == (not bond)


@pytest.mark.parametrize(
    "part",
    [
        "I m : p = 2 kg*v; C s : F = 1 [N/m]*x; 1(m) -> s", "0 m : electric; C s : q = 1 F*u; m -> s",
        "multibody m : planar { body s { mass = 1 kg } }",
    ],
)  # fmt: skip
def test_the_name_of_a_part_is_no_factor(part: str) -> None:
    text = f"model A {{\n  {part}\n  parameter a = 5 N*m, b = 9.81 m/s^2\n  output x = a, y = b\n}}\n"
    found = numbers(text)
    assert found["x"] == 5.0 and found["y"] == 9.81


@pytest.mark.parametrize(
    "unit", ["mm/s^2", "(mm/s)^2/m", "(N*m)/(kg*m)", "m/(2*s)^2", "m*s^-2", "m^(2/2)/s^(4/2)", "1/(s^2/m)"]
)
def test_a_reported_unit_is_shown_as_it_is_written(unit: str) -> None:
    text = f"model A {{\n  output y = 3 [m/s^2]\n  experiment go {{ simulate 0 .. 1 s; report y in {unit} }}\n}}\n"
    (item,) = (reported for reported, _ in bondgraph.load(text).simulate(points=2).shown())
    assert item.unit == unit


def test_a_file_constant_comes_first_and_another_model_does_not_count() -> None:
    text = "constant m = 2 kg\nmodel A {\n  B b\n  output y = 5 N*m, z = b.z\n}\nmodel B { parameter s = 3; output z = 4 N*m/s }\n"
    notes = compiled(text).certificate.notes
    assert len(notes) == 2 and "`5 [N]*m`" in notes[0]
    other = "model A {\n  B b\n  output y = 5 N*m, z = b.z\n}\nmodel B { parameter m = 3; output z = 4 N*m }\n"
    (note,) = compiled(other).certificate.notes
    assert "`4 [N]*m`" in note and numbers(other)["y"] == 5.0


@pytest.mark.parametrize("law", ["F = 3 N*s/m*v", "F = v*3 N*s/m", "v = F/(3 N*s/m)"])
def test_in_a_law_its_letters_come_first(law: str) -> None:
    """`v`, `F`, `x` are variables, never units; what is neither letter nor name belongs to the unit."""
    text = f"model A {{\n  Se push : F = 6 N\n  R damper : {law}\n  push -> 1(damper)\n  output y = damper.v\n}}\n"
    assert numbers(text)["y"] == pytest.approx(2.0, rel=1e-14)


def test_a_letter_that_is_a_unit_is_the_letter() -> None:
    """`V` is the volume in a hydraulic law: `2 Pa*V` is no unit there."""
    text = "model A {\n  C tank : P = 2 Pa*V/(1 [m^3]) { start V = 3 [m^3] }\n  0 node\n  node -> tank\n  output y = tank.P\n}\n"
    assert numbers(text)["y"] == pytest.approx(6.0)


@pytest.mark.parametrize("value", ["1/5 m/s", "5 N*m^99999999", "5 N*x", "2*s", "5 [N]*m", "x/3 N*m"])
def test_what_is_not_certain_is_no_unit(value: str) -> None:
    mistake(f"model A {{\n  parameter a = {value}\n  output y = a\n}}\n", "BG101")


def test_advice_works() -> None:
    with pytest.raises(CompilationFailed) as caught:
        compiled("model A {\n  parameter a = 1/5 m/s\n  output y = a\n}\n").certificate  # noqa: B018
    assert "in brackets behind the number" in str(caught.value)
    assert numbers("model A {\n  parameter a = 1/5 [m/s]\n  output y = a\n}\n")["y"] == 0.2


MODEL = "model A {\n  parameter w = 1 [rad/s], m = 2 kg\n  I disk : L = 1 [kg*m^2]*omega\n  1 j\n  j -> disk\n  output y = w, E = 0.5*1 [kg*m^2]*disk.omega^2\n  experiment e { simulate 0 .. 1 s; report y in rpm, E in kWh }\n}\n"


def test_settings_and_reports() -> None:
    model = bondgraph.load(MODEL)
    assert model.simulate(settings={"w": "100 rad/s"}).final("y") == pytest.approx(100.0)
    assert [r.unit for r in model.simulate(settings={"w": "2 Hz"}).report] == ["rpm", "kWh"]


def test_every_symbol_keeps_its_meaning_behind_a_number() -> None:
    """No unit hides another: a symbol with prefix is the prefix times the symbol."""
    assert (
        UNITS["Pa"].number == 1 and UNITS["cd"].number == 1 and UNITS["min"].number == 60 and UNITS["ft"] != UNITS["t"]
    )
    assert UNITS["kn"].dimension == UNITS["mph"].dimension and UNITS["gal"].dimension == UNITS["L"].dimension
