"""Pieces of a file: what stands before its models, and each model with what follows it. An edit costs the parsing of its own piece."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from ..errors import Diagnostic
from ..fast_dataclass import dataclass
from ..source import Source
from .parse import parse_what_can_be_read
from .tree import SyntaxNode

# `model` is reserved and texts end with their lines: a line that begins so is always the head of a model, however much before it is half-typed.
_MODEL = re.compile(r"^[ \t]*(?:plain[ \t]+)?model[ \t]+([A-Za-z_]\w*)", re.MULTILINE | re.ASCII)
_BRACE = re.compile(r'"[^"\n]*"|#[^\n]*|([{}])')
_WORD = re.compile(r"[A-Za-z_]\w*", re.ASCII)


MOST_REPAIRS = 4  # of a piece that cannot be read at all


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A part of a file, parsed alone; places in its nodes and mistakes are in one of its `sources`.

    `model`: the name of its model, "" for the head of a file. `words`: all names in it.
    """

    text: str
    sources: tuple[Source, ...]
    model: str
    statements: tuple[SyntaxNode, ...]
    mistakes: tuple[Diagnostic, ...]
    words: frozenset[str]

    @property
    def source(self) -> Source:
        """Source of its nodes."""
        return self.sources[-1]


def cut(text: str) -> list[str]:
    """Return the texts of the pieces of a file, which together are that file."""
    heads = [head.start() for head in _MODEL.finditer(text)]
    return [text[start:end] for start, end in pairwise([0, *heads, len(text)]) if start < end]


def read_piece(name: str, path: Path | None, text: str) -> Piece:
    """Parse a piece as far as possible: lines with errors are left out, and braces that are open at its end are closed there."""
    sources = [Source(name, text, path)]
    tree, latest = parse_what_can_be_read(sources[0])
    mistakes = [*latest]
    for _ in range(MOST_REPAIRS):
        repaired = None if tree is not None else _repaired(sources[-1], latest)
        if repaired is None:
            break
        sources.append(Source(name, repaired, path))
        tree, latest = parse_what_can_be_read(sources[-1])
        lines = {m.span.line for m in mistakes}
        mistakes += [m for m in latest if m.span.line not in lines and m.span.start < len(text)]
    head = _MODEL.match(text)
    statements = () if tree is None else tree.statements
    return Piece(text, tuple(sources), head[1] if head else "", statements, tuple(mistakes), words_of(text))


def _repaired(source: Source, mistakes: Sequence[Diagnostic]) -> str | None:
    """Return the text with its open braces closed; else without the line before its last mistake, which may have been half-typed."""
    missing = _open_braces(source.text)
    if missing > 0:
        return source.text + "\n}" * missing
    number = mistakes[-1].span.line - 1 if mistakes else 0
    while number > 0 and not source.line(number).split("#")[0].strip():
        number -= 1
    if number <= 0:
        return None
    start, line = source.line_starts[number - 1], source.line(number)
    text = source.text[:start] + " " * len(line) + source.text[start + len(line) :]
    added = -_open_braces(text)  # braces that were put behind the text for one that is in this line
    if added > 0:
        return text[: -2 * added] if text.endswith("\n}" * added) else None
    return text


def words_of(text: str) -> frozenset[str]:
    """Return all names in a text."""
    return frozenset(_WORD.findall(text))


def _open_braces(text: str) -> int:
    braces = [brace[1] for brace in _BRACE.finditer(text)]
    return braces.count("{") - braces.count("}")
