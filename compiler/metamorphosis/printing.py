"""Syntax trees as text, statement by statement and with every bracket that could matter; and trees made of trees."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from fractions import Fraction
from typing import Any

from ..source import Source, Span
from ..syntax import parse_expression, tree

NOWHERE = Span(Source("changed text", ""), 0, 0)
ATOMS = (tree.Literal, tree.PathSyntax, tree.Call, tree.VectorSyntax)


def text_of(statements: tuple[tree.SyntaxNode, ...]) -> str:
    """A file."""
    return "\n".join(statement(s, "") for s in statements) + "\n"


def with_parts(node: object, change: Callable[[Any], Any]) -> Any:
    """A node, or a tuple, with `change` applied to each of its parts."""
    if isinstance(node, tuple):
        return tuple(map(change, node))
    if isinstance(node, Span) or not is_dataclass(node):
        return node
    new = {field.name: change(getattr(node, field.name)) for field in fields(node)}
    return replace(node, **new)  # type: ignore[type-var]


def rewrite(node: object, change: Callable[[Any], Any]) -> Any:
    """The tree with `change` applied to every node, from the leaves up."""
    new = with_parts(node, lambda part: rewrite(part, change))
    return change(new) if is_dataclass(new) and not isinstance(new, Span) else new


def path(words: str) -> tree.PathSyntax:
    """`a.b[2].c` as a path."""
    parsed = parse_expression(Source("path", words))
    assert isinstance(parsed, tree.PathSyntax), words
    return parsed


def unit(words: str) -> tree.Unit:
    """`N/m` as a unit."""
    parsed = parse_expression(Source("unit", f"1 [{words}]"))
    assert isinstance(parsed, tree.Literal) and parsed.unit is not None
    return parsed.unit


# ---------------------------------------------------------------- expressions


def number(value: Fraction) -> str:
    """A decimal number, exactly."""
    power, bottom = 0, value.denominator
    while bottom > 1:
        divisor = 10 if bottom % 10 == 0 else (2 if bottom % 2 == 0 else 5)
        assert bottom % divisor == 0, f"{value} is no decimal number"
        bottom //= divisor
        power += 1
    digits = value * 10**power
    return f"{digits.numerator}e-{power}" if power else str(value.numerator)


def unit_text(u: tree.Unit) -> str:
    """`kg*m^2*s^-1`."""
    parts = []
    if u.number != 1 or not u.factors:
        parts.append(str(u.number))
    for symbol, power, _ in u.factors:
        shown = str(power) if power.denominator == 1 else f"({power})"
        parts.append(symbol if power == 1 else f"{symbol}^{shown}")
    return "*".join(parts)


def inner(node: tree.ExpressionSyntax) -> str:
    """An operand, in brackets unless it is an atom."""
    return expression(node) if isinstance(node, ATOMS) else f"({expression(node)})"


def path_text(node: tree.PathSyntax) -> str:
    text = node.head
    for step in node.steps:
        text += f".{step.name}" if isinstance(step, tree.Member) else index_text(step)
    return text


def index_text(index: tree.Index | None) -> str:
    return "" if index is None else f"[{', '.join(map(expression, index.items))}]"


def expression(node: object) -> str:
    """An expression."""
    match node:
        case tree.Literal():
            return number(node.number) + ("" if node.unit is None else f" [{unit_text(node.unit)}]")
        case tree.PathSyntax():
            return path_text(node)
        case tree.TextSyntax():
            return f'"{node.value}"'
        case tree.Call():
            return f"{node.function}({', '.join(map(expression, node.arguments))})"
        case tree.VectorSyntax():
            return f"[{', '.join(map(expression, node.items))}]"
        case tree.Sum():
            return _chain(node.terms, "+", "-")
        case tree.Product():
            return _chain(node.factors, "*", "/")
        case tree.Negative():
            return f"-{inner(node.operand)}"
        case tree.Power():
            return f"{inner(node.base)}^{inner(node.exponent)}"
        case tree.Comparison():
            return f"{inner(node.left)} {node.operator} {inner(node.right)}"
        case tree.Logical(operator="not"):
            return f"not {inner(node.operands[0])}"
        case tree.Logical():
            return f" {node.operator} ".join(map(inner, node.operands))
        case tree.ChoiceSyntax():
            return f"{inner(node.value)} if {inner(node.condition)} else {inner(node.otherwise)}"
    raise AssertionError(type(node))


def _chain(parts: tuple[tuple[int, tree.ExpressionSyntax], ...], plus: str, minus: str) -> str:
    assert parts[0][0] == 1
    text = inner(parts[0][1])
    for sign, part in parts[1:]:
        text += f" {plus if sign > 0 else minus} {inner(part)}"
    return text


# ---------------------------------------------------------------- statements


def statement(node: tree.SyntaxNode, margin: str) -> str:
    """One statement, its blocks indented."""
    return margin + _statement(node, margin)


def _law(equations: tuple[tree.Equation, ...]) -> str:
    return ", ".join(f"{expression(e.left)} = {expression(e.right)}" for e in equations)


def _block(head: str, statements: tuple[tree.SyntaxNode, ...], margin: str) -> str:
    lines = "".join(statement(s, margin + "  ") + "\n" for s in statements)
    return f"{head} {{\n{lines}{margin}}}"


def _statement(node: object, margin: str) -> str:
    match node:
        case tree.ModelSyntax():
            return _block(f"{'plain ' * node.plain}model {node.name}", node.statements, margin)
        case tree.Import():
            names = ", ".join(name for name, _ in node.names)
            return f"import {names} from " + (f'"{node.place}"' if node.is_file else node.place)
        case tree.Description():
            return f'"{node.text}"'
        case tree.RequirementSyntax():
            return f'require {expression(node.condition)} "{node.text}"'
        case tree.Quantities():
            law = f"{_law(node.equations)} for " if node.equations else ""
            return f"{node.role} {law}" + ", ".join(map(_item, node.items))
        case tree.ParameterSet():
            lines = "".join(f"{margin}  {_item(i)}\n" for i in node.items)
            return f"parameters {node.name} {{\n{lines}{margin}}}"
        case tree.FunctionSyntax():
            return f"function {node.name}({', '.join(node.parameters)}) = {expression(node.body)}"
        case tree.PortsSyntax():
            return "port " + ", ".join(map(_port, node.items))
        case tree.Declaration():
            return _declaration(node)
        case tree.Bonds():
            text = ", ".join(map(place, node.places[0]))
            for arrow, group in zip(node.arrows, node.places[1:], strict=True):
                text += f" {arrow} " + ", ".join(map(place, group))
            return text
        case tree.SettingSyntax():
            return f"{node.name} = {expression(node.value)}"
        case tree.LoopSyntax():
            return _block(f"for {node.name} in {_range(node.range)}", node.statements, margin)
        case tree.ConditionalSyntax():
            text = _block(f"if {expression(node.condition)}", node.statements, margin)
            return text + (_block(" else", node.otherwise, margin) if node.otherwise else "")
        case tree.MechanismSyntax():
            return _block(
                f"multibody {node.name}{index_text(node.index)}" + (f" : {node.space}" if node.space else ""),
                node.statements,
                margin,
            )
        case tree.EventSyntax():
            resets = "; ".join(f"{expression(r.target)} = {expression(r.value)}" for r in node.resets)
            timing = "".join(f" {t.word} {expression(t.value)}" for t in node.timing)
            return f"{'every' if node.sampled else 'when'} {expression(node.condition)}{timing} {{ {resets} }}"
    return _step(node, margin)


def _step(node: object, margin: str) -> str:
    """An experiment with its steps."""
    match node:
        case tree.Experiment():
            return _block(f"experiment {node.name}", node.steps, margin)
        case tree.Bandwidth():
            return f"bandwidth {expression(node.value)}"
        case tree.StopSyntax():
            return f"stop when {expression(node.condition)}"
        case tree.Set():
            return f"{node.role} {expression(node.target)} = {expression(node.value)}"
        case tree.Simulate():
            return f"simulate {_range(node.range)}{_attributes(node.attributes)}"
        case tree.Report():
            readings = (
                expression(r.value) + ("" if r.unit is None else f" in {unit_text(r.unit)}") for r in node.readings
            )
            return "report " + ", ".join(readings)
        case tree.SweepSyntax():
            shown = "" if node.unit is None else f": {unit_text(node.unit)}"
            return f"sweep {expression(node.path)}{shown} = {', '.join(map(expression, node.values))}"
        case tree.Analysis():
            return _analysis(node)
    raise AssertionError(type(node))


def _analysis(node: tree.Analysis) -> str:
    inputs, outputs = (", ".join(map(_given, some)) for some in (node.given, node.wanted))
    files = ", ".join(f'"{text.value}"' for text in node.files)
    subject = " to ".join(words for words in (inputs, outputs, files) if words)
    over = "" if node.range is None else f" over {_range(node.range)}"
    return f"{node.role} {subject}".strip() + over + _attributes(node.attributes)


def _given(node: tree.GivenSyntax) -> str:
    if node.word:
        return f"{node.word}({expression(node.path)}, {expression(node.other)}) = {expression(node.value)}"
    text = expression(node.path) + ("" if node.other is None else f"/{expression(node.other)}")
    text += "" if node.value is None else f" = {expression(node.value)}"
    return text + ("" if node.range is None else f" = {_range(node.range)}")


def _range(node: tree.Range) -> str:
    return f"{inner(node.first)} .. {inner(node.last)}"


def _item(node: tree.Item) -> str:
    text = node.name + index_text(node.index)
    text += "" if node.unit is None else f": {unit_text(node.unit)}"
    text += f": {{ {', '.join(name for name, _ in node.choices)} }}" if node.choices else ""
    text += "" if node.value is None else f" = {expression(node.value)}"
    return text + ("" if node.description is None else f' "{node.description}"')


def _components(components: tuple[tree.Component, ...]) -> str:
    if not components:
        return ""
    return (
        "(" + ", ".join(c.name + (f": {c.domain}{index_text(c.width)}" if c.domain else "") for c in components) + ")"
    )


def _port(node: tree.PortItem) -> str:
    text = node.name + index_text(node.index) + _components(node.components)
    text += f": {node.domain}{index_text(node.width)}" if node.domain else ""
    return text + ("" if node.description is None else f' "{node.description}"')


def _attributes(attributes: tuple[tree.Attribute, ...]) -> str:
    if not attributes:
        return ""
    shown = (
        a.name + (f" {expression(a.target)}" if a.target is not None else "") + f" = {expression(a.value)}"
        for a in attributes
    )
    return " { " + "; ".join(shown) + " }"


def _declaration(node: tree.Declaration) -> str:
    names = ", ".join(d.name + index_text(d.index) + _components(d.components) for d in node.names)
    text = f"{node.kind} {names}"
    match node.definition:
        case None:
            pass
        case tree.LawSyntax(equations=equations):
            text += f" : {_law(equations)}"
        case tree.LinkSyntax(first=first, second=second):
            text += f" : {expression(first)} to {expression(second)}"
        case other:
            text += f" : {expression(other)}"
    text += _attributes(node.attributes)
    return text + ("" if node.description is None else f' "{node.description}"')


def place(node: tree.PathSyntax | tree.Nest) -> str:
    """Endpoint of a bond."""
    if isinstance(node, tree.PathSyntax):
        return path_text(node)
    return f"{node.kind}({', '.join(map(place, node.members))})"
