"""Pygments lexer: colours in Sphinx, LaTeX and terminals. Pygments finds it by the entry point of the package."""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce
from typing import Any

from pygments.lexer import RegexLexer, bygroups
from pygments.token import Token

from .rules import CLASSES, Rule, quantity_rules, rules


class BondgraphLexer(RegexLexer):  # type: ignore[misc]
    """Lexer of bond-graph models."""

    name = "bondgraph"
    aliases = ("bondgraph", "bg")
    filenames = ("*.bg",)
    url = ""

    @classmethod
    def get_tokendefs(cls) -> dict[str, list[Any]]:
        """The rules as Pygments takes them, made when the first lexer is."""
        rest = [(r"\n", Token.Text), (r"[ \t\r]+", Token.Text), (r"[^\n]", Token.Punctuation)]
        ends = [(r"(?<![,(])\n", Token.Text, "#pop"), (";", Token.Punctuation, "#pop")]
        return {"root": [*_states(rules()), *rest], "quantities": [*_states(quantity_rules()), *ends, *rest]}


def _states(listed: Iterable[Rule]) -> list[Any]:
    entries = []
    for rule in listed:
        tokens = bygroups(*(reduce(getattr, CLASSES[kind][1].split("."), Token) for _, kind in rule.parts))
        entries.append((rule.pattern, tokens, "quantities") if rule.begins else (rule.pattern, tokens))
    return entries
