"""Text to tokens for lark's parser: one regular expression for all words, and the parser's state where a word has two meanings.

lark's own contextual lexer does the same with one expression for each set of words that may come next, in three times the time.
What a word is, is read from the grammar's terminals; `_NEXT` must know their shapes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from lark.exceptions import UnexpectedCharacters
from lark.lexer import Lexer, PatternStr, Token

from .errors import StrangeCharacter, TooDeep
from .refused import Refused

MAXIMUM_NESTING = 100  # brackets within brackets

_NEXT = re.compile(
    r"""((?>(?:[ \t\r\n]|\#[^\n]*)*))                      # what stands between words
    (?: ([A-Za-z_][A-Za-z_0-9]*)
      | ([0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?)
      | ("[^"\n]*")
      | (->|=>|\.\.|[<>=!]=|[-+*/^=<>,;:.(){}\[\]]) )?""",
    re.VERBOSE,
)
# Control characters, and those that turn the direction of writing: in a text they would rewrite the terminal or the reader's eye.
_HIDDEN = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff]")
_WORD, _NUMBER, _STRING = 2, 3, 4
_GOES_ON = re.compile(r"[-+*/^,=)\]<>:!]|(?:if|else|and|or)\b")  # what begins a line that continues the one above
_JUNCTION = re.compile(r"[01](?=[ \t]+[A-Za-z_])")
_NEST = re.compile(r"[01]\(")
_OPENING = frozenset({"LPAR", "NEST", "LSQB", "LBRACE"})
_CLOSING = {"RPAR": False, "RSQB": False, "RBRACE": True}


class Word(Token):
    """A token that knows where it stands by offsets alone: lines are counted when a message needs them."""

    __slots__ = ()
    line = column = end_line = end_column = None

    @staticmethod
    def of(kind: str, text: str, start: int, end: int) -> Word:
        word = str.__new__(Word, text)
        word.type, word.value, word.start_pos, word.end_pos = kind, text, start, end
        return word


class Words(Lexer):
    """Reads words, drops line breaks inside ( ) and [ ], where no statement can end, and limits nesting."""

    __future_interface__ = 2  # of lark: `lex` is given the state of the parser
    last: Words  # the one that lark has made

    def __init__(self, lexer_conf: Any) -> None:
        self.fixed: dict[str, list[str]] = {}  # text -> terminals that stand for it
        for terminal in lexer_conf.terminals:
            if isinstance(terminal.pattern, PatternStr):
                self.fixed.setdefault(terminal.pattern.value, []).append(terminal.name)
        for operator in ("<=", ">=", "==", "!=", "<", ">"):
            self.fixed[operator] = ["COMPARE"]
        self.fixed["-"] = ["MINUS", "EXPONENT_SIGN"]
        self.fixed["*"] = ["STAR", "UNIT_SIGN"]
        self.fixed["/"] = ["SLASH", "UNIT_SIGN"]
        self.usual = {text: names[0] for text, names in self.fixed.items()}
        self.accepted: dict[Any, _Accepted] = {}  # by state of the parser
        self.open: list[Token] = []  # brackets that are open where the parser stands
        self.seen: list[Token] | None = None  # gathers the tokens, for who asks
        Words.last = self

    def lex(self, lexer_state: Any, parser_state: Any) -> Iterator[Token]:
        text: str = getattr(lexer_state.text, "text", lexer_state.text)
        accepted, states = self.accepted, parser_state.parse_conf.states
        position, length = 0, len(text)
        following, of = _NEXT.match, Word.of
        self.open = []
        while True:
            found = following(text, position)
            assert found is not None
            start = found.end(1)
            state = parser_state.position
            here = accepted.get(state) or self._accept(state, states)
            if start > position and here.ends and self._ends(text, position, start):
                yield self._gather(of("_NL", text[position:start], position, start))
                state = parser_state.position
                here = accepted.get(state) or self._accept(state, states)
            if start == length:
                return
            index = found.lastindex
            word = found[index or 0]
            end = found.end()
            if index == _WORD:
                kind = here.words.get(word) or ("NAME" if here.names or word not in self.fixed else self.fixed[word][0])
            elif index == _NUMBER:
                kind = here.number
                if not here.numbers:
                    kind, end = _junction(text, start, end, here)
                    word = text[start:end]
            elif index == _STRING:
                kind = "STRING"
                hidden = _HIDDEN.search(text, start, end)
                if hidden:
                    raise _strange(hidden)
            elif index is None or index == 1:
                raise UnexpectedCharacters(text, start, 0, 0, allowed=set(here.all), state=state)  # type: ignore[no-untyped-call]
            else:
                kind = here.words.get(word) or self.usual.get(word, "COMPARE")
            token = of(kind, word, start, end)
            if index == 5 or kind == "NEST":
                self._bracket(token)
            yield self._gather(token)
            position = end

    def _ends(self, text: str, start: int, end: int) -> bool:
        """Whether a statement ends with what stands between two words: a line break, outside of ( ) and [ ]."""
        inside = self.open and self.open[-1].type != "LBRACE"
        return not inside and text.find("\n", start, end) >= 0 and not _GOES_ON.match(text, end)

    def _gather(self, token: Token) -> Token:
        if self.seen is not None:
            self.seen.append(token)
        return token

    def _bracket(self, token: Token) -> None:
        kind = token.type
        if kind in _OPENING:
            self.open.append(token)
            if len(self.open) > MAXIMUM_NESTING:
                raise Refused(TooDeep, token.start_pos or 0, token.end_pos or 0, limit=MAXIMUM_NESTING)
        elif kind in _CLOSING and self.open and _CLOSING[kind] == (self.open[-1].type == "LBRACE"):
            self.open.pop()

    def _accept(self, state: Any, states: Mapping[Any, Mapping[str, Any]]) -> _Accepted:
        self.accepted[state] = found = _Accepted(states[state], self.fixed)
        return found


class _Accepted:
    """What the parser takes in one of its states."""

    def __init__(self, actions: Mapping[str, Any], fixed: Mapping[str, list[str]]) -> None:
        # The names are those of the table itself, so that looking up what to do ends with a comparison of identities.
        self.all = {name: name for name in actions if name.isupper() or name.startswith("__ANON")}
        self.words = {text: self.all[name] for text, names in fixed.items() for name in names if name in self.all}
        self.name, self.number = self.all.get("NAME", "NAME"), self.all.get("NUMBER", "NUMBER")
        self.names, self.numbers, self.ends = "NAME" in self.all, "NUMBER" in self.all, "_NL" in self.all


def _strange(found: re.Match[str]) -> Refused:
    hint = "Texts are made of letters, digits, marks and spaces: what cannot be seen has no place in them."
    return Refused(StrangeCharacter, found.start(), found.end(), character=f"U+{ord(found[0]):04X}", hint=hint)


def _junction(text: str, start: int, end: int, here: _Accepted) -> tuple[str, int]:
    """Where no number can stand, 0 and 1 are junctions."""
    if "NEST" in here.all and _NEST.match(text, start):
        return "NEST", start + 2
    if "JUNCTION" in here.all and _JUNCTION.match(text, start):
        return "JUNCTION", start + 1
    return "NUMBER", end
