"""The grammar itself: LALR(1) without a conflict, and every sketch of the language's tour parses."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import lark
import pytest

from compiler.source import Source
from compiler.syntax import parse, tree
from compiler.syntax.words import grammar

GRAMMAR = grammar()
SKETCHES = sorted((Path(__file__).parent / "sketches").glob("*.bg"))

needs_interegular = pytest.mark.skipif(
    importlib.util.find_spec("interegular") is None,
    reason="lark looks for conflicts between terminals only where interegular is installed",
)


@needs_interegular
def test_no_conflicts() -> None:
    """Strict lark refuses every shift/reduce conflict and every pair of terminals that could match the same text."""
    parser = lark.Lark(GRAMMAR, parser="lalr", start=["start", "alone"], strict=True)
    assert {t.name for t in parser.terminals} >= {"NAME", "NUMBER", "_NL", "NEST", "JUNCTION"}


@needs_interegular
@pytest.mark.parametrize(
    "old, new",
    [
        ("?atom: quantity", "?atom: quantity | NAME -> again"),
        ("?operand: atom", '?operand: atom | operand "-" atom -> odd'),
    ],
    ids=["reduce/reduce", "shift/reduce"],
)
def test_the_check_for_conflicts_can_fail(old: str, new: str) -> None:
    assert old in GRAMMAR
    with pytest.raises(lark.exceptions.GrammarError):
        lark.Lark(GRAMMAR.replace(old, new), parser="lalr", start=["start", "alone"], strict=True)


@pytest.mark.parametrize("path", SKETCHES, ids=lambda p: p.stem)
def test_sketches_parse(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    found = parse(Source(path.name, text))
    words = [line.split() for line in text.splitlines()]
    heads = [w[2] if w[0] == "plain" else w[1] for w in words if w[:1] == ["model"] or w[:2] == ["plain", "model"]]
    assert list(found.models) == heads
    assert all(m.statements for m in found.models.values())


def test_there_are_sketches() -> None:
    assert len(SKETCHES) >= 16


def test_no_word_is_reserved_by_the_grammar() -> None:
    """Kinds, units and statement words are ordinary names in the place of a name; `Traps` in sketches/ has the rest."""
    text = "model m { parameter C = 1, I = 2, model = 3, body = 4, hinge = 5, um = 6\n signal s = model + body*um }"
    (model,) = parse(Source("t", text)).statements
    assert isinstance(model, tree.ModelSyntax)
    quantities = model.statements[0]
    assert isinstance(quantities, tree.Quantities)
    assert [i.name for i in quantities.items] == ["C", "I", "model", "body", "hinge", "um"]


@pytest.mark.parametrize(
    "word", ["set", "start", "sweep", "simulate", "equilibrium", "modes", "response", "report", "experiment_"]
)
def test_words_of_experiments_are_names_in_a_model(word: str) -> None:
    """A bond, too, may begin with an element that is called so."""
    text = f"model M {{\n  1 {word}\n  {word} -> c; {word} -> d\n  experiment e {{ simulate 0 .. 1; report x\n report y }}\n}}\n"
    (model,) = parse(Source("words.bg", text)).statements
    assert isinstance(model, tree.ModelSyntax)
    assert [type(s).__name__ for s in model.statements] == ["Declaration", "Bonds", "Bonds", "Experiment"]
