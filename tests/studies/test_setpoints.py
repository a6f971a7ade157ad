"""Setpoints from files: lines that are held at rest, paths over a column of time; errors name the file and heading."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.commands import commands
from bondgraph.errors import UsageError

SPRING = """\
model A {
  parameter k = 8 [N/m], m = 2 mg, r = 2e-3 [N*s/m], c = 2e-6 [N/V^2]
  input push = 0 V, pull = 0 V, load = 0 N
  MSe comb : F = c*(push^2 - pull^2)
  MSe hand : F = load
  1 body
  C spring : F = k*x
  I mass   : p = m*v
  R air    : F = r*v
  comb -> body -> spring, mass, air
  hand -> body
  output x = spring.x, F = spring.F
  experiment twice { set k = 16 [N/m]; simulate 0 .. 1 s; report x in um }
}
"""


@pytest.fixture(scope="module")
def model() -> Any:
    return bondgraph.load(SPRING)


def written(folder: Path, text: str) -> Path:
    path = folder / "setpoints.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_each_line_is_held_at_rest(model: Any, tmp_path: Path) -> None:
    """c (push^2 - pull^2) + load = k x, with settings in a line or for all."""
    file = written(tmp_path, "# three places\nx [um], load [uN], k [N/m]\n3, 0, 8\n-3, 0, 8\n\n1.5, 2, 16\n")
    found = model.invert_file(file, ["push/pull"], None)
    assert list(found.swept.items()) == [("x", "m"), ("load", "N"), ("k", "N/m")]
    volts = np.sqrt(np.abs([24e-6, -24e-6, 22e-6]) / 2e-6)
    assert found("push") == pytest.approx([volts[0], 0, volts[2]], rel=1e-9)
    assert found("pull") == pytest.approx([0, volts[1], 0], rel=1e-9)
    for point in found:
        settings = {**point.of("invert").inputs, "load": point.settings["load"], "k": point.settings["k"]}
        assert model.equilibrium(None, settings)["x"] == pytest.approx(point.settings["x"], abs=1e-15)
    halved = model.invert_file(written(tmp_path, "x [um]\n3\n"), ["load"], "twice")
    assert halved("load") == pytest.approx([48e-6]) and "um" in halved.summary()


def test_a_column_of_time_is_a_path(model: Any, tmp_path: Path) -> None:
    """m x'' + r x' + k x is the load that leads x along the polynomial, whose points the file has."""
    rise = np.polynomial.Polynomial([0, 0, 0, 0, 0, 126, -420, 540, -315, 70])
    times = np.linspace(0, 1, 81)
    lines = [f"{20 + 50 * t!r}, {float(5 * rise(t))!r}" for t in map(float, times)]
    file = written(tmp_path, "time [ms], x [um]\n" + "\n".join(lines) + "\n")
    lead = model.invert_file(file, ["load"], None, points=41)
    assert lead.time[[0, -1]] == pytest.approx([0.02, 0.07])
    s = (lead.time - 0.02) / 0.05
    force = 5e-6 * (2e-6 * rise.deriv(2)(s) / 0.05**2 + 2e-3 * rise.deriv(1)(s) / 0.05 + 8 * rise(s))
    assert lead["load"] == pytest.approx(force, abs=1e-6 * force.max())
    part = model.invert_file(file, ["load"], None, start="20 ms", to="45 ms", points=21, limits={"load": "1 N"})
    assert part.time[-1] == 0.045 and part["load"][-1] == pytest.approx(lead["load"][20], rel=1e-6)


def test_the_command(tmp_path: Path) -> None:
    file = tmp_path / "a.bg"
    file.write_text(SPRING, encoding="utf-8")
    setpoints, table = written(tmp_path, "x [um]\n3\n-3\n"), tmp_path / "volts.csv"
    asked = ["invert", str(file), "--setpoints", str(setpoints), "--by", "push/pull", "-e", "none"]
    done = CliRunner().invoke(commands, [*asked, "--out", str(table), "--json"])
    assert done.exit_code == 0, done.output
    inputs = [p["analyses"][0]["inputs"] for p in json.loads(done.stdout)["points"]]
    assert inputs[1]["pull"] == {"value": pytest.approx(math.sqrt(12), rel=1e-12), "unit": "V"}
    assert table.read_text(encoding="utf-8").splitlines()[0].replace('"', "") == "x [m],push [V],pull [V]"
    for more, told in (
        (["--want", "x=3 um"], "by --want, or by --setpoints"),
        (["--controller", str(tmp_path / "c.bg")], "--controller is for inputs along a path"),
        (["--to", "1 s"], "without a column `time [s]`"),
    ):
        refused = CliRunner().invoke(commands, [*asked, *more])
        assert refused.exit_code == 2 and told in refused.output, refused.output


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("y [m]\n1\n", "the model has no `y`"),
        ("x [V]\n1\n", r"`x` is in m; it stands there in V"),
        ("x\n1\n", r"`x` is in m; it stands there without a unit"),
        ("m [kg]\n1\n", "no column of an output; outputs are x, F"),
        ("x [m], load [N]\n1, 0\n", "`load` is to be found, and set line by line"),
        ("x [m], k [N/m]\n1, 8\n", "`k` is set for all, and line by line"),
        ("x [m], sigma x [m]\n1, 2\n", "`sigma x` is nothing that inputs could hold"),
        ("x [m], frequency 1 [Hz]\n1, 2\n", "`frequency 1` is nothing that inputs could hold"),
        ("x [m], F [N]\n1,\n", "`F` is not given in every line"),
        ("x [m]\none\n", "line 2: `one` in the column `x` is no number"),
        ("time [s], x [m]\n0, 0\n0, 1\n", "`time` does not grow"),
        ("time [s], x [m], m [kg]\n0, 0, 1\n1, 1, 1\n", "leave out `m`, or set it for all"),
        ("time [s], x [m]\n0, 0\n", "two instants or more"),
        ("x [m], F [N]\n1, 2\n", "2 outputs want as many inputs"),
    ],
)
def test_refused(model: Any, tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(UsageError, match=told):
        model.invert_file(written(tmp_path, text), ["load"], None, settings={"k": 8.0})
