"""Files of columns as texts: `# a comment`, a header, then rows of cells with commas between."""

from __future__ import annotations

import re
from pathlib import Path

from ...fast_dataclass import dataclass
from ...source import Source, Span
from .errors import WrongColumn
from .statement_errors import Wrong

MAXIMUM_SIZE = 4_000_000  # bytes of a file of columns
MAXIMUM_ROWS = 10_000  # of a file of columns

_CELL = re.compile(r'[ \t]*("(?:[^"]|"")*"|[^,\n]*?)[ \t]*(?:,|$)')
_SHAPE = "A file of columns has a header such as `x [mm], force [N]`, then numbers with commas between."


@dataclass(frozen=True, slots=True)
class Sheet:
    """A file of columns, as texts: headers and rows of cells."""

    source: Source
    names: tuple[str, ...]
    headers: tuple[Span, ...]
    rows: tuple[tuple[Span, ...], ...]


def read_sheet(span: Span, name: str, path: Path) -> Sheet:
    """The cells of a file. Raises `Wrong`."""
    try:
        size = path.stat().st_size
        if size > MAXIMUM_SIZE:
            hint = f"At most {MAXIMUM_SIZE} bytes are read: keep the columns and rows that matter."
            raise Wrong(WrongColumn(span, f"`{name}` has {size} bytes", hint))
        source = Source(name, path.read_text(encoding="utf-8-sig"), path)
    except OSError as error:
        raise Wrong(WrongColumn(span, f"`{name}` cannot be read", str(error.strerror or error))) from None
    except UnicodeDecodeError:
        raise Wrong(WrongColumn(span, f"`{name}` is not a text in UTF-8", _SHAPE)) from None
    rows = []
    position = 0
    for line in source.text.split("\n"):
        if line.strip() and not line.lstrip().startswith("#"):
            rows.append(_cells(source, position, line.rstrip("\r")))
        position += len(line) + 1
    if len(rows) < 2:
        raise Wrong(WrongColumn(span, f"`{name}` has no rows of numbers", _SHAPE))
    if len(rows) - 1 > MAXIMUM_ROWS:
        hint = f"At most {MAXIMUM_ROWS} are read: keep every second one, or those where the curve bends."
        raise Wrong(WrongColumn(span, f"`{name}` has {len(rows) - 1} rows", hint))
    return Sheet(source, tuple(word_of(cell) for cell in rows[0]), rows[0], tuple(rows[1:]))


def _cells(source: Source, position: int, line: str) -> tuple[Span, ...]:
    spans = []
    at = 0
    while at <= len(line):
        match = _CELL.match(line, at)
        if match is None:  # text behind a closing quote: taken as it is
            spans.append(Span(source, position + at, position + len(line)))
            break
        spans.append(Span(source, position + match.start(1), position + match.end(1)))
        if match.end() == at or (match.end() == len(line) and not match.group(0).endswith(",")):
            break
        at = match.end()
    return tuple(spans)


def word_of(cell: Span) -> str:
    text = cell.text
    return text[1:-1].replace('""', '"') if text.startswith('"') and text.endswith('"') and len(text) > 1 else text
