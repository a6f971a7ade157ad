"""Corrections of errors: each that is offered leaves the file without the error, and with no name or number of its own."""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path

import pytest

from bondgraph.language_service.corrections import corrections, corrections_of
from bondgraph.language_service.navigation import edited
from bondgraph.language_service.workspace import Workspace
from compiler.errors import Diagnostic
from compiler.examination import check
from compiler.source import Source
from tests.compiling import LIBRARY, ROOT
from tests.errors.test_foreign_words import CASES as FOREIGN
from tests.errors.test_foreign_words import MODEL

# Codes whose errors have corrections, with at least one case among the wrong files.
CORRECTED = "001 002 007 101 102 103 104 105 106 109 111 116 117 118 119 120 121 122 131 134 140 150 152 172 175 201 301 504 506"
CASES = sorted((ROOT / "tests/errors/cases").glob("*.bg"))


def errors(text: str, path: Path) -> tuple[Diagnostic, ...]:
    return check(Source(str(path), text, path), None, LIBRARY)


def offered(path: Path) -> dict[str, list[str]]:
    """The errors of a file by code, each with the texts of its corrections; those texts are without the error."""
    workspace = Workspace()
    text = path.read_text(encoding="utf-8")
    found = workspace.survey(path, True).diagnostics
    texts = defaultdict(list)
    for item in [d for d in found if d.span.source.path == path][:4]:
        for correction in corrections_of(workspace, path, item, len(found)):
            new = edited(text, list(correction.edits), path)
            left = errors(new, path)
            assert (item.code, item.sentence, item.span.line) not in {(d.code, d.sentence, d.span.line) for d in left}
            later = [d for d in left if d.code > "BG3"]  # what is found only where nothing else is wrong
            assert item.code < "BG1" or "Did you mean" in item.help or len(left) - len(later) < len(found)
            numbers = re.findall(r"\d+(?:\.\d+)?", new)
            assert not set(numbers) - set(re.findall(r"\d+(?:\.\d+)?", text.replace("_", ""))) - {"0.5", "5.0", "2"}, (
                "a number that nobody wrote"
            )
            texts[item.code].append(new)
    return texts


def test_corrections_mend_what_they_are_offered_for() -> None:
    codes = {code for path in CASES for code, texts in offered(path).items() if texts}
    assert codes == {f"BG{code}" for code in CORRECTED.split()}


def test_lines_of_other_languages_become_what_their_authors_meant() -> None:
    """The first correction of a foreign line is the line as the table of these lines has it, but for spaces."""
    right, wrong = [], []
    for line, _, followed in FOREIGN:
        text = MODEL.replace("IMPORT", "").replace("LINE", line)
        workspace, path = Workspace(), ROOT / "models/foreign.bg"
        workspace.open(path, text)
        start = text.index(f"\n  {line}") + 1
        options = corrections(workspace, path, start, start + len(line))
        if options and followed and followed != "import":
            new = edited(text, list(options[0].edits), path).split("\n")[text.count("\n", 0, start)]
            same = "".join(followed.split()).startswith("".join(new.split()))
            (right if same else wrong).append(line)
    assert wrong == [] and len(right) >= 35


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        ("  output y = sprin.x", "  output y = spring.x"),
        ("  R other : F = 2 [N*s/m]*v*spring.x/(1 m)", "  MR other : F = 2 [N*s/m]*v*spring.x/(1 m)"),
        ("  output y = spring.x + 3", "  output y = spring.x + 3 m"),
        ("  output y = spring", "  output y = spring.F"),
        ("  parameter m = 2", "  parameter m_2 = 2"),
        ("  spring -> body", "  body -> spring"),
        ("  output y = (1 + 2", "  output y = (1 + 2)"),
        ("  output y = sinus(1)", "  output y = sin(1)"),
        ("  output y = spring.u", "  output y = spring.x"),
        ("  parameter k: N/m = 16 kN", "  parameter k: N/m = 16 [kN/m]"),
        ("  parameter k: N/m = 16 N", "  parameter k: N/m = 16 [N/m]"),
        ("  parameter y = spring.x", "  signal y = spring.x"),
        ("  output y = 1 if 1 < m/(1 kg) < 2 else 0", "  output y = 1 if 1 < m/(1 kg) and m/(1 kg) < 2 else 0"),
        ("  R idle : F = 1 [N*s/m]*v", "}"),
        ("  R other : F = 1 [N*s/m]*v, v = 1 [m/(N*s)]*F", "  R other : F = 1 [N*s/m]*v"),
        ("  output y = linear(time, (2 s, 0, 1 s), (5, 6, 7))", "  output y = linear(time, (0, 1 s, 2 s), (6, 7, 5))"),
        ("  every 2 ms delay 1 ms { mass.v = 0 [m/s] }", "  every 2 ms { mass.v = 0 [m/s] }"),
        ("  I other : p = m*v { start p = 1 [N*s], colour = 3 }", "  I other : p = m*v { start p = 1 [N*s] }"),
    ],
)
def test_a_mistake_of_each_sort(tmp_path: Path, line: str, wanted: str) -> None:
    text = f"model A {{\n  parameter m = 1 kg\n  I mass : p = m*v\n  C spring : F = 5 [N/m]*x\n  1 body\n  body -> mass\n{line}\n}}\n"
    if "-> body" not in line:
        text = text.replace("body -> mass", "body -> mass, spring" + (", other" if "other" in line else ""))
    workspace, path = Workspace(), tmp_path / "a.bg"
    workspace.open(path, text)
    at = text.index(line)
    options = [
        edited(text, list(c.edits), path).split("\n")[6] for c in corrections(workspace, path, at, at + len(line))
    ]
    assert wanted in options


