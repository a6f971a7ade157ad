"""Numbers and units as they are printed and drawn, against closed forms: phases, instants far from zero, energies, units of several inputs."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bondgraph import UsageError, load
from bondgraph.analysis.energies import energies
from bondgraph.language_service.hover import hover
from bondgraph.language_service.workspace import Workspace
from bondgraph.presentation.page.document import _bond
from bondgraph.presentation.page.experiments import author_units

LAGS = """model Lags {
  input u = 1
  signal a = integral((u - a)/1 s, 0), b = integral((a - b)/1 s, 0), c = integral((b - c)/1 s, 0), d = integral((c - d)/1 s, 0)
  output y = d, opposite = -d
}"""
MASSES = """model Masses {
  input f = 0 N
  MSe push : F = f
  I m1, m2, m3 : p = 1 kg*v
  C k1, k2, k3 : F = 100 [N/m]*x
  R r1, r2, r3 : F = 0.5 [N*s/m]*v
  1 a, b, c
  push -> a -> m1, k1, r1
  a -> 0(1(k2, r2)) -> b -> m2
  b -> 0(1(k3, r3)) -> c -> m3
  output y = k1.x - k2.x - k3.x
}"""
LAG = """model Lag {
  input volt = 1 V, amps = 0 A
  MSe source : u = volt
  MSf extra : i = amps
  R r : u = 1 kohm*i
  C c : u = q/1 uF
  0 node
  source -> 1(r) -> node -> c
  extra -> node
  output u = c.u
}"""
SPRING = """model Spring {
  parameter k: N/mm = 0.4
  Se push : F = 2 N
  I mass : p = 250 g*v
  C spring : F = k*x
  push -> 1(mass, spring)
  output x = spring.x
  experiment late { simulate 1e6 s .. 1000000.25 s; report x in mm }
  experiment drawn { montecarlo k = uniform(0.3 [N/mm], 0.5 [N/mm]) { samples = 8, indices = 0 }; simulate 0 .. 0.1 s }
}"""
HEATED = """model Heated {
  parameter warmer = 30 degC - 20 degC, room = 20 degC
  input torque: N*mm = 5
  Se supply : u = 230 V
  R wire : u = 529 ohm*i
  I coil : lambda = 1 H*i
  MSf heater : f = wire.u*wire.i
  Se outside : e = room
  C air : e = room + q/50 [kJ/K]
  R wall : f = e*10 [W/K]
  0 inside : pseudothermal
  supply -> 1(wire, coil)
  heater -> inside -> air
  outside -> 1(wall) -> inside
  output T = air.T, rise = T - room + 0*warmer*torque/1 [N*m]
  experiment go { simulate 0 .. 10 s; report T in degC, rise }
}"""


@pytest.mark.parametrize("points", [2, 3, 5, 50])
def test_a_phase_does_not_depend_on_how_few_frequencies_are_asked_for(points: int) -> None:
    found = load(LAGS).response(low=1e-4, high=1e3, points=points)
    exact = -4 * np.degrees(np.arctan(2 * np.pi * found.frequencies))
    assert np.allclose(found.phase[:, 0, 0], exact, atol=1e-6)
    assert np.allclose(found.phase[:, 1, 0], exact + 180, atol=1e-6)


@pytest.mark.parametrize("points", [2, 400])
def test_peaks_and_dips_have_the_phase_of_the_curve(points: int) -> None:
    found = load(MASSES).response(low=0.1, high=100, points=points)
    assert len(found.extrema) == 5
    for one in found.extrema:
        at = int(np.argmin(np.abs(found.frequencies - one.frequency)))
        assert one.phase == pytest.approx(found.phase[at, 0, 0], abs=1e-9)
    assert found.extrema[-1].phase == pytest.approx(-414.8, abs=0.1)
    assert "-266.5 deg" in found.summary() and "177.4 deg" not in found.summary()


def test_instants_far_from_zero_are_told_with_the_digits_of_the_run() -> None:
    late = load(SPRING).simulate("late")
    text = late.summary()  # x = 5 mm (1 - cos(40 t)), at most 10 mm after pi/40 s
    assert "1000000 .. 1000000.25 s" in text
    assert re.search(r"x +\S+ +0 +1000000 +\S+ +1000000\.07\d +mm", text), text


def test_an_experiment_with_random_parameters_is_refused_as_one_run() -> None:
    with pytest.raises(UsageError, match="it is many runs"):
        load(SPRING).simulate("drawn")


def test_a_response_from_inputs_of_several_units_names_each(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    figure = load(LAG).response(points=5).plot(tmp_path / "bode.svg")
    magnitude = figure.axes[0]
    assert magnitude.get_ylabel() == "u"
    assert [t.get_text() for t in magnitude.get_legend().get_texts()] == ["from volt [V/V]", "from amps [V/A]"]


def test_heat_times_temperature_is_in_no_energy_balance() -> None:
    model = load(HEATED)
    run = model.simulate("go", energy=True)
    balance = run.energy
    assert [e.name for e in balance.elements] == ["supply", "wire", "coil"]
    lag = 1 / 529  # s, of the coil; i = (230/529) (1 - exp(-t/lag)): 100 W for 10 s but for the beginning
    assert balance.supplied == pytest.approx(100 * (10 - lag), rel=1e-6)
    assert balance.dissipated == pytest.approx(100 * (10 - 1.5 * lag), rel=1e-6)
    assert abs(balance.residual) < 1e-6
    assert "no power at `heater`, `outside`, `air`, `wall`" in " ".join(run.notes)
    found = energies(model, "go", points=3)
    assert set(found.elements) == {"supply", "wire", "coil"}
    assert found.supplied[-1] == pytest.approx(balance.supplied, rel=1e-6)
    graph = model.compilation().graph
    told = {_bond(graph, b)["power"] for b in range(len(graph.bonds))}
    assert told == {("power", "W"), ("T*Q_dot", "kg*m^2*K/s^3")}


def test_a_plain_model_has_energies_over_time() -> None:
    text = "plain model P { C c : e = 2*q { start q = 1 }; R r : e = f; 1(r) -> c\n experiment go { simulate 0 .. 9 } }"
    assert energies(load(text), points=3).dissipated[-1] == pytest.approx(1, rel=1e-6)


def test_differences_of_temperatures_are_no_temperatures(tmp_path: Path) -> None:
    model = load(HEATED)
    shown = author_units(model, {"warmer": "K", "room": "K"})
    assert [(u, float(s.from_si(v))) for (u, s), v in zip(shown.values(), (10, 293.15), strict=True)] == [("K", 10), ("degC", pytest.approx(20))]  # fmt: skip
    file, space = tmp_path / "heated.bg", Workspace()
    file.write_text(HEATED)
    space.open(file, HEATED)
    told = hover(space, file, HEATED.index("torque"))
    assert told is not None and "in N*mm" in told.text


def test_reported_units_and_words_are_shown_by_all_analyses() -> None:
    """Kelvin and the numbers of words were printed by a branch, an inversion and a sweep."""
    body = """model Body {
      parameter kind: {copper, steel} = copper, P = 20 W, cold = 300 K
      parameter G: W/K = 2 W/K if kind == copper else 1 W/K
      Sf source : Q_dot = P + G*cold
      0 node : pseudothermal
      C store : Q = 10 [J/K]*T
      R wall : Q_dot = G*T
      source -> node -> store, wall
      output warm = node.T
      experiment e { simulate 0 .. 1 s; report warm in degC }
      experiment s { sweep kind = copper, steel; equilibrium; report warm in degC }
    }"""
    model = load(body)
    branch = model.continuation("P", "0 W", "20 W", points=2).summary()
    assert re.search(r"W +degC\n", branch) and re.search(r"stable +20 +36\.85", branch)
    assert re.search(r"warm +46\.85 +degC", model.invert({"warm": "320 K"}, ["P"]).summary())
    along = model.invert({"warm": "320 K"}, ["P"], to="1 s", points=2).summary()
    assert re.search(r"W +degC\n", along) and re.search(r"1 +40 +46\.85", along)
    for swept in (model.run("s"), model.sweep({"kind": "copper, steel"}, "equilibrium")):
        assert re.search(r"copper +36\.85\n +steel +46\.85", swept.summary())


@pytest.mark.parametrize(("slope", "shown"), [(1e-17, ["k"]), (1e-9, ["k", "m"])])
def test_a_slope_that_is_rounding_is_not_shown(slope: float, shown: list[str]) -> None:
    text = "plain model A {\n  parameter k = 2, m = 3\n  C c : e = k*q\n  I i : p = m*f\n  R r : e = f\n  Se s : e = 1\n  s -> 1(c, i, r)\n  output x = c.q\n}"
    found = load(text).sensitivity(("k", "m"), of="equilibrium")
    assert found.quantities == ("x",) and found.of("x", "k") == pytest.approx(-0.25)
    rows = [line.split() for line in replace(found, slopes=np.array([[-0.25, slope]])).summary().splitlines()]
    assert [row[-3] for row in rows if len(row) > 2 and row[-3] in ("k", "m")] == shown
