"""Fits against closed forms, intervals that hold what they promise, data that are none, parameters that data leave open."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph import UsageError
from bondgraph.commands import commands
from bondgraph.studies.fit_problem import Problem
from bondgraph.studies.measured import Measurements
from compiler.api import BoundedParameter
from tests.compiling import MODELS

TEXT = """
model Bench {
  parameter k: N/m = 100, m = 1 kg, r: N*s/m = 0.2, soft: N/m^3 = 0
  input load = 0 N
  MSe push : F = load
  I mass : p = m*v
  R drag : F = r*v
  C spring : F = k*x + soft*x^3
  push -> 1(mass, drag, spring)
  output x = spring.x
}
"""


@pytest.fixture(scope="module")
def model() -> Any:
    return bondgraph.load(TEXT)


def measured(settings: dict[str, Any], found: dict[str, Any], sigmas: dict[str, Any] | None = None) -> Measurements:
    return Measurements(
        "data",
        *(
            {n: np.atleast_1d(np.asarray(c, dtype=float)) for n, c in part.items()}
            for part in (settings, found, sigmas or {})
        ),
        None,
    )


def test_a_straight_line_with_known_sigmas(model: Any, tmp_path: Path) -> None:
    """x = F/k: the compliance is the weighted mean of x/F, its deviation 1/sqrt(sum F^2/s^2); a column was not measured in one line."""
    loads, x, sigma = np.array([1.0, 2, 4, 3]), np.array([11.0, 19, 42, np.nan]), np.array([1.0, 1, 2, 1])
    rows = ["load [N],x [mm],sigma x [mm]", "# by hand"] + [
        f"{f},{'' if np.isnan(y) else y},{s}" for f, y, s in zip(loads, x, sigma, strict=True)
    ]
    (tmp_path / "d.csv").write_text("\n".join(rows) + "\n")
    found = model.fit(tmp_path / "d.csv", {"k": "10 N/m .. 1 kN/m"})
    there = ~np.isnan(x)
    weight = (loads / (sigma * 1e-3))[there] ** 2
    compliance = (weight * (x * 1e-3)[there] / loads[there]).sum() / weight.sum()
    k = found.of("k")
    assert k.value == pytest.approx(1 / compliance, rel=1e-9)
    assert k.error == pytest.approx(k.value**2 / math.sqrt(weight.sum()), rel=1e-6)
    assert (k.high - k.low) / 2 == pytest.approx(1.959964 * k.error, rel=1e-6)
    assert found.weighted and found.freedom == 2 and found.series[0].rows == (0, 1, 2)


def test_without_sigmas_the_scatter_tells(model: Any) -> None:
    """Student's interval of Gauss' problem in 1/k, of data that are equally wrong."""
    from scipy import stats

    loads = np.linspace(1, 10, 12)
    x = loads / 80 + 2e-3 * np.random.default_rng(5).normal(size=12)
    found = model.fit(measured({"load": loads}, {"x": x}), {"k": "log"})
    compliance = (loads * x).sum() / (loads**2).sum()
    scatter = ((x - compliance * loads) ** 2).sum() / 11
    k = found.of("k")
    assert k.value == pytest.approx(1 / compliance, rel=1e-8) and not found.weighted and found.freedom == 11
    assert k.error / k.value == pytest.approx(math.sqrt(scatter / (loads**2).sum()) / compliance, rel=1e-5)
    assert math.log(k.high / k.value) == pytest.approx(stats.t.ppf(0.975, 11) * k.error / k.value, rel=1e-9)
    assert math.log(k.high / k.value) == pytest.approx(math.log(k.value / k.low), rel=1e-9)


def test_intervals_hold_the_truth(model: Any) -> None:
    """40 trials with noise of unknown size; stiffness by three deflections, so that Student's 4.3 replaces 1.96."""
    random, loads, inside = np.random.default_rng(11), np.array([2.0, 4, 6]), 0
    for _ in range(40):
        k = model.fit(measured({"load": loads}, {"x": loads / 90 + 1e-3 * random.normal(size=3)}), {"k": ""}).of("k")
        inside += k.low <= 90 <= k.high
        assert (k.high - k.low) / 2 == pytest.approx(4.302653 * k.error, rel=1e-6)
    assert 34 <= inside <= 40


