"""Answers of the service: plain data in characters of a file's text, for an editor, a page or a script."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class TextPlace:
    """A part of a file, by its first character and the one behind its last."""

    path: Path
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class TextEdit:
    """A replacement of a part of a file."""

    place: TextPlace
    text: str


@dataclass(frozen=True, slots=True)
class TextProblem:
    """A diagnostic. `related`: other places, each with a word why."""

    place: TextPlace
    code: str
    sentence: str
    advice: str
    related: tuple[tuple[TextPlace, str], ...] = ()


@dataclass(frozen=True, slots=True)
class Correction:
    """A change that makes a problem go away."""

    title: str
    code: str
    edits: tuple[TextEdit, ...]


@dataclass(frozen=True, slots=True)
class HoverText:
    """Text in Markdown about the word at a place."""

    place: TextPlace
    text: str


@dataclass(frozen=True, slots=True)
class Suggestion:
    """An item of completion. `insert` is a snippet (`${1:name}`) if `is_snippet`; `edits` are changes elsewhere, such as an import."""

    label: str
    kind: str
    detail: str = ""
    documentation: str = ""
    insert: str = ""
    is_snippet: bool = False
    edits: tuple[TextEdit, ...] = ()


@dataclass(frozen=True, slots=True)
class CallUsage:
    """Arguments of a call, and the number of the one at the cursor."""

    label: str
    arguments: tuple[str, ...]
    active: int
    documentation: str = ""


@dataclass(frozen=True, slots=True)
class OutlineNode:
    """A declared name with what is declared in it. `place` is all of it, `name_place` its name."""

    name: str
    kind: str
    detail: str
    place: TextPlace
    name_place: TextPlace
    children: tuple[OutlineNode, ...] = ()


@dataclass(frozen=True, slots=True)
class MarkedWord:
    """A word with its class, for colours."""

    start: int
    end: int
    kind: str
    is_definition: bool = False


@dataclass(frozen=True, slots=True)
class InlineHint:
    """A small text that an editor shows before a character."""

    at: int
    text: str
    why: str = ""
    is_unit: bool = False


@dataclass(frozen=True, slots=True)
class Lens:
    """A command above a line of the text: `words` of the command line, or none for the diagram."""

    place: TextPlace
    title: str
    words: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class LinkedDiagram:
    """Diagram beside a text. `parts`: `data-id` of a group in the SVG -> its places, first its own, then those of the instances around it."""

    model: str
    svg: str
    parts: Mapping[str, tuple[TextPlace, ...]]