@pytest.mark.parametrize(("unit", "number"), [("N/m", "16 ms"), ("kg", "16 [kN/m]"), ("m", "16 degC")])
def test_a_prefix_is_not_lost(tmp_path: Path, unit: str, number: str) -> None:
    """Another unit without the author's prefix would be another value."""
    workspace, path = Workspace(), tmp_path / "a.bg"
    workspace.open(path, f"model A {{\n  parameter k: {unit} = {number}\n  output y = k\n}}\n")
    assert workspace.survey(path, True).diagnostics and corrections(workspace, path, 12, 12) == []


def test_nothing_is_left_out_that_is_referred_to(tmp_path: Path) -> None:
    text = (
        "model A {\n  Se u : u = 1 V\n  R idle : u = 1 ohm*i\n  R r : u = 1 ohm*i\n  u -> r\n  output i = idle.i\n}\n"
    )
    workspace, path = Workspace(), tmp_path / "a.bg"
    workspace.open(path, text)
    at = text.index("idle")
    assert workspace.survey(path, True).diagnostics and corrections(workspace, path, at, at) == []


def test_what_a_delay_cannot_set_is_sampled_alone(tmp_path: Path) -> None:
    text = "model A {\n  mode b = 0\n  I mass : p = 1 kg*v\n  1 body\n  body -> mass\n  every 2 ms offset 1 ms delay 1 ms { mass.v = 0 [m/s]; b = 1 }\n}\n"
    workspace, path = Workspace(), tmp_path / "a.bg"
    workspace.open(path, text)
    (option,) = corrections(workspace, path, text.index("every"), text.index("every"))
    assert edited(text, list(option.edits), path).splitlines()[5:7] == [
        "  every 2 ms offset 1 ms delay 1 ms { b = 1 }",
        "  every 2 ms offset 1 ms { mass.v = 0 [m/s] }",
    ]


def test_a_statement_outside_of_models_moves_into_one(tmp_path: Path) -> None:
    text = "parameter a = 2\nmodel A {\n  output y = a\n}\n"
    workspace, path = Workspace(), tmp_path / "a.bg"
    workspace.open(path, text)
    (option,) = corrections(workspace, path, 0, 1)
    assert edited(text, list(option.edits), path) == "model A {\n  parameter a = 2\n  output y = a\n}\n"


def test_a_part_is_imported_from_the_library(tmp_path: Path) -> None:
    text = "model A {\n  Se u : u = 1 V\n  Resistor r { R = 10 ohm }\n  u -> r.pins\n  output i = u.i\n}\n"
    workspace, path = Workspace(), tmp_path / "a.bg"
    workspace.open(path, text)
    at = text.index("Resistor")
    (option,) = corrections(workspace, path, at, at)
    new = edited(text, list(option.edits), path)
    assert new.startswith("import Resistor from electric\n") and "BG105" not in [d.code for d in errors(new, path)]
