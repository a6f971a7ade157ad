"""Mutants of small texts: the changes that are made, and those that are not."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.compiling import ROOT
from tests.mutation.mutants import mutants_of


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a = b + c\n", {"a = b - c"}),
        ("a = b * (c)\n", {"a = b / (c)", "a = b + (c)"}),
        ("a = b < c\n", {"a = b <= c", "a = b > c"}),
        ("a = b and c or d\n", {"a = b or c or d", "a = b and c and d"}),
        ("a = 2\n", {"a = 3", "a = 1"}),
        ("a = 2.5\n", {"a = 5.0", "a = 1.25"}),
        ("a = not b\n", {"a = b"}),
        ("a = 'é' + b\n", {"a = 'é' - b"}),
        ("if a:\n    b()\n", {"if (not (a)):\n    b()"}),
        ("a: int | None = b\n", set()),
        ("def a(b: int | str) -> int | None: ...\n", set()),
        ("A = B | C\n", set()),
        ("a = f'{b + c}'\n", set()),
    ],
)
def test_changes_of_a_line(tmp_path: Path, text: str, expected: set[str]) -> None:
    path = tmp_path / "room.py"
    path.write_text(text, encoding="utf-8")
    assert {m.applied(text).strip() for m in mutants_of(tmp_path, path)} == expected


def test_every_mutant_of_a_room_differs_in_its_line() -> None:
    path = ROOT / "compiler" / "source.py"
    source = path.read_text(encoding="utf-8")
    mutants = mutants_of(ROOT, path)
    assert len(mutants) > 10
    for mutant in mutants:
        assert source[mutant.start : mutant.end] == mutant.before != mutant.after
        assert source.count("\n", 0, mutant.start) + 1 >= mutant.line
