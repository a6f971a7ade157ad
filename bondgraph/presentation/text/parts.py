"""Parts of the library as plain text: a list to choose from, and the page of one part."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import groupby
from textwrap import wrap
from typing import TYPE_CHECKING

from .tables import aligned, counted

if TYPE_CHECKING:
    from ...catalogue import Interface, LibraryPart, PartQuantity

WIDTH = 100  # characters of a line of running text
LONGEST_LAW = 72
_ARROW = re.compile(r",? ?arrows? (in|out)$")  # of a port: its direction has a column of its own


def list_text(parts: Sequence[LibraryPart]) -> str:
    """Return the parts by their files, each in a line with its law."""
    sections = []
    for library, group in groupby(sorted(parts, key=lambda p: p.library), lambda p: p.library):
        rows = [(f"  {p.name}", _cut(p.law or p.description)) for p in group]
        sections.append("\n".join([library, aligned(rows, "<<")]))
    end = f"{counted(len(parts), 'part')}; `bondgraph library PART` shows one, `import PART from FILE` uses it"
    return "\n\n".join([*sections, end])


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST_LAW else text[: LONGEST_LAW - 2].rstrip() + " …"


def page_text(part: LibraryPart, interface: Interface, example: str) -> str:
    """Return the page of a part: what it is, its law, ports, quantities, validity, source, and its example as a file."""
    notes = [
        ("law", part.law),
        ("valid", part.valid),
        *(("require", t) for t in interface.limits),
        ("source", part.source),
    ]
    blocks = ["\n".join([f"{part.name}, of {part.library}", *wrap(part.description, WIDTH)])]
    lines = [line for key, text in notes if text for line in _note(key, text)]
    blocks += ["\n".join(lines)] if lines else []
    arrow = {True: "arrow in", False: "arrow out"}
    ports = [(f"  {p.name}", p.domain, arrow[p.enters], _ARROW.sub("", p.description)) for p in interface.ports]
    blocks += ["\n".join(["ports", aligned(ports, "<<<<")])] if ports else []
    blocks += list(_quantities(interface.quantities))
    if example:
        hint = f"`bondgraph library {part.name} -o example.bg` writes it, `-o example.svg` draws it"
        blocks.append(f"example (a file; {hint})\n\n{example.rstrip()}")
    return "\n\n".join(blocks)


def _note(key: str, text: str) -> Iterator[str]:
    first, *more = wrap(text, WIDTH - 10)
    yield f"{key:<10}{first}"
    yield from (f"{'':<10}{line}" for line in more)


def _quantities(quantities: Sequence[PartQuantity]) -> Iterator[str]:
    for role, group in groupby(quantities, lambda q: q.role):
        rows = [(f"  {q.name}", q.value, q.unit, q.description) for q in group]
        yield "\n".join([f"{role}s", aligned(rows, "<><<")])
