"""`require` as a statement and as an attribute, texts among arguments, and how both are formatted."""

from __future__ import annotations

import pytest

from compiler.errors import CompilationFailed
from compiler.source import Source
from compiler.syntax import parse, tree
from compiler.syntax.format import format_text


def statements(body: str) -> tuple[tree.SyntaxNode, ...]:
    return parse(Source("t.bg", f"model A {{\n{body}\n}}\n")).models["A"].statements


def test_a_condition_and_a_text() -> None:
    first, second = statements('require a < 1 mm\n  and b > 2 "both"; require c')
    assert isinstance(first, tree.RequirementSyntax) and isinstance(second, tree.RequirementSyntax)
    assert (first.text, second.text) == ("both", "")
    assert isinstance(first.condition, tree.Logical) and first.span.text.endswith("b > 2")


def test_the_word_stays_an_attribute() -> None:
    (declaration,) = statements("R r : u = 1 ohm*i { require = flow }")
    assert isinstance(declaration, tree.Declaration) and declaration.attributes[0].name == "require"


def test_texts_are_read_in_expressions_and_behind_them() -> None:
    (quantity,) = statements('constant a = column("curve.csv", "force, raw")')
    assert isinstance(quantity, tree.Quantities) and isinstance(quantity.items[0].value, tree.Call)
    assert [a.value for a in quantity.items[0].value.arguments if isinstance(a, tree.TextSyntax)] == [
        "curve.csv",
        "force, raw",
    ]
    (quantity,) = statements('parameter a = "x" "what it is"')
    assert isinstance(quantity, tree.Quantities) and isinstance(quantity.items[0].value, tree.TextSyntax)
    assert quantity.items[0].description == "what it is"
    for wrong in ("require", 'require a > 0 "x" "y"', 'parameter a = "x" "y" "z"', 'parameter a = 1 + "x'):
        with pytest.raises(CompilationFailed):
            statements(wrong)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('require  abs( x )<3mm   "small"', 'require abs(x) < 3 mm   "small"'),
        ("require(a>0)or not b", "require (a > 0) or not b"),
        ('constant a=column( "c.csv","x" )', 'constant a = column("c.csv", "x")'),
    ],
)
def test_format(before: str, after: str) -> None:
    assert format_text(Source("t.bg", f"model A {{\n{before}\n}}\n")) == f"model A {{\n  {after}\n}}\n"
