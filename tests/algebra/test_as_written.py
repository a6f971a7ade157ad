"""Expressions in sympy as they were written, and curves and noise as people read them."""

from __future__ import annotations

from typing import Any

import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from compiler.algebra.expression import MINUS_ONE, Apply, Expression, Number, Symbol, call, evaluate, select
from compiler.algebra.sympy_form import as_written, number_as_written, quotient, sympy_name, to_sympy
from compiler.algebra.table import noise, table

X, Y, A = Symbol("x"), Symbol("y"), Symbol("a")
NAMES: dict[str, Any] = {k: sympy.Symbol(k) for k in "xya"}
x, y, a = NAMES.values()
MINUS, KEPT = sympy.S.NegativeOne, {"evaluate": False}


def written(expression: Expression) -> sympy.Basic:
    return as_written(expression, NAMES.__getitem__)


@pytest.mark.parametrize(
    ("expression", "arguments"),
    [
        (Apply("add", (Y, X, Y, Number(0.0))), (y, x, y, 0)),
        (Apply("multiply", (Y, X, Y, Number(2.0))), (y, x, y, 2)),
        (Apply("multiply", (MINUS_ONE, X, Apply("multiply", (MINUS_ONE, Y)))), (x, y)),
        (Apply("multiply", (X, MINUS_ONE, Y)), (-1, x, y)),
        (Apply("multiply", (X, Apply("multiply", (MINUS_ONE, Y)), A)), (-1, x, y, a)),
        (Apply("multiply", (Number(1.0), X, Y)), (x, y)),
        (Apply("divide", (X, Y)), (x, sympy.Pow(y, -1))),
        (Apply("divide", (X, Apply("multiply", (MINUS_ONE, Y, A)))), (-1, x, sympy.Pow(sympy.Mul(y, a, **KEPT), -1, **KEPT))),
        (Apply("divide", (X, Apply("multiply", (Y, A)))), (x, sympy.Pow(sympy.Mul(y, a, **KEPT), -1, **KEPT))),
        (Apply("divide", (Apply("multiply", (MINUS_ONE, X)), Apply("multiply", (MINUS_ONE, Y)))), (x, sympy.Pow(y, -1))),
        (Apply("power", (X, Number(2.0))), (x, 2)),
        (Apply("power", (Number(2.0), Number(3.0))), (2, 3)),
        (Apply("sqrt", (Number(4.0),)), (4, sympy.S.Half)),
        (Apply("sin", (Number(0.0),)), (0,)),
        (Apply("log10", (X,)), (x,)),
        (Apply("min", (X, Number(2.0))), (x, 2)),
        (Apply("linear", (Number(0.0), X, *map(Number, (1.0, 2.0, 5.0, 6.0)))), (0, x, sympy.Tuple(1, 2), sympy.Tuple(5, 6))),
        (Apply("inverse", (Number(0.0), X, *map(Number, (1.0, 2.0, 5.0, 6.0, 7.0, 8.0)))), (0, x, sympy.Tuple(1, 2), sympy.Tuple(5, 6), sympy.Tuple(7, 8))),
        (Apply("cubic", (Number(1.0), X, A, *map(Number, (2.0, 5.0, 6.0, 7.0, 8.0)))), (1, x, sympy.Tuple(a, 2), sympy.Tuple(5, 6), sympy.Tuple(7, 8))),
        (Apply("natural_slope", (Number(1.0), *map(Number, (1.0, 2.0, 3.0, 5.0)), A, X)), (1, sympy.Tuple(1, 2, 3), sympy.Tuple(5, a, x))),
        (Apply("monotone_slope", (Number(0.0), A, Number(2.0), X, Y)), (0, sympy.Tuple(a, 2), sympy.Tuple(x, y))),
        (noise(X, Number(3.0)), (0, x, 3)),
    ],
)  # fmt: skip
def test_operands_in_their_order(expression: Apply, arguments: tuple[Any, ...]) -> None:
    found = written(expression)
    if expression.operator in ("min", "max"):
        assert set(found.args) == set(map(sympy.sympify, arguments))
    else:
        assert found.args == tuple(map(sympy.sympify, arguments))
    named = {"add": sympy.Add, "multiply": sympy.Mul, "divide": sympy.Mul, "power": sympy.Pow, "sqrt": sympy.Pow, "min": sympy.Min, "sin": sympy.sin}  # fmt: skip
    assert found.func == named.get(expression.operator, sympy.Function(expression.operator))


def test_a_choice_and_a_sign() -> None:
    assert written(select(call("less", X, Y), X, A)).args == ((x, x < y), (a, True))
    assert written(Apply("multiply", (MINUS_ONE, X))) == sympy.Mul(-1, x)
    assert written(Apply("multiply", (Number(1.0), X))) == x, "one factor is no product"
    assert quotient(x, sympy.Mul(-1, y, **KEPT)).args == (MINUS, x, 1 / y)
    assert quotient(x, sympy.Mul(2, y, **KEPT)).args == (x, sympy.Pow(sympy.Mul(2, y, **KEPT), -1, **KEPT))
    assert sympy_name("asin") == "asin" and sympy_name("max") == "Max" and sympy_name("log10") == "log10"


