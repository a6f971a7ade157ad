"""Graphs that cannot be written as text, and names that no text can have."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import bondgraph
from compiler.algebra.expression import Apply, Number, Symbol, multiply
from compiler.algebra.formula import Bound, Formula
from compiler.errors import CompilationFailed, InternalError
from compiler.graph.network import BondGraph, Quantity
from compiler.unparse import write_text


def test_everything_that_cannot_be_written_is_told_at_once() -> None:
    """A 37th root of metres has no unit that can be written; the letters of an untyped law imply no domain."""
    model = bondgraph.load("""
      model Part { port a: untyped; C c : e = 3*q; a -> c }
      model M {
        C c : F = 2 [N/m]*x
        R r : F = 3 [N*s/m]*v
        1 j
        j -> c, r
        Part p
        Se s : e = 2
        s -> p.a
        output y = (c.x)^(1/37), x = c.x
      }
    """)
    with pytest.raises(CompilationFailed) as failed:
        model.text()
    assert [(d.code, d.span.line) for d in failed.value.diagnostics] == [("BG703", 2), ("BG701", 11)]
    told = str(failed.value)
    assert "The bond from `s` to `p.c` cannot be written as text: nothing tells its domain" in told
    assert "`y` cannot be written as text: the language has no unit for m^(1/37)" in told


# ---------------------------------------------------------------- graphs that no text made


def small() -> BondGraph:
    text = 'model M {\n parameter k: N/m = 3 "stiff"\n C c : F = k*x\n 1 j\n I m : p = 1 kg*v\n j -> c, m\n output x = c.x\n}'
    return bondgraph.load(text).compilation().whole_graph


def named(graph: BondGraph, **changes: object) -> BondGraph:
    return replace(graph, quantities={**graph.quantities, "k": replace(graph.quantities["k"], **changes)})


@pytest.mark.parametrize("description", ['with a "quote"', "two\nlines"])
def test_descriptions_cannot_end_their_literal(description: str) -> None:
    with pytest.raises(InternalError, match="a description that no text can have"):
        write_text(named(small(), description=description))


@pytest.mark.parametrize(
    "evil", ["c\nSe x : F = 1 N", "c\r\u2028\x85 }", "c\u202e#\x1b[31m", '"', "model", "1", "..", ""]
)
def test_names_cannot_leave_their_comment(evil: str) -> None:
    graph = small()
    (c, j, m) = graph.nodes
    renamed = replace(graph, nodes=(replace(c, name=evil), j, m), outputs={}, quantities={"k": graph.quantities["k"]})
    reread = bondgraph.load(write_text(renamed))
    assert len(reread.compilation().whole_graph.nodes) == 3
    assert len(reread.compilation().whole_graph.bonds) == 2


SIMILAR = [
    "a",
    "a[1]",
    "a[2]",
    "a_1",
    "a[1].b",
    "a_1_b",
    "a[1, 2]",
    "x",
    "x[1]",
    "k",
    "k[1]",
    "v[1]",
    "model[1]",
    "a[01]",
]


@settings(max_examples=200, deadline=None)
@example(["a[1]", "a[01]", "a[0]"])
@given(st.lists(st.one_of(st.text(max_size=8), st.sampled_from(SIMILAR)), min_size=3, max_size=3, unique=True))
def test_any_names_are_mapped_one_to_one(names: list[str]) -> None:
    graph = small()
    nodes = tuple(replace(n, name=name) for n, name in zip(graph.nodes, names, strict=True))
    flat = write_text(replace(graph, nodes=nodes, outputs={}, quantities={"k": graph.quantities["k"]}))
    found = bondgraph.load(flat).compilation().whole_graph
    assert len({n.name for n in found.nodes}) == 3
    assert [b.tail.node for b in found.bonds] == [b.tail.node for b in graph.bonds]


def test_what_no_text_can_say() -> None:
    graph = small()
    with pytest.raises(InternalError, match="`k` has no value"):
        write_text(named(graph, definition=None))
    strange = Bound(Formula(1, Apply("gamma", (Symbol(0),))), (Quantity("k"),))
    with pytest.raises(InternalError, match="the operator `gamma` has no name in the language"):
        write_text(named(graph, definition=strange))
    endless = Bound(Formula(1, multiply(Number(math.inf), Symbol(0))), (Quantity("k"),))
    with pytest.raises(CompilationFailed, match="`k` cannot be written as text: it contains the number inf"):
        write_text(named(graph, definition=endless))


def test_shared_expressions_that_grow_too_large() -> None:
    """Shared expressions of the graph are written out in the text; an exponential text is refused in words."""
    expression = Symbol(0)
    for _ in range(40):
        expression = Apply("multiply", (Apply("sin", (expression,)), Apply("cos", (expression,))))
    graph = (
        bondgraph.load("model M {\n parameter k = 3\n input u = 0\n signal s = u\n output x = s\n}")
        .compilation()
        .whole_graph
    )
    s = graph.quantities["s"]
    grown = replace(s, definition=Bound(Formula(1, expression), s.definition.arguments if s.definition else ()))
    with pytest.raises(
        CompilationFailed, match="`s` cannot be written as text: its expression has more than 200000 terms"
    ):
        write_text(replace(graph, quantities={**graph.quantities, "s": grown}))


def test_expressions_that_are_nested_too_deep() -> None:
    expression = Symbol(0)
    for _ in range(110):
        expression = Apply("sin", (expression,))
    graph = bondgraph.load("model M {\n input u = 0\n signal s = u\n output x = s\n}").compilation().whole_graph
    s = graph.quantities["s"]
    grown = replace(s, definition=Bound(Formula(1, expression), s.definition.arguments if s.definition else ()))
    with pytest.raises(CompilationFailed, match="more brackets within brackets than the language reads"):
        write_text(replace(graph, quantities={**graph.quantities, "s": grown}))
