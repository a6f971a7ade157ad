"""Catalogue of a file of parts: each part as its own text describes it.

A part documents itself in comments behind its first text, in one form: `# law: …`, `# source: …`, `# valid: …`, `# words: …` and `# example: …`;
lines that are further in go on with the one above. An example is the inside of a model that imports the part and runs.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import dedent
from typing import TYPE_CHECKING

from compiler import api

from .compiled_model import LIBRARY

if TYPE_CHECKING:
    from compiler.api import ModelSyntax, Source

_NOTE = re.compile(r"[ \t]*# (law|source|valid|words|example):[ \t]*(.*)")
_MORE = re.compile(r"[ \t]*#(?:   ?(.*)|[ \t]*)")
_TEXT = re.compile(r'\{\s*"([^"\n]*)"[^\n]*\n')
_WORD = re.compile(r"[A-Za-z_]\w*")


@dataclass(frozen=True, slots=True)
class LibraryPart:
    """A model of a file with its documentation; `text` is the model as it is written, `library` the file that `import` names."""

    name: str
    library: str
    text: str
    description: str
    law: str = ""
    source: str = ""
    valid: str = ""
    words: str = ""
    example: str = ""


@dataclass(frozen=True, slots=True)
class PartPort:
    """A port: its domain, and whether the arrow of its bond enters the part."""

    name: str
    domain: str
    enters: bool
    description: str


@dataclass(frozen=True, slots=True)
class PartQuantity:
    """A parameter, input or output: unit and default as they are written."""

    role: str
    name: str
    unit: str
    value: str
    description: str


@dataclass(frozen=True, slots=True)
class Interface:
    """Everything of a part that its surroundings see; `limits` are its `require`s, each condition with its text."""

    ports: tuple[PartPort, ...]
    quantities: tuple[PartQuantity, ...]
    limits: tuple[str, ...]


def library_parts() -> tuple[LibraryPart, ...]:
    """Return all parts of the library, file by file, in the order in which they stand. No file is parsed."""
    return tuple(part for file in sorted(LIBRARY.glob("*.bg")) for part in parts_of(file))


def parts_of(file: Path) -> tuple[LibraryPart, ...]:
    """Return the models of a file that can be read as parts. Raises OSError, `CompilationFailed` for one that is not UTF-8."""
    text = api.read_source(file).text
    library = file.stem if file.parent == LIBRARY else f'"{file.name}"'
    places = ((name, place) for name, spans in api.Outline(text).models.items() for place in spans)
    return tuple(_part(name, library, text[start:end]) for name, (start, end) in places)


def _part(name: str, library: str, text: str) -> LibraryPart:
    first = _TEXT.search(text)
    notes = dict(_notes(text[first.end() :].split("\n"))) if first else {}
    return LibraryPart(name, library, text, first[1] if first else "", **notes)


def _notes(lines: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield the documenting comments at the beginning of some lines, by their keys."""
    key, body = "", [""]
    for line in lines:
        if note := _NOTE.fullmatch(line):
            if key:
                yield key, _joined(key, body)
            key, body = note[1], [note[2].strip()]
        elif key and (more := _MORE.fullmatch(line)):
            body.append(more[1] or "")
        else:
            break
    if key:
        yield key, _joined(key, body)


def _joined(key: str, body: Sequence[str]) -> str:
    """One text of the lines of a note; those of an example stay lines."""
    if key == "example":
        return dedent("\n".join(body[1:])).strip("\n") + "\n"
    return " ".join(filter(None, (line.strip() for line in body)))


def found_by(parts: Sequence[LibraryPart], words: Sequence[str]) -> tuple[LibraryPart, ...]:
    """Return the parts that all of these words describe, those first whose name has them. Capitals do not matter, nor hyphens and spaces in a name."""
    folded = [w.casefold() for w in words]
    joined = [re.sub(r"[\s-]", "", w) for w in folded]
    described = {p.name: f"{p.name} {p.library} {p.description} {p.law} {p.source} {p.words}".casefold() for p in parts}
    named = {p.name: [w in p.name.casefold() for w in joined] for p in parts}
    chosen = [p for p in parts if all(n or w in described[p.name] for w, n in zip(folded, named[p.name], strict=True))]
    return tuple(sorted(chosen, key=lambda p: not all(named[p.name])))


def interface_of(part: LibraryPart) -> Interface:
    """Return ports, quantities and limits of a part. Raises `CompilationFailed` if its text cannot be parsed."""
    model = next(iter(api.parse(api.Source(part.library, part.text)).models.values()))
    quantities = [q for role in ("parameter", "input", "output") for q in _quantities(model, role)]
    limits = [
        f"{s.condition.span.text}{f' ({s.text})' * bool(s.text)}"
        for s in model.statements
        if isinstance(s, api.RequirementSyntax)
    ]
    return Interface(tuple(_ports(model)), tuple(quantities), tuple(limits))


def _ports(model: ModelSyntax) -> Iterator[PartPort]:
    """Yield the ports. An arrow enters by those that stand before every arrow that names them."""
    bonds = [s for s in model.statements if isinstance(s, api.Bonds)]
    left = {e.head for b in bonds for place in b.places[:-1] for e in place if isinstance(e, api.PathSyntax)}
    for statement in (s for s in model.statements if isinstance(s, api.PortsSyntax)):
        texts = _descriptions([i.description for i in statement.items])
        for item, text in zip(statement.items, texts, strict=True):
            yield PartPort(item.name, item.domain or "", item.name in left, text)


def _quantities(model: ModelSyntax, role: str) -> Iterator[PartQuantity]:
    for statement in (s for s in model.statements if isinstance(s, api.Quantities) and s.role == role):
        texts = _descriptions([i.description for i in statement.items])
        for item, text in zip(statement.items, texts, strict=True):
            unit, value = (s.span.source.text[s.span.start : s.span.end] if s else "" for s in (item.unit, item.value))
            yield PartQuantity(role, item.name, unit, value if role != "output" else "", text)


def _descriptions(texts: Sequence[str | None]) -> list[str]:
    """Texts of the items of one statement: one that has none shares that of the next."""
    shared: list[str] = []
    for text in reversed(texts):
        shared.append(text if text is not None else shared[-1] if shared else "")
    return shared[::-1]


def example_of(part: LibraryPart, beside: Sequence[LibraryPart]) -> str:
    """Return the text of the model that shows a part at work; `beside`: the parts of its file. Empty if it has none."""
    if not part.example:
        return ""
    lines = part.example.splitlines()
    imports = [line.strip() for line in lines if line.startswith("import ")]
    body = [line for line in lines if not line.startswith("import ")]
    used = set(_WORD.findall("\n".join(body)))
    names = ", ".join(p.name for p in beside if p.name in used and p.library == part.library)
    head = [
        f"import {names} from {part.library}",
        *imports,
        "",
        f"model {part.name}Example {{",
        f'  "{part.description}"',
    ]
    return "\n".join([*head, *(f"  {line}".rstrip() for line in body), "}", ""])


def example_source(file: Path, name: str) -> Source | None:
    """Return the example of a model of a file as a text beside that file; None if it documents none."""
    parts = parts_of(file)
    part = next((p for p in parts if p.name == name), None)
    text = "" if part is None else example_of(part, parts)
    return api.Source(f"example of {name}", text, file.with_name(f"{name}Example.bg")) if text else None
