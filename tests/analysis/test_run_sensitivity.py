"""Derivatives of runs against closed forms and against neighbouring runs, and the fits of measurements over time that use them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph import UsageError
from bondgraph.analysis.operating_point import OperatingPoint
from bondgraph.commands import commands
from bondgraph.studies.identify import OPEN
from tests.compiling import MODELS

DECAY = """
model Decay {
  parameter R = 2 ohm, C: F = 0.5, u0 = 3 V, t0 = 0.7 s, U = 5 V
  Se source : u = U*step(time - t0)
  C store : q = C*u { start q = C*u0 }
  R drop : u = R*i
  source -> 1(drop, store)
  output u = store.u
}
"""
HARD = """
model Hard {
  parameter m = 2 kg, k: N/m = 3, r: N*s/m = 0.4, x0 = 0.1 m
  Se push : F = 2 N*step(time - 1.3 s)
  I mass : p = m*v
  C spring : F = k*x + 5 [N/m^3]*x^3 { start x = x0 }
  R drag : F = r*v*abs(v)/1 [m/s] + 0.2 [N*s/m]*v
  push -> 1(mass, spring, drag)
  output x = spring.x, v = mass.v
}
"""
LOOP = """
model Loop {
  parameter R = 1 ohm, b: A/V^3 = 0.5, C: F = 1
  Se source : u = 2 V
  R first : u = R*i
  R second : i = 0.3 [A/V]*u + b*u^3
  R third : u = 2 ohm*i
  C store : q = C*u
  source -> 1(first, 0(second, 1(third, store)))
  output u = store.u, i = first.i
}
"""


@pytest.mark.interpreted
def test_a_loop_of_hinges() -> None:
    """Of a four-bar by a length that moves where the loop is drawn: against runs beside each other."""
    model, step, outputs = bondgraph.load(MODELS / "four_bar.bg"), 1e-5, ("swing", "load_x")
    found = model.sensitivity_of_run("crank", to=0.01, points=3, outputs=outputs)
    value = model.parameters["crank"].value
    beside = [
        model.simulate(
            settings={"crank": value + sign * step}, to=0.01, points=3, rtol=1e-11, outputs=outputs, target="numpy"
        )
        for sign in (1, -1)
    ]
    for output in outputs:
        wanted = (beside[0][output] - beside[1][output]) / (2 * step)
        assert found.of(output, "crank") == pytest.approx(wanted, rel=1e-5, abs=1e-6 * np.abs(wanted).max())


def test_a_charge_that_is_switched_on() -> None:
    """u = u0 e^(-t/RC) + U (1 - e^(-(t - t0)/RC)) beyond t0: by all five parameters, the instant of the step among them."""
    names = ("R", "C", "u0", "t0", "U")
    found = bondgraph.load(DECAY).sensitivity_of_run(names, None, to=2, points=41)
    R, C, u0, t0, U = 2.0, 0.5, 3.0, 0.7, 5.0
    t, T = found.time, R * C
    on = t > t0
    late = np.where(on, t - t0, 0.0)
    by_T = u0 * np.exp(-t / T) * t / T**2 - np.where(on, U * np.exp(-late / T) * late / T**2, 0.0)
    exact = {
        "R": by_T * C, "C": by_T * R, "u0": np.exp(-t / T), "t0": -np.where(on, U * np.exp(-late / T) / T, 0.0), "U": np.where(on, 1 - np.exp(-late / T), 0.0)
    }  # fmt: skip
    for name in names:
        assert found.of("u", name) == pytest.approx(exact[name], abs=1e-7 * abs(exact[name]).max()), name
    assert found.values[:, 0] == pytest.approx(
        u0 * np.exp(-t / T) + np.where(on, U * (1 - np.exp(-late / T)), 0.0), rel=1e-7
    )
    assert found.at.tolist() == [R, C, u0, t0, U] and "at the end" in found.summary()


CONTACT = """
model Drop {
  parameter m = 2 kg, r: N*s/m = 12, x0 = 0.1 m, push = 3 N, fast = 0.5 [m/s]
  I mass : p = m*v
  Se weight : F = m*9.81 [m/s^2]
  C way : F = 20 [N/m]*x { start x = -x0 }
  signal here = way.x
  MSe wall : F = -(3000 [N/m]*here + r*mass.v) if here > 0 m else 0
  MSe jet : F = push if mass.v > fast else 0
  1 j : translation
  j -> mass, way
  weight -> j
  wall -> j
  jet -> j
  output v = mass.v, place = way.x
}
"""


@pytest.mark.interpreted
def test_forces_that_jump_where_states_say_so() -> None:
    """A mass falls on a wall with damping and bounces, and a jet blows on it while it is fast: six jumps whose instants move with all parameters."""
    model = bondgraph.load(CONTACT)
    found = model.sensitivity_of_run(("m", "r", "x0", "push", "fast"), None, to=0.8, points=17)
    for j, name in enumerate(found.parameters):
        h = 2e-4 * found.at[j]
        beside = [model.simulate(None, {name: found.at[j] + d}, 0.8, 17, rtol=1e-11) for d in (h, -h)]
        for output in found.outputs:
            slope = (beside[0][output] - beside[1][output]) / (2 * h)
            assert found.of(output, name) == pytest.approx(slope, abs=3e-6 * abs(slope).max()), (output, name)


@pytest.mark.interpreted
def test_a_kink_between_the_start_of_a_part_and_its_first_node() -> None:
    """A stop without damping: the slope of the rate jumps, and no node of a part may be on one side. The error was 1e-4."""
    law = "MSe wall : F = -3000 [N/m]*max(here - reach, 0 m)"
    text = CONTACT.replace("MSe wall : F = -(3000 [N/m]*here + r*mass.v) if here > 0 m else 0", law)
    text = text.replace("MSe jet : F = push if mass.v > fast else 0", "MSe jet : F = -r*mass.v")
    model = bondgraph.load(text.replace("x0 = 0.1 m", "x0 = 0.1 m, reach = 0.02 m"))
    found, h = model.sensitivity_of_run(("reach",), None, to=0.6, points=23), 4e-7
    beside = [model.simulate(None, {"reach": 0.02 + d}, 0.6, 23, rtol=1e-11)["v"] for d in (h, -h)]
    assert found.of("v", "reach") == pytest.approx(
        (beside[0] - beside[1]) / (2 * h), abs=3e-6 * found.of("v", "reach").max()
    )


def test_a_condition_that_only_touches() -> None:
    """A spring that pushes at v > 0 begins where v is at its top: whether it does is decided by rounding."""
    text = CONTACT.replace("if mass.v > fast", "if here > -x0")
    with pytest.raises((UsageError, bondgraph.RunFailed), match=r"jumps at|touches|threshold"):
        bondgraph.load(text).sensitivity_of_run(("x0",), None, to=0.2, points=3)


@pytest.mark.parametrize(
    ("text", "names", "settings"), [(HARD, ("m", "k", "r", "x0"), {"r": 0.5}), (LOOP, ("R", "b", "C"), {})]
)
@pytest.mark.interpreted
def test_against_runs_beside_each_other(text: str, names: tuple[str, ...], settings: dict[str, Any]) -> None:
    """A nonlinear oscillator that is pushed, and a nonlinear loop."""
    model = bondgraph.load(text)
    found = model.sensitivity_of_run(names, None, settings, 3.0, 13)
    for j, name in enumerate(names):
        h = 1e-4 * found.at[j]
        beside = [
            model.simulate(None, {**settings, name: found.at[j] + d}, 3.0, 13, rtol=1e-11, target="numpy")
            for d in (h, -h)
        ]
        for output in found.outputs:
            slope = (beside[0][output] - beside[1][output]) / (2 * h)
            assert found.of(output, name) == pytest.approx(slope, abs=3e-7 * abs(slope).max()), (output, name)


def test_parts_of_a_run_are_mapped_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the start and the instant of the step are looked at by Python alone; 1 400 points were."""
    points, create = [], OperatingPoint.__init__

    def counted(self: OperatingPoint, *given: Any) -> None:
        points.append(given)
        create(self, *given)

    monkeypatch.setattr(OperatingPoint, "__init__", counted)
    found = bondgraph.load(HARD).sensitivity_of_run(("m", "k", "r"), None, to=3, points=13)
    assert np.isfinite(found.slopes).all() and len(points) < 12


