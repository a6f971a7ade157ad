"""Patterns of words on a line, in the notation that Python and Oniguruma share. A TextMate grammar and a Pygments lexer are copies of this table.

Words are not reserved, so most patterns hold at the beginning of a statement only. Each is a row of groups that cover all of what it takes.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any

from ..language_service.vocabulary import classes

# Class of a word -> scope of TextMate, token of Pygments.
CLASSES = {
    "comment": ("comment.line.number-sign", "Comment.Single"),
    "text": ("string.quoted.double", "Literal.String.Double"),
    "number": ("constant.numeric", "Literal.Number"),
    "unit": ("keyword.other.unit", "Keyword.Type"),
    "keyword": ("keyword.control", "Keyword"),
    "operator": ("keyword.operator.word", "Operator.Word"),
    "value": ("constant.language", "Keyword.Constant"),
    "attribute": ("entity.other.attribute-name", "Name.Attribute"),
    "kind": ("support.type", "Name.Builtin"),
    "domain": ("support.type.domain", "Name.Namespace"),
    "function": ("support.function", "Name.Function"),
    "model": ("entity.name.type", "Name.Class"),
    "name": ("variable.other", "Name.Variable"),
    "sign": ("keyword.operator", "Operator"),
    "": ("", "Text"),
}
NAME = r"[A-Za-z_][A-Za-z_0-9]*"
_START = r"(?:^|(?<=[{;]))"  # of a statement
_SYMBOL = r"%|[A-Za-z\u00b5\u03bc\u03a9\u2126][A-Za-z_0-9\u00b5\u03bc\u03a9\u2126]*"
_UNIT = rf"(?:{_SYMBOL}|1)(?:[*/^](?:{_SYMBOL}|-?[0-9]+|\([^()\n]*\)))*"
_END_OF_UNIT = r'(?=[ \t]*(?:[=,;}"#]|$))'
_SPACE = (r"[ \t]+", "")
_WITHIN = ("for", "when")  # `solve x^2 = a for x = 1`, `idle -> run when x > 1`


@dataclass(frozen=True, slots=True)
class Rule:
    """`parts`: patterns of the groups with their classes; `before`, `after`: what stands around. `begins`: quantities follow up to the end of the line."""

    parts: tuple[tuple[str, str], ...]
    before: str = ""
    after: str = ""
    begins: bool = False

    @property
    def pattern(self) -> str:
        return self.before + "".join(f"({pattern})" for pattern, _ in self.parts) + self.after


def _any(words: Iterable[str]) -> str:
    return "(?:" + "|".join(sorted(words, key=lambda w: (-len(w), w))) + r")\b"


def _statement(*parts: tuple[str, str], after: str = "", begins: bool = False) -> Rule:
    return Rule(((r"[ \t]*", ""), *parts), _START, after, begins)


@cache
def rules() -> tuple[Rule, ...]:
    """Rules of a line, first those that win."""
    words = classes()
    infix = _any((*words["operator"], *words["timing"]))
    lists = [w for w in ("parameter", "constant", "input", "output", "signal", "mode") if w in words["keyword"]]
    others = [w for w in words["keyword"] if w not in lists]
    ends = r"(?![ \t]*(?:->|=>|[.,:\[\)]|=(?!=)))"  # in a bond, or left of `=`, a word is a name
    return (
        Rule(((r"#.*", "comment"),)),
        Rule(((r'"[^"\n]*"?', "text"),)),
        _statement(("(?:plain[ \\t]+)?model", "keyword"), _SPACE, (NAME, "model")),
        _statement(("parameters", "keyword"), _SPACE, (NAME, "model"), after=r"(?=[ \t]*\{)"),
        _statement(("import", "keyword"), (r"[ \t]+[A-Za-z_0-9, \t]+?[ \t]+", "model"), ("from", "keyword"), after=r"\b"),
        _statement(("stop", "keyword"), _SPACE, ("when", "keyword"), after=r"\b"),
        _statement((_any(("experiment", "multibody", "function")), "keyword"), _SPACE, (NAME, "name")),
        _statement((_any(lists), "keyword"), after=r"(?=[ \t]+[A-Za-z_])", begins=True),
        _statement((_any(others), "keyword"), after=ends),
        _statement(("[01]", "kind"), _SPACE, (rf"(?!{infix}){NAME}", "name")),
        Rule((("[01]", "kind"),), r"(?<![A-Za-z_0-9.])", r"(?=\()"),
        _statement((_any(words["kind"]), "kind"), _SPACE, (rf"(?!{infix}){NAME}", "name")),
        _statement((rf"(?!{infix}){NAME}", "model"), _SPACE, (rf"(?!{infix}){NAME}", "name"), after=r'(?=[ \t]*(?:[:{,\[("#;]|$))'),
        Rule(
            ((r"[ \t]*", ""), (_any((*words["attribute"], "parameters")), "attribute")),
            r"(?:^|(?<=[{,;]))",
            rf"(?=(?:[ \t]+{NAME}[A-Za-z_0-9.\[\]]*)?[ \t]*=(?!=))",
        ),
        *expression_rules(),
    )  # fmt: skip


@cache
def expression_rules() -> tuple[Rule, ...]:
    """Rules of what may stand anywhere."""
    words = classes()
    infix = _any((*words["operator"], *words["timing"], *_WITHIN))
    number = r"[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?"
    alone = r"(?<![.A-Za-z_0-9])"
    return (
        Rule(((number, "number"), (r"[ \t]*", ""), (r"\[[^\]\n]*\]", "unit")), alone),
        Rule(((number, "number"), (r"[ \t]*", ""), (rf"(?!{infix}|[eE][+-]?[0-9])(?:{_SYMBOL})", "unit")), alone),
        Rule(((number, "number"),)),
        Rule((("in", "operator"), _SPACE, (_UNIT, "unit")), alone, _END_OF_UNIT),
        Rule(((":", ""), (r"[ \t]*", ""), (_any(words["domain"]), "domain")), after=r"(?![ \t]*[.=*/+^\-(])"),
        Rule(((_any(words["function"]), "function"),), alone, r"(?=[ \t]*\()"),
        Rule(((_any((*words["timing"], *_WITHIN)), "keyword"),), alone, r"(?=[ \t]+[A-Za-z_0-9])"),
        Rule(((_any(words["operator"]), "operator"),), alone),
        Rule(((_any(words["value"]), "value"),), alone, r"(?![ \t]*(?:=(?!=)|\())"),
        Rule((("->|=>|\\.\\.|<=|>=|==|!=|[-+*/^<>=]", "sign"),)),
        Rule(((NAME, ""),)),
    )


@cache
def quantity_rules() -> tuple[Rule, ...]:
    """Rules behind `parameter` and its like: what follows a colon is a unit or a domain."""
    unit = Rule(((":", ""), (r"[ \t]*", ""), (_UNIT, "unit")), after=_END_OF_UNIT)
    first, second, *others = rules()[:2] + expression_rules()
    return (first, second, unit, *others)


END_OF_QUANTITIES = r"(?<![,(])$|;"


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
