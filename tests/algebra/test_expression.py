"""Constructors: vanishing terms are removed completely, and folding never changes a value."""

from __future__ import annotations

import gc
import math
from collections.abc import Callable
from typing import NamedTuple

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from compiler.algebra.expression import (
    MINUS_ONE,
    ONE,
    ZERO,
    Apply,
    Expression,
    Number,
    Symbol,
    add,
    call,
    closed,
    depends_on,
    divide,
    evaluate,
    multiply,
    negate,
    power,
    select,
    substitute,
    symbols,
)
from compiler.algebra.operators import OPERATORS

X, Y, Z = Symbol("x"), Symbol("y"), Symbol("z")
BELOW = call("less", X, Y)


@pytest.mark.parametrize(
    ("built", "expected"),
    [
        (X + 0, X), (0 + X, X), (X - 0, X), (X * 1, X), (1 * X, X), (X * 0, ZERO), (0 * X, ZERO), (X / 1, X), (0 / X, ZERO), (X**1, X), (X**0, ONE),
        (X + 2 + 3, add(X, Number(5.0))), (2 * X * 3, multiply(Number(6.0), X)), (add(), ZERO), (multiply(), ONE), (add(Number(2.0), Number(-2.0)), ZERO),
        (-(-X), X), (X - 0.0, X), (X / -1, -X), (Number(6.0) / 3, Number(2.0)), (-(X + Y), add(-X, -Y)), ((-X) / Y, -(X / Y)), (X / (-Y), -(X / Y)), ((-X) / (-Y), X / Y),
        ((X + Y) + Z, add(X, Y, Z)), (X * (Y * Z), multiply(X, Y, Z)), (call("sin", ZERO), ZERO), (call("cos", ZERO), ONE), (call("sqrt", Number(9.0)), Number(3.0)),
        (call("min", Number(2.0), Number(3.0)), Number(2.0)), (power(Number(2.0), Number(10.0)), Number(1024.0)), (call("sin", Number(math.pi)), ZERO),
        (call("cos", Number(math.pi / 2)), ZERO), (call("cos", Number(1.5 * math.pi)), ZERO), (select(call("less", ONE, Number(2.0)), X, Y), X),
        (select(call("less", Number(2.0), ONE), X, Y), Y), (select(BELOW, X, X), X), (select(call("not", call("less", ONE, ZERO)), X, Y), X),
        (select(call("and", call("less", ZERO, ONE), call("equal", ONE, ONE)), X, Y), X), (negate(ZERO), ZERO), (MINUS_ONE * MINUS_ONE, ONE),
    ],
)  # fmt: skip
def test_what_folds(built: Expression, expected: Expression) -> None:
    assert built == expected
    if isinstance(expected, Number):
        assert str(built) == str(expected) or built.value == 0.0  # type: ignore[union-attr]


@pytest.mark.parametrize(
    "built",
    [X + Y, X * Y, X / Y, X / 2, X**2, X / 0, ZERO / ZERO, call("sqrt", Number(-1.0)), call("log", ZERO), power(Number(-2.0), Number(0.5)), power(ZERO, Number(-1.0)), call("exp", Number(1e9)),
     call("less", ONE, Number(2.0)), call("sin", Number(1e-17) * X), call("asin", Number(2.0)), ONE / X],
)  # fmt: skip
def test_what_stays(built: Expression) -> None:
    """An operation without finite value is kept, and reported with a place when it is evaluated; conditions stay conditions."""
    assert isinstance(built, Apply)


def test_small_values_of_sine_are_kept() -> None:
    """Only the rounding error at a multiple of 90 deg is dropped, not a small angle."""
    assert call("sin", Number(1e-20)) == Number(1e-20)
    assert call("sin", Number(math.pi + 1e-9)) != ZERO
    assert call("cos", Number(math.pi / 2 + 1e-9)) != ZERO


