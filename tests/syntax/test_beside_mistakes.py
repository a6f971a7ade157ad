"""After a mistake in how one model is written, the other models of the file are checked all the same; nothing false follows."""

from __future__ import annotations

import pytest

from compiler.examination import check
from compiler.source import Source

WRONG = "model Broken {\n  port a: translation\n  I m : p = 1 kg*v\n  m m m\n  a -> m\n}\n"
USER = "model Main {\n  Broken b\n  Se s : F = 1 N\n  s -> b.a\n  output x = b.m.v\n}\n"


def codes(text: str) -> list[str]:
    return [d.code for d in check(Source("file.bg", text))]


@pytest.mark.parametrize("text", [WRONG + USER, USER + WRONG], ids=["before", "behind"])
def test_its_instances_tell_nothing(text: str) -> None:
    assert codes(text) == ["BG001"]


def test_other_models_are_looked_at() -> None:
    assert sorted(codes(WRONG + USER.replace("1 N", "nothing"))) == ["BG001", "BG101"]
    assert codes(WRONG + "model Part {\n  parameter k: N/m\n}\n") == ["BG001"], "a part may lack values"


@pytest.mark.parametrize(
    "line",
    ["constant k = = 3 N\n", "import Broken frm somewhere\n", "function f(x) = x x x\n"],
    ids=["constant", "import", "function"],
)
def test_what_names_mean_is_not_guessed(line: str) -> None:
    """A line outside of models may have said what the names in them are."""
    user = "model Main {\n  Se s : F = k*f(1)\n  Broken b\n  s -> b.a\n}\n"
    assert set(codes(line + user)) == {"BG001"}
    assert set(codes("model First { }\n" + line + user)) == {"BG001"}


def test_braces_in_texts_and_comments_open_nothing() -> None:
    text = 'model First {\n  "a { in a text"  # and { here\n}\nconstant k = = 3 N\nmodel Main {\n  Se s : F = k\n}\n'
    assert codes(text) == ["BG001"]
