"""Names of run-time parameters behind quantities, and expressions over them; units beyond the range of doubles."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from compiler.algebra.expression import Expression, Symbol, evaluate, symbols
from compiler.algebra.formula import Bound, Formula, bind
from compiler.graph.network import Named, Quantity, Reading, behind, over_arguments
from compiler.graph.units import METRE, Scale
from compiler.source import Source, Span
from tests.compiling import compiled

TEXT = """plain model A {
  parameter a = 2, b = 3*a, c = b + 1, d = 5
  signal s = c*d + time
  output y = s + d*b
}"""


def test_all_that_definitions_read_is_behind_them() -> None:
    quantities = compiled(TEXT).whole_graph.quantities
    definite = {n for n in quantities if n in "abcdsy"}
    assert definite >= set("abcds")
    assert behind([], quantities) == frozenset()
    assert behind(["a"], quantities) == {"a"}
    assert behind(["c"], quantities) == {"a", "b", "c"}
    assert behind(["d", "b"], quantities) == {"a", "b", "d"}
    assert behind(["s", "s"], quantities) == {"a", "b", "c", "d", "s"}
    assert behind(["nothing"], quantities) == frozenset()


def named(name: str, definition: Expression | None) -> Named:
    span = Span(Source("text.bg", ""), 0, 0)
    return Named(name, "signal", "1", None if definition is None else bind(definition), None, span)


def of(name: str) -> Symbol:
    return Symbol(Quantity(name))


@pytest.mark.parametrize("seed", range(12))
def test_definitions_are_put_in_down_to_what_has_none(seed: int) -> None:
    """A random net of sums and products, each over earlier ones, some read several times: values by hand, in order."""
    numbers = np.random.default_rng(seed)
    quantities, values = {"p": named("p", None), "q": named("q", None)}, {"p": 1.3, "q": -0.7}
    reading = Reading("r", "", "f")
    for k in range(8):
        a, b, c = (str(n) for n in numbers.choice(list(values), 3))
        quantities[f"x{k}"] = named(f"x{k}", of(a) * of(b) + 2.0 * of(c) + Symbol(reading))
        values[f"x{k}"] = values[a] * values[b] + 2 * values[c] + 0.25
    bound = bind(of("x7") - of("x5") * of("q"))
    found = over_arguments(bound, quantities)
    assert {s.key for s in symbols(found)} <= {"p", "q", reading}
    expected = values["x7"] - values["x5"] * values["q"]
    assert evaluate(found, {"p": 1.3, "q": -0.7, reading: 0.25}.__getitem__) == pytest.approx(expected, rel=1e-12)


def test_a_long_row_of_definitions() -> None:
    """Longer than Python nests calls."""
    quantities = {"x0": named("x0", None)} | {f"x{k}": named(f"x{k}", of(f"x{k - 1}")) for k in range(1, 5000)}
    assert over_arguments(bind(of("x4999")), quantities) == Symbol("x0")
    assert len(behind(["x4999"], quantities)) == 5000


def test_numbers_among_the_arguments_stay_numbers() -> None:
    bound = Bound(Formula(2, Symbol(0) * Symbol(1)), (2.5, Quantity("p")))
    assert evaluate(over_arguments(bound, {"p": named("p", None)}), {"p": 4.0}.__getitem__) == 10.0


def test_a_value_beyond_the_range_of_doubles_is_infinite() -> None:
    scale = Scale(METRE, Fraction(1000))
    assert scale.to_si(Fraction(10) ** 400) == math.inf
    assert scale.to_si(-(Fraction(10) ** 400)) == -math.inf
    assert scale.to_si(Fraction(3, 2)) == 1500.0
    assert replace(scale, offset=Fraction(7)).to_si(-(Fraction(10) ** 400)) == -math.inf
