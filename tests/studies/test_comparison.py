"""A run beside other runs and measured data: differences against closed forms, and what is no such file."""

import json
from math import exp
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.commands import commands
from bondgraph.errors import UsageError

DECAY = """model Decay {
  parameter R = 1 kohm
  C c : u = q/1 uF { start u = 5 V }
  R r : u = R*i
  0 n : electric
  n -> c, r
  output u = c.u, i = r.i
  experiment go { simulate 0 .. 4 ms; report u in mV, i in mA }
}"""


def test_differences_of_two_runs_and_of_data(tmp_path: Path) -> None:
    model = bondgraph.load(DECAY)
    run, slower = model.simulate(points=401), model.simulate(settings={"R": "2 kohm"}, points=401)
    file = tmp_path / "data.csv"
    file.write_text("time [ms],u [V],note,i [uA]\n-1,9,0,9\n1,1.75,7,\n2,0.5,8,600\n5,0,9,0\n")
    comparison = bondgraph.compare(run, slower, file)
    first, second, third = (next(d for d in comparison.differences if (d.output, d.other) == key) for key in
                            (("u", "run 2"), ("u", "data.csv"), ("i", "data.csv")))  # fmt: skip
    at = 1e-3 * 2 * np.log(2)  # of exp(-t/2) - exp(-t)
    assert first.largest == pytest.approx(5 * 0.25, rel=1e-4)
    assert first.at == pytest.approx(at, abs=1e-5)
    assert second.instants == 2
    assert second.largest == pytest.approx(abs(0.5 - 5 * exp(-2)), rel=1e-5)
    assert second.root_mean_square == pytest.approx(
        np.hypot(1.75 - 5 * exp(-1), 0.5 - 5 * exp(-2)) / np.sqrt(2), rel=1e-5
    )
    assert (third.instants, third.at) == (1, 2e-3)
    assert third.largest == pytest.approx(abs(6e-4 - 5e-3 * exp(-2)), rel=1e-5)
    assert f"{1e3 * first.largest:.6g}" in comparison.summary()
    figure = comparison.plot()
    assert [len(axes.get_lines()) for axes in figure.axes] == [3, 3]
    assert figure.axes[0].get_lines()[2].get_ydata()[1] == 1750.0


def test_a_run_beside_itself_differs_nowhere() -> None:
    run = bondgraph.load(DECAY).simulate()
    assert all(d.largest == 0 for d in bondgraph.compare(run, run).differences)
    assert "no instant" in bondgraph.compare(run).summary()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("u [V]\n1\n", "a column `time"),
        ("time [s],u [A]\n0,1\n", "`u` is in V"),
        ("time [s],other\n0,1\n", "no column of the outputs u, i"),
        ("time [s],u [V]\n1,1\n0,2\n", "does not grow"),
        ("time [s],u [V]\n0,x\n", "is no number"),
        ("time [s],u [V]\n", "a line of headings"),
    ],
)
def test_data_that_are_none(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "data.csv"
    file.write_text(text)
    with pytest.raises(UsageError, match=words):
        bondgraph.compare(bondgraph.load(DECAY).simulate(points=3), file)


def test_other_outputs_and_units_are_refused() -> None:
    run = bondgraph.load(DECAY).simulate(points=3)
    other = bondgraph.load("model M { C x : F = 1 [N/m]*x\n Sf v : v = 1 [m/s]\n v -> x\n output u = x.F }").simulate(
        to=1.0, points=3
    )
    with pytest.raises(UsageError, match="`u` is in N there, in V in the run"):
        bondgraph.compare(run, other)
    with pytest.raises(UsageError, match="has none of the outputs"):
        bondgraph.compare(run, bondgraph.load("models/rlc.bg").simulate(outputs=("resistor.u",), points=3))


def test_commands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("m.bg").write_text(DECAY)
    Path("data.csv").write_text("time [ms],u [V]\n1,1.75\n")

    def call(*arguments: str) -> str:
        outcome = CliRunner().invoke(commands, arguments)
        assert outcome.exit_code == 0, outcome.output
        return outcome.stdout

    call("run", "m.bg", "--out", "before.npz")
    shown = call(
        "run", "m.bg", "--set", "R=2 kohm", "--against", "before.npz", "--against", "data.csv", "--plot", "x.svg"
    )
    assert "largest difference" in shown and "before.npz" in Path("x.svg").read_text()
    told = json.loads(call("run", "m.bg", "--against", "before.npz", "--json"))["against"]
    assert [row["largest"] for row in told["differences"]] == [0.0, 0.0]
    assert "data.csv" in call("plot", "before.npz", "data.csv", "-o", "y.png")
    assert Path("y.png").read_bytes()[:4] == b"\x89PNG"
    assert "Decay: go" in call("plot", "before.npz")
    refused = CliRunner().invoke(commands, ["run", "m.bg", "--against", "m.bg"])
    assert refused.exit_code == 2 and "no result of a run" in refused.output
