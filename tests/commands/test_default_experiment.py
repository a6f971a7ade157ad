"""One rule for the experiment of a call that names none: the first of the model, in all commands and methods that run or analyse."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.commands import COMMANDS, commands

TEXT = """model Rod {
  parameter k = 8 [N/m], m = 2 kg, r = 1 [N*s/m]
  input load = 1 N
  MSe push  : F = load
  1  body
  I  mass   : p = m*v
  C  spring : F = k*x
  R  damper : F = r*v
  push -> body -> mass, spring, damper
  output x = spring.x, v = mass.v
  experiment stiff { set k = 32 [N/m]; simulate 0 .. 1 s { points = 3 }; report x in mm }
  experiment soft { set k = 2 [N/m]; simulate 0 .. 2 s; report x in mm }
}
"""
CALLS = (
    ["run"], ["sweep", "--over", "r=1 [N*s/m], 2 [N*s/m]", "--jobs", "1"], ["sweep", "--over", "m=1 kg, 2 kg", "--of", "equilibrium", "--jobs", "1"],
    ["montecarlo", "--vary", "m=uniform(1 kg, 2 kg)", "--samples", "4", "--indices", "0", "--jobs", "1"], ["equilibrium"], ["modes"], ["linearize"],
    ["bode", "--points", "3"], ["sensitivity"], ["sensitivity", "--of", "linearize", "--by", "m"],
    ["continue", "--along", "load=1 N .. 2 N", "--points", "3"], ["invert", "--want", "x=1 mm", "--by", "load"],
    ["fit", "--data", "data.csv", "--parameter", "m=0.1 kg .. 9 kg"], ["show", "--stage", "code"],
)  # fmt: skip
WHOLE_TEXT = {"draw", "compile"}, {"draw", "compile", "text", "to_fmu", "to_ssp"}  # they show or export the whole text


@pytest.fixture
def told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    (tmp_path / "rod.bg").write_text(TEXT, encoding="utf-8")
    (tmp_path / "data.csv").write_text("frequency 1 [Hz]\n0.6\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return lambda *words: CliRunner().invoke(commands, [words[0], "rod.bg", *words[1:]])


@pytest.mark.few(7)
@pytest.mark.parametrize("call", CALLS, ids=" ".join)
def test_commands_take_the_first(call: list[str], told: Any) -> None:
    plain, first, none = (told(*call, *more) for more in ((), ("-e", "stiff"), ("-e", "none")))
    assert plain.exit_code == 0, plain.output
    said = [answer.stdout.partition("; took")[0] for answer in (plain, first, none)]
    assert said[0] == said[1] != said[2]


def test_all_commands_say_so() -> None:
    """A command with another default names it in its help."""
    context = commands.make_context("bondgraph", ["--help"], resilient_parsing=True)
    found = {name: commands.get_command(context, name) for name in COMMANDS}
    defaults = {n: p.default for n, c in found.items() if c is not None for p in c.params if p.name == "experiment"}
    assert {n for n, default in defaults.items() if default != ""} == WHOLE_TEXT[0]
    assert {call[0] for call in CALLS} <= defaults.keys()


def test_methods_take_the_first() -> None:
    model = bondgraph.load(TEXT)
    known = ((n, inspect.signature(f).parameters) for n, f in inspect.getmembers(bondgraph.Model, inspect.isfunction))
    defaults = {n: p["experiment"].default for n, p in known if not n.startswith("_") and "experiment" in p}
    assert {n for n, default in defaults.items() if default != ""} == WHOLE_TEXT[1]
    assert model.equilibrium()["x"] == pytest.approx(1 / 32)
    assert np.abs(model.linearize().A).max() == pytest.approx(32)
    assert abs(model.response(points=3, low=1e-4, high=1e-3).of("load", "x")[0]) == pytest.approx(1 / 32, rel=1e-3)
    assert model.sensitivity(("load",)).of("x", "load") == pytest.approx(1 / 32)
    assert model.continuation("load", 1.0, 2.0, points=2)["x"][0] == pytest.approx(1 / 32)
    assert model.invert({"x": 1.0}, ["load"]).inputs["load"] == pytest.approx(32)
    assert model.equilibrium(None)["x"] == pytest.approx(1 / 8)
    moved = bondgraph.load(TEXT.replace("set k = 32 [N/m]", "set load = 1 N*step(time - 1 s)"))
    assert moved.continuation("load", 1.0, 2.0, points=2)["x"][0] == pytest.approx(
        1 / 8
    )  # not as the experiment moves it
