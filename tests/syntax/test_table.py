"""The table of the grammar that is kept says what lark says that reads the grammar."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from typing import Any

import lark
import pytest

import compiler.persistent_cache as kept_module
from compiler.syntax.grammar import Parser, WordFilter
from compiler.syntax.tables import ALWAYS, STARTS, ParserTable, make_table
from compiler.syntax.token import END
from compiler.syntax.words import grammar
from tests.compiling import ROOT

GRAMMAR = grammar()
MODELS = ["oscillator.bg", "manipulator.bg", "dc_motor.bg"]


class Names:
    """A builder that keeps the parts of each rule with its name."""

    def __getattr__(self, name: str) -> Any:
        if not name[:1].isalpha() or name.isupper():
            raise AttributeError(name)
        return lambda parts: (name, [part if isinstance(part, tuple) else part and str(part) for part in parts])


class LineBreaks(WordFilter):
    """lark adds the word at the end of a text itself."""

    always_accept = ALWAYS

    def process(self, stream: Iterator[Any]) -> Iterator[Any]:
        return (word for word in super().process(stream) if word.type != END)


@pytest.mark.parametrize("model", MODELS)
def test_as_lark_reads(model: str) -> None:
    """The loop over tables that were kept gives what lark gives that has just read the grammar."""
    text = (ROOT / "models" / model).read_text(encoding="utf-8")
    names: Any = Names()
    fresh = lark.Lark(GRAMMAR, parser="lalr", start=STARTS, transformer=names, postlex=LineBreaks())  # type: ignore[arg-type]
    assert Parser(names).parse(text, "start", None) == fresh.parse(text, "start")


def test_a_table_is_plain_data() -> None:
    """It can be kept and fetched: nothing of lark is in it."""
    table = make_table(GRAMMAR)
    assert pickle.loads(pickle.dumps(table)) == table
    assert b"lark" not in pickle.dumps(table)


def test_made_once_where_it_can_be_kept() -> None:
    class Shelf:
        def __init__(self) -> None:
            self.things: dict[str, object] = {}

        def key_of(self, *parts: object) -> str:
            return repr(parts)

        def fetch(self, key: str) -> object:
            return self.things.get(key)

        def keep(self, key: str, value: object) -> None:
            self.things[key] = value

    made: list[str] = []

    def make(grammar: str) -> ParserTable:
        made.append(grammar)
        return ParserTable({}, [grammar], {}, {}, [], {}, 0)

    before = kept_module._backends[:]
    try:
        shelf = Shelf()
        kept_module.keep_on(lambda: shelf)
        tables = [kept_module.kept(ParserTable, grammar, make) for grammar in ("one", "one", "two")]
    finally:
        kept_module._backends[:] = before
    assert made == ["one", "two"]
    assert [t.rules for t in tables] == [["one"], ["one"], ["two"]]
