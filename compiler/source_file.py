"""A file as a source."""

from __future__ import annotations

import codecs
from pathlib import Path

from .errors import CompilationFailed, Diagnostic
from .source import Source, Span, read_text

_AFTER = 200  # bytes that are shown from the first that is no text on


def read_source(path: str | Path, newline: str | None = None) -> Source:
    """Text of a file, named by its path. Raises OSError, or `CompilationFailed` if it is not UTF-8."""
    try:
        return Source(str(path), read_text(path, newline), Path(path))
    except UnicodeDecodeError:
        raise CompilationFailed([_not_utf8(Path(path), str(path))]) from None


def _not_utf8(path: Path, name: str) -> Diagnostic:
    """Diagnostic at the first byte that is not UTF-8."""
    from .syntax.errors import NotUtf8  # a file that is one needs no room of the compiler

    data = path.read_bytes()
    try:
        data.decode("utf-8")
        place = 0  # the file has changed since it was read
    except UnicodeDecodeError as problem:
        place = problem.start
    text = _lines(data[: place + _AFTER])
    start = len(_lines(data[:place]))
    is_utf16 = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    hint = "It begins as UTF-16 does: save it as UTF-8." if is_utf16 else "Save it as UTF-8, if it is a text."
    if data.startswith(b"PK"):  # a zip archive
        hint = (
            f'It is an archive. If it is a unit of another tool, a model imports it: `import Name from "{path.name}"`.'
        )
    what = f"byte {place + 1} is 0x{data[place]:02x}" if data else "it has changed"
    return NotUtf8(Span(Source(name, text, path), start, min(start + 4, len(text))), what, hint)


def _lines(data: bytes) -> str:
    r"""Decoded bytes with line breaks as in a text; invalid bytes are `\xff`, in Python's notation."""
    text = data.decode("utf-8-sig", "backslashreplace")
    return text.replace("\r\n", "\n").replace("\r", "\n")
