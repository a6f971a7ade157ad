"""The table of the grammar says what lark says: lark's own parser, given the same words, makes the same of them."""

from __future__ import annotations

import pickle
from typing import Any

import lark
import pytest

import compiler.persistent_cache as kept_module
from compiler.syntax.read import Reader
from compiler.syntax.table import STARTS, ParserTable, make_table
from compiler.syntax.word import Word
from tests.compiling import ROOT

GRAMMAR = (ROOT / "compiler" / "syntax" / "grammar.lark").read_text(encoding="utf-8")
MODELS = ["oscillator.bg", "manipulator.bg", "dc_motor.bg"]


class Listing:
    """A builder that only lists: each rule's name and parts."""

    def __getattr__(self, name: str) -> Any:
        if name in ("expression", "operand", "atom", "definition"):  # they only stand for what they are
            raise AttributeError(name)
        return lambda parts: (name, parts)


def listed(node: Any) -> Any:
    """lark's tree in the same form."""
    if isinstance(node, lark.Tree):
        return (str(node.data), [listed(child) for child in node.children])
    return None if node is None else str(node)


@pytest.mark.parametrize("model", MODELS)
def test_as_lark_reads(model: str) -> None:
    text = (ROOT / "models" / model).read_text(encoding="utf-8")
    seen: list[Word] = []
    ours = Reader(make_table(GRAMMAR), Listing()).read(text, "start", seen)

    class Same(lark.lexer.Lexer):
        """Hands lark the words that we have read."""

        __future_interface__ = 2

        def __init__(self, conf: Any) -> None:
            pass

        def lex(self, lexer_state: Any, parser_state: Any) -> Any:
            return (lark.Token(word.type, str(word)) for word in seen)

    theirs = lark.Lark(GRAMMAR, parser="lalr", start=list(STARTS), lexer=Same).parse(text, start="start")
    assert listed(theirs) == ours


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
        return ParserTable({}, (), (), (), {grammar: ()})

    before = kept_module._backends[:]
    try:
        shelf = Shelf()
        kept_module.keep_on(lambda: shelf)
        tables = [kept_module.kept(ParserTable, grammar, make) for grammar in ("one", "one", "two")]
    finally:
        kept_module._backends[:] = before
    assert made == ["one", "two"]
    assert [list(t.fixed) for t in tables] == [["one"], ["one"], ["two"]]
