"""Model text as markup: numbered lines, with words coloured by their kind; the diagram is linked with the lines."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import PurePath

from compiler.api import ANALYSIS_STEPS, ELEMENT_KINDS, Source

from .markup import Html, joined, tag

WORDS = frozenset((
    "model", "plain", "parameter", "constant", "input", "output", "signal", "port", "import", "from", "for", "in", "function", "multibody",
    "body", "frame", "mode", "solve", "when", "every", "experiment", "set", "sweep", "simulate", "report", "start", *ANALYSIS_STEPS,
    "require", "integral", "delay", "der", "hysteresis", "if", "else", "and", "or", "not", "true", "false", "time", "pi", "ground", "to", "over",
))  # fmt: skip
WORDING = {"words": sorted(WORDS), "kinds": sorted(ELEMENT_KINDS)}  # for the editor
_PIECES = re.compile(
    r'(?P<remark>#.*)|(?P<words>"[^"]*"?)|(?P<number>\b\d[\d.]*(?:[eE][-+]?\d+)?)|(?P<name>[^\W\d]\w*)|(?P<arrow>->|=>)'
)
_BEGINS = re.compile(r"(?:^|[{;])[ \t]*$")  # of a statement: only there a letter is a kind
_DECLARED = re.compile(
    rf"(?:^|[{{;])[ \t]*(?:[01]|{'|'.join(ELEMENT_KINDS)})[ \t]+$|[-=]>[ \t]*$"
)  # before a name, which may equal a word
_NAMED = re.compile(r"[ \t]*(?:[-=]>|[.:\[]|=(?!=))")  # behind one
LONGEST = 4000  # most lines of one file


def text_markup(sources: Sequence[Source]) -> Html:
    """Return all files of a model, the model's own first and open."""
    return joined(_file(number, source) for number, source in enumerate(sources))


def _file(number: int, source: Source) -> Html:
    lines = source.text.split("\n")
    if lines and not lines[-1]:
        lines.pop()
    rows = (
        tag("li", tag("code", *_pieces(line)), data_at=f"{number}:{i}") for i, line in enumerate(lines[:LONGEST], 1)
    )
    listing = tag("ol", *rows, class_="listing")
    more = [tag("p", f"and {len(lines) - LONGEST} lines more")] if len(lines) > LONGEST else []
    name = PurePath(source.name).name
    return tag("details", tag("summary", tag("code", name)), listing, *more, open=number == 0, class_="file")


def _pieces(line: str) -> Iterator[str]:
    """Yield the parts of a line; text that is neither word, number, comment nor arrow is unchanged."""
    done = 0
    for found in _PIECES.finditer(line):
        kind = found.lastgroup or ""
        if kind == "name":
            kind = _kind(line[: found.start()], found[0], line[found.end() :])
        if kind:
            yield line[done : found.start()]
            yield tag("span", found[0], class_=kind)
            done = found.end()
    yield line[done:]


def _kind(before: str, name: str, after: str) -> str:
    """Return the class of a name by what stands around it; the editor has the same rules."""
    if name in ELEMENT_KINDS:
        return "kind" if _BEGINS.search(before) and re.match(r"[ \t]+[^\W\d]", after) else ""
    return "word" if name in WORDS and not _DECLARED.search(before) and not _NAMED.match(after) else ""