@pytest.mark.parametrize("value", [0.0, 3.0, -7.0, 999999999999999.0, -999999999999999.0, 1e15, -1e15, 3e15, 0.1, 1 / 3, 1e300, 5e-324])  # fmt: skip
def test_a_number_bit_by_bit(value: float) -> None:
    found = number_as_written(value)
    assert float(found) == value
    assert found.is_Integer == (value == int(value) and abs(value) < 1e15)


def test_what_is_known_is_used_and_what_is_written_becomes_known() -> None:
    inner = call("sin", X)
    known: dict[Expression, sympy.Basic] = {inner: sympy.Symbol("v1")}
    law = Apply("add", (inner, Y))
    found = as_written(law, NAMES.__getitem__, known)
    assert found.args == (sympy.Symbol("v1"), y) and known[law] is found and known[Y] == y
    assert X not in known, "the inside of what is known is not looked at"


@st.composite
def laws(draw: st.DrawFn, depth: int = 2) -> Expression:
    if depth == 0:
        return draw(st.sampled_from([X, Y, A, Number(2.0), Number(-1.0), Number(0.1), Number(1.0)]))
    first, second = draw(laws(depth - 1)), draw(laws(depth - 1))
    kind = draw(st.sampled_from(["add", "multiply", "divide", "power", "select", "sin", "atan2"]))
    match kind:
        case "divide":
            return Apply("divide", (first, Apply("multiply", (MINUS_ONE, Apply("add", (Number(2.0), second**2))))))
        case "power":
            return Apply("power", (first, Number(3.0)))
        case "select":
            return select(call("less", first, second), first, second)
        case "sin":
            return Apply("sin", (first,))
    return Apply(kind, (first, second))


@settings(max_examples=15)
@given(laws())
def test_a_line_printed_from_it_computes_the_same(law: Expression) -> None:
    function = sympy.lambdify(list(NAMES.values()), written(law), "math")
    for point in ((0.7, 0.3, 2.0), (-0.4, 0.9, 0.5)):
        assert function(*point) == pytest.approx(
            evaluate(law, dict(zip("xya", point, strict=True)).__getitem__), rel=1e-13, abs=1e-13
        )


def read(expression: Expression) -> str:
    return str(to_sympy(expression, NAMES.__getitem__))


def test_curves_as_people_read_them() -> None:
    places, values = [Number(float(i)) for i in range(12)], [Number(float(i * i)) for i in range(12)]
    assert read(table("linear", X, places[:3], values[:3])) == "linear(x, (0, 1, 2), (0, 1, 4))"
    assert read(table("monotone", X, places[:2], [A, Y])) == "monotone(x, (0, 1), (a, y))"
    assert read(table("cubic", X, places[:2], values[:2])) == "cubic(x, (0, 1), (0, 1))", (
        "slopes follow from the points"
    )
    assert read(table("cubic", X, places, values)).startswith("cubic(x, (0, 1, 2, 3,")
    assert read(table("cubic", X, [*places, Number(12.0)], [*values, A])) == "cubic(x, 13 points)"
    inverse = Apply("inverse", (Number(0.0), Y, *map(Number, (1.0, 2.0, 5.0, 6.0, 1.0, 1.0))))
    assert read(inverse) == "inverse(y, (1, 2), (5, 6))"


def test_derivatives_have_names() -> None:
    points = (Number(0.0), Number(1.0), Number(2.0), Number(5.0))
    names = {0.0: "linear", 1.0: "linear_slope", 2.0: "linear_derivative_2"}
    for order, name in names.items():
        assert read(Apply("linear", (Number(order), X, *points))) == f"{name}(x, (0, 1), (2, 5))"
    assert read(noise(X, Number(7.0))) == "noise(x, 7)"
    assert read(Apply("noise", (Number(3.0), X, Number(7.0)))) == "noise_derivative_3(x, 7)"
    assert read(Apply("natural_slope", (Number(1.0), *points))) == "natural_slope(1, 0, 1, 2, 5)"
    assert read(Apply("monotone_slope", (Number(0.0), *points))) == "monotone_slope(0, 0, 1, 2, 5)"


def test_simple_fractions_and_long_numbers() -> None:
    """A number of more than 15 characters has 17 digits, all others those of sympy."""
    for value, text in ((0.25, "1/4"), (-0.5, "-1/2"), (1.5, "3/2"), (0.5, "1/2"), (2.0, "2"), (-3.0, "-3")):
        assert read(Number(value)) == text
    for value, text in ((1 / 3, "0.33333333333333330"), (0.12345678901234, "0.12345678901234000"), (0.1234567890123, "0.123456789012300"), (0.75, "0.750000000000000")):  # fmt: skip
        assert read(Number(value)) == text and float(to_sympy(Number(value), NAMES.__getitem__)) == value
    for value, whole in ((999999999999999.0, True), (-999999999999999.0, True), (1e15, False), (-1e15, False)):
        assert to_sympy(Number(value), NAMES.__getitem__).is_Integer == whole
