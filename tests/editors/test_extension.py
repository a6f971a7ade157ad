"""The extension of VS Code as a file, and in a session with the server; configurations of other editors."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner

from bondgraph.commands import commands
from bondgraph.commands.editors import EDITORS
from bondgraph.editors.configurations import CONFIGURATIONS
from bondgraph.editors.extension import SOURCES
from tests.compiling import ROOT

TEXT = """model Car {
  parameter k: N/m = 16e3
  Se road : F = 1 kN*step(time)
  I mass : p = 250 kg*v
  C spring : F = k*x
   1   body
  road -> body -> mass, sprin
  output travel = spring.x
  experiment bump { simulate 0 .. 1 s }
}
"""


def editor(*arguments: str, code: int = 0) -> str:
    done = CliRunner().invoke(commands, ["editor", *arguments])
    assert done.exit_code == code, done.output
    return done.output


def test_the_extension_is_complete(tmp_path: Path) -> None:
    """All that its manifests name is there, and it is the same file each time."""
    out = tmp_path / "b.vsix"
    editor("vscode", "-o", str(out), "--command", "bondgraph lsp")
    first = out.read_bytes()
    editor("vscode", "-o", str(out), "--command", "bondgraph lsp")
    assert out.read_bytes() == first
    with zipfile.ZipFile(out) as archive:
        names, package = set(archive.namelist()), json.loads(archive.read("extension/package.json"))
        manifest = ElementTree.fromstring(archive.read("extension.vsixmanifest"))
        types = ElementTree.fromstring(archive.read("[Content_Types].xml"))
        grammar = json.loads(archive.read("extension/bondgraph.tmLanguage.json"))
    contributes = package["contributes"]
    paths = [package["main"], contributes["languages"][0]["configuration"], contributes["grammars"][0]["path"]]
    assert {f"extension/{p.removeprefix('./')}" for p in paths} < names
    assert contributes["grammars"][0]["scopeName"] == grammar["scopeName"]
    assert contributes["configuration"]["properties"]["bondgraph.command"]["default"] == ["bondgraph", "lsp"]
    identity = next(e for e in manifest.iter() if e.tag.endswith("Identity"))
    assert (identity.get("Id"), identity.get("Version")) == (package["name"], package["version"])
    assert {e.get("Extension") for e in types} == {Path(n).suffix for n in names} - {".xml"}


def test_each_editor_has_a_text() -> None:
    assert set(EDITORS) == {"vscode", "tree-sitter", *CONFIGURATIONS}
    for name in ("neovim", "helix", "emacs", "zed"):
        assert '"/a b/python"' in editor(name, "--command", "'/a b/python' lsp")
        assert json.dumps(sys.executable) in editor(name)
    helix = tomllib.loads(editor("helix", "--command", "'/a b/python' lsp"))
    assert helix["language-server"]["bondgraph"] == {"command": "/a b/python", "args": ["lsp"]}
    assert editor("emacs").count("(") == editor("emacs").count(")")
    assert json.loads(editor("textmate"))["scopeName"] == "source.bondgraph"
    tomllib.loads(editor("zed").split("# ---- src")[0].split("# ---- Cargo.toml")[1])


@pytest.mark.parametrize(
    "words",
    [
        ["vscode"],
        ["tree-sitter"],
        ["vscode", "-o", "b.zip"],
        ["vim"],
        ["neovim", "--command", ""],
        ["helix", "--command", "'a"],
    ],
)
def test_wrong_uses_are_refused(words: list[str]) -> None:
    assert "Traceback" not in editor(*words, code=2)


def session(command: list[str], path: Path) -> dict[str, Any]:
    pytest.importorskip("pygls")
    if (node := shutil.which("node")) is None:
        pytest.skip("node is not installed")
    script = [
        node,
        str(Path(__file__).with_name("session.js")),
        str(SOURCES / "extension.js"),
        json.dumps(command),
        str(path),
    ]
    path.write_text(TEXT, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(script, env=environment, capture_output=True, text=True, check=True, timeout=120)
    return json.loads(done.stdout)  # type: ignore[no-any-return]


def test_a_session(tmp_path: Path) -> None:
    """A mistake is shown and corrected; then everything is asked once."""
    command, path = [sys.executable, "-P", "-m", "bondgraph"], tmp_path / "car.bg"
    answer = session([*command, "lsp"], path)
    assert answer["mistake"]["code"] == "BG101" and answer["mistake"]["range"]["start"] == {"line": 6, "character": 24}
    assert answer["edit"]["newText"] == "spring" and answer["left"] == [] and answer["shown"] == []
    assert "N/m" in answer["hover"] and answer["definition"]["start"] == {"line": 1, "character": 12}
    assert {"parameter", "experiment", "Se"} <= set(answer["items"])
    assert answer["symbols"][0][0] == "Car" and "spring" in answer["symbols"][0][1]
    assert answer["tokens"] > 100 and answer["tokens"] % 5 == 0 and answer["renamed"] == 2 and answer["folds"] == 1
    assert "\n  1  body\n" in answer["formatted"] or "\n  1 body\n" in answer["formatted"]
    assert answer["hints"]
    assert [lens["command"]["title"] for lens in answer["lenses"]] == ["Diagram", "Run", "Modes"]
    assert answer["tasks"] == [[*command, name, str(path), "-e", "bump"] for name in ("run", "modes")]
    # The diagram: a part leads to its place, and the line of the cursor to its parts.
    assert answer["jumps"] == [{"start": {"line": 4, "character": 4}, "end": {"line": 4, "character": 10}}]
    assert answer["lit"] == [answer["id"]] and "acquireVsCodeApi" in answer["script"]


def test_a_server_that_cannot_start_is_told(tmp_path: Path) -> None:
    (sentence,) = session(["no-such-program", "lsp"], tmp_path / "car.bg")["shown"]
    assert "no-such-program lsp" in sentence and "bondgraph.command" in sentence
