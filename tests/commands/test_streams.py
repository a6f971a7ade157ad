"""Standard streams that are closed, full or abandoned: every command ends as it would, with its own exit code and its files."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from bondgraph.commands import COMMANDS
from tests.compiling import ROOT

pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device")

MODEL = """model Rlc {
  parameter R = 10 ohm, U = 5 V
  Se battery   : u = U
  1  loop      : electric
  R  resistor  : u = R*i
  I  inductor  : lambda = 10 mH*i
  C  capacitor : q = 10 uF*u
  battery -> loop -> resistor, inductor, capacitor
  output i = loop.i, u = capacitor.u
  experiment go { simulate 0 .. 1 ms { points = 3 } }
}
"""

# What each command is called with in the folder of `m.bg`; the files it leaves come first.
CALLS = {
    "benchmark": ("m.bg", "--rounds", "1", "--alone", "--to", "1 ms"),
    "bode": ("m.bg", "--input", "U", "--output", "i", "--points", "3"),
    "causality": ("m.bg",),
    "certificate": ("m.bg",),
    "check": ("m.bg",),
    "compile": ("m.bg", "-o", "out.py"),
    "continue": ("m.bg", "--along", "R=1 ohm .. 2 ohm", "--points", "3"),
    "draw": ("m.bg", "--out", "out.svg"),
    "editor": ("neovim", "-o", "out.lua"),
    "equations": ("m.bg",),
    "equilibrium": ("m.bg",),
    "exercise": ("m.bg", "equations"),
    "explain": ("m.bg", "i"),
    "fit": ("m.bg", "--data", "missing.csv"),
    "fmt": ("--check", "m.bg"),
    "import": ("missing.mo", "-o", "out.bg"),
    "invert": ("m.bg", "--want", "u=2 V", "--by", "U"),
    "library": ("diode", "pins"),
    "linearize": ("m.bg",),
    "lsp": ("--help",),
    "manual": ("--help",),
    "mcp": ("--help",),
    "modes": ("m.bg",),
    "montecarlo": ("m.bg", "--vary", "R=1 %", "--samples", "4", "--jobs", "1"),
    "new": ("new.bg",),
    "plot": ("missing.npz",),
    "report": ("m.bg", "-o", "out.html"),
    "reproduce": ("missing",),
    "run": ("m.bg", "--out", "out.csv"),
    "sensitivity": ("m.bg",),
    "serve": ("missing.bg",),
    "show": ("m.bg", "--stage", "graph"),
    "stress": ("m.bg", "--for", "0.2 s"),
    "watch": ("missing.bg",),
    "sweep": ("m.bg", "--over", "R=1 ohm .. 2 ohm : 2", "--jobs", "1"),
}
MODES = ("plain", "closed", "full")
ERRORS_TOO = (*MODES, "abandoned", "errors closed", "errors full", "errors abandoned", "all closed")

# Each case is a fork of one process that has read everything: a process of its own for each would take minutes.
DRIVER = """
import gc, json, os, sys
sys.path.insert(0, os.getcwd())
from pathlib import Path
from click.testing import CliRunner
from bondgraph.commands import COMMANDS, main, commands
for name in COMMANDS:
    commands.get_command(None, name)
model, first, cases = json.load(sys.stdin)
with CliRunner().isolated_filesystem(sys.argv[1]):
    Path("m.bg").write_text(model)
    for arguments in first:
        CliRunner().invoke(commands, arguments)

def shut(stream):
    os.close(stream)
    setattr(sys, {0: "stdin", 1: "stdout", 2: "stderr"}[stream], None)

def become(mode, folder):
    os.chdir(folder)
    for stream, name in ((1, "stdout"), (2, "stderr")):
        os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), stream)
    stream = 2 if mode.startswith("errors") else 1
    if mode == "all closed":
        for stream in (0, 1, 2):
            shut(stream)
    elif mode.endswith("closed"):
        shut(stream)
    elif mode.endswith("full"):
        os.dup2(os.open("/dev/full", os.O_WRONLY), stream)
    elif mode.endswith("abandoned"):
        read, write = os.pipe()
        os.close(read)
        os.dup2(write, stream)