@pytest.mark.interpreted
def test_what_a_run_leaves_open_stays_open() -> None:
    """Mass, stiffnesses and drag of a free oscillator scale together: the derivative along that direction is rounding, far below `OPEN`."""
    text = HARD.replace("Se push : F = 2 N*step(time - 1.3 s)", "parameter hard: N/m^3 = 5, air: N*s^2/m^2 = 1")
    text = text.replace("push -> 1(mass", "1 j : translation\n  j -> mass").replace("drag)", "drag")
    text = text.replace("5 [N/m^3]*x^3", "hard*x^3").replace(
        "r*v*abs(v)/1 [m/s] + 0.2 [N*s/m]*v", "r*v + air*v^3/1 [m/s]"
    )
    names = ("m", "k", "r", "hard", "air")
    found = bondgraph.load(text).sensitivity_of_run(names, None, to=3, points=21, outputs=("x",))
    sizes = np.linalg.svd(found.slopes[:, 0] * found.at, compute_uv=False)
    assert sizes[-1] < 1e-2 * OPEN * sizes[0] and sizes[-2] > 1e-6 * sizes[0]


def test_an_instant_just_beside_a_reported_one() -> None:
    """The step is at 0.3 s, the fourth instant one rounding later: the part up to the next one was taken in one step, ten time constants long."""
    model = bondgraph.load(DECAY.replace("C: F = 0.5", "C: F = 5e-3").replace("t0 = 0.7 s", "t0 = 0.3 s"))
    found = model.sensitivity_of_run(("C",), None, to=0.5, points=6)
    late = found.time - 0.3
    exact = 3 * np.exp(-found.time / 0.01) * found.time / 0.01 - np.where(
        late > 0, 5 * np.exp(-late / 0.01) * late / 0.01, 0
    )
    assert found.time[3] > 0.3 and found.of("u", "C") == pytest.approx(exact / 5e-3, abs=1e-8 * 1e3)