def test_manipulators_are_found_within_their_intervals() -> None:
    """The thickness of a flexure from a deflection and three resonances under load: 20 trials; widths at the bound of Cramer and Rao."""
    model = bondgraph.load(MODELS / "manipulator.bg")
    true, load = {"d[1]": 1.97e-6}, 15e-6
    x = model.equilibrium(settings={**true, "fx": load})["x"]
    f = model.modes(settings={**true, "fx": load}).frequencies[:3]
    random, sigmas = np.random.default_rng(0), {"x": 2e-8} | {f"frequency {i}": 1.0 for i in (1, 2, 3)}
    exact = {"x": x} | {f"frequency {i}": f[i - 1] for i in (1, 2, 3)}
    problem = Problem(
        model,
        [measured({"fx": load}, exact, sigmas)],
        [BoundedParameter(n, start=v) for n, v in true.items()],
        None,
        {},
    )
    slopes = problem.slopes(problem.coordinates(problem.start))
    bound = 2 * 1.959964 * math.sqrt(np.linalg.inv(slopes.T @ slopes)[0, 0]) * true["d[1]"]
    inside = 0
    for _ in range(20):
        noisy = {n: v + sigmas[n] * random.normal() for n, v in exact.items()}
        found = model.fit(measured({"fx": load}, noisy, sigmas), {"d[1]": "1.5 um .. 2.5 um"}).of("d[1]")
        inside += found.low <= true["d[1]"] <= found.high
        assert found.high - found.low == pytest.approx(bound, rel=0.25)
    assert 16 <= inside <= 20


def test_what_explains_the_measured_resonances() -> None:
    """Against 1160, 1200, 1457 Hz no single parameter does; thickness and the platform's size together do: a smaller radius lifts the third."""
    model = bondgraph.load(MODELS / "manipulator.bg")
    data = measured({}, {"frequency 1": 1160.0, "frequency 2": 1200.0, "frequency 3": 1457.0})
    found = model.fit(data, {"h": "30 um .. 50 um", "a": "100 um .. 250 um"}, explain=True)
    as_it_is, best = found.explanations[0], next(e for e in found.explanations if len(e.changes) == 2)
    assert as_it_is.changes == {} and 0.04 < as_it_is.left < 0.06  # 7.1, 3.3 and 3.1 percent of the computed
    assert set(best.changes) == {"a", "h"} and best.left < 2e-3
    assert best.changes["a"] == pytest.approx(-0.133, abs=0.02) and best.changes["h"] == pytest.approx(0.069, abs=0.02)
    assert all(e.left > 0.015 for e in found.explanations if len(e.changes) == 1)
    told = model.modes(settings=best.values).frequencies[:3]
    assert np.sqrt(np.mean((told / [1160, 1200, 1457] - 1) ** 2)) == pytest.approx(best.left, rel=1e-6)
    assert "h, a" in found.summary() and "(as it is)" in found.summary()


def test_what_data_leave_open_is_named(model: Any) -> None:
    """A frequency determines k/m alone: proportional changes of both have no effect. Of all solutions, one is taken, and told as one."""
    data = measured({}, {"frequency 1": math.sqrt(121) / (2 * math.pi)}, {"frequency 1": 0.01})
    found = model.fit(data, {"k": "", "m": ""})
    weakest = found.directions[0]
    assert weakest.open and weakest.weights == pytest.approx({"k": math.sqrt(0.5), "m": math.sqrt(0.5)}, abs=0.08)
    assert found["k"] / found["m"] == pytest.approx(121, rel=1e-6) and found["k"] > 100 > 100 * found["m"]
    assert found.of("k").error == math.inf and any("other values meet them as well" in n for n in found.notes)
    assert sorted(tuple(sorted(e.changes)) for e in found.explanations) == [(), ("k",), ("m",)]
    told = found.to_json()
    assert (
        told["directions"][0]["deviation"] is None
        and told["parameters"]["m"]["high"] is None
        and json.dumps(told, allow_nan=False)
    )
    both = model.fit([data, measured({"load": 1.0}, {"x": 0.01}, {"x": 1e-5})], {"k": "", "m": ""})
    assert both["k"] == pytest.approx(100, rel=1e-8) and not both.directions[0].open and both.explanations == ()
    unseen = model.fit(measured({"load": 1.0}, {"x": 0.0125}, {"x": 1e-5}), {"k": "", "r": ""}, explain=False)
    assert (
        unseen.directions[0].weights == {"r": 1.0} and unseen["r"] == 0.2 and unseen["k"] == pytest.approx(80, rel=1e-6)
    )


