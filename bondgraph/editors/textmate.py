"""TextMate grammar, as VS Code, Sublime Text and others read it."""

from __future__ import annotations

from typing import Any

from .rules import CLASSES, END_OF_QUANTITIES, Rule, quantity_rules, rules


def textmate_grammar() -> dict[str, Any]:
    """Grammar as plain data, to be written as JSON."""
    return {
        "name": "bondgraph",
        "scopeName": "source.bondgraph",
        "fileTypes": ["bg"],
        "patterns": [_pattern(rule) for rule in rules()],
        "repository": {"quantities": {"patterns": [_pattern(rule) for rule in quantity_rules()]}},
    }


def _pattern(rule: Rule) -> dict[str, Any]:
    named = {
        str(number): {"name": f"{CLASSES[kind][0]}.bondgraph"} for number, (_, kind) in enumerate(rule.parts, 1) if kind
    }
    if not rule.begins:
        return {"match": rule.pattern, "captures": named}
    inside = [{"include": "#quantities"}]
    return {"begin": rule.pattern, "beginCaptures": named, "end": END_OF_QUANTITIES, "patterns": inside}
