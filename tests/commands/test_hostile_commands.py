"""Some 260 command lines that a careless or hostile user may type, each with its exit code (`hostile_commands.txt`).

Whatever is typed: no traceback, no defect of ours (70), a sentence where it is refused, and nothing written then, not even in part.
"""

from __future__ import annotations

import math
import os
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

from bondgraph.commands import commands

LINES = [
    line.split(" | ", 1)
    for line in (Path(__file__).parent / "hostile_commands.txt").read_text(encoding="utf-8").splitlines()
    if line and not line.startswith("#")
]
MODEL = """model Loop {
  parameter R: ohm = 1e3, C: F = 1 uF, m = 2 kg
  input w = 1 V
  MSe s : u = w
  R r : u = R*i
  C c : u = q/C
  s -> 1(r) -> c
  output y = c.u, i = r.i
  experiment step { set R = 2 kohm; simulate 0 .. 10 ms { points = 11 } }
  experiment rest { equilibrium; simulate 0 .. 1 ms { points = 3 } }
}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model, data right and wrong in all ways, and a folder `d`."""
    made = tmp_path_factory.mktemp("hostile")
    measured = "".join(f"{k * 1e-4},{1 - math.exp(-k / 10)}\n" for k in range(51))
    head = "time [s],y [V]\n"
    files = {
        "m.bg": MODEL, "data.csv": head + measured, "nan.csv": f"{head}0,nan\n1e-3,0.5\n", "back.csv": f"{head}1e-3,0\n0,0.5\n",
        "one.csv": f"{head}0,0\n", "nounit.csv": "time,y\n0,0\n1e-3,1\n", "wrongunit.csv": "time [s],y [A]\n0,0\n1e-3,1\n", "empty.csv": "",
    }  # fmt: skip
    for name, text in files.items():
        (made / name).write_text(text, encoding="utf-8")
    (made / "bin.npz").write_bytes(b"PK\x03\x04garbage")
    (made / "d").mkdir()
    return made


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p): p.read_bytes() if p.is_file() else b"" for p in folder.rglob("*")}


def test_there_are_many() -> None:
    assert len(LINES) > 200
    tried = {shlex.split(line)[0] for _, line in LINES if line != "''"}
    assert tried >= {*commands.list_commands(None)}  # type: ignore[arg-type]


@pytest.mark.parametrize(("code", "line"), LINES, ids=[f"{i} {line[:40]}" for i, (_, line) in enumerate(LINES)])
def test_a_command_line(code: str, line: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    before = contents(folder)
    done = CliRunner().invoke(commands, shlex.split(line))
    assert done.exit_code == int(code), done.output
    assert done.exception is None or isinstance(done.exception, SystemExit)
    assert "Traceback" not in done.output and "defect" not in done.output and "Warning" not in done.output
    after = contents(folder)
    if done.exit_code:
        assert len(done.stderr.split()) > 3, "no sentence"
        assert after == before, "something was written"
    for path in sorted(set(after) - set(before), reverse=True):
        assert Path(path).stat().st_size > 0
        os.remove(path)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("run m.bg --set R=1/0", "help: Write an expression that has a finite value"),
        ("run m.bg --set y=1", "It is an output; only parameters and inputs"),
        ("run m.bg --set 'R=1 kohm' --set 'R=2 kohm'", "--set has `R` twice, as `1 kohm` and as `2 kohm`: leave one out"),
        ("linearize m.bg --input nothing", "help: Parameters and inputs: R, C, m, w."),
        ("bode m.bg --points 10000000000000", "from 2 to 1000000 points; these are 10000000000000"),
        ("bode m.bg --over '1e-300 .. 1e300'", "within 1e-150 to 1e+150 Hz; not from 1e-300 to 1e+300 Hz"),
        ("continue m.bg --along R", '--along "k=1 N/m .. 2 N/m"'),
        ("invert m.bg --want y --by w", '--want "x=1 um"'),
        ("invert m.bg --want 'y=1 V' --want 'y=2 V' --by w", "--want has `y` twice"),
        ("sweep m.bg --over R", '--over "k=1 N/m, 2 N/m"'),
        ("montecarlo m.bg --vary R", '--vary "d=normal(2 um, 50 nm)"'),
        ("fit m.bg --data data.csv --parameter R --parameter 'R=1 ohm .. 2 ohm'", "--parameter has `R` twice"),
        ("run m.bg --from bin.npz", "bin.npz is no result of a run"),
    ],
)  # fmt: skip
def test_words(line: str, words: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    done = CliRunner().invoke(commands, shlex.split(line))
    assert done.exit_code in (1, 2) and words in done.stderr