class TestRoots:
    """V = gain sqrt(abs(c)) sign(c) and its square stay smooth at 0."""

    root = call("sqrt", call("abs", X))
    sign = call("sign", X)

    @pytest.mark.parametrize(
        ("built", "expected"),
        [
            (call("abs", X) * call("sign", X), X), (X * call("sign", X), call("abs", X)), (power(call("abs", X), Number(2.0)), power(X, Number(2.0))), (power(call("abs", X), Number(4.0)), power(X, Number(4.0))),
            (power(call("sign", X), Number(3.0)), call("sign", X)), (power(call("sqrt", call("abs", X)), Number(2.0)), call("abs", X)), (power(call("sqrt", call("exp", X)), Number(4.0)), power(call("exp", X), Number(2.0))),
            (power(X * Y, Number(2.0)), multiply(power(X, Number(2.0)), power(Y, Number(2.0)))),
        ],
    )  # fmt: skip
    def test_they_open(self, built: Expression, expected: Expression) -> None:
        assert built == expected

    @pytest.mark.parametrize(
        "built",
        [
            power(call("sqrt", X), Number(2.0)),
            power(call("sqrt", X - 1), Number(2.0)),
            power(call("abs", X), Number(3.0)),
        ],
    )
    def test_but_not_where_it_would_change_a_value(self, built: Expression) -> None:
        """sqrt(x)^2 is x only where x is never negative."""
        assert isinstance(built, Apply) and built.operator == "power"

    def test_the_square(self) -> None:
        voltage = multiply(Number(3.0), self.root, self.sign)
        assert power(voltage, Number(2.0)) == multiply(Number(9.0), call("abs", X))


class Built(NamedTuple):
    """An expression and the same computed with floats."""

    expression: Expression
    value: float


POINT = {"x": 0.75, "y": -1.25, "z": 2.0}


@st.composite
def built(draw: st.DrawFn, depth: int = 3) -> Built:
    kind = draw(
        st.sampled_from(
            ["symbol", "number"]
            if depth == 0
            else ["symbol", "number", "add", "multiply", "divide", "power", "negate", "call", "select"]
        )
    )
    if kind == "symbol":
        name = draw(st.sampled_from("xyz"))
        return Built(Symbol(name), POINT[name])
    if kind == "number":
        number = draw(st.sampled_from([0.0, 1.0, -1.0, 2.0, -0.5, 3.0]))
        return Built(Number(number), number)
    a, b = draw(built(depth - 1)), draw(built(depth - 1))
    match kind:
        case "add":
            return Built(add(a.expression, b.expression), a.value + b.value)
        case "multiply":
            return Built(multiply(a.expression, b.expression), a.value * b.value)
        case "divide":
            assume(abs(b.value) > 1e-3)
            return Built(divide(a.expression, b.expression), a.value / b.value)
        case "power":
            exponent = draw(st.sampled_from([0.0, 1.0, 2.0, 3.0, 4.0, -1.0, -2.0]))
            assume(abs(a.value) > 1e-3 or exponent >= 0)
            return Built(power(a.expression, Number(exponent)), a.value**exponent)
        case "negate":
            return Built(negate(a.expression), -a.value)
        case "select":
            return Built(
                select(call("less", a.expression, b.expression), a.expression, b.expression), min(a.value, b.value)
            )
    operator, function = draw(
        st.sampled_from(
            [
                ("abs", abs),
                ("sign", lambda v: math.copysign(1.0, v) if v else 0.0),
                ("sin", math.sin),
                ("atan", math.atan),
                ("root", lambda v: math.sqrt(abs(v))),
            ]
        )
    )
    inner = call("abs", a.expression) if operator == "root" else a.expression
    return Built(call("sqrt" if operator == "root" else operator, inner), function(a.value))


@given(built())
def test_folding_never_changes_a_value(pair: Built) -> None:
    assume(math.isfinite(pair.value) and abs(pair.value) < 1e6)
    # close to a jump of sign or select, rounding may take the other side
    assert evaluate(pair.expression, POINT.__getitem__) == pytest.approx(
        pair.value, rel=1e-9, abs=1e-9
    ) or _touches_a_jump(pair.expression)


