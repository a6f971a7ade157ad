"""The table of the grammar that is kept says what lark says that reads the grammar."""

from __future__ import annotations

import pickle

import lark
import pytest

import compiler.persistent_cache as kept_module
from compiler.source import Source
from compiler.syntax.build import Builder
from compiler.syntax.grammar import STARTS, Parser, ParserTable, WordFilter, make_table
from compiler.syntax.words import grammar
from tests.compiling import ROOT

GRAMMAR = grammar()
MODELS = ["oscillator.bg", "manipulator.bg", "dc_motor.bg"]


@pytest.mark.parametrize("model", MODELS)
def test_as_lark_reads(model: str) -> None:
    """Tables that were kept give what lark gives that has just read the grammar."""
    text = (ROOT / "models" / model).read_text(encoding="utf-8")
    kept_parser, builder = Parser(), Builder()
    kept_parser.builder.source = builder.source = Source(model, text)
    fresh = lark.Lark(GRAMMAR, parser="lalr", start=STARTS, transformer=builder, postlex=WordFilter())
    assert kept_parser.parse(text, "start", None) == fresh.parse(text, "start")


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
        return ParserTable({grammar: ()}, {})

    before = kept_module._backends[:]
    try:
        shelf = Shelf()
        kept_module.keep_on(lambda: shelf)
        tables = [kept_module.kept(ParserTable, grammar, make) for grammar in ("one", "one", "two")]
    finally:
        kept_module._backends[:] = before
    assert made == ["one", "two"]
    assert [list(t.data) for t in tables] == [["one"], ["one"], ["two"]]
