"""Places in characters of a text, and in lines and code units as editors count them."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import lru_cache

UTF8, UTF16, UTF32 = "utf-8", "utf-16", "utf-32"


@dataclass(frozen=True, slots=True)
class Lines:
    """A text by lines; `encoding` is that in whose code units an editor counts columns."""

    text: str
    starts: tuple[int, ...]
    encoding: str

    def position(self, offset: int) -> tuple[int, int]:
        """Line and column, from 0, of a character."""
        offset = max(0, min(offset, len(self.text)))
        line = bisect_right(self.starts, offset) - 1
        return line, self._units(self.text[self.starts[line] : offset])

    def offset(self, line: int, column: int) -> int:
        """Character of a line and a column; the end of the line, or of the text, for one behind it."""
        if line >= len(self.starts):
            return len(self.text)
        start = self.starts[line]
        end = self.starts[line + 1] - 1 if line + 1 < len(self.starts) else len(self.text)
        if self.text[start:end].isascii() or self.encoding == UTF32:
            return min(start + column, end)
        at, units = start, 0
        while at < end and units < column:
            units += self._units(self.text[at])
            at += 1
        return at

    def _units(self, text: str) -> int:
        if text.isascii() or self.encoding == UTF32:
            return len(text)
        return len(text.encode("utf-8" if self.encoding == UTF8 else "utf-16-le")) // (
            1 if self.encoding == UTF8 else 2
        )


@lru_cache(64)
def lines_of(text: str, encoding: str) -> Lines:
    """The lines of a text."""
    starts = [0]
    at = text.find("\n")
    while at >= 0:
        starts.append(at + 1)
        at = text.find("\n", at + 1)
    return Lines(text, tuple(starts), encoding)
