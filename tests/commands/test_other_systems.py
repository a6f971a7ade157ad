"""What other systems do otherwise: line ends, marks at the start of a file, names of files, processes that begin from nothing."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from bondgraph.commands import commands

WHEEL = "model Wheel {\n  port p : translation\n  C tyre : F = 100 [N/m]*x\n  p -> tyre\n}\n"
CAR = """import Wheel from "parts of a car/räder.bg"

model Car {
  parameter m = 4 kg  "the body"
  Se load : F = 1 N
  1  body
  I  mass : p = m*v
  Wheel wheel
  load -> body -> mass, wheel.p
  output x = wheel.tyre.x
  experiment go { simulate 0 .. 1 s; report x in mm }
}
"""


def called(*arguments: str | Path) -> str:
    done = CliRunner().invoke(commands, [str(a) for a in arguments])
    assert done.exit_code == 0, done.output
    return done.stdout


def test_a_file_of_windows_is_the_same_model(tmp_path: Path) -> None:
    """Carriage returns, a byte order mark, spaces and letters beyond ASCII in all names; what is formatted keeps its line ends."""
    found = []
    for name, mark, ends in (("plain", "", "\n"), ("Eigene Dateien ü", "\ufeff", "\r\n")):
        folder = tmp_path / name
        (folder / "parts of a car").mkdir(parents=True)
        files = {folder / "parts of a car" / "räder.bg": WHEEL, folder / "das Auto.bg": CAR}
        for path, text in files.items():
            path.write_bytes((mark + text.replace("\n", ends)).encode())
        called("check", *files)
        run = called("run", folder / "das Auto.bg", "--json", "--out", folder / "läuft 1.csv")
        found.append(json.loads(run)["outputs"])
        called("draw", folder / "das Auto.bg", "-o", folder / "ein Bild.svg")
        assert (folder / "läuft 1.csv").stat().st_size and "räder" in called("equations", folder / "das Auto.bg")
        lines = CAR.count("\n")
        called("fmt", folder / "das Auto.bg")
        assert (folder / "das Auto.bg").read_bytes().count(ends.encode()) == lines
    assert found[0] == found[1]


@pytest.mark.few(0)
def test_processes_that_begin_from_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On Windows and macOS processes are not copied: a grid that they share is that of one process."""
    (tmp_path / "räder.bg").write_text(WHEEL, encoding="utf-8")
    (tmp_path / "car.bg").write_text(CAR.replace("parts of a car/", ""), encoding="utf-8")
    monkeypatch.setattr("sys.platform", "darwin")
    shared, alone = (called("sweep", tmp_path / "car.bg", "--over", "m=1 kg, 2 kg, 4 kg", "--jobs", jobs) for jobs in ("2", "1"))  # fmt: skip
    assert shared.splitlines()[:4] == alone.splitlines()[:4] and len(shared.splitlines()) > 3