def test_sigmas_that_are_too_small_are_told(model: Any) -> None:
    loads = np.linspace(1, 10, 10)
    x = loads / 100 + 1e-3 * np.random.default_rng(2).normal(size=10)
    honest, proud = (
        model.fit(measured({"load": loads}, {"x": x}, {"x": np.full(10, s)}), {"k": ""}) for s in (1e-3, 1e-4)
    )
    assert honest.notes == () and any("times as far from the model as their sigmas say" in n for n in proud.notes)
    width = [f.of("k").high - f.of("k").low for f in (honest, proud)]
    assert width[1] == pytest.approx(width[0], rel=0.6)


def test_bounds_hold_and_are_told(model: Any) -> None:
    found = model.fit(measured({"load": 1.0}, {"x": 0.005}), {"k": "50 N/m .. 150 N/m"})
    assert found["k"] == pytest.approx(150, rel=1e-6) and any("ended on a bound" in n for n in found.notes)
    started = model.fit(measured({"load": 1.0}, {"x": 0.005}), {"k": "150 N/m .. 250 N/m"}, settings={"k": "160 [N/m]"})
    assert started["k"] == pytest.approx(200, rel=1e-8) and started.of("k").start == 160


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "a line of headings"), ("x [mm]\n", "a line of headings"), ("q [mm]\n1\n", "the model has no `q`"), ("x [kg]\n1\n", "`x` is in m; it stands there in kg"),
        ("x\n1\n", "stands there without a unit"), ("x [floob]\n1\n", "is no unit"), ("load [N],x [mm]\n1,nan\n", "line 2: `nan` in the column `x` is no number"),
        ("load [N],x [mm]\n1,abc\n", "`abc` in the column"), ("load [N],x [mm]\n1,2\n,3\n", "`load` is not given in every line"), ("x [mm],x [mm]\n1,2\n", "two columns are called"),
        ("load [N],x [mm]\n1,2,3\n", "line 2: as many fields"), ("load [N]\n1\n", "nothing is measured"), ("x [mm],sigma x [mm]\n1,0\n", "not above zero"),
        ("x [mm],sigma v [mm]\n1,1\n", "the model has no `v`"), ("load [N],x [mm]\n1,\n", "the column `x` is empty"), ("frequency 1 [m]\n3\n", "is in Hz"), ("frequency 1 [rpm]\n3\n", "is in Hz; it stands there in rpm"), ("x [mm],sigma x [mm]\n1,\n", "not above zero"),
        ("k [N/m],x [mm]\n100,1\n", "`k` is fitted, and set line by line"), ("frequency 7 [Hz]\n3\n", "no `frequency 7`: fewer modes move"),
    ],
)  # fmt: skip
def test_data_that_are_none(model: Any, tmp_path: Path, text: str, told: str) -> None:
    (tmp_path / "d.csv").write_text(text)
    with pytest.raises((UsageError, bondgraph.RunFailed), match=told):
        model.fit(tmp_path / "d.csv", {"k": ""})


def test_parameters_that_are_none(model: Any) -> None:
    data = measured({"load": 1.0}, {"x": 0.01})
    for given, settings, told in (
        ({}, {}, "name the parameters"), ({"k": "1 kg .. 2 kg"}, {}, "no quantity in N/m"), ({"k": "2 N/m .. 1 N/m"}, {}, "is not below"), ({"k": "3 N/m"}, {}, "LOW .. HIGH"),
        ({"k": "1 N/m .. 2 N/m"}, {}, "outside of its bounds"), ({"soft": "log"}, {}, "begins above zero"), ({"k": "log -1 N/m .. 2 N/m"}, {}, "no bounds below zero"),
    ):  # fmt: skip
        with pytest.raises(UsageError, match=told):
            model.fit(data, given, settings=settings)
    with pytest.raises(bondgraph.CompilationFailed, match="no `q`"):
        model.fit(data, {"q": ""})


