"""Classes of the words of a file, for colours that know what a name is."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from compiler.api import path_of, tree

from .answers import MarkedWord
from .context import WORD
from .vocabulary import classes
from .workspace import Workspace

CLASSES = ("keyword", "operator", "value", "attribute", "kind", "domain", "function", "unit", "model", "parameter", "constant", "variable", "port",
           "element", "instance", "text", "number", "comment")  # fmt: skip
_OF_NAMES = {
    "model": "model", "parameter": "parameter", "constant": "constant", "input": "variable", "output": "variable", "signal": "variable", "mode": "variable",
    "port": "port", "component": "port", "element": "element", "junction": "element", "part": "element", "instance": "instance", "mechanism": "instance",
    "function": "function", "argument": "parameter", "index": "parameter", "experiment": "function", "solve": "variable",
}  # fmt: skip
_PLAIN = {"comment": "comment", "text": "text", "number": "number"}


def marked_words(workspace: Workspace, path: Path) -> Iterator[MarkedWord]:
    """Yield the words of a file with their classes, in order; names that are not declared, and signs, have none."""
    document, _ = workspace.names(path)
    path = path.resolve()
    named: dict[int, tuple[str, bool]] = {}
    words: dict[str, str] = {}
    for occurrence in workspace.occurrences(path):
        kind = _OF_NAMES.get(occurrence.name.kind, "") if occurrence.name is not None else _builtin(occurrence.kind)
        if kind and path_of(occurrence.span) == path:
            named[occurrence.span.offset] = (kind, occurrence.is_definition)
        if occurrence.is_definition and occurrence.name is not None and isinstance(occurrence.name.node, tree.Item):
            words |= {word: "value" for word, _ in occurrence.name.node.choices}
    words |= {w: kind for kind, listed in classes().items() if kind not in ("timing", "function") for w in listed}
    functions = dict.fromkeys(classes()["function"], "function")  # `rotation(angle)`; without brackets it is a domain
    timing = dict.fromkeys((*classes()["timing"], "solve"), "keyword")  # `delay(x, 1 ms)` is a signal
    for match in WORD.finditer(document.text):
        sort = match.lastgroup or ""
        kind, defined = named.get(match.start(), (_PLAIN.get(sort, ""), False))
        if not kind and sort == "name":
            called = document.text.startswith("(", match.end())
            kind = (functions if called else timing).get(match[0], words.get(match[0], ""))
        if kind:
            yield MarkedWord(match.start(), match.end(), kind, defined)


def _builtin(kind: str) -> str:
    if kind == "library":
        return "model"
    return kind if kind in ("unit", "function", "kind", "attribute", "variable") else ""
