"""The parser of `grammar.lark`: LALR(1) and contextual patterns by lark's tables, our nodes.

lark makes the tables once; they are kept as plain data, and lark is not imported again. Its own loop over words also counts lines and columns, and takes twice
as long.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any

from ..persistent_cache import kept
from .build import Builder
from .errors import StrangeCharacter, TooDeep
from .refused import Refused, Unreadable
from .tables import CLOSING, OPENING, ParserTable, make_table
from .token import END, Token
from .words import grammar

MAXIMUM_NESTING = 100  # brackets within brackets
# Control characters, and those that turn the direction of writing: in a text they would rewrite the terminal or the reader's eye.
_HIDDEN = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff]")
_SPACES = r"(?>[ \t]+(?![ \t\r\n#]))?"  # before a word; those before a line break may belong to it

_Pattern = tuple[Callable[[str, int], "re.Match[str] | None"], dict[str, str]]


class WordFilter:
    """Words on their way to the parser: line breaks in ( ) and [ ] are dropped, brackets and texts checked."""

    def __init__(self) -> None:
        self.open_brackets: list[Token] = []
        self.words: list[Token] | None = None  # collects all words of a text

    def process(self, stream: Iterator[Token]) -> Iterator[Token]:
        """Yield the words that the parser reads, and one at the end of the text."""
        self.open_brackets = brackets = list[Token]()
        words, start, end = self.words, 0, 0
        for word in stream:
            kind = word.type
            if kind == "_NL":
                if brackets and brackets[-1].type != "LBRACE":
                    continue
            elif kind in OPENING:
                brackets.append(word)
                if len(brackets) > MAXIMUM_NESTING:
                    raise Refused.at(TooDeep, word, limit=MAXIMUM_NESTING)
            elif kind in CLOSING:
                if brackets and (kind == "RBRACE") == (brackets[-1].type == "LBRACE"):
                    brackets.pop()
            elif kind == "STRING":
                _refuse_hidden(word)
            if words is not None:
                words.append(word)
            start, end = word.start_pos, word.end_pos
            yield word
        yield Token(END, "", start, end)


def _refuse_hidden(word: Token) -> None:
    """Raise `Refused` if a text has an invisible character."""
    hidden = _HIDDEN.search(word)
    if hidden:
        start = word.start_pos + hidden.start()
        hint = "Texts are made of letters, digits, marks and spaces: what cannot be seen has no place in them."
        raise Refused(StrangeCharacter, start, start + 1, character=f"U+{ord(hidden[0]):04X}", hint=hint)


class Parser:
    """Parser with a builder of nodes. The caller sets the builder's source."""

    def __init__(self, builder: Builder | None = None) -> None:
        self.builder, self.words = builder or Builder(), WordFilter()
        self.table = table = kept(ParserTable, grammar(), make_table)
        self._rules = [(n, getattr(self.builder, build, _as_they_are), *more) for n, build, *more in table.rules]
        self._matches: dict[int, _Pattern] = {}

    def parse(self, text: str, start: str, words: list[Token] | None) -> Any:
        """Return the result of rule `start`; `words` collects the words of the text. Raises `Unreadable` and `Refused`."""
        self.words.words = words
        states, rules, end = self.table.states, self._rules, self.table.ends[start]
        stack, values = [self.table.starts[start]], list[Any]()
        for word in self.words.process(self._words_of(text, stack)):
            kind = word.type
            while (step := states[stack[-1]].get(kind)) is not None and step < 0:
                name, build, size, places, absent, passes = rules[~step]
                if passes and size == 1 and places is None:
                    stack[-1] = states[stack[-2]][name]
                    continue
                parts = values[-size:] if size else []
                if size:
                    del values[-size:], stack[-size:]
                if places is not None:
                    parts = _kept(parts, places, absent)
                values.append(parts[0] if passes and len(parts) == 1 else build(parts))
                stack.append(states[stack[-1]][name])
                if kind == END and stack[-1] == end:
                    return values[-1]
            if step is None:
                raise self._unreadable(word, stack)
            stack.append(step)
            values.append(word)
        raise AssertionError(start)

    def _words_of(self, text: str, stack: list[int]) -> Iterator[Token]:
        """Yield the words of a text, each by the pattern of the state in which the parser is then. Raises `Unreadable`."""
        place, contexts, matches = 0, self.table.contexts, self._matches
        while place < len(text):
            number = contexts[stack[-1]]
            match, keywords = matches.get(number) or self._pattern(number)
            word = match(text, place)
            if word is None:
                raise self._strange(text, place, stack)
            kind: Any = word.lastgroup
            begin, place = word.span(kind)
            if kind != "BLANK":
                value = text[begin:place]
                yield Token(keywords.get(value, kind) if kind == "NAME" else kind, value, begin, place)

    def _pattern(self, number: int) -> _Pattern:
        """Return a pattern of words and its keywords."""
        pattern, keywords = self.table.patterns[number]
        self._matches[number] = re.compile(f"{_SPACES}(?:{pattern})").match, dict(keywords)
        return self._matches[number]

    def _strange(self, text: str, place: int, stack: list[int]) -> Unreadable:
        """Return the error of a text that is no word that can be there: a word of another place, or a character that begins none."""
        match, keywords = self._pattern(self.table.everywhere)
        if (word := match(text, place)) is not None:
            value, kind = word.group(), str(word.lastgroup)
            kind = keywords.get(value, kind) if kind == "NAME" else kind
            return self._unreadable(Token(kind, value, place, word.end()), stack)
        expected = {kind for kind in self.table.states[stack[-1]] if kind.isupper()}
        return Unreadable(place, None, expected, self.words.open_brackets)

    def _unreadable(self, word: Token, stack: list[int]) -> Unreadable:
        """Return the error of a word that cannot be there."""
        expected = {kind for kind in self.table.states[stack[-1]] if kind.isupper() and self._accepts(stack, kind)}
        if word.type == "NAME" and "NAME" not in expected:
            _, keywords = self._pattern(self.table.everywhere)
            word.type = keywords.get(word, word.type)
        return Unreadable(word.start_pos, word, expected, self.words.open_brackets)

    def _accepts(self, stack: list[int], kind: str) -> bool:
        """Return True if a word of this kind can be next."""
        states, stack = self.table.states, list(stack)
        while (step := states[stack[-1]].get(kind)) is not None and step < 0:
            name, _, size, *_ = self.table.rules[~step]
            del stack[len(stack) - size :]
            stack.append(states[stack[-1]][name])
        return step is not None


def _as_they_are(parts: list[Any]) -> list[Any]:
    return parts


def _kept(parts: list[Any], places: tuple[tuple[int, bool, int], ...], absent: int) -> list[Any]:
    """Return the parts of a rule that its node gets, with None for absent ones."""
    chosen: list[Any] = []
    for place, inner, before in places:
        if before:
            chosen += [None] * before
        if not inner:
            chosen.append(parts[place])
        elif chosen:
            chosen += parts[place]
        else:  # a long list grows by one at each of its parts
            chosen = parts[place]
    return chosen + [None] * absent if absent else chosen
