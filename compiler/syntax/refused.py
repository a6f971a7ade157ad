"""Exceptions of the parser."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..errors import Diagnostic
from ..source import Source, Span
from .errors import StrangeCharacter, Unexpected

if TYPE_CHECKING:
    from lark import Token


def place_of(word: Token) -> tuple[int, int]:
    """Offsets of a word. lark gives none to the end of an empty text."""
    return word.start_pos or 0, word.end_pos or 0


class Refused(Exception):
    """A limit is exceeded, or words do not fit together: a diagnostic that still needs the source."""

    def __init__(self, kind: type[Diagnostic], start: int, end: int, **values: Any) -> None:
        self.kind, self.start, self.end, self.values = kind, start, end, values
        super().__init__(kind.__name__)

    @classmethod
    def at(cls, kind: type[Diagnostic], word: Token, **values: Any) -> Refused:
        """Refusal of one word."""
        return cls(kind, *place_of(word), **values)

    @property
    def is_limit(self) -> bool:
        """True if parsing the rest would only cost time."""
        return self.kind not in (Unexpected, StrangeCharacter)

    def diagnostic(self, source: Source) -> Diagnostic:
        return self.kind(Span(source, self.start, self.end), **self.values)


class Unreadable(Exception):
    """A word that cannot be at its place, or a character (`word` is None) that begins no word. `expected`: terminals that can be there."""

    def __init__(self, position: int, word: Token | None, expected: set[str], open_brackets: list[Token]) -> None:
        self.position, self.word, self.expected, self.open_brackets = position, word, expected, open_brackets
        super().__init__(position)
