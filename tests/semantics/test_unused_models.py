"""Imported files: only the models in use are parsed, wherever braces, names and statements stand."""

from __future__ import annotations

from pathlib import Path

import pytest

from compiler.compilation import Compilation
from compiler.errors import Diagnostic
from compiler.examination import check
from compiler.scene import Scene
from compiler.source import Source
from compiler.syntax.outline import Outline
from tests.compiling import LIBRARY, Running

BROKEN = "model Unused {\n  R wire : u = = i\n}\n"
WHEEL = "model Wheel {\n  parameter r = 2 m\n  output y = r\n}\n"
OTHERS = {
    "one": "model Other { output z = 1 }",
    "comment with a brace": "model Other {  # } not yet\n  output z = 1\n}",
    "text with braces": 'model Other {\n  "} model Wheel {"\n  output z = 1\n}',
    "comment that names it": "# model Wheel {\nmodel Other { output z = 1 }",
    "plain": "plain model Other { output z = 1 }",
    "on one line": "model Other { output z = 1 }; model Third { output z = 2 }",
    "slot": "model Other { parameter Kind: model = Third }\nmodel Third { output z = 1 }",
    "attributes": "model Other { 1 j : translation; I m : p = 1 kg*v { start v = 1 [m/s] }; j -> m }",
    "constant behind it": "model Other { output z = 1 }; constant half = 0.5",
    "constant between": "model Other { output z = 1 }\nconstant half = 0.5\nmodel Third { output z = half }",
    "function": "function half(x) = 0.5*x\nmodel Other { output z = half(1) }",
    "broken": BROKEN,
    "two of one name": "model Other { output z = 1 }\nmodel Other { output z = 2 }",
    "an element's kind": "model R { output z = 1 }",
}
MAIN = 'import %s from "parts.bg"\nmodel A {\n  Wheel left { r = 3 m }\n  output y = left.y\n}\n'


def main_of(folder: Path, parts: str, names: str = "Wheel", main: str = MAIN) -> Source:
    (folder / "parts.bg").write_text(parts, encoding="utf-8")
    file = folder / "main.bg"
    file.write_text(main % names, encoding="utf-8")
    return Source(str(file), file.read_text(encoding="utf-8"), file)


def told(source: Source) -> list[Diagnostic]:
    return list(check(source, None, LIBRARY))


@pytest.mark.parametrize("before", [True, False])
@pytest.mark.parametrize("kind", OTHERS)
def test_a_model_beside_others(tmp_path: Path, kind: str, before: bool) -> None:
    other = OTHERS[kind]
    source = main_of(tmp_path, f"{other}\n{WHEEL}" if before else f"{WHEEL}{other}\n")
    assert not told(source)
    assert Running(Compilation(source, Scene(None, None), LIBRARY)).outputs()["y"] == 3.0


@pytest.mark.parametrize("kind", OTHERS)
def test_what_is_not_used_is_no_text_for_the_parser(kind: str) -> None:
    text = f"{OTHERS[kind]}\n{WHEEL}"
    outline = Outline(text)
    part = outline.next_text({"Wheel"})
    assert WHEEL.rstrip() in part and len(part) <= len(text)
    assert "output z" not in part.replace("plain", "") and "u = =" not in part
    assert all(part[i] in (" ", "\n", text[i]) for i in range(len(part)))  # places stay
    again = outline.next_text(outline.models)
    assert "model Wheel" not in again or "model Wheel" in OTHERS[kind]
    assert outline.next_text(outline.models).strip() == ""


def test_models_that_use_each_other(tmp_path: Path) -> None:
    chain = "".join(f"model M{i} {{\n  M{i + 1} next\n  output y = next.y\n}}\n" for i in range(20))
    parts = chain + "model M20 { output y = 7 }\n" + BROKEN
    source = main_of(tmp_path, parts, "M0", 'import %s from "parts.bg"\nmodel A {\n  M0 a\n  output y = a.y\n}\n')
    assert not told(source)
    assert Running(Compilation(source, Scene(None, None), LIBRARY)).outputs()["y"] == 7.0


def test_a_second_import_reads_on(tmp_path: Path) -> None:
    parts = "constant half = 0.5\nmodel One { output y = half }\nmodel Two { output y = 2*half }\n" + BROKEN
    main = 'import One from "parts.bg"\nimport %s from "parts.bg"\nmodel A {\n  One one\n  Two two\n  output y = one.y + two.y\n}\n'
    source = main_of(tmp_path, parts, "Two", main)
    assert not told(source)
    assert Running(Compilation(source, Scene(None, None), LIBRARY)).outputs()["y"] == 1.5


def test_errors_of_what_is_used_have_their_places(tmp_path: Path) -> None:
    source = main_of(tmp_path, f"{OTHERS['one']}\n{WHEEL.replace('= r', '= q')}")
    (mistake,) = told(source)
    assert (Path(mistake.span.source.name).name, mistake.span.line, mistake.span.column) == ("parts.bg", 4, 14)
    source = main_of(tmp_path, f"{OTHERS['one']}\n{WHEEL.replace('= 2 m', '= = 2 m')}")
    assert [m.span.line for m in told(source)] == [3]


def test_the_file_itself_tells_all(tmp_path: Path) -> None:
    main_of(tmp_path, f"{BROKEN}{WHEEL}")
    file = tmp_path / "parts.bg"
    assert [m.span.line for m in told(Source(str(file), file.read_text(encoding="utf-8"), file))] == [2]


def test_a_name_that_is_used_and_defined_twice_is_told(tmp_path: Path) -> None:
    source = main_of(tmp_path, f"{WHEEL}{OTHERS['one']}\n{WHEEL}")
    assert [m.code for m in told(source)] == ["BG104"]


def test_names_that_were_not_read_are_offered(tmp_path: Path) -> None:
    (mistake,) = told(main_of(tmp_path, f"{OTHERS['one']}\n{WHEEL}", "Wheel, Othre"))
    assert "Other" in (mistake.help or "")


@pytest.mark.parametrize("text", ["model A { output y = 1", "model A { output y = 1 }\n}", "} model A {", "model A"])
def test_braces_that_do_not_match(tmp_path: Path, text: str) -> None:
    """The whole file is parsed, and the error told."""
    assert not Outline(text).models
    assert Outline(text).next_text({"A"}) == text
    assert told(main_of(tmp_path, text, "A"))
