"""Precedence of operators: parsed expressions are evaluated and compared with the rules."""

from __future__ import annotations

from typing import NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compiler.source import Source
from compiler.syntax import parse_expression, tree

NAMES = {"a": 2.0, "b": 3.0, "c": 5.0, "d": 7.0}


def divided(a: float, b: float) -> float:
    return a / b if b else 11.0


def raised(a: float, b: float) -> float:
    """A power where there is one; elsewhere any number that both sides of a comparison compute in the same way."""
    try:
        result = a**b
    except (OverflowError, ZeroDivisionError):
        return 13.0
    return result if isinstance(result, float) and abs(result) < 1e6 else 17.0


def value(node: tree.ExpressionSyntax) -> float:
    """The value of a tree, conditions as 0 and 1."""
    match node:
        case tree.Literal():
            return float(node.number)
        case tree.PathSyntax():
            return NAMES[node.head]
        case tree.Sum():
            total = 0.0
            for sign, term in node.terms:
                total = total + value(term) if sign > 0 else total - value(term)
            return total
        case tree.Product():
            result = 1.0
            for direction, factor in node.factors:
                result = result * value(factor) if direction > 0 else divided(result, value(factor))
            return result
        case tree.Negative():
            return -value(node.operand)
        case tree.Power():
            return raised(value(node.base), value(node.exponent))
        case tree.Comparison():
            x, y = value(node.left), value(node.right)
            return float(
                {"<": x < y, "<=": x <= y, ">": x > y, ">=": x >= y, "==": x == y, "!=": x != y}[node.operator]
            )
        case tree.Logical():
            truths = [bool(value(o)) for o in node.operands]
            return float({"and": all(truths), "or": any(truths), "not": not truths[0]}[node.operator])
        case tree.ChoiceSyntax():
            return value(node.value) if value(node.condition) else value(node.otherwise)
    raise AssertionError(type(node))


def parsed(text: str) -> float:
    return value(parse_expression(Source("t", text)))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("2^3^2", 2.0**9),
        ("(2^3)^2", 64.0),
        ("-2^2", -4.0),
        ("(-2)^2", 4.0),
        ("2^-1", 0.5),
        ("2^-2^2", 2.0**-4),
        ("--3", 3.0),
        ("-a*b", -6.0),
        ("a*-b", -6.0),
        ("a/b*c", 2 / 3 * 5),
        ("a/(b*c)", 2 / 15),
        ("a/b/c", 2 / 3 / 5),
        ("12/2^2", 3.0),
        ("a - b - c", -6.0),
        ("a - (b - c)", 4.0),
        ("a + b*c^2", 77.0),
        ("(a + b)*c", 25.0),
        ("a - -b", 5.0),
        ("1/2*6", 3.0),
        ("10 if a < b else 20", 10.0),
        ("10 if a + 1 < b else 20", 20.0),
        ("1 + 10 if a > b else 20 + 2", 22.0),
        ("1 if a > b else 2 if b > c else 3", 3.0),
        ("(1 if a < b else 2) + 5", 6.0),
        ("1 if a > b or b < c and c > d else 2", 2.0),
        ("1 if (a < b or b < c) and c > d else 2", 2.0),
        ("1 if a < b or b < c and c > d else 2", 1.0),
        ("1 if not a > b and c > d else 2", 2.0),
        ("1 if not (a > b and c > d) else 2", 1.0),
        ("1 if not a > b or c < d else 2", 1.0),
        ("1 if not not a < b else 2", 1.0),
        ("1 if a != b and a == a and b >= b and a <= b else 2", 1.0),
        ("1 if a + b == c else 2", 1.0),
        ("-1 if a < b else 1", -1.0),
    ],
)
def test_documented_order(text: str, expected: float) -> None:
    assert parsed(text) == expected


# Expressions at random, written with no more brackets than the rules ask for.
CHOICE, OR, AND, NOT, COMPARE, SUM, PRODUCT, SIGN, POWER, ATOM = range(10)


class Written(NamedTuple):
    """An expression as text, its value, and how strongly its outermost operator binds."""

    text: str
    value: float
    strength: int

    def within(self, strength: int) -> str:
        """The text as an operand that must bind at least so strongly."""
        return self.text if self.strength >= strength else f"({self.text})"


@st.composite
def expressions(draw: st.DrawFn, depth: int = 3) -> Written:
    """A number."""
    shape = draw(st.sampled_from(["name", "number"] if depth == 0 else ["name", "+", "-", "*", "/", "^", "sign", "if"]))
    if shape == "name":
        name = draw(st.sampled_from(sorted(NAMES)))
        return Written(name, NAMES[name], ATOM)
    if shape == "number":
        number = draw(st.integers(0, 9))
        return Written(str(number), float(number), ATOM)
    a = draw(expressions(depth - 1))
    if shape == "sign":
        return Written(f"-{a.within(SIGN)}", -a.value, SIGN)
    b = draw(expressions(depth - 1))
    match shape:
        case "+":
            return Written(f"{a.within(SUM)} + {b.within(PRODUCT)}", a.value + b.value, SUM)
        case "-":
            return Written(f"{a.within(SUM)} - {b.within(PRODUCT)}", a.value - b.value, SUM)
        case "*":
            return Written(f"{a.within(PRODUCT)}*{b.within(SIGN)}", a.value * b.value, PRODUCT)
        case "/":
            return Written(f"{a.within(PRODUCT)}/{b.within(SIGN)}", divided(a.value, b.value), PRODUCT)
        case "^":
            return Written(f"{a.within(ATOM)}^{b.within(SIGN)}", raised(a.value, b.value), POWER)
    condition = draw(conditions(depth - 1))
    text = f"{a.within(OR)} if {condition.within(OR)} else {b.within(CHOICE)}"
    return Written(text, a.value if condition.value else b.value, CHOICE)


@st.composite
def conditions(draw: st.DrawFn, depth: int) -> Written:
    """A truth, as 0 or 1."""
    shape = draw(st.sampled_from(["compare", "and", "or", "not"] if depth > 0 else ["compare"]))
    if shape == "compare":
        a, b = draw(expressions(max(0, depth - 1))), draw(expressions(max(0, depth - 1)))
        operator, truth = draw(
            st.sampled_from([("<", a.value < b.value), (">=", a.value >= b.value), ("!=", a.value != b.value)])
        )
        return Written(f"{a.within(SUM)} {operator} {b.within(SUM)}", float(truth), COMPARE)
    first = draw(conditions(depth - 1))
    if shape == "not":
        return Written(f"not {first.within(NOT)}", float(not first.value), NOT)
    second = draw(conditions(depth - 1))
    if shape == "and":
        return Written(f"{first.within(AND)} and {second.within(NOT)}", float(bool(first.value and second.value)), AND)
    return Written(f"{first.within(OR)} or {second.within(AND)}", float(bool(first.value or second.value)), OR)


@settings(max_examples=300, deadline=None)
@given(expressions())
def test_brackets_where_the_rules_ask_for_them_and_nowhere_else(written: Written) -> None:
    assert parsed(written.text) == written.value
