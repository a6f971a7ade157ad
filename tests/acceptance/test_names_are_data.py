"""Names, texts, units, comments and names of files are data in every product: payloads of all kinds leave no trace of execution."""

from __future__ import annotations

import ast
import csv
import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from bondgraph.commands import commands
from bondgraph.results.result import _csv_field

# What would be run if a literal could be ended: each writes the file `canary`. A text holds no quotation mark, a comment does.
TEXTS = [
    "'''; open('canary', 'w') #",
    "\\\\'; open('canary', 'w') #\\\\",
    "{open('canary', 'w')} %s {0} {span}",
    "=cmd|'/C echo > canary'!A0",
    "\\\\input{canary} \\\\write18{touch canary} }$$ \\\\end{align*} %",
    "<script>fetch('canary')</script> &amp; ]]> --> <img src=x onerror=alert(1)>",
    "[red]red[/red] [link=file:///canary]here[/link]",
    "$\\\\frac{1}{0$ $(touch canary) `touch canary` ; touch canary",
]
COMMENT = (
    "\"\"\" ; open('canary', 'w') # $\\input{canary}$ </svg><script/> =cmd|A0"  # control characters in a text are BG002
)
NAME = "it's \x1b[31m$x$ %s {0} [red] <b> \u202e#\n open('canary', 'w').bg"

