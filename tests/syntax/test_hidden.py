"""Invisible characters in texts between quotes, at their places; an expression from outside has no other check."""

from __future__ import annotations

import pytest

from compiler.errors import CompilationFailed
from compiler.source import Source
from compiler.syntax import parse_expression
from tests.compiling import mistake


@pytest.mark.parametrize(
    ("text", "place", "character"),
    [
        ('column("a\u202eb", "c")', 9, "U+202E"),
        ('"\x7f"', 1, "U+007F"),
        ('a + "b\x1f\x1f"', 6, "U+001F"),
        ('f("ab", "\ufeff")', 9, "U+FEFF"),
    ],
)
def test_an_expression_has_no_invisible_character(text: str, place: int, character: str) -> None:
    with pytest.raises(CompilationFailed) as failed:
        parse_expression(Source("setting", text))
    (found,) = failed.value.diagnostics
    assert (found.code, found.span.start, found.span.end) == ("BG002", place, place + 1)
    assert found.sentence == f"The language has no use for the character {character}"


def test_a_file_is_told_in_the_same_place() -> None:
    found = mistake('model M {\n  parameter a = 1 "a\u202ebc"\n  output z = a\n}', "BG002")
    assert (found.span.place, found.span.text) == ("text.bg:2:21", "\u202e")
