"""The grammar of tree-sitter: its words are the table's, its queries name what it has, and with the command line of tree-sitter all texts have a tree."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from click.testing import CliRunner

from bondgraph.commands import commands
from bondgraph.editors.tree_sitter_grammar import tree_sitter_files
from compiler.syntax.words import grammar_words
from tests.compiling import LIBRARY, MODELS, ROOT

# Lines that go on, words as names, a word of the next line that only begins as an operator.
TEXT = """# first
plain model A {
  parameter a = 1,
            b = 2   # more
  signal s = a
    # between
    + b if a > 1
    else 3
  else_ -> order
  signal u = -a
  orbit -> mode.x => 0(a, 1(b))
  order -> input -> c
  if a == 1 { R r : F = v }
  else { C k : F = x { start x = 1 mm
                       prefer = integral } }
  experiment e { set a = 5 %; montecarlo k = normal(8 [N/m], 1 [N/m]), correlation(a, b) = 0.3
    fit k = 1 .. 20 [N/m], c to "x.csv" { seed = 3 }; invert u/v to x = 1 um over 0 V .. 5 V }
}
"""
WRONG = "model A {\n  parameter a = \n  C spring : F = k*\n  a -> -> b\n  experiment e { simulate 0 .. } }\nmodel B {\n  R r : F = v\n}\n"


def test_words_are_those_of_the_table() -> None:
    files = tree_sitter_files()
    grammar = re.sub(r'field\("\w+"|name: "\w+"|//.*', "", files["grammar.js"])
    words = set(re.findall(r'"([a-z]+)"', grammar))
    assert words == set(grammar_words())
    highlights = files["queries/bondgraph/highlights.scm"]
    named = [re.findall(r'"(\w+)"', row) for row in re.findall(r"^\[(.*)\] @keyword", highlights, re.M)]
    assert {word for row in named for word in row} == words


def test_queries_name_what_the_grammar_defines() -> None:
    files = tree_sitter_files()
    grammar = files["grammar.js"]
    nodes, fields = set(re.findall(r"^    ([a-z]\w*): \(", grammar, re.M)), set(re.findall(r'field\("(\w+)"', grammar))
    signs = set(re.findall(r'"([^"\w\s]+)"', grammar)) | {"(", ")", "[", "]", "{", "}"}
    for name, text in files.items():
        if name.endswith(".scm"):
            assert {*re.findall(r"\(([a-z_]+)", text)} <= nodes, name
            assert {*re.findall(r"(\w+): ", text)} <= fields, name
            assert {*re.findall(r'"([^"\w\s]+)"', re.sub(r";.*", "", text))} <= signs, name


def test_with_its_command_line(tmp_path: Path) -> None:
    """The parser is made without conflicts, all texts of ours are parsed, a wrong text costs its own lines alone, and colours can be made."""
    if (program := shutil.which("tree-sitter")) is None or shutil.which("cc") is None:
        pytest.skip("the grammar is tried with the command line of tree-sitter and a C compiler")
    done = CliRunner().invoke(commands, ["editor", "tree-sitter", "-o", str(tmp_path / "grammar")])
    assert done.exit_code == 0, done.output

    def call(*words: str, code: int = 0) -> str:
        environment = os.environ | {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path)}
        done = subprocess.run([program, *words], cwd=tmp_path / "grammar", env=environment, capture_output=True, text=True, check=False)  # fmt: skip
        assert done.returncode == code, done.stdout + done.stderr
        return done.stdout

    call("generate")
    reference = (ROOT / "bondgraph" / "language.md").read_text(encoding="utf-8")
    texts = [TEXT, *re.findall(r"^```bg\n(.*?)^```", reference, re.S | re.M)]
    places = [*MODELS.rglob("*.bg"), *LIBRARY.rglob("*.bg")]
    for number, text in enumerate(texts):
        places.append(tmp_path / f"{number}.bg")
        places[-1].write_text(text, encoding="utf-8")
    (tmp_path / "all").write_text("\n".join(map(str, places)), encoding="utf-8")
    call("parse", "--quiet", "--paths", str(tmp_path / "all"))
    (tmp_path / "wrong.bg").write_text(WRONG, encoding="utf-8")
    first, second = call("parse", str(tmp_path / "wrong.bg"), code=1).rpartition("\n/")[0].split("(model")[1:]
    assert "ERROR" in first and "ERROR" not in second and "equation" in second
    coloured = call("highlight", "--html", str(tmp_path / "0.bg"))
    assert len(re.findall("<span style", coloured)) > 60
