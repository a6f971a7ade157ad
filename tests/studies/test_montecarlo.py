"""Monte Carlo studies against closed forms: moments, Sobol indices, failures, the command."""

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
from bondgraph.studies.montecarlo import cube
from bondgraph.studies.tolerances import indices, mixed
from bondgraph.studies.workers import Workers
from tests.compiling import MODELS

REST = """
model Rest {
  parameter a = 0, b = 0
  C spring : F = 1 [N/m]*x
  Se push : F = 1 N*sin(a)
  R drag : F = 1 [N*s/m]*v
  push -> 1(spring, drag)
  output y = spring.x/1 m, z = 2*a + b
}
"""
OSCILLATOR = """
model Oscillator {
  parameter k: N/m = 100, m = 1 kg
  I mass : p = m*v
  C spring : F = k*x { start x = 1 m }
  1 body
  body -> mass, spring
  output x = spring.x
}
"""
ALONE = Workers(1)


def uniform(low: float, high: float) -> str:
    return f"uniform({low!r}, {high!r})"


def test_sobol_indices_of_ishigami() -> None:
    """Ishigami and Homma, 1990: V = A^2/8 + B pi^4/5 + B^2 pi^8/18 + 1/2 with A = 7, B = 0.1; a second quantity is linear, a third still."""
    A, B, pi, rows = 7.0, 0.1, math.pi, 4096
    points = 2 * pi * cube(rows, 6, 0) - pi
    first, second = points[:, :3], points[:, 3:]

    def values(x: Any) -> Any:
        a, b, c = x.T
        return np.stack(
            [np.sin(a) + A * np.sin(b) ** 2 + B * c**4 * np.sin(a), 1e-9 * (2 * a + b), np.full(len(a), 7.0)], axis=1
        )

    told, lost = indices(values(first), values(second), values(mixed(first, second)), 0)
    variance = A**2 / 8 + B * pi**4 / 5 + B**2 * pi**8 / 18 + 0.5
    alone = np.array([(1 + B * pi**4 / 5) ** 2 / 2, A**2 / 8, 0.0]) / variance
    both = B**2 * pi**8 * (1 / 18 - 1 / 50) / variance
    assert told is not None and told.count == rows and lost == 0
    assert told.first[0] == pytest.approx(alone, abs=0.02)
    assert told.total[0] == pytest.approx(alone + np.array([both, 0, both]), abs=0.02)
    assert told.first[1] == pytest.approx([0.8, 0.2, 0.0], abs=0.01) and np.isnan(told.first[2]).all()
    widths = np.diff(told.first_interval[:2], axis=-1)
    assert (
        (widths < 0.1).all()
        and (told.first_interval[0, :2, 0] < alone[:2]).all()
        and (alone[:2] < told.first_interval[0, :2, 1]).all()
    )


def test_indices_and_swings_of_rest() -> None:
    """x = F/k with sin(a) as F, and 2 a + b: a fifth of its variance is b's."""
    ends = uniform(-math.pi, math.pi)
    found = bondgraph.load(REST).montecarlo(dict.fromkeys("ab", ends), of="equilibrium", samples=128, workers=ALONE)
    assert found.quantities == ("y", "z") and found.indices is not None and found.indices.count == 128
    np.testing.assert_allclose(found("y"), np.sin(found("a")), rtol=1e-9, atol=1e-12)
    assert found.indices.first[1] == pytest.approx([0.8, 0.2], abs=0.05)
    low, high = found.swing.ends[1, 0]
    assert high == pytest.approx(1.6 * math.pi, rel=1e-9) and low == -high


def test_frequencies_of_lognormal_stiffness_and_mass() -> None:
    """ln f = (ln k - ln m)/2 - ln 2 pi is normal; correlated by r its variance is (sk^2 + sm^2 - 2 r sk sm)/4."""
    vary = {"k": "lognormal(100 N/m, 20 N/m)", "m": "lognormal(1 kg, 0.1 kg)"}
    sk, sm = math.sqrt(math.log1p(0.04)), math.sqrt(math.log1p(0.01))
    model = bondgraph.load(OSCILLATOR)
    for r in (0.0, 0.7):
        found = model.montecarlo(
            vary, samples=256, correlations={("k", "m"): r} if r else None, indices=0, workers=ALONE
        )
        logs = np.log(found("frequency 1"))
        middle = (math.log(100) - sk**2 / 2 + sm**2 / 2) / 2 - math.log(2 * math.pi)
        assert logs.mean() == pytest.approx(middle, abs=2e-3)
        assert logs.std() == pytest.approx(math.sqrt(sk**2 + sm**2 - 2 * r * sk * sm) / 2, rel=1e-2)
        assert found.indices is None and any("correlated" in n for n in found.notes) == bool(r)
        np.testing.assert_allclose(found("frequency 1"), np.sqrt(found("k") / found("m")) / (2 * np.pi), rtol=1e-12)


