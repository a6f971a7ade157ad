"""State equations as text: what is small is part of what reads it, the rest stands in lines with their places."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import pytest
import sympy

from compiler.codegen.symbolic.formulate import formulate
from compiler.codegen.symbolic.listing import listing
from compiler.codegen.symbolic.state_equations import (
    Entry,
    EventEquations,
    LinearSystem,
    Partials,
    ResetEquation,
    SolvedEquation,
    StateEquations,
)
from compiler.source import Source, Span
from tests.compiling import compiled

SOURCE = Source("text.bg", "one\ntwo\nthree\n")
ONE, TWO, THREE = Span(SOURCE, 0, 3), Span(SOURCE, 4, 7), Span(SOURCE, 8, 13)
a, b, c, x, y, z, p, q, r = sympy.symbols("a b c x y z p q r")
EMPTY: Any = StateEquations(
    "M", sympy.Symbol("time"), *[()] * 6, frozenset(), *[()] * 12, Partials({}, ()), Partials({}, ()), ()
)  # type: ignore[call-arg]


def text(**parts: Any) -> list[str]:
    heading, *rows = listing(replace(cast(Any, EMPTY), **parts))
    assert heading.startswith("state equations M: ")
    return rows


def placed(equation: str, rest: str) -> str:
    """A row: its comment begins two columns behind column 74."""
    return f"  {equation.ljust(72)}  # {rest}"


def test_each_kind_of_row_has_its_form() -> None:
    event = EventEquations(
        "hit", sympy.StrictLessThan(x, 0), (ResetEquation(x, -x, "x"), ResetEquation(y, a, "y")), (), ONE
    )
    sampled = replace(event, sampling=(a + b, sympy.S.Zero, c, sympy.S.Zero, sympy.S.Zero), resets=())
    rows = text(
        rates=(Entry("x", 2 * y, "", ONE),),
        residuals=(Entry("z", z - a, "", TWO),),
        outputs=(Entry("out", x + y),),
        starts=(Entry("x", a, "", ONE),),
        initial=(Entry("spring", b, "", TWO),),
        constraints=(Entry("joint", c, "", THREE),),
        switches=(Entry("valve", sympy.StrictGreaterThan(y, 0), "", ONE),),
        events=(event, sampled),
    )
    assert rows == [
        placed("d/dt x = 2*y", "text.bg:1"),
        placed("0 = z - a, solved for z", "text.bg:2"),
        "  output out = x + y",
        placed("start of x = a", "text.bg:1"),
        placed("at the start spring is 0 = b", "text.bg:2"),
        placed("along a run joint is 0 = c", "text.bg:3"),
        placed("valve is on: y > 0", "text.bg:1"),
        placed("when x < 0: x := -x; y := a", "text.bg:1"),
        placed("every a + b delay c:", "text.bg:1"),
    ]


def nested(operations: int) -> Any:
    """An expression with this number of operations."""
    return nested(operations - 1) * a if operations == 2 else sympy.sin(nested(operations - 1)) if operations else b


@pytest.mark.parametrize(("operations", "kept"), [(40, False), (41, True)])
def test_a_line_of_few_operations_is_part_of_what_reads_it(operations: int, kept: bool) -> None:
    right = nested(operations)
    lines = (SolvedEquation(p, right, TWO, "spring"), SolvedEquation(r, right * 2, ONE, "idle"))
    rows = text(lines=lines, rates=(Entry("x", -p, "", ONE),))
    assert len(rows) == 1 + kept
    assert ("= -p " in rows[-1]) == kept and ("sin" in rows[-1]) != kept
    if kept:
        assert rows[0].startswith("  p = sin(sin(") and rows[0].endswith(")  # text.bg:2 spring")
        assert rows[0].count("sin(") + rows[0].count("*") == operations


def test_small_lines_are_closed_in_one_another_and_in_systems_and_events() -> None:
    lines = (
        SolvedEquation(p, a + b, ONE, "one"),
        SolvedEquation(q, p * c, ONE, "two"),
        LinearSystem((y, z), ((p, x), (sympy.Integer(1), q)), (c * p, sympy.Integer(0)), TWO, "loop"),
    )
    event = EventEquations("hit", sympy.StrictLessThan(p, y), (ResetEquation(x, q, "x"),), (p,), THREE)
    assert text(lines=lines, events=(event,), starts=(Entry("x", p),)) == [
        placed("solve [a + b x; 1 c*(a + b)] [y, z] = [c*(a + b), 0]", "text.bg:2 loop"),
        "  start of x = a + b",
        placed("every a + b: x := c*(a + b)", "text.bg:3"),
    ]
    assert text(lines=lines, rates=(Entry("x", q),)) == ["  d/dt x = c*(a + b)"]


def test_the_heading_counts() -> None:
    model = compiled("plain model P { signal s = integral(1, 2), t = integral(s, 0); output y = s, z = t, w = 1 }")
    assert model.state_equations.splitlines()[0] == "state equations P: states 2, unknowns 0, outputs 3, events 0"


def test_a_start_of_a_computed_quantity_is_a_residual() -> None:
    """Two masses on one shaft: the start of the second, which is computed, is the given one less 6."""
    model = compiled("""plain model P {
      I one : p = 2*f { start p = 4 }
      I two : p = 3*f { start p = 6 }
      Se push : e = 1
      push -> 1(one, two)
      output f = one.f
    }""")
    e = formulate(model.state_space)
    ((name, value),) = [(i.name, i.value) for i in e.initial]
    assert name == "two"
    (dependent,) = value.free_symbols
    assert value.subs(dependent, 10).doit() == 4
