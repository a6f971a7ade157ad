"""Pieces of a text, at random: expressions, numbers, chains of bonds are read back unchanged."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import bondgraph
from compiler.algebra.expression import (
    CONDITIONS,
    Apply,
    Expression,
    Number,
    Symbol,
    add,
    call,
    divide,
    multiply,
    negate,
    power,
    select,
    substitute,
)  # fmt: skip
from compiler.algebra.formula import Bound, Formula
from compiler.errors import CompilationFailed
from compiler.graph.network import Quantity
from compiler.source import Source
from compiler.syntax import parse, parse_expression, tree
from compiler.unparse import write_text
from compiler.unparse.literals import bond_lines, number_text

NUMBERS = (2.0, -1.0, 1.0, -2.0, 0.5, -3.25, 1e-7, 3e5, 1e-305, 0.1)
CALLS = {"sin": 1, "exp": 1, "sqrt": 1, "abs": 1, "tanh": 1, "sign": 1, "floor": 1, "min": 2, "max": 2, "atan2": 2}


@st.composite
def expressions(draw: st.DrawFn, depth: int = 4) -> Expression:
    """Over the symbols 0 to 3: a length, a time, two bare numbers; made by the constructors that the compiler uses."""
    form = draw(st.integers(0, 9 if depth else 1))
    inner = expressions(depth - 1)
    if form == 0:
        return Symbol(draw(st.integers(0, 3)))
    if form == 1:
        return Number(draw(st.sampled_from(NUMBERS)))
    if form in (2, 3):
        return (add if form == 2 else multiply)(*draw(st.lists(inner, min_size=2, max_size=4)))
    if form == 4:
        return negate(draw(inner))
    if form in (5, 6):
        return divide(draw(inner), draw(inner))
    if form == 7:
        return power(draw(inner), Number(draw(st.sampled_from([2.0, -1.0, 3.0, -2.0, 0.5, 1.5, -0.25]))))
    if form == 8:
        name = draw(st.sampled_from(sorted(CALLS)))
        return call(name, *(draw(inner) for _ in range(CALLS[name])))
    return select(draw(conditions(depth - 1)), draw(inner), draw(inner))


@st.composite
def conditions(draw: st.DrawFn, depth: int) -> Expression:
    form = draw(st.sampled_from(["less", "less_equal", "equal", *(["not", "and", "or"] if depth > 0 else [])]))
    inner = conditions(depth - 1) if form in ("not", "and", "or") else expressions(max(depth, 0))
    return call(form, *(draw(inner) for _ in range(1 if form == "not" else 2)))


HOST = """model M {
  input a = 1 m, b = 2 s, c = 0.5, d = -1.5
  signal y = a*b/1 s%s
  output z = y
}"""


@settings(max_examples=400, deadline=None)
@given(expressions(), st.sampled_from(["m", "1", "N", "kg/m^3", "s^(1/2)"]))
def test_any_expression_is_read_again_as_the_same(expression: Expression, unit: str) -> None:
    """Brackets, signs, units: the text means the same expression, operand by operand."""
    assume(not isinstance(expression, Number) and all(map(_is_sound, _nodes(expression))))
    graph = bondgraph.load(HOST % "").compilation().whole_graph
    names = tuple(Quantity(n) for n in "abcd")
    y = replace(graph.quantities["y"], definition=Bound(Formula(4, expression), names), unit=unit)
    written = replace(graph, quantities={**graph.quantities, "y": y}, outputs={})
    try:
        flat = write_text(written)
    except CompilationFailed as failed:
        assert {d.code for d in failed.diagnostics} <= {"BG701"}  # powers of powers: an exponent beyond the language's
        return
    try:
        found = bondgraph.load(flat).compilation().whole_graph.quantities["y"]
    except CompilationFailed as failed:
        assert {d.code for d in failed.diagnostics} <= {"BG105"}, flat  # numbers that have no value: 0^-1
        return
    assert found.unit == unit
    assert found.definition is not None
    arguments = found.definition.arguments
    read = substitute(found.definition.formula.expression, lambda s: Symbol("abcd".index(arguments[s.key].name)))
    assert read == substitute(expression, lambda s: s), flat


def _nodes(x: Expression) -> Iterator[Expression]:
    yield x
    for operand in x.operands if isinstance(x, Apply) else ():
        yield from _nodes(operand)


def _is_sound(x: Expression) -> bool:
    """Finite numbers, and no operation on numbers alone that has no value, which no text may contain."""
    if isinstance(x, Number):
        return math.isfinite(x.value)
    return not (
        isinstance(x, Apply) and x.operator not in CONDITIONS and all(isinstance(o, Number) for o in x.operands)
    )


@settings(max_examples=300, deadline=None)
@given(st.floats(allow_nan=False, allow_infinity=False))
def test_any_number_is_read_again(value: float) -> None:
    model = bondgraph.load(f"model M {{\n parameter a = {number_text(value)}\n}}")
    assert model.parameters["a"].value == value
    parse_expression(Source("number", number_text(value)))


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(*[st.sampled_from("abcd")] * 2, st.sampled_from(["->", "=>"])), max_size=30))
def test_chains_and_fans_are_the_same_bonds(bonds: list[tuple[str, str, str]]) -> None:
    wanted = [(tail, arrow, head) for tail, head, arrow in bonds]
    text = "model M {\n" + "\n".join(bond_lines(wanted)) + "\n}"
    (model,) = parse(Source("text", text)).statements
    assert isinstance(model, tree.ModelSyntax)
    found = []
    for statement in model.statements:
        assert isinstance(statement, tree.Bonds)
        for arrow, tails, heads in zip(statement.arrows, statement.places, statement.places[1:], strict=False):
            assert len(tails) == 1 or len(heads) == 1
            found += [(t.words, arrow, h.words) for t in tails for h in heads]  # type: ignore[union-attr]
    assert found == wanted


def test_a_delay_has_one_name() -> None:
    """A delay within an expression gets a name once; a signal that is a delay keeps its own; neither gains another in the text of the text."""
    text = (
        "model M {\n signal a = delay(time, 1 s), b = a\n output y = a, z = delay(a, 0.5 s), w = floor(delay(time, 0.3 s)/0.25 s)\n"
        " experiment e { simulate 0 .. 2 s } }"
    )
    first = bondgraph.load(text)
    second = bondgraph.load(first.text())
    assert second.text() == bondgraph.load(second.text()).text()
    assert "signal a: s = delay(time, 1 s)" in second.text() and second.text().count("delay(") == 3
    found = second.simulate(to="2 s", points=9)
    np.testing.assert_allclose(found["z"], np.maximum(found.time - 1.5, 0), atol=1e-12)
