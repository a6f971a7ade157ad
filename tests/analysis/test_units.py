"""Analyses in other units: folds, crossings, slopes beside a point. No unit changes any physics."""

from __future__ import annotations

import math

import pytest

import bondgraph
from compiler.api import Source, scene_of
from tests.compiling import LIBRARY, MODELS
from tests.second_opinion.scales import POWERS, in_other_units

SMALLER: tuple[dict[str, int], ...] = (
    {}, {"mass": -24}, {"length": -10}, {"time": 10, "mass": 8}, {"length": -8, "mass": -20, "time": -10, "charge": -16},
)  # fmt: skip
PLATE = """model Pull {
  parameter A = 1 [mm^2], gap = 3 um, eps = 8.8541878128e-12 [F/m], k = 8 [N/m], m = 20 ug, r = 2e-4 [N*s/m]
  input volt = 0 V
  MSe source : u = volt
  R lead : u = 1 ohm*i
  C plates(q: electric, x: translation) : energy = 1/2*q^2*(gap - x)/(eps*A)
  1 plate : translation
  I mass : p = m*v
  C spring : F = k*x
  R air : F = r*v
  source -> 1(lead) -> plates.q
  plate -> plates.x, mass, spring, air
  output share = spring.x/gap
}"""
COLUMN = """model Column {
  parameter k = 3 [N/m], L = 20 mm, b = 5 mm, m = 2 g, r = 0.1 [N*s/m], load = 1 mN
  C lean : F = k*x*(1 + (x/b)^2) - load*x/L
  I mass : p = m*v
  R air : F = r*v
  1 top : translation
  top -> lean, mass, air
  output aside = lean.x/b
}"""
LOAD = 3.0 * 20e-3  # N: the column leans from k*L on, and (x/b)^2 = load/(k*L) - 1


@pytest.mark.few(7)
@pytest.mark.parametrize("powers", (*POWERS, *SMALLER), ids=str)
def test_a_plate_is_pulled_in_at_a_third_of_its_gap(powers: dict[str, int]) -> None:
    """V^2 = 8 k g^3/(27 eps A); in small units of mass and large ones of time the branch had no fold."""
    text, units = in_other_units(PLATE, powers)
    volt = units.of_unit("V")
    found = bondgraph.load(text).continuation("volt", 0.0, 20 * volt, points=20)
    (fold,) = found.folds
    assert fold.value == pytest.approx(math.sqrt(8 * 8 * 3e-6**3 / (27 * 8.8541878128e-12 * 1e-6)) * volt, rel=1e-8)
    assert fold.outputs["share"] == pytest.approx(1 / 3, rel=1e-5)
    assert found.stable[0] and found.unstable[-1]


@pytest.mark.few(3)
@pytest.mark.parametrize("powers", ({}, *POWERS[::2], *SMALLER[1::2]), ids=str)
def test_a_column_leans_from_its_critical_load_on(powers: dict[str, int]) -> None:
    """Nothing moves on the way there: the state that leans has no value, and no size, until the branch is crossed."""
    text, units = in_other_units(COLUMN, powers)
    newton = units.of_unit("N")
    found = bondgraph.load(text).continuation("load", 1e-3 * newton, 0.1 * newton, points=10, branches=True)
    (crossed,) = found.special
    assert crossed.kind == "branch"
    assert crossed.value == pytest.approx(LOAD * newton, rel=1e-8)
    assert found.stable[0] and found.unstable[-1] and not found["aside"].any()
    for other in found.others:
        expected = other.values / (LOAD * newton) - 1
        assert other["aside"][-1] ** 2 == pytest.approx(expected[-1], rel=1e-8)
        assert other.stable[-1]
    assert {math.copysign(1, o["aside"][-1]) for o in found.others} == {-1.0, 1.0}


@pytest.mark.few(3)
@pytest.mark.parametrize("powers", ({}, *POWERS[::2]), ids=str)
def test_a_disc_has_the_temperature_of_the_air(powers: dict[str, int]) -> None:
    """Its entropy counts from there: what rounding leaves of it was taken for its magnitude, and the branch ended where it began."""
    text, _ = in_other_units((MODELS / "brake.bg").read_text(encoding="utf-8"), powers)
    found = bondgraph.load(text).continuation("T_air", "293.15 K", "600 K", points=10)
    assert found["T"] == pytest.approx(found.values, rel=1e-9) and found.values[-1] == 600.0
    assert len(found) > 5 and found.stable.all()


@pytest.mark.few(3)
@pytest.mark.parametrize("powers", ({}, *POWERS[::2]), ids=str)
def test_an_amplifier_is_linear_between_its_limits(powers: dict[str, int]) -> None:
    """Displacements by a millionth of an SI unit found its limits, in small units, instead of its slopes."""
    scene = scene_of(
        Source("a", (text := MODELS / "active_filter.bg").read_text(encoding="utf-8"), text),
        LIBRARY,
        (None, None),
        None,
        {},
    )
    changed, units = in_other_units(scene.text, powers)
    model = bondgraph.load(changed, model=scene.model)
    slowest = model.modes()[0].eigenvalue * units.of_unit("s")
    assert slowest == pytest.approx(bondgraph.load(text).modes()[0].eigenvalue, rel=1e-9)
    assert model.equilibrium().stable


