"""Grammar and queries of tree-sitter, as Neovim, Helix, Zed and Emacs use them: the texts of `tree_sitter/`, with the words of the language."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from compiler import api

from ..language_service.vocabulary import classes
from ..version import VERSION

SOURCES = Path(__file__).with_name("tree_sitter")
_GRAMMAR = {"name": "bondgraph", "scope": "source.bondgraph", "path": ".", "file-types": ["bg"]}


def tree_sitter_files() -> Mapping[str, str]:
    """Texts of the files of a folder in which `tree-sitter generate` makes the parser, by their names."""
    words = classes()
    replaced = {
        "ANALYSES": _quoted(api.ANALYSIS_STEPS, ", "),
        "KEYWORDS": _quoted(dict.fromkeys((*words["keyword"], *words["timing"]))),
        **{f"{kind.upper()}S": _quoted(words[kind]) for kind in ("operator", "kind", "domain", "function", "value")},
    }
    queries = {path.stem: f"queries/bondgraph/{path.name}" for path in sorted(SOURCES.glob("*.scm"))}
    places = {kind: place for kind, place in queries.items() if kind != "folds"}  # the others are of its command line
    metadata = {"version": VERSION, "license": "MIT", "description": "Bond graphs as text"}
    return {
        "tree-sitter.json": json.dumps({"grammars": [_GRAMMAR | places], "metadata": metadata}, indent=2) + "\n",
        **{
            place: re.sub(rf"\b(?:{'|'.join(replaced)})\b", lambda match: replaced[match[0]], text)
            for name, place in {"grammar": "grammar.js", **queries}.items()
            for text in [(SOURCES / Path(place).name).read_text(encoding="utf-8")]
        },
    }


def _quoted(words: Iterable[str], between: str = " ") -> str:
    return between.join(json.dumps(word) for word in words)