def _touches_a_jump(x: Expression) -> bool:
    """Return True if a condition or sign within it is within rounding of its jump."""
    if not isinstance(x, Apply):
        return False
    if x.operator in ("sign", "less"):
        a, b = (
            evaluate(x.operands[0], POINT.__getitem__),
            evaluate(x.operands[-1], POINT.__getitem__) if x.operator == "less" else 0.0,
        )
        if abs(a - b) < 1e-12:
            return True
    return any(map(_touches_a_jump, x.operands))


@given(built(), built())
def test_equal_structure_is_equal(a: Built, b: Built) -> None:
    """Equality is by structure and consistent with the hash."""
    again = substitute(a.expression, lambda s: s)
    assert again == a.expression and hash(again) == hash(a.expression)
    if a.expression == b.expression:
        assert hash(a.expression) == hash(b.expression)
        assert a.value == pytest.approx(b.value, rel=1e-12, abs=1e-300)


@given(built())
def test_substitution_folds_like_the_constructors(pair: Built) -> None:
    """Numbers for symbols give the number, and nothing of the symbols is left."""
    assume(math.isfinite(pair.value) and abs(pair.value) < 1e6)
    put = substitute(pair.expression, lambda s: Number(POINT[s.key]))
    assert not list(symbols(put))
    if not _touches_a_jump(pair.expression):
        assert evaluate(put, {}.__getitem__) == pytest.approx(pair.value, rel=1e-9, abs=1e-9)


def test_symbols_in_order_of_their_first_occurrence() -> None:
    assert list(symbols(Y * X + call("sin", Z) + X)) == [Y, X, Z]
    assert depends_on(Y * X, X) and not depends_on(Y * X, Z)


def test_the_branch_not_taken_needs_no_value() -> None:
    safe = select(call("less", ZERO, X), divide(ONE, X), ZERO)
    assert evaluate(safe, {"x": 0.0}.__getitem__) == 0.0
    with pytest.raises(ZeroDivisionError):
        evaluate(ONE / X, {"x": 0.0}.__getitem__)


@pytest.mark.parametrize("operator", sorted({name for name, row in OPERATORS.items() if row.arity} - {"select"}))
def test_every_operator_evaluates(operator: str) -> None:
    """Its meaning for floats, called through an expression."""
    count, function = OPERATORS[operator].arity, OPERATORS[operator].value
    values = {"acosh": (1.5,), "atanh": (0.5,)}.get(operator, (0.4, 0.9)[:count])
    arguments = tuple(Symbol(i) for i in range(count))
    assert evaluate(Apply(operator, arguments), values.__getitem__) == function(*values)


def test_a_shared_subexpression_is_walked_once() -> None:
    """Forty doublings are forty steps, not a billion."""
    x: Expression = X
    for _ in range(40):
        x = Apply("add", (x, x))
    assert evaluate(x, {"x": 1.0}.__getitem__) == 2.0**40
    assert list(symbols(x)) == [X]
    assert substitute(x, lambda s: ONE) == Number(2.0**40)


def test_what_is_shared_is_compared_once() -> None:
    """Two expressions of forty levels that were built separately are equal; one that differs at the lowest level is not."""

    def doubled(x: Expression) -> Expression:
        for _ in range(40):
            x = Apply("add", (x, x))
        return x

    assert doubled(X) == doubled(Symbol("x"))
    assert doubled(X) != doubled(Symbol("y"))


@pytest.mark.parametrize("build", [add, multiply])
def test_many_operands(build: Callable[..., Expression]) -> None:
    """A flat sum or product of thousands is one node, and is walked without recursion trouble."""
    terms: list[Expression] = [Symbol(i) for i in range(5000)]
    found = build(*terms)
    assert isinstance(found, Apply) and len(found.operands) == 5000
    assert evaluate(found, lambda key: 1.0) in (5000.0, 1.0)


