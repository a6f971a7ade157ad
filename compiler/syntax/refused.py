"""What is raised while a text is read."""

from __future__ import annotations

from typing import Any

from ..errors import Diagnostic
from ..source import Source, Span
from .errors import StrangeCharacter, Unexpected
from .word import Word


class Refused(Exception):
    """A limit was passed, or words do not fit together: the diagnostic, as soon as the source is known."""

    def __init__(self, kind: type[Diagnostic], start: int, end: int, **values: Any) -> None:
        self.kind, self.start, self.end, self.values = kind, start, end, values
        super().__init__(kind.__name__)

    @property
    def is_limit(self) -> bool:
        """Whether what follows could only cost time."""
        return self.kind not in (Unexpected, StrangeCharacter)

    def diagnostic(self, source: Source) -> Diagnostic:
        return self.kind(Span(source, self.start, self.end), **self.values)


class Unreadable(Exception):
    """A word that cannot stand where it stands, or a character (`word` is None) with which none begins; `expected`: terminals that can."""

    def __init__(self, position: int, word: Word | None, expected: set[str], open_brackets: list[Word]) -> None:
        self.position, self.word, self.expected, self.open_brackets = position, word, expected, open_brackets
        super().__init__(position)
