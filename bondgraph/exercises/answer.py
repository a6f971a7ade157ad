"""Answers of students: the lines of a text, and a mark for each."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter

from compiler.api import Source, Span

COMMENT = re.compile(r"(^|\s)#.*")  # names of nodes have the sign, too: `1(r[i])#2`


@dataclass(frozen=True, slots=True)
class Mark:
    """A line of an answer, or a gap (at the end of the answer), with what is wrong with it; nothing if it is right."""

    span: Span
    words: str
    wrong: str = ""

    def text(self) -> str:
        """Return the mark with its place, as editors understand it."""
        return f"{self.span.place}: {f'wrong: {self.words}: {self.wrong}' if self.wrong else f'right: {self.words}'}"


@dataclass(frozen=True, slots=True)
class MarkedAnswer:
    """Marks of an answer in the order of its lines; `note` is a remark on the whole."""

    marks: tuple[Mark, ...]
    note: str = ""

    @property
    def right(self) -> bool:
        """True if nothing is wrong or missing."""
        return not any(m.wrong for m in self.marks)

    @property
    def count(self) -> str:
        """Number of lines that are right, and the remark."""
        right = sum(not m.wrong for m in self.marks)
        return f"{right} of {len(self.marks)} are right{f': {self.note}' * bool(self.note)}"

    def text(self) -> str:
        """Return a line for each mark, in the order of the answer."""
        return "\n".join(m.text() for m in sorted(self.marks, key=attrgetter("span.start")))


def lines_of(answer: Source) -> Iterator[Span]:
    """Yield the lines that have more than a comment, without that."""
    for number, start in enumerate(answer.line_starts, 1):
        text = COMMENT.sub("", answer.line(number)).rstrip()
        if text:
            yield Span(answer, start + len(text) - len(text.lstrip()), start + len(text))


def gaps(answer: Source, missing: Sequence[str]) -> Iterator[Mark]:
    """Yield a mark for each line that an answer lacks."""
    end = len(answer.text.rstrip())
    yield from (Mark(Span(answer, end, end), words, "this line is missing") for words in missing)
