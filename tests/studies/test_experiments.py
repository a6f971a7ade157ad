"""Experiments that sweep and analyse, sweeps from Python and the command line: closed forms, order, workers, refusals."""

from __future__ import annotations

import json
import math
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph import CompilationFailed
from bondgraph.commands import commands
from bondgraph.errors import UsageError
from bondgraph.studies.workers import work

TEXT = """
model Sweep {
  parameter k = 3 [N/m], m = 2 kg
  input fx = 0 N
  I mass : p = m*v
  R r : F = 0.1 [N*s/m]*v
  C spring : F = k*x
  MSe push : F = fx
  push -> 1(spring, mass, r)
  output x = spring.x
  experiment stiffness { sweep load: uN = -30, 0, 30; sweep k = 3 [N/m], 6 [N/m]; set fx = load; equilibrium; modes; report x in um }
  experiment bode { response fx to x over 0.01 Hz .. 10 Hz { points = 50 }; modes }
  experiment go { sweep m = 1 kg, 2 kg; set fx = 1 N; simulate 0 .. 1 s { points = 11 } }
}
"""


@pytest.fixture(scope="module")
def model() -> Any:
    return bondgraph.load(TEXT)


def test_a_grid_of_equilibria_and_modes(model: Any) -> None:
    found = model.run("stiffness")
    assert list(found.swept.items()) == [("load", "N"), ("k", "N/m")]
    loads, k = np.repeat([-30e-6, 0, 30e-6], 2), np.tile([3.0, 6.0], 3)
    assert found("load") == pytest.approx(loads) and found("k").tolist() == k.tolist()
    assert found("x") == pytest.approx(loads / k, rel=1e-12, abs=1e-18)
    assert found("frequency 1") == pytest.approx(np.sqrt(k / 2) / (2 * np.pi), rel=1e-12)
    assert "um" in found.summary() and found[-1].equilibrium.stable


def test_texts_and_choices_are_swept_by_their_words(tmp_path: Path) -> None:
    """In an experiment, from Python and from the command line; tables, files and pictures have the words."""
    for name, slope in (("a", 1), ("b", 5)):
        (tmp_path / f"{name}.csv").write_text(f"x [m], f [N]\n0, 0\n1, {slope}\n")
    (tmp_path / "m.bg").write_text("""model M {
  parameter file = "a.csv", other = "b.csv", kind: { single, double } = single
  output f = linear(0.5 m, column(file, "x"), column(file, "f"))*(2 if kind == double else 1)
  experiment all { sweep kind = double, single; sweep file = other, "a.csv"; equilibrium }
}
""")
    model = bondgraph.load(tmp_path / "m.bg")
    for found in (model.run(), model.sweep({"kind": "double, single", "file": ['"b.csv"', '"a.csv"']}, "equilibrium")):
        assert found("f").tolist() == [5.0, 1.0, 2.5, 0.5]
        assert [found.in_words(p.settings) for p in found][1] == {"kind": "double", "file": "a.csv"}
        assert "double  b.csv    5" in found.summary()
        assert found.to_json()["words"]["file"] == ["b.csv", "a.csv"]
    axis = found.plot().axes[-1]
    assert [label.get_text() for label in axis.get_xticklabels()] == ["b.csv", "a.csv"]
    found.write(tmp_path / "s.csv")
    assert (tmp_path / "s.csv").read_text().splitlines()[2] == '"double","a.csv",1'
    call = ["sweep", str(tmp_path / "m.bg"), "--of", "equilibrium", "--together", "--over"]
    told = CliRunner().invoke(commands, [*call, 'file="b.csv", "a.csv"', "--out", "-"]).output
    assert told.splitlines()[:3] == ['"file [1]","f [N]"', '"b.csv",2.5', '"a.csv",0.5']
    told = CliRunner().invoke(commands, [*call, "file=b.csv, a.csv"]).output
    assert "`file` cannot be `b.csv`; it can be texts in quotation marks" in told
    with pytest.raises(CompilationFailed, match='A text stands in quotation marks: `sweep file = "single"`'):
        _ = bondgraph.load((tmp_path / "m.bg").read_text().replace("= other, ", "= single, ")).run()


def test_what_a_call_sets_is_not_swept(model: Any) -> None:
    found = model.run("stiffness", {"k": "12 [N/m]"})
    assert list(found.swept) == ["load"] and found("x") == pytest.approx(
        np.array([-2.5e-6, 0, 2.5e-6]), rel=1e-12, abs=1e-18
    )


def test_response_and_modes_of_one_point(model: Any) -> None:
    (point,) = model.run("bode")
    (response,) = point.responses
    w = 2 * np.pi * response.frequencies
    assert response.of("fx", "x") == pytest.approx(1 / (3 - 2 * w**2 + 0.1j * w), rel=1e-12)
    assert len(point.modes) == 1 and point.run is None


