"""Parameters that are texts: names of files and columns, and words that are compared; known before there is a program."""

from __future__ import annotations

from pathlib import Path

import pytest

import bondgraph
from compiler.errors import CompilationFailed
from compiler.metamorphosis.printing import text_of
from compiler.source import Source
from compiler.syntax import parse
from tests.compiling import compiled, mistake, mistakes, outputs_of

LIBRARY = """
model Road {
  parameter file: text, column_name = "h", kind = "smooth", own = kind
  constant xs = column(file, "x"), hs = column(file, column_name), twice = 2*hs
  output y = linear(0.5 m, xs, hs), z = linear(0.5 m, xs, twice), rough = kind == "rough", alike = own != "smooth"
}
"""
MODEL = """import Road from "lib/road.bg"
constant spare = "b.csv"
parameters Rough { kind = "rough"; file = "b.csv" }
function height(file, x) = linear(x, column(file, "x"), column(file, "h"))
function spared(x) = linear(x, column(spare, "x"), column(spare, "h"))
model Ride {
  parameter file = "a.csv" "the road", other = file
  function here(x) = linear(x, column(file, "x"), column(file, "h"))
  Road one { file = file }
  Road two { file = other, column_name = "g", kind = "rough" }
  Road three { parameters = Rough }
  if file != "a.csv" { Road four { file = "a.csv" }; output last = four.y }
  output y1 = one.y, y2 = two.y, y3 = three.y, z1 = one.z, z3 = three.z, rough = two.rough, alike = two.alike
  output f = height(spare, 0.5 m) - height(one.file, 0.5 m), g = spared(1 m), h = here(1 m)
}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "road.bg").write_text(LIBRARY, encoding="utf-8")
    (tmp_path / "main.bg").write_text(MODEL, encoding="utf-8")
    for name, top in (("a.csv", 10), ("b.csv", 30), ("c.csv", 50)):
        (tmp_path / name).write_text(f"x [m], h [mm], g [mm]\n0, 0, 0\n1, {top}, {2 * top}\n", encoding="utf-8")
    return tmp_path


def test_each_instance_reads_the_file_that_it_is_given(folder: Path) -> None:
    """Also where it is read through lists that are constants, which otherwise are the same in all instances."""
    wanted = {"y1": 5e-3, "y2": 10e-3, "y3": 15e-3, "z1": 10e-3, "z3": 30e-3, "rough": 1, "alike": 1}
    found = outputs_of(compiled(folder / "main.bg"))
    assert found == pytest.approx({**wanted, "f": 10e-3, "g": 30e-3, "h": 10e-3})
    found = outputs_of(compiled(folder / "main.bg", {"file": '"c.csv"', "two.kind": '"smooth"'}))
    changed = {"y1": 25e-3, "y2": 50e-3, "z1": 50e-3, "rough": 0, "alike": 0, "last": 5e-3}
    assert found == pytest.approx({**wanted, **changed, "f": -10e-3, "g": 30e-3, "h": 50e-3})


def test_an_experiment_sets_it_and_texts_are_printed_as_they_are(folder: Path) -> None:
    text = MODEL.replace("output f", 'experiment e { set file = "b.csv"; simulate 0 .. 1 s }\n  output f')
    printed = text_of(parse(Source("main.bg", text)).statements)
    for words in (text, printed):
        (folder / "main.bg").write_text(words, encoding="utf-8")
        assert bondgraph.load(folder / "main.bg").simulate().final("y1") == pytest.approx(15e-3)


def test_nothing_outside_of_the_project_is_read(folder: Path) -> None:
    (folder / "lib" / "bondgraph.toml").write_text("", encoding="utf-8")
    main = folder / "lib" / "main.bg"
    main.write_text(
        'import Road from "road.bg"\nmodel A { Road r { file = "../a.csv" }; output y = r.y }', encoding="utf-8"
    )
    assert "outside the project folder" in mistakes(main)[0].sentence
    main.write_text(
        'import Road from "road.bg"\nmodel A { parameter f = "x.csv"; Road r { file = f }; output y = r.y }'
    )
    with pytest.raises(CompilationFailed, match="outside the project folder"):
        outputs_of(compiled(main, {"f": '"../a.csv"'}))


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        ("output y = a", "BG111", 'this is the text "one"'), ("output y = norm(a)", "BG111", 'the text "one"'), ("output y = a if n > 1 else a", "BG111", "the text"),
        ("parameter b: mm = \"x\"", "BG111", "this is a text"), ("constant b = (\"x\", \"y\")", "BG111", "A number"), ("output y = 1 if a == n else 0", "BG111", "A text is expected here, this is `n`"),
        ("output y = 1 if 3 == a else 0", "BG111", "this is `3`"), ('output y = a < "b"', "BG111", "this is `<`"), ("output y = not a", "BG111", "the text"), ("signal s = a", "BG111", "A number"),
        ("experiment e { set a = n; simulate 0 .. 1 s }", "BG111", "A text for `a` is expected here, this is `n`"), ('experiment e { sweep n = "x", "y"; simulate 0 .. 1 s }', "BG111", "A number"),
        ("experiment e { sweep a = 1, 2; simulate 0 .. 1 s }", "BG122", "`a` of `the sweep` cannot be `1`"),
        ("parameter b: text", "BG110", "`b` has no value"), ("parameter b: text = 3", "BG111", "A text for `b`"), ('output y = 1 if kind == "soft" else 0', "BG111", "One of soft, hard"), ("when time > 1 s { a = \"b\" }", "BG153", "cannot be set"),
    ],
)  # fmt: skip
def test_a_text_is_no_number(line: str, code: str, words: str) -> None:
    text = f'model A {{ parameter a = "one", n = 2, kind: {{ soft, hard }} = soft\n {line}\n output z = time }}'
    assert words in mistake(text, code).sentence


def test_a_part_may_leave_it_open() -> None:
    law = 'F = k*linear(x, column(file, "x"), column(file, "x"))'
    text = f"model P {{ port a: translation; parameter file: text, k: N/m = 2; C c : {law}; a -> c }}"
    assert mistakes(text) == ()
