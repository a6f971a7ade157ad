"""Small wrong files with their messages: the complete text that a user reads is frozen beside each file.

A message is good if it is at the right place, uses the author's names and gives advice. Read the output of
`pytest --update-golden` as a user would, before committing it.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from compiler.errors import Diagnostic, printable, render
from compiler.examination import check
from compiler.source import Source
from tests.compiling import LIBRARY
from tests.conftest import Golden

CASES = sorted((Path(__file__).parent / "cases").glob("*.bg"))
every_case = pytest.mark.parametrize("path", CASES, ids=lambda p: p.stem)


def told(path: Path) -> tuple[Diagnostic, ...]:
    return check(Source(path.name, path.read_text(encoding="utf-8"), path), None, LIBRARY)


def test_there_are_many() -> None:
    assert len(CASES) >= 45
    assert not {p.stem for p in (Path(__file__).parent / "cases").glob("*.txt")} - {p.stem for p in CASES}, (
        "a golden file without its case"
    )


@every_case
def test_message(path: Path, golden: Golden) -> None:
    found = told(path)
    assert found, "nothing is wrong with this file"
    golden(path.with_suffix(".txt"), "\n\n".join(map(render, found)))


@every_case
def test_form(path: Path) -> None:
    """Properties of every message."""
    source = path.read_text(encoding="utf-8")
    for item in told(path):
        assert re.fullmatch(r"BG\d{3}", item.code)
        assert item.span.source.name == path.name and 0 <= item.span.start <= item.span.end <= len(source) + 1
        sentence = item.sentence
        assert sentence and sentence == sentence.strip() and not sentence.endswith("."), (
            "a sentence in the title line has no full stop"
        )
        assert item.help.strip(), f"{item.code} says nothing about what to do"
        for text in (sentence, item.help):
            assert "\n" not in text and "  " not in text
            assert not re.search(r"\bNone\b|<class|object at|Error\b|np\.float", text), "a word of Python"
            assert not re.search(r"\b(circumflex|rpar|lpar|lsqb|rsqb|anon|rbrace)\b", text, re.IGNORECASE), (
                "a word of the parser"
            )
            assert text.count("`") % 2 == 0
            assert not any(
                q.count("(") != q.count(")") for q in re.findall(r"`([^`]+)`", text) if q not in ("(", ")", "0(", "1(")
            ), "a quoted expression has lost a bracket"
        for span, why in item.related():
            assert why and (span.source is item.span.source or span.source.name.endswith(".csv"))


@every_case
def test_what_is_quoted_is_the_author_s(path: Path) -> None:
    """The marked text is on the line that is shown, and the mark is below it."""
    for item in told(path):
        lines = render(item).splitlines()
        assert lines[0].startswith(f"{path.name}:{item.span.line}:{item.span.column}: {item.code}: ")
        shown, mark = lines[1], lines[2]
        first = mark.index("^")
        marked = shown[first : first + mark.count("^")]
        expected = printable(item.span.text.split("\n")[0])
        assert marked == expected[: len(marked)] or not expected.strip()


@every_case
def test_the_same_in_every_run(path: Path) -> None:
    assert [render(d) for d in told(path)] == [render(d) for d in told(path)]