def test_instants_that_meet_and_part() -> None:
    """Two steps at 1 s, of which only one moves with the parameter: there is a derivative to each side, and none."""
    text = DECAY.replace("u = U*step(time - t0)", "u = U*step(time - 0.7 s) + U*step(time - t0)")
    with pytest.raises(UsageError, match="two instants meet"):
        bondgraph.load(text).sensitivity_of_run(("t0",), None, to=1)


def test_of_no_parameter_and_of_one_that_only_starts_read() -> None:
    model = bondgraph.load(DECAY)
    assert model.sensitivity_of_run((), None, to=1, points=3).slopes.shape == (3, 1, 0)
    assert model.sensitivity_of_run(("u0",), None, to=1, points=3).slopes[:, 0, 0] == pytest.approx(
        np.exp([0, -0.5, -1])
    )


def test_what_has_no_such_derivatives() -> None:
    event = HARD.replace("  output", "  when spring.x > 0.2 m { mass.v = 0 [m/s] }\n  output")
    with pytest.raises(UsageError, match="events, whole numbers of states"):
        bondgraph.load(event).sensitivity_of_run(("k",), None, to=1)
    with pytest.raises(UsageError, match="no parameter or input"):
        bondgraph.load(HARD).sensitivity_of_run(("q",), None, to=1)


@pytest.mark.interpreted
def test_fits_of_runs(tmp_path: Path) -> None:
    """Noise of 1 mm on 20 readings: the truth lies within four standard errors, and these are at the bound; without noise it is found to 1e-6."""
    model, true = bondgraph.load(HARD), {"k": 3.3, "m": 1.9}
    run = model.simulate(None, true, 2.0, 21, outputs=("x",), rtol=1e-10, target="numpy")
    rows = [f"{t!r},{x!r},1" for t, x in zip(run.time[1:].tolist(), (1e3 * run["x"][1:]).tolist(), strict=True)]
    (tmp_path / "d.csv").write_text("time [s],x [mm],sigma x [mm]\n" + "\n".join(rows) + "\n")
    found = model.fit(tmp_path / "d.csv", {"k": "1 N/m .. 10 N/m", "m": "log"})
    assert found.settings == pytest.approx(true, rel=1e-6)
    noisy = run["x"] + 1e-3 * np.random.default_rng(4).normal(size=21)
    rows = [f"{t!r},{1e3 * x!r},1" for t, x in zip(run.time[1:].tolist(), noisy[1:].tolist(), strict=True)]
    (tmp_path / "d.csv").write_text("time [s],x [mm],sigma x [mm]\n" + "\n".join(rows) + "\n")
    again = model.fit(tmp_path / "d.csv", {"k": "1 N/m .. 10 N/m", "m": "log"})
    for name, value in true.items():
        p = again.of(name)
        assert abs(p.value - value) < 4 * p.error and p.error == pytest.approx(found.of(name).error, rel=0.2)


def test_the_command(tmp_path: Path) -> None:
    (tmp_path / "d.bg").write_text(DECAY)
    arguments = [
        "sensitivity",
        str(tmp_path / "d.bg"),
        "--of",
        "simulate",
        "--to",
        "1 s",
        "--points",
        "3",
        "--by",
        "u0",
    ]
    told = json.loads(CliRunner().invoke(commands, [*arguments, "--json"]).stdout)
    assert told["outputs"]["u"]["slopes"]["u0"] == pytest.approx([1, np.exp(-0.5), np.exp(-1)], rel=1e-6)
    assert CliRunner().invoke(commands, arguments).exit_code == 0
    assert "stands alone" in CliRunner().invoke(commands, [*arguments, "--of", "modes"]).output


def test_a_parameter_of_a_block_that_no_output_needs() -> None:
    text = "model A {\n parameter T = 0.1 s\n mode count = 0\n every T { count = count + 1 }\n output x = integral(2*time/1 s, 0 s), n = count\n experiment go { simulate 0 .. 1 s; report x }\n}"
    assert not bondgraph.load(text).sensitivity_of_run(("T",), outputs=("x",)).slopes.any()


@pytest.mark.parametrize("name", ["seed_", "point"])
def test_seeds_and_points_of_tables_have_no_slopes(name: str) -> None:
    text = "model A {\n parameter seed_ = 3, point = 0.5\n output x = noise(time, 1 s, seed_), y = linear(time/1 s, (0, point, 2), (0, 1, 5))\n}"
    with pytest.raises(UsageError, match="a seed of noise"):
        bondgraph.load(text).sensitivity_of_run((name,), to="1 s")
