"""Diagnostics: errors as values, with a code, a place, a sentence in the author's own names, and advice.

Every room lists its diagnostics in its own `errors.py`, with a range of codes of its own:
BG0xx syntax, BG1xx semantics, BG2xx graph and mechanisms, BG3xx causality, BG4xx equations, BG5xx reduction, BG6xx code,
BG7xx back to text.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import field, fields, replace
from typing import ClassVar, dataclass_transform

from .fast_dataclass import dataclass
from .source import Span


@dataclass_transform(frozen_default=True)
@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One error in a text. Subclasses, dataclasses like this one, set `code`, `title` and `advice`, templates over their own fields."""

    code: ClassVar[str] = "BG000"
    title: ClassVar[str] = ""
    advice: ClassVar[str] = ""
    span: Span
    # the instances that it is in, outermost first
    stands: tuple[tuple[Span, str], ...] = field(default=(), kw_only=True)

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True)(cls)

    def _fill(self, template: str) -> str:
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("span", "stands")}
        return template.format(**values) if values else template

    @property
    def sentence(self) -> str:
        """Description of the error."""
        return self._fill(self.title)

    @property
    def help(self) -> str:
        """Advice for the author."""
        return self._fill(self.advice)

    @property
    def cause(self) -> tuple[str, str, int, str]:
        """Equal for one error of a definition in all its instances: code, file, place, and the words without names."""
        return self.code, self.span.source.name, self.span.offset, re.sub(r"`[^`]*`", "", self.sentence)

    def to_json(self) -> dict[str, str | int]:
        """Data for `json.dumps`: {file, line, column, code, message, help}."""
        place = self.span
        return {
            "file": place.source.name, "line": place.line, "column": place.column, "code": self.code, "message": self.sentence, "help": self.help
        }  # fmt: skip

    def related(self) -> tuple[tuple[Span, str], ...]:
        """Other relevant places, each with a word why."""
        return ()


class WordedDiagnostic(Diagnostic):
    """An error whose sentence and advice are written where it is found; `others` are related places. Subclasses have a code alone."""

    title = "{what}"
    advice = "{hint}"
    what: str
    hint: str
    others: tuple[tuple[Span, str], ...] = ()

    def related(self) -> tuple[tuple[Span, str], ...]:
        return self.others


def standing(item: Diagnostic, stands: Mapping[str, Span]) -> Diagnostic:
    """The diagnostic with the places of the instances that it is in, found by the names in it."""
    if item.stands:
        return item
    names = (getattr(item, word, "") for word in ("element", "owner", "culprit", "node"))
    name = next((n for n in names if isinstance(n, str) and n), "")
    parts = name.split(".")
    paths = [".".join(parts[:i]) for i in range(1, len(parts) + 1)]
    return replace(item, stands=tuple((stands[p], f"`{p}` stands here") for p in paths if p in stands))


class CompilationFailed(Exception):
    """The text has errors; `diagnostics` lists all of them, with places and causes."""

    def __init__(self, diagnostics: Iterable[Diagnostic]) -> None:
        unique: dict[tuple[str, str, int, str], Diagnostic] = {}
        for item in diagnostics:
            unique.setdefault(item.cause, item)
        self.diagnostics = tuple(sorted(unique.values(), key=lambda d: (d.span.source.name, d.span.offset, d.code)))
        super().__init__("\n\n".join(render(item) for item in self.diagnostics))

    def __reduce__(self) -> tuple[type[CompilationFailed], tuple[tuple[Diagnostic, ...]]]:
        return type(self), (self.diagnostics,)  # as it goes from one process to another


class ValuesNeeded(Exception):
    """The compiler needs values that only a run knows, because they decide more than numbers (a length, a choice).

    `why`: for each name the place that needs it, in the author's words.
    """

    def __init__(self, why: Mapping[str, str]) -> None:
        self.names, self.why = frozenset(why), dict(why)
        super().__init__(", ".join(sorted(self.names)))


class InternalError(Exception):
    """A defect of the compiler, not of the text."""

    def __init__(self, what: str) -> None:
        super().__init__(f"defect in the compiler, please report it: {what}")


def printable(text: str) -> str:
    """The text with control and bidirectional characters made visible, so that a file cannot rewrite a terminal."""
    return "".join(c if c.isprintable() or c == "\t" else f"\\u{ord(c):04x}" for c in text)


def render(item: Diagnostic) -> str:
    """The diagnostic as text: place and sentence, the line with a mark below it, advice."""
    parts = [f"{printable(item.span.place)}: {item.code}: {printable(item.sentence)}", _excerpt(item.span)]
    for span, why in (*item.related(), *item.stands):
        parts += [f"{printable(span.place)}: {printable(why)}", _excerpt(span)]
    if item.help:
        parts.append(f"  help: {printable(item.help)}")
    return "\n".join(parts)


def _excerpt(span: Span) -> str:
    line = span.source.line(span.line)
    first = span.column - 1
    length = max(1, min(span.end - span.start, len(line) - first))
    if len(line) > 160:  # a very long line is shown around the place only
        cut = max(0, first - 60)
        line, first, length = line[cut : cut + 140], first - cut, min(length, 80)
    line = line.replace("\t", " ")
    before, marked = printable(line[:first]), printable(line[first : first + length])
    first, length = len(before), max(length, len(marked))  # as long as it is shown
    line = printable(line)
    number = str(span.line)
    return f"  {number} | {line}\n  {' ' * len(number)} | {' ' * first}{'^' * length}"