@pytest.mark.few(3)
@pytest.mark.parametrize("powers", ({}, *POWERS[1::2], {"time": 6}), ids=str)
def test_a_pendulum_that_starts_level_hangs_at_rest(powers: dict[str, int]) -> None:
    """Gravity has no moment's slope there: the time of the fastest mode was rounding, and the first step led some thousand turns away."""
    text, units = in_other_units((MODELS / "pendulum.bg").read_text(encoding="utf-8"), powers)
    found = bondgraph.load(text).equilibrium()
    assert [found["upper"], found["lower"]] == pytest.approx([-math.pi / 2] * 2, rel=1e-9)
    assert found["y"] == pytest.approx(-1.5 * units.of_unit("m"), rel=1e-9) and found.stable


@pytest.mark.few(2)
@pytest.mark.parametrize("powers", POWERS[::2], ids=str)
def test_a_relay_without_current_is_away_from_its_threshold(powers: dict[str, int]) -> None:
    """No parameter has the unit of its flux linkage, and nothing moves it: its size is that of henries and amperes, the natural one of the model."""
    text = """import Resistor, Relay from electric
model M {
  input volt = 0 V
  MSe control : u = volt
  Se supply : u = 24 V
  Resistor lamp { R = 48 ohm }
  Relay part
  control -> part.coil
  supply -> 1(lamp.pins, part.contact)
  output i = lamp.current
}"""
    scene = scene_of(Source("relay", text, None), LIBRARY, (None, None), None, {})
    changed, units = in_other_units(scene.text, powers)
    model, same = bondgraph.load(text), bondgraph.load(changed, model=scene.model)
    assert same.equilibrium().stable is model.equilibrium().stable is True
    expected = [m.eigenvalue / units.of_unit("s") for m in model.modes()]
    assert [m.eigenvalue for m in same.modes()] == pytest.approx(expected, rel=1e-9)


CLOCKED = """model Clocked {
  parameter R = 2 ohm, L = 8 mH, k = 3 ohm
  mode drive = 0 V
  R winding : u = R*i
  I coil : lambda = L*i
  MSe bridge : u = drive
  every 1 ms { drive = k*(1 A - coil.i) }
  bridge -> 1(winding, coil)
}"""
TIMED = """model Timed {
  parameter R = 2 kohm, C = 1 nF, T = 3 ms
  R lead : u = R*i
  C store : u = q/C
  Se source : u = 3 V if mod(time, T) < T/2 else 1 V
  source -> 1(lead, store)
}"""
FASTER = tuple({"time": -k} for k in (0, 5, 10, 15, 18))


@pytest.mark.few(2)
@pytest.mark.parametrize("powers", (*FASTER, {"time": 5}, *POWERS[::3]), ids=str)
def test_an_analysis_of_one_instant_looks_at_no_second(powers: dict[str, int]) -> None:
    """Samples every 1e-21 s are no million too many, and periods of 3e-21 s are none: no experiment tells a length of time."""
    text, units = in_other_units(CLOCKED, powers)
    rest = bondgraph.load(text).equilibrium()
    assert rest.states["coil.lambda"] == pytest.approx(8e-3 * 3 / (2 + 3) * units.of_unit("V*s"), rel=1e-12)
    assert rest.stable
    text, units = in_other_units(TIMED, powers)
    model = bondgraph.load(text)
    assert model.equilibrium().states["store.q"] == pytest.approx(3e-9 * units.of_unit("C"), rel=1e-12)
    (mode,) = model.modes()
    assert mode.eigenvalue == pytest.approx(-1 / 2e-6 / units.of_unit("s"), rel=1e-12)


@pytest.mark.few(3)
@pytest.mark.parametrize("powers", ({}, *POWERS), ids=str)
def test_a_limited_controller_is_inverted_at_rest(powers: dict[str, int]) -> None:
    """At its limit the command reads no state, and the angle goes on while Newton's step is zero: no rest. Newton's matrix is of one size in all units."""
    path = MODELS / "pid_dc_motor.bg"
    scene = scene_of(Source(path.name, path.read_text(encoding="utf-8"), path), LIBRARY, (None, None), None, {})
    model = bondgraph.load(in_other_units(scene.text, powers)[0], model=scene.model)
    for angle in (-7.0, 1e-3, 0.5):
        found = model.invert({"phi": angle}, ("wanted",), experiment=None)
        assert found.inputs["wanted"] == pytest.approx(angle, rel=1e-9)
        assert found.stable