MODEL = """# COMMENT
model lambda {
  "TEXT"
  parameter int = 2 [N/m] "TEXT", np = 1 kg "TEXT", class: N*s/m = 3 "TEXT"
  Se exec       : F = 1 N*step(time - 0.1 s) "TEXT"
  C  None       : F = int*x    "TEXT"   # COMMENT
  I  batch      : p = np*v     "TEXT"
  R  __import__ : F = class*v
  exec -> 1(None, batch, __import__)
  output print = None.x "TEXT", constants = batch.v, __name__ = None.F, open = exec.F
  experiment eval {
    simulate 0 .. 1 s { points = 3 }
    report print, -print in um, None.x*(1 # COMMENT
      + 1) in m* # COMMENT
      s/s, constants, __name__
  }
}
"""


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A file full of payloads, in a folder of its own that is the current one."""
    monkeypatch.chdir(tmp_path)
    text = MODEL.replace("COMMENT", COMMENT)
    assert text.count("TEXT") == len(TEXTS)
    for payload in TEXTS:
        text = text.replace("TEXT", payload.replace("\\\\", "\\"), 1)
    Path(NAME).write_text(text, encoding="utf-8")
    return NAME


def run(*arguments: str) -> Result:
    result = CliRunner().invoke(commands, [*arguments])
    assert result.exit_code == 0, result.output
    harmless(result.output)
    assert not Path("canary").exists()
    return result


def harmless(text: str) -> None:
    """Nothing that a terminal obeys, nothing that turns what is read."""
    assert not re.search(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]", text), repr(text)


def test_the_terminal(file: str) -> None:
    run("check", file)
    for stage in ("syntax", "graph", "causality", "equations", "reduction", "state_equations", "code"):
        run("show", file, "--stage", stage)
    run("equations", file)
    run("run", file, "--energy")
    run("fmt", file)


def test_the_python_module(file: str) -> None:
    run("compile", file, "-o", "made.py")
    source = Path("made.py").read_text(encoding="utf-8")
    harmless(source)
    names = {n.id for n in ast.walk(ast.parse(source)) if isinstance(n, ast.Name)}
    assert not names & {"open", "exec", "eval", "__import__", "compile", "getattr"}
    code = (
        "import made; p = made.Parameters(); x = made.start(p); "
        "print(made.derivative(0.0, x, p), [n for n, _ in made.STATES + made.OUTPUTS])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for name in ("None.x", "batch.p", "print", "constants", "__name__", "open", "int", "np", "class"):
        assert repr(name) in done.stdout or f"  # {name!r}" in source
    assert not Path("canary").exists()


def test_the_table(file: str) -> None:
    run("run", file, "--out", "r.csv")
    text = Path("r.csv").read_text(encoding="utf-8")
    harmless(text)
    rows = list(csv.reader(text.splitlines()))
    assert len(rows) == 4 and len({len(r) for r in rows}) == 1
    assert rows[0] == ["time [s]", "print [m]", "(-print [m])", "None.x*(1 + 1) [m]", "constants [m/s]", "__name__ [N]"]
    assert all(float(value) is not None for row in rows[1:] for value in row)


@pytest.mark.parametrize("start", ["=1+1", "+1", "-x", "@SUM(A1)", "\t=1", "\r=1"])
def test_no_heading_is_a_formula(start: str) -> None:
    assert _csv_field(start).lstrip('"')[0] == "("


def test_the_archive_and_json(file: str) -> None:
    run("run", file, "--out", "r.npz")
    with np.load("r.npz", allow_pickle=False) as arrays:
        assert arrays["print"].shape == (3,)
        assert all(name.isprintable() and ".." not in name for name in arrays)
    told = json.loads(run("run", file, "--json").stdout)
    assert told["schema"] == "bondgraph-result/1"


@pytest.mark.parametrize("closed", [(), ("--closed", "--numbers")])
def test_the_diagram(file: str, closed: tuple[str, ...]) -> None:
    run("draw", file, "-o", "d.svg", *closed)
    text = Path("d.svg").read_text(encoding="utf-8")
    harmless(text)
    kinds = {item.tag.partition("}")[2] for item in ElementTree.fromstring(text).iter()}
    assert kinds <= {"svg", "title", "style", "rect", "g", "path", "text", "circle"}
    assert text.count("<style>") == 1 and "url(" not in text and "@import" not in text


def test_latex(file: str) -> None:
    text = run("equations", file, "--latex").stdout
    for word in ("input", "write", "$", "%", "#", "openout", "canary"):
        assert "\\" + word not in text and (word.isalpha() or word not in text)
    bare = re.sub(r"\\[{}]", "", text)
    depth = 0
    for brace in re.findall(r"[{}]", bare):
        depth += 1 if brace == "{" else -1
        assert depth >= 0
    assert depth == 0
    assert text.count("\\begin{align*}") == text.count("\\end{align*}") == 1


@pytest.mark.machine_code
def test_pictures(file: str) -> None:
    run("run", file, "--plot", "r.svg")
    root = ElementTree.parse("r.svg").getroot()
    kinds = {element.tag.rpartition("}")[2] for element in root.iter()}
    assert not kinds & {"script", "foreignObject", "image", "a", "iframe"}
    assert not [k for e in root.iter() for k in e.attrib if k.lower().startswith("on")]
    run("run", file, "--plot", "r.png")
    assert Path("r.png").read_bytes().startswith(b"\x89PNG")


def test_formatting_keeps_every_payload(file: str) -> None:
    before = Path(file).read_text(encoding="utf-8")
    run("fmt", file)
    assert Path(file).read_text(encoding="utf-8").split() == before.split()


@pytest.mark.parametrize(
    "character", ["\x1b", "\x00", "\x7f", "\x9b", "\u202e", "\u2066", "\u200f", "\u2028", "\ufeff"]
)
def test_texts_and_names_hold_no_hidden_characters(character: str, tmp_path: Path) -> None:
    path = tmp_path / "hidden.bg"
    for text in (f'model A {{ "a{character}b" }}', f"model A{character} {{ }}", f"model A {{ 1 a{character}b }}"):
        path.write_text(text, encoding="utf-8")
        result = CliRunner().invoke(commands, ["check", str(path)])
        assert result.exit_code == 1
        assert f"BG002: The language has no use for the character U+{ord(character):04X}" in result.stderr
        harmless(result.output)


def test_a_mistake_is_told_harmlessly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The line of an error is shown completely, with the name of its file."""
    monkeypatch.chdir(tmp_path)
    Path(NAME).write_text(f"model A {{\n  output y = nothing # {COMMENT}\n}}\n", encoding="utf-8")
    result = CliRunner().invoke(commands, ["check", NAME])
    assert result.exit_code == 1 and "BG101" in result.stderr
    harmless(result.output)
    missing = CliRunner().invoke(commands, ["check", f"no {NAME}"])
    assert missing.exit_code == 2
    harmless(missing.output)
