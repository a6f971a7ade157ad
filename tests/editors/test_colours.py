"""Colours: both copies of the table agree, and with the server, which knows what each name is."""

from __future__ import annotations

import re
from collections import Counter
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from bondgraph.editors.pygments_lexer import BondgraphLexer
from bondgraph.editors.rules import CLASSES, textmate_grammar
from bondgraph.language_service.colours import marked_words
from bondgraph.language_service.vocabulary import KEYWORDS, classes
from bondgraph.language_service.workspace import Workspace
from compiler.syntax.grammar import Parser
from compiler.syntax.words import grammar_words
from tests.compiling import ROOT

MODELS = sorted((ROOT / "models").glob("*.bg"))
MODEL = """plain model Main {
  parameter start = 3, k: N/m = 4 [N/m], kind: {linear, cubic} = linear   # a start
  mode on = true; port a: translation
  C  spring : F = k*x { start x = 1 mm, prefer = integral }
  Part if_any { radius = 2 }
  1  body
  mode -> body -> 0(spring, on)
  signal y = delay(x, 1 ms) if not on else dot(u, v)
  every 1 ms offset 0.2 ms delay 1 us { seed = 3 }
  experiment go { stop when x > 1e-3; set k = 5 %; report x in mm, y }
}
"""
SURE = ("keyword", "operator", "value", "kind", "function", "unit", "number", "comment", "text", "domain")
COLOURS = """keyword:plain model model:Main keyword:parameter number:3 unit:N/m number:4 unit:[N/m] comment:# a start keyword:mode value:true keyword:port domain:translation
kind:C name:spring keyword:start number:1 unit:mm attribute:prefer model:Part name:if_any attribute:radius number:2 kind:1 name:body kind:0 keyword:signal function:delay number:1 unit:ms
operator:if operator:not operator:else function:dot keyword:every number:1 unit:ms keyword:offset number:0.2 unit:ms keyword:delay number:1 unit:us attribute:seed number:3
keyword:experiment name:go keyword:stop keyword:when number:1e-3 keyword:set number:5 unit:% keyword:report operator:in unit:mm"""


class TextMate:
    """The engine of editors on a grammar without nesting: line by line, the leftmost match, the first rule of several."""

    def __init__(self, grammar: dict[str, Any]) -> None:
        self.states = {"": grammar["patterns"], "inside": grammar["repository"]["quantities"]["patterns"]}
        self.end = next(p["end"] for p in grammar["patterns"] if "end" in p)
        self.kinds = {f"{scope}.bondgraph": kind for kind, (scope, _) in CLASSES.items()}

    def words(self, text: str) -> list[tuple[str, str]]:
        state, found = "", list[tuple[str, str]]()
        for line in text.splitlines(keepends=True):
            at = 0
            while at <= len(line):
                rules = [({"end": True}, self.end)] if state else []
                rules += [(p, p.get("match") or p["begin"]) for p in self.states[state]]
                matches = [
                    (m.start(), n, m, p)
                    for n, (p, r) in enumerate(rules)
                    if (m := re.compile(r, re.M).search(line, at))
                ]
                if not matches:
                    break
                _, _, match, pattern = min(matches, key=lambda row: row[:2])
                named = pattern.get("captures") or pattern.get("beginCaptures") or {}
                found += [(self.kinds[v["name"]], match[int(n)]) for n, v in named.items()]
                state = "" if "end" in pattern and pattern["end"] is True else "inside" if "begin" in pattern else state
                at = max(match.end(), at + (match.end() == match.start()))
        return [(kind, word.strip()) for kind, word in found if kind != "sign"]


def by_pygments(text: str) -> list[tuple[int, str, str]]:
    kinds = {f"Token.{token}": kind for kind, (_, token) in CLASSES.items()}
    listed = [
        (at, kinds.get(str(token), ""), word) for at, token, word in BondgraphLexer().get_tokens_unprocessed(text)
    ]
    return [row for row in listed if row[1] not in ("", "sign")]


def test_colours_of_a_model() -> None:
    found = [f"{kind}:{word.strip()}" for _, kind, word in by_pygments(MODEL)]
    assert " ".join(found) == COLOURS.replace("\n", " ")


@pytest.mark.parametrize("path", MODELS[::6], ids=lambda path: path.stem)
def test_both_copies_agree(path: Path) -> None:
    text = path.read_text(encoding="utf-8") + MODEL
    assert TextMate(textmate_grammar()).words(text) == [(kind, word.strip()) for _, kind, word in by_pygments(text)]


def test_the_server_agrees() -> None:
    """A pattern cannot know all names; of the other words nearly all have the class that the server gives them, and none is left out."""
    workspace, differ, count = Workspace(), Counter[tuple[str, str, str]](), 0
    for path in MODELS[::3]:
        text = path.read_text(encoding="utf-8")
        ours = {at + n: kind for at, kind, word in by_pygments(text) for n in range(len(word))}
        for word in marked_words(workspace, path):
            shown, kind = text[word.start : word.end], ours.get(word.start, "")
            if word.kind not in SURE or shown in (
                "0",
                "1",
                "start",
            ):  # junctions, and a keyword that is an attribute too
                continue
            if word.kind in ("function", "value") and shown not in classes()[word.kind]:  # of the author
                continue
            count += 1
            if kind != word.kind and (kind, word.kind) != ("unit", "number"):  # a unit of several words is one here
                differ[shown, kind, word.kind] += 1
    assert differ.total() < 0.004 * count and count > 500, differ


def test_every_word_is_known() -> None:
    """Words of the grammar are those of the parser; each has a sentence and a class."""
    assert set(grammar_words()) == {word for word in Parser().keywords if word.isalpha()}
    assert set(grammar_words()) <= {row.word for row in KEYWORDS}
    assert set(grammar_words()) <= {word for words in classes().values() for word in words}


def test_pygments_finds_the_lexer() -> None:
    """The entry point names it, and one lexer colours any text completely."""
    assert 'bondgraph = "bondgraph.editors.pygments_lexer:BondgraphLexer"' in (ROOT / "pyproject.toml").read_text()
    assert import_module("bondgraph.editors.pygments_lexer").BondgraphLexer.name == "bondgraph"
    for text in ('model {\n "open\n parameter a = (1,\n 2) µ ° \\ 3 Ω', "\r\n;;{{}}", "parameter a: "):
        assert "".join(word for _, _, word in BondgraphLexer().get_tokens_unprocessed(text)) == text