gc.freeze()  # the end of a child would walk through all that
found = []
for index, (mode, arguments) in enumerate(cases):
    folder = Path(sys.argv[1]) / str(index)
    folder.mkdir()
    (folder / "m.bg").write_text(model)
    child = os.fork()
    if child == 0:
        sys.argv = ["bondgraph", *arguments]
        become(mode, folder)
        main()
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    texts = [(folder / n).read_text() for n in ("stdout", "stderr")]
    files = sorted(p.name for p in folder.glob("out.*")) + sorted(p.name for p in folder.glob("new.bg"))
    found.append([code, *texts, files])
json.dump(found, sys.stdout)
"""

End = tuple[int, str, str, list[str]]
CASES = {
    **{name: [name, *arguments] for name, arguments in CALLS.items()},
    "run --help": ["run", "--help"],
    "--help": ["--help"],
    "no command": [],
    "wrong option": ["run", "--nothing"],
    "wrong model": ["check", "wrong.bg"],
}


KEYS = [
    (name, mode)
    for name in CASES
    for mode in (MODES if name in CALLS and name not in ("run", "check", "new") else ERRORS_TOO)
]


READ_ALL = [
    "report",
    "equilibrium",
    "stress",
    "compile",
    "draw",
    "run",
]  # between them they import what all commands do
FINE = ["run", "check", "equations", "compile", "new", "modes", "report", "draw"]


@pytest.fixture(scope="module")
def ends(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str], End]:
    """End of each case that a test of this session asks for: exit code, standard output, errors, files."""
    parameters = [
        item.callspec.params
        for item in request.session.items
        if isinstance(item, pytest.Function) and hasattr(item, "callspec")
    ]
    wanted = {(p["name"], p["mode"]) for p in parameters if p.keys() == {"name", "mode"}}
    plain = {name for name, _ in wanted} | set(FINE)
    keys = [key for key in KEYS if key in wanted or (key[1] == "plain" and key[0] in plain)]
    asked = json.dumps([MODEL, [CASES[name] for name in READ_ALL], [(mode, CASES[name]) for name, mode in keys]])
    command = [sys.executable, "-c", DRIVER, str(tmp_path_factory.mktemp("streams"))]
    done = subprocess.run(command, cwd=ROOT, input=asked, capture_output=True, text=True, check=True, timeout=300)
    return dict(zip(keys, (tuple(e) for e in json.loads(done.stdout)), strict=True))


def test_every_command_is_tried() -> None:
    assert set(CALLS) == set(COMMANDS)


@pytest.mark.few(18)
@pytest.mark.parametrize(("name", "mode"), KEYS)
def test_a_stream_ends_no_command(name: str, mode: str, ends: dict[tuple[str, str], End]) -> None:
    plain, (code, _, errors, files) = ends[name, "plain"], ends[name, mode]
    assert "Traceback" not in errors and "defect" not in errors and "Exception ignored" not in errors
    assert files == plain[3]
    if mode == "full" and plain[1]:
        assert code == (plain[0] or 2)
        assert errors.endswith("bondgraph: the standard output cannot be written: No space left on device\n")
    else:
        assert code == plain[0]
        assert plain[0] in (0, 1, 2)
        assert errors == ("" if mode.startswith("errors") or mode == "all closed" else plain[2])


@pytest.mark.parametrize("name", FINE)
def test_the_plain_case_is_fine(name: str, ends: dict[tuple[str, str], End]) -> None:
    assert ends[name, "plain"][0] == 0, ends[name, "plain"][2]


def test_a_letter_that_the_stream_has_not() -> None:
    command = [sys.executable, "-X", "utf8=0", "-m", "bondgraph", "run", "models/rlc.bg"]
    done = subprocess.run(command, cwd=ROOT, env={"PYTHONIOENCODING": "ascii"}, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.isascii()