def test_runs() -> None:
    found = bondgraph.load(OSCILLATOR).montecarlo(
        {"k": "uniform(50 N/m, 150 N/m)"}, of=("simulate", "modes"), samples=64, indices=0, to=0.3, rtol=1e-9, workers=ALONE
    )  # fmt: skip
    assert found.quantities == ("frequency 1", "x")
    np.testing.assert_allclose(found("x"), np.cos(0.3 * np.sqrt(found("k"))), atol=1e-7)


def test_what_fails_is_counted_named_and_in_no_statistic() -> None:
    """A negative mass is refused: a fifth of the points, whose rows are out of the indices, too."""
    model = bondgraph.load(OSCILLATOR.replace("  1 body", "  require m > 0 kg\n  1 body"))
    found = model.montecarlo(
        {"m": "uniform(-0.25 kg, 1 kg)", "k": "uniform(90 N/m, 110 N/m)"}, samples=32, indices=32, workers=ALONE
    )  # fmt: skip
    bad = found("m") <= 0
    assert set(found.failures) == set(np.flatnonzero(bad)) and 4 < bad.sum() < 9
    assert (np.isnan(found("frequency 1")) == bad).all()
    assert found.statistics("frequency 1")["count"] == 32 - bad.sum()
    assert any(n.startswith(f"{bad.sum()} of 32 points failed and are in no statistic; point ") for n in found.notes)
    assert found.indices is not None and found.indices.count == 16 and any("16 of 32 rows" in n for n in found.notes)
    told = found.to_json()
    assert len(told["failures"]) == bad.sum() and json.dumps(told, allow_nan=False)
    with pytest.raises(bondgraph.RunFailed, match="not one of 8 points"):
        model.montecarlo({"m": "uniform(-2 kg, -1 kg)"}, samples=8, workers=ALONE)


def test_a_rest_that_is_left_without_vibrating_has_no_frequency() -> None:
    """How fast a mode leaves its rest was among the frequencies: 25 of 100 points of this spring."""
    model = bondgraph.load(OSCILLATOR)
    found = model.montecarlo({"k": "uniform(-50 N/m, 150 N/m)"}, "modes", samples=16, indices=0, workers=ALONE)
    assert found.failures.keys() == set(np.flatnonzero(found("k") < 0)) and len(found.failures) == 4
    assert all("without vibrating, which is no frequency" in why for why in found.failures.values())
    there = found("k") > 0
    assert found("frequency 1")[there] == pytest.approx(np.sqrt(found("k")[there]) / (2 * np.pi), rel=1e-12)


def test_bad_calls() -> None:
    model = bondgraph.load(OSCILLATOR)
    vary = {"k": "uniform(50 N/m, 150 N/m)"}
    for arguments, told in (
        ({"samples": 1}, "samples = 1"), ({"indices": 100}, "power of two"), ({"indices": 2048}, "only 1000 samples"), ({"of": "rest"}, "not of `rest`"),
        ({"settings": {"k": 3.0}}, "one of the two"), ({"workers": Workers(0)}, "workers = 0"), ({"workers": Workers(executor=3)}, "this is int"),
    ):  # fmt: skip
        with pytest.raises(UsageError, match=told):
            model.montecarlo(vary, **arguments)
    with pytest.raises(bondgraph.CompilationFailed, match="no `q`"):
        model.montecarlo({"q": "uniform(1, 2)"})


