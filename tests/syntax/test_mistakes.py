"""Syntax errors: all of them are reported at once, each on its own line, and nothing else."""

from __future__ import annotations

import pytest

from compiler.errors import CompilationFailed, Diagnostic
from compiler.source import Source
from compiler.syntax import parse, parse_expression


def told(text: str) -> list[Diagnostic]:
    with pytest.raises(CompilationFailed) as failed:
        parse(Source("t.bg", text))
    return list(failed.value.diagnostics)


def lines(text: str) -> list[int]:
    return [d.span.line for d in told(text)]


def test_several_mistakes_at_once() -> None:
    text = "\n".join(
        [
            "model A {",
            "  parameter a = 2 + * 3",
            "  parameter b = 4",
            "  C spring F = k*x",
            "  a - > b",
            "  output y = a b",
            "}",
            "model B {",
            "  signal s = 1 if 2",
            "  1 body",
            "}",
        ]
    )
    assert lines(text) == [2, 4, 5, 6, 9]


def test_the_same_line_is_told_once() -> None:
    assert lines("model A {\n signal a = * , b = * , c = *\n}") == [2]


def test_what_follows_an_open_bracket_is_not_blamed() -> None:
    """The bracket of line 2 is never closed; lines 3 and 4 are right."""
    found = told("model A {\n  parameter a = (1 + 2\n  parameter b = 4\n  output y = b\n}\n")
    assert [d.span.line for d in found] == [2]


def test_mistakes_in_every_block() -> None:
    text = "model A {\n for i in 1..3 {\n  1 body[i] x\n }\n multibody m : planar {\n  body a b\n }\n experiment e {\n  simulate 0 . 1 s\n }\n}"
    assert lines(text) == [3, 6, 9]


@pytest.mark.parametrize(
    ("line", "column", "found"),
    [
        ("signal s = a b", 14, "`b`"),
        ("signal s = (a", None, None),
        ("a -> -> b", 6, "`->`"),
        ("signal s = 2 ^", None, None),
        ("C : F = k*x", 3, "`:`"),
        ("for i 1..3 { }", 7, "`1`"),
        ('import A from "b.bg"', 10, "`from`"),
        ("signal s = a ? b", 14, "`?`"),
        ('"text', 1, '`"`'),
    ],
)
def test_the_place_of_a_mistake(line: str, column: int | None, found: str | None) -> None:
    first = told(f"model A {{\n{line}\n}}\n")[0]
    if column is not None:
        assert (first.span.line, first.span.column) == (2, column)
    if found is not None:
        assert found in first.sentence


@pytest.mark.parametrize("character", ["²", "µ", "é", "§", "\u202e", "\x00", "\u00a0", "‐", "→", "🙂"])
def test_characters_that_the_language_does_not_use(character: str) -> None:
    """Reported with its code point, so that an invisible or lookalike character is found; advice is never empty."""
    found = told(f"model A {{\n  signal s = a {character} b\n}}")[0]
    assert (found.code, found.span.line, found.span.column) == ("BG002", 2, 16)
    assert found.help
    assert all(c.isprintable() for c in found.sentence)


@pytest.mark.parametrize(
    "text",
    [
        "model A {",
        "model A {\n",
        "model A {\n  C c : F = k*x\n  { start x = 1",
        "model A {\n  for i in 1..3 {\n  }\n",
        "model",
        "plain",
    ],
)
def test_a_text_that_ends_too_early(text: str) -> None:
    found = told(text)
    assert found and {d.code for d in found} <= {"BG001", "BG007"}
    assert max(d.span.end for d in found) <= len(text)


@pytest.mark.parametrize(
    "text",
    [
        "",
        " ",
        "\n\n",
        "# only a comment",
        "# only a comment\n\n",
        '"only a description"\n',
        "constant a = 2",
        "\ufeff"[:0],
    ],
)
def test_empty_files_parse(text: str) -> None:
    assert parse(Source("t.bg", text)).models == {}


def test_no_more_than_twenty_are_told() -> None:
    text = "model A {\n" + "  signal s = * 2\n" * 50 + "}\n"
    assert 1 < len(told(text)) <= 20


def test_the_other_language_of_that_ending() -> None:
    found = told("version: 1\nname: rc\ncomponents:\n  - C: 1\nnetlist:\n  - C 0\n")
    assert [d.code for d in found] == ["BG006"]


@pytest.mark.parametrize("text", ["", "1 +", "a b", "1; 2", "model A {}", "x = 3", "(1", "\n"])
def test_a_setting_is_one_expression(text: str) -> None:
    with pytest.raises(CompilationFailed) as failed:
        parse_expression(Source("setting", text))
    assert len(failed.value.diagnostics) == 1