def test_the_command(tmp_path: Path) -> None:
    file, data = tmp_path / "b.bg", tmp_path / "d.csv"
    file.write_text(TEXT)
    data.write_text("load [N],x [mm],sigma x [mm]\n1,10.5,0.1\n2,20.9,0.1\n")
    arguments = [
        "fit",
        str(file),
        "--data",
        str(data),
        "--parameter",
        "k=50 N/m .. 200 N/m",
        "--out",
        str(tmp_path / "f.csv"),
    ]
    done = CliRunner().invoke(commands, [*arguments, "--json"])
    told = json.loads(done.stdout)
    assert told["schema"] == "bondgraph-fit/1" and told["parameters"]["k"]["value"] == pytest.approx(
        5 / 0.0523, rel=1e-8
    )
    assert (tmp_path / "f.csv").read_text().startswith('"series [1]","row [1]","measured [1]"')
    assert "from (95 %)" in CliRunner().invoke(commands, arguments).stdout
    data.write_text("load [N],x [mm]\n1,NaN\n")
    done = CliRunner().invoke(commands, arguments)
    assert (
        done.exit_code == 2
        and "line 2: `NaN` in the column `x` is no number" in done.output
        and "Traceback" not in done.output
    )
    pytest.importorskip("matplotlib")
    data.write_text("load [N],x [mm]\n1,10\n")
    assert CliRunner().invoke(commands, [*arguments, "--plot", str(tmp_path / "f.svg")]).exit_code == 0
    assert "fitted" in (tmp_path / "f.svg").read_text("utf-8")


@pytest.mark.parametrize("bounds", ["-8 pm .. 8 pm", BoundedParameter("d")])
def test_a_length_of_picometres_begins_at_zero(bounds: str | BoundedParameter) -> None:
    """x = L (exp(d/L) - 1): a metre was the size of what has no value, and d = 0 was said to be fitted."""
    text = """model Bias {
  parameter d = 0 m, L = 1 pm
  input load = 0 N
  MSe push : F = load
  signal bias = 1 [N/m]*L*(exp(d/L) - 1)
  MSe pull : F = bias
  C spring : F = 1 [N/m]*x
  R air : F = 1 [N*s/m]*v
  1 j : translation
  push -> j -> spring, air
  pull -> j
  output x = spring.x
}"""
    data = measured({"load": [0.0, 1e-12]}, {"x": np.array([0.0, 1e-12]) + 1e-12 * math.expm1(1.5)})
    found = bondgraph.load(text).fit(data, {"d": bounds})
    assert found["d"] == pytest.approx(1.5e-12, rel=1e-6)


def test_an_input_with_a_number_as_its_value_is_fitted(tmp_path: Path) -> None:
    """The load behind a measured rest, from the value that the model has and from one of `settings`; an input that goes with time has none."""
    text = "model F {\n input load = LOAD\n MSe push : F = load\n C c : F = 2 [N/m]*x\n R r : F = 1 [N*s/m]*v\n push -> 1(c, r)\n output x = c.x\n}"
    (tmp_path / "rest.csv").write_text("x [m]\n1.5\n", encoding="utf-8")
    model = bondgraph.load(text.replace("LOAD", "1 N"))
    for settings in ({}, {"load": "2 N"}):
        found = model.fit(tmp_path / "rest.csv", {"load": "0 N .. 10 N"}, settings=settings)
        assert found.settings["load"] == pytest.approx(3, rel=1e-6)
    with pytest.raises(UsageError, match="no parameter or input with a value"):
        bondgraph.load(text.replace("LOAD", "1 N*sin(time/1 s)")).fit(tmp_path / "rest.csv", {"load": "0 N .. 10 N"})
