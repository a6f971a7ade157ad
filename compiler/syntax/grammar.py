"""The parser that lark makes of `grammar.lark`: its contextual lexer, its LALR(1) tables, our nodes.

lark reads the grammar once; its tables are kept as plain data, as making them takes longer than parsing most models.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import lark
from lark import Token
from lark.grammar import Rule
from lark.lark import PostLex
from lark.lexer import PatternStr, TerminalDef

from ..fast_dataclass import dataclass
from ..persistent_cache import kept
from .build import Builder
from .errors import StrangeCharacter, TooDeep
from .refused import Refused, Unreadable, place_of
from .words import grammar

STARTS = ["start", "alone", "alone_law"]
MAXIMUM_NESTING = 100  # brackets within brackets
_OPENING, _CLOSING = frozenset({"LPAR", "LSQB", "NEST", "LBRACE"}), frozenset({"RPAR", "RSQB", "RBRACE"})
# Control characters, and those that turn the direction of writing: in a text they would rewrite the terminal or the reader's eye.
_HIDDEN = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff]")


@dataclass(frozen=True, slots=True)
class ParserTable:
    """lark's parser as plain data: tables, terminals and rules."""

    data: dict[str, Any]
    memo: dict[int, Any]


def make_table(grammar: str) -> ParserTable:
    """Table of a grammar in lark's notation."""
    data, memo = lark.Lark(grammar, parser="lalr", start=STARTS).memo_serialize([TerminalDef, Rule])
    return ParserTable(_plain(data), _plain(memo))


def _plain(data: Any) -> Any:
    """Return the same data without lark's own kind of text, so that it can be kept."""
    if isinstance(data, dict):
        return {_plain(key): _plain(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return type(data)(map(_plain, data))
    return str(data) if isinstance(data, str) else data


class WordFilter(PostLex):
    """Words on their way from the lexer to the parser: line breaks in ( ) and [ ] are dropped, brackets and texts checked."""

    # Read in every state, so that `orange` is never `or` and `ange`, nor `==` two signs.
    always_accept = (
        "NAME",
        "NUMBER",
        "STRING",
        "COMPARE",
        "__ANON_0",
        "__ANON_1",
        "__ANON_2",
        *_CLOSING,
        *_OPENING - {"NEST"},
    )

    def __init__(self) -> None:
        self.open_brackets: list[Token] = []
        self.words: list[Token] | None = None  # collects all words of a text

    def process(self, stream: Iterator[Token]) -> Iterator[Token]:
        self.open_brackets = brackets = list[Token]()
        words = self.words
        for word in stream:
            kind = word.type
            if kind == "_NL":
                if brackets and brackets[-1].type != "LBRACE":
                    continue
            elif kind in _OPENING:
                brackets.append(word)
                if len(brackets) > MAXIMUM_NESTING:
                    raise Refused.at(TooDeep, word, limit=MAXIMUM_NESTING)
            elif kind in _CLOSING:
                if brackets and (kind == "RBRACE") == (brackets[-1].type == "LBRACE"):
                    brackets.pop()
            elif kind == "STRING":
                _refuse_hidden(word)
            if words is not None:
                words.append(word)
            yield word


def _refuse_hidden(word: Token) -> None:
    """Raise `Refused` if a text has an invisible character."""
    hidden = _HIDDEN.search(word)
    if hidden:
        start = place_of(word)[0] + hidden.start()
        hint = "Texts are made of letters, digits, marks and spaces: what cannot be seen has no place in them."
        raise Refused(StrangeCharacter, start, start + 1, character=f"U+{ord(hidden[0]):04X}", hint=hint)


class Parser:
    """lark's parser with a builder of nodes. The caller sets the builder's source."""

    def __init__(self) -> None:
        table = kept(ParserTable, f"// lark {lark.__version__}\n{grammar()}", make_table)
        self.builder, self.words = Builder(), WordFilter()
        self.lark = lark.Lark._load_from_dict(table.data, table.memo, transformer=self.builder, postlex=self.words)  # type: ignore[no-untyped-call]
        patterns = {t.name: t.pattern for t in self.lark.terminals}
        self.keywords = {p.value: name for name, p in patterns.items() if isinstance(p, PatternStr)}

    def parse(self, text: str, start: str, words: list[Token] | None) -> Any:
        """Return the result of rule `start`; `words` collects the words of the text. Raises `Unreadable` and `Refused`."""
        self.words.words = words
        try:
            return self.lark.parse(text, start)
        except lark.UnexpectedCharacters as error:
            expected = {kind for kind in error.interactive_parser.choices() if kind.isupper()}  # type: ignore[no-untyped-call]
            raise Unreadable(error.pos_in_stream or 0, None, expected, self.words.open_brackets) from None
        except lark.UnexpectedToken as error:
            expected, word = error.interactive_parser.accepts(), error.token  # type: ignore[no-untyped-call]
            if word.type == "NAME" and "NAME" not in expected and word in self.keywords:
                word = Token.new_borrow_pos(self.keywords[word], word, word)
            raise Unreadable(place_of(word)[0], word, expected, self.words.open_brackets) from None