@pytest.mark.parametrize("inner", [X**2, 4 * X**2, X**2 + call("abs", Y), X**4 * call("exp", Y) + 1, call("cosh", X), Apply("add", (Number(0.0), X**2))])  # fmt: skip
def test_the_square_of_a_root_of_what_is_never_negative_is_that(inner: Expression) -> None:
    assert power(call("sqrt", inner), Number(2.0)) == inner
    fourth, values = power(call("sqrt", inner), Number(4.0)), {"x": -1.7, "y": 0.3}
    assert evaluate(fourth, values.__getitem__) == pytest.approx(evaluate(inner, values.__getitem__) ** 2, rel=1e-15)


@pytest.mark.parametrize(
    ("base", "exponent", "root"),
    [
        (X**2, 0.5, call("abs", X)),
        (X * X, 0.5, call("abs", X)),
        (4 * X**2, 0.5, 2 * call("abs", X)),
        ((X - 1) ** 2, 0.5, call("abs", X - 1)),
        (X**2 * Y**4, 0.5, call("abs", X) * Y**2),
        (X**2, 1.5, call("abs", X) ** 3),
        (X**-2, 0.5, call("abs", X) ** -1),
        (X**2, 1 / 3, call("abs", X) ** (2 / 3)),
    ],
)
def test_roots_of_even_powers_are_absolute_values(base: Expression, exponent: float, root: Expression) -> None:
    """Their bends are located, and their slopes known, as those of `abs` are."""
    assert power(base, Number(exponent)) == root


@pytest.mark.parametrize("base", [X, X**3, X * Y, -4 * X**2, X**2 + Y**2, X**2 * Y])
def test_other_roots_stay(base: Expression) -> None:
    assert call("sqrt", base) == Apply("sqrt", (base,))


@pytest.mark.parametrize("inner", [X, X**3, -(X**2), X**2 - 1, X**2 + Y, X**2 * Y, call("sin", X), X**0.5 * Y, X**1.5, Apply("power", (X, Y)), X / Y])  # fmt: skip
def test_the_square_of_another_root_stays(inner: Expression) -> None:
    assert power(call("sqrt", inner), Number(2.0)) == Apply("power", (call("sqrt", inner), Number(2.0)))


def test_a_closed_sum_or_product_stays_one_operand() -> None:
    for opened, kept in ((X + Y, closed(X + Y)), (X * Y, closed(X * Y)), (2 * X, closed(2 * X))):
        assert isinstance(kept, Apply) and isinstance(opened, Apply)
        assert kept == opened and kept.closed and not opened.closed and closed(kept) is kept
        joined, constructor = (add, "add") if kept.operator == "add" else (multiply, "multiply")
        assert joined(kept, Z) == Apply(constructor, (kept, Z)) and joined(opened, Z) != Apply(constructor, (opened, Z))


@pytest.mark.parametrize("x", [X, Number(2.0), call("sin", X), X / Y, -X, X * call("abs", Y), X * call("sign", Y), X * call("sqrt", Y), X * Y**2, X * call("root", Y, Z)])  # fmt: skip
def test_what_may_cancel_with_other_factors_stays_open(x: Expression) -> None:
    """A sign in front of a product, and factors such as abs(x) sign(x)."""
    assert closed(x) is x
    assert not isinstance(x, Apply) or not x.closed


def test_a_sum_of_such_factors_is_closed() -> None:
    for x in (call("abs", X) + Y, X - Y, 3 * X, X * call("sin", Y)):
        kept = closed(x)
        assert isinstance(kept, Apply) and kept.closed


def test_walks_leave_nothing_to_the_garbage_collector() -> None:
    """A closure that calls itself is a cycle: those of a large model took a sixth of its compilation."""
    x = add(power(Symbol("x"), Number(2.0)), call("sin", Symbol("y")))
    gc.collect()
    gc.disable()
    try:
        for _ in range(9):
            evaluate(substitute(x, lambda symbol: Number(0.5) if symbol.key == "x" else symbol), lambda _: 1.0)
        assert gc.collect() == 0
    finally:
        gc.enable()