def test_runs_and_a_sweep_agree_whoever_makes_them(model: Any) -> None:
    """In this process, in threads, and by the function that goes to a worker; against the closed form of an underdamped step."""
    here = model.run("go")
    with ThreadPoolExecutor(2) as executor:
        there = model.run("go", workers=executor)
    assert (here("x") == there("x")).all()
    by_call = model.sweep({"m": "1 kg, 2000 g"}, experiment="go", to="1 s")
    assert by_call("x") == pytest.approx(here("x"), rel=1e-12)
    for m, x in zip((1.0, 2.0), here("x"), strict=True):
        decay, natural = 0.1 / (2 * m), math.sqrt(3 / m)
        w = math.sqrt(natural**2 - decay**2)
        assert x == pytest.approx((1 - math.exp(-decay) * (math.cos(w) + decay / w * math.sin(w))) / 3, rel=1e-9)
    with pytest.raises(UsageError, match=r"sweeps `m`: it is many runs"):
        model.simulate("go")
    with pytest.raises(UsageError, match=r"simulates nothing, but has `response`, `modes`"):
        model.simulate("bode")


def test_jobs_can_be_sent(model: Any) -> None:
    """A job and its point go through pickle, as they do between processes."""
    import pickle

    class Sending(Executor):
        def submit(self, function: Any, job: Any) -> Any:  # type: ignore[override]
            assert function is work
            future: Future[Any] = Future()
            future.set_result(pickle.loads(pickle.dumps(function(pickle.loads(pickle.dumps(job))))))
            return future

    found = model.run("stiffness", workers=Sending())
    assert found("x") == pytest.approx(model.run("stiffness")("x"), rel=1e-12)
    assert found[0].modes[0].energy == pytest.approx({"mass": 0.5, "spring": 0.5}, rel=1e-2)


def test_together_and_ranges(model: Any) -> None:
    found = model.sweep({"k": "1 N/m .. 3 N/m : 3", "m": [1.0, "4000 g", 9]}, of="modes", together=True)
    assert found("frequency 1") == pytest.approx(np.sqrt([1, 2 / 4, 3 / 9]) / (2 * np.pi), rel=1e-12)
    with pytest.raises(UsageError, match="as many for each name"):
        model.sweep({"k": [1.0], "m": [1.0, 2.0]}, of="modes", together=True)
    with pytest.raises(UsageError, match="k: `1 mm` is no quantity in N/m"):
        model.sweep({"k": "1 mm"})
    with pytest.raises(bondgraph.CompilationFailed, match="There is no `q` in `Sweep`"):
        model.sweep({"q": [1.0]})
    with pytest.raises(UsageError, match="not of `nonsense`"):
        model.sweep({"k": [1.0]}, of="nonsense")


def test_commands(tmp_path: Path) -> None:
    file = tmp_path / "sweep.bg"
    file.write_text(TEXT, encoding="utf-8")
    done = CliRunner().invoke(
        commands, ["run", str(file), "-e", "stiffness", "--json", "--out", str(tmp_path / "s.csv")]
    )
    told = json.loads(done.stdout)
    assert told["schema"] == "bondgraph-outcome/1" and len(told["points"]) == 6
    assert told["points"][0]["equilibrium"]["outputs"]["x"] == {"value": pytest.approx(-1e-5), "unit": "m"}
    head, first = (tmp_path / "s.csv").read_text().split("\n")[:2]
    assert head.startswith('"load [N]","k [N/m]","x [m]","frequency 1 [Hz]"') and first.startswith("-3")
    for arguments, schema in (
        (["equilibrium"], "bondgraph-equilibrium/1"), (["linearize"], "bondgraph-linearization/1"), (["modes"], "bondgraph-modes/1"),
        (["bode", "--over", "1 Hz .. 2 Hz", "--points", "3"], "bondgraph-response/1"),
        (["sweep", "--over", "k=1 N/m, 2 N/m", "--of", "modes"], "bondgraph-outcome/1"),
    ):  # fmt: skip
        done = CliRunner().invoke(commands, [arguments[0], str(file), *arguments[1:], "--json"])
        assert done.exit_code == 0 and json.loads(done.stdout)["schema"] == schema, done.output
        assert CliRunner().invoke(commands, [arguments[0], str(file), *arguments[1:]]).exit_code == 0


def test_plots(tmp_path: Path, model: Any) -> None:
    pytest.importorskip("matplotlib")
    model.run("stiffness").plot(tmp_path / "s.svg")
    assert "load" in (tmp_path / "s.svg").read_text(encoding="utf-8")
    model.run("bode").plot(tmp_path / "b.svg")
    with pytest.raises(UsageError, match="neither a sweep"):
        model.sweep({}, of="equilibrium").plot(tmp_path / "n.svg")
