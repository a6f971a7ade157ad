"""Texts and places in them: a `Source` is one file or one string, a `Span` a part of it."""

from __future__ import annotations

import errno
import re
import stat
from bisect import bisect_right
from dataclasses import field
from pathlib import Path, PurePath

from .fast_dataclass import dataclass

MAXIMUM_BYTES = 32_000_000  # of one file, before it is read
UNIT = ".fmu"  # ending of functional mock-up units, which are imported as models
SYSTEM = ".ssp"  # of systems of them
_COMMENT = re.compile(r"#[^\n]*")


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """One text with its name in messages; `path` is None for a text that is no file.

    `before`: of a piece of a file, the characters and lines of the file before it.
    """

    name: str
    text: str
    path: Path | None = None
    before: tuple[int, int] = (0, 0)
    line_starts: tuple[int, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        starts = [0]
        position = self.text.find("\n")
        while position >= 0:
            starts.append(position + 1)
            position = self.text.find("\n", position + 1)
        object.__setattr__(self, "line_starts", tuple(starts))

    def line(self, number: int) -> str:
        """Text of line `number` of the file (from 1), without its line break."""
        number -= self.before[1]
        start = self.line_starts[number - 1]
        end = self.line_starts[number] if number < len(self.line_starts) else len(self.text)
        return self.text[start:end].rstrip("\r\n")


@dataclass(frozen=True, slots=True)
class Span:
    """The part `start:end` (offsets) of a source."""

    source: Source
    start: int
    end: int

    @property
    def line(self) -> int:
        """Line number in the file, from 1."""
        return bisect_right(self.source.line_starts, self.start) + self.source.before[1]

    @property
    def column(self) -> int:
        """Column, from 1."""
        return self.start - self.source.line_starts[bisect_right(self.source.line_starts, self.start) - 1] + 1

    @property
    def offset(self) -> int:
        """First character, counted from the beginning of the file."""
        return self.source.before[0] + self.start

    @property
    def place(self) -> str:
        """`file:line:column`, as editors understand it."""
        return f"{self.source.name}:{self.line}:{self.column}"

    @property
    def file_and_line(self) -> str:
        """`file:line` without folders, for messages in which the file is known."""
        return f"{PurePath(self.source.name).name}:{self.line}"

    @property
    def text(self) -> str:
        """Text of the span."""
        return self.source.text[self.start : self.end]

    @property
    def words(self) -> str:
        """Text on one line without its comments, as its name in messages."""
        return " ".join(_COMMENT.sub(" ", self.text).split())

    @property
    def unit(self) -> Path | None:
        """File of a functional mock-up unit for which the text stands; None for an author's text."""
        path = self.source.path
        return path if path is not None and path.suffix == UNIT else None

    def to(self, other: Span) -> Span:
        """Span from the start of this one to the end of the other."""
        return Span(self.source, self.start, max(self.end, other.end))


def move(piece: Source, characters: int, lines: int) -> None:
    """Tell a piece of a file how much of the file stands before it, as it changes when another piece is edited."""
    object.__setattr__(piece, "before", (characters, lines))


def read_text(path: str | Path, newline: str | None = None) -> str:
    """Text of a file in UTF-8. Only regular files of a bounded size are read: a device or a pipe may never end.

    Raises OSError, or UnicodeDecodeError.
    """
    found = Path(path).stat()
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, "it is a folder, not a file", str(path))
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "it is no regular file", str(path))
    if found.st_size > MAXIMUM_BYTES:
        raise OSError(errno.EFBIG, f"it has {found.st_size} bytes; the limit is {MAXIMUM_BYTES}", str(path))
    with Path(path).open(encoding="utf-8-sig", newline=newline) as stream:
        return stream.read()
