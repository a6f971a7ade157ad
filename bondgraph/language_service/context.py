"""Surroundings of the cursor in a text that may be half-typed: open blocks, the statement before it, open brackets. Words only, no tree."""

from __future__ import annotations

import re
from dataclasses import dataclass

WORD = re.compile(
    r'(?P<comment>#[^\n]*)|(?P<text>"[^"\n]*"?)|(?P<number>\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_]\w*)'
    r"|(?P<operator>->|=>|\.\.|<=|>=|==|!=)|(?P<newline>\n)|(?P<sign>[^\s])",
    re.ASCII,
)
_GOES_ON = frozenset(
    {"->", "=>", "..", "<=", ">=", "==", "!=", "+", "-", "*", "/", "^", "=", ",", ":", "(", "[", "<", ">"}
)
_BEGINS_AS_BEFORE = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*(?:[-+*/^,=)\]<>:!]|(?:if|else|and|or)\b)")


@dataclass(frozen=True, slots=True)
class Word:
    """A word of a text."""

    kind: str
    text: str
    start: int

    @property
    def end(self) -> int:
        """The character behind it."""
        return self.start + len(self.text)


@dataclass(frozen=True, slots=True)
class Context:
    """`blocks`: for each open brace the words of the statement that opened it. `statement`: words of the current one, before the word that is typed.

    `prefix`: what is typed of a word; `brackets`: positions in `statement` of those that are open.
    """

    blocks: tuple[tuple[Word, ...], ...]
    statement: tuple[Word, ...]
    prefix: Word
    brackets: tuple[int, ...]
    is_silent: bool = False  # in a comment or a text

    @property
    def head(self) -> str:
        """First word of the statement that opened the innermost block; empty outside of blocks."""
        words = self.blocks[-1] if self.blocks else ()
        return "model" if words and words[0].text == "plain" else words[0].text if words else ""

    @property
    def first(self) -> str:
        """First word of the statement."""
        return self.statement[0].text if self.statement else ""

    @property
    def last(self) -> str:
        """Last word before the one that is typed."""
        return self.statement[-1].text if self.statement else ""


def context_at(text: str, at: int) -> Context:
    """Return the surroundings of a character."""
    blocks: list[tuple[Word, ...]] = []
    statement: list[Word] = []
    brackets: list[int] = []
    for match in WORD.finditer(text, 0, at):
        kind = match.lastgroup or ""
        word = Word(kind, match[0], match.start())
        if kind == "comment":
            if word.end >= at:
                return Context(tuple(blocks), tuple(statement), Word("name", "", at), tuple(brackets), True)
        elif kind == "newline" or match[0] == ";":
            in_line = match[0] == "\n" and (
                brackets
                or (statement and statement[-1].text in _GOES_ON)
                or _BEGINS_AS_BEFORE.match(text, match.end(), at)
            )
            if not in_line:
                statement, brackets = [], []
        elif match[0] == "{":
            blocks.append(tuple(statement))
            statement, brackets = [], []
        elif match[0] == "}":
            statement, brackets = list(blocks.pop()) if blocks else [], []
        else:
            _bracket(match[0], statement, brackets)
            statement.append(word)
    return _typed(blocks, statement, brackets, at)


def _bracket(sign: str, statement: list[Word], brackets: list[int]) -> None:
    if sign in ("(", "["):
        brackets.append(len(statement))
    elif sign in (")", "]") and brackets:
        brackets.pop()


def _typed(blocks: list[tuple[Word, ...]], statement: list[Word], brackets: list[int], at: int) -> Context:
    """Take the word that ends at the cursor from the statement: it is what is being typed."""
    prefix, silent = Word("name", "", at), False
    if statement and statement[-1].end == at and statement[-1].kind in ("name", "text"):
        last = statement.pop()
        if last.kind == "name":
            prefix = last
        else:
            silent = len(last.text) == 1 or not last.text.endswith('"')
            prefix = Word("text", last.text[1:], last.start + 1) if silent else prefix
    return Context(tuple(blocks), tuple(statement), prefix, tuple(brackets), silent)


def path_before(words: tuple[Word, ...]) -> tuple[str, ...]:
    """The names of the path that a last point continues: `a[2].b.` gives a and b."""
    names: list[str] = []
    position = len(words) - 1
    while position > 0 and words[position].text == ".":
        position -= 1
        if words[position].text == "]":
            while position > 0 and words[position].text != "[":
                position -= 1
            position -= 1
        if position < 0 or words[position].kind != "name":
            break
        names.insert(0, words[position].text)
        position -= 1
    return tuple(names)