def test_manipulators_and_the_command(tmp_path: Path) -> None:
    """Tolerances of flexures, by hand: half of the swing of a frequency, to first order, is its exact sensitivity times 1.2816 sigma."""
    out = tmp_path / "m.csv"
    arguments = [
        "montecarlo", str(MODELS / "manipulator.bg"), "--vary", "d[1]=normal(1.95 um, 5 nm)", "--vary", "f=uniform(0.42, 0.45)",
        "--samples", "32", "--indices", "16", "--jobs", "1", "--out", str(out), "--json",
    ]  # fmt: skip
    done = CliRunner().invoke(commands, arguments)
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert told["schema"] == "bondgraph-montecarlo/1" and told["samples"] == 32 and told["failures"] == []
    low, high = told["quantities"]["frequency 3"]["swing"]["d[1]"]
    slope = bondgraph.load(MODELS / "manipulator.bg").sensitivity(("d[1]",), of="modes").of("frequency 3", "d[1]")
    assert high - low == pytest.approx(2 * 1.2815515655 * 5e-9 * slope, rel=1e-3)
    assert out.read_text().count("\n") == 33 and out.read_text().startswith('"d[1] [m]","f [1]","frequency 1 [Hz]"')
    for extra, words in (
        (["--correlation", "d[1] f 0.5"], "--correlation takes"), (["--vary", "d[2]=normal(1 um, 0 um)"], "larger than zero"), (["--out", "x.txt"], "ends in .csv or .npz"),
    ):  # fmt: skip
        done = CliRunner().invoke(commands, [*arguments, *extra])
        assert done.exit_code == 2 and words in done.output and "Traceback" not in done.output


def test_plots(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    vary: dict[str, Any] = {"k": "uniform(50 N/m, 150 N/m)"}
    found = bondgraph.load(OSCILLATOR).montecarlo(vary, samples=64, workers=ALONE)
    found.plot(tmp_path / "h.svg")
    found.plot_tornado(tmp_path / "t.svg")
    assert "frequency 1" in (tmp_path / "h.svg").read_text("utf-8") and "quantile" in (tmp_path / "t.svg").read_text(
        "utf-8"
    )
    assert "what moves frequency 1" in found.summary() and "99.7 %" in found.summary()


class TestNotDetermined:
    """Shares of a variance that the sample does not determine are reported so, in words and as null."""

    @pytest.mark.parametrize("mean", [1.0, -3e5, 2e-12])
    @pytest.mark.parametrize("size", [0.0, 1e-17, 5e-16, 1e-13])
    def test_an_output_that_hardly_moves(self, size: float, mean: float) -> None:
        text = f"model A {{\n parameter a = 1, b = 1\n C c : u = q/(1 F)\n R r : u = 1 ohm*i\n 0 k\n k -> c, r\n output y = ({mean!r})*(1 + {size!r}*(a + b*a)), z = a + 2*b + c.u/(1 V)\n}}"
        vary = {"a": "uniform(0.9, 1.1)", "b": "uniform(0.9, 1.1)"}
        found = bondgraph.load(text).montecarlo(vary, "equilibrium", samples=64, indices=64, workers=ALONE)
        told = found.to_json()["quantities"]
        assert [told["y"]["indices"][p]["first"] for p in "ab"] == [None, None]
        assert told["z"]["indices"]["a"]["first"] == pytest.approx(0.2, abs=0.15)
        assert "not determined" in found.summary() and any("`y` are not determined" in n for n in found.notes)

    @pytest.mark.parametrize("samples", [8, 16])
    def test_intervals_that_hold_all_shares(self, samples: int) -> None:
        """A product of many factors far from the mean, by few rows."""
        names = [f"p{i}" for i in range(6)]
        text = (
            "model A {\n parameter "
            + ", ".join(f"{n} = 0" for n in names)
            + "\n C c : u = q/(1 F)\n R r : u = 1 ohm*i\n 0 k\n k -> c, r\n"
        )
        text += " output y = " + "*".join(f"exp(3*{n})" for n in names) + " + c.u/(1 V)\n}"
        found = bondgraph.load(text).montecarlo(
            dict.fromkeys(names, "normal(0, 1)"), "equilibrium", samples=samples, indices=samples, workers=ALONE
        )
        assert found.indices is not None
        wide = found.indices.total_interval[0, :, 1] - found.indices.total_interval[0, :, 0] >= 1
        assert (
            wide.any()
            and np.isnan(found.indices.total[0][wide]).all()
            and np.isfinite(found.indices.total[0][~wide]).all()
        )
        assert "not determined" in found.summary()

    def test_a_run_that_moves_by_less_than_its_tolerance(self) -> None:
        text = "model A {\n parameter a = 1, b = 1\n I m : p = 1 kg*v { start v = 1 [m/s] }\n R r : F = (1 + 1e-9*a*b)*1 [N*s/m]*v\n 1 k\n k -> m, r\n output v = m.v\n}"
        vary = {"a": "uniform(0.9, 1.1)", "b": "uniform(0.9, 1.1)"}
        found = bondgraph.load(text).montecarlo(vary, "simulate", samples=16, indices=16, to=1.0, workers=ALONE)
        assert found.indices is not None and np.isnan(found.indices.total).all()
