"""Affine parts: slope and rest exactly where an expression is affine, None where it is not."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from compiler.algebra.affine import affine_parts, jointly_affine, solve_affine
from compiler.algebra.expression import (
    ZERO,
    Apply,
    Expression,
    Number,
    Symbol,
    add,
    call,
    depends_on,
    divide,
    evaluate,
    multiply,
    negate,
    select,
)

X, A, B = Symbol("x"), Symbol("a"), Symbol("b")
POINTS = [{"x": x, "a": 1.7, "b": -0.6} for x in (-2.0, 0.0, 0.5, 3.0)]


@st.composite
def affine(draw: st.DrawFn, depth: int = 3) -> Expression:
    """Affine in x by its construction."""
    kind = draw(st.sampled_from(["x", "rest"] if depth == 0 else ["x", "rest", "add", "scale", "divide", "negate"]))
    if kind == "x":
        return X
    if kind == "rest":
        return draw(st.sampled_from([A, B, Number(2.0), call("sin", A), A * B, ZERO, call("exp", B) + A]))
    inner = draw(affine(depth - 1))
    if kind == "add":
        return add(inner, draw(affine(depth - 1)))
    if kind == "negate":
        return negate(inner)
    factor = draw(st.sampled_from([A, B, Number(-3.0), call("cos", B), A + 4]))
    return multiply(factor, inner) if kind == "scale" else divide(inner, factor)


@given(affine())
def test_slope_and_rest(x: Expression) -> None:
    found = affine_parts(x, X)
    assert found is not None
    slope, rest = found
    assert not depends_on(slope, X) and not depends_on(rest, X)
    for point in POINTS:
        value = evaluate(x, point.__getitem__)
        assert evaluate(slope, point.__getitem__) * point["x"] + evaluate(rest, point.__getitem__) == pytest.approx(
            value, rel=1e-12, abs=1e-12
        )


@pytest.mark.parametrize(
    "x",
    [
        X * X,
        X**2,
        call("sin", X),
        A / X,
        X * (X + A),
        call("abs", X),
        call("exp", X) + X,
        A * call("sqrt", X),
        select(call("less", X, A), X, 2 * X),
        call("max", X, A),
        X / (X + 1),
        A**X,
    ],
)
def test_what_is_not_affine(x: Expression) -> None:
    assert affine_parts(x, X) is None
    assert affine_parts(A + 2 * x, X) is None


def test_what_does_not_depend() -> None:
    assert affine_parts(A * B + 1, X) == (ZERO, A * B + 1)
    assert affine_parts(Number(3.0), X) == (ZERO, Number(3.0))


@given(affine(), affine())
def test_solutions_solve(left: Expression, right: Expression) -> None:
    """A solution satisfies the equation; there is none only if the slope is zero."""
    found = solve_affine(left, right, X)
    parts = affine_parts(left - right, X)
    assert parts is not None
    if found is None:
        assert parts[0] == ZERO
        return
    assert not depends_on(found, X)
    point = dict(POINTS[0])
    slope = evaluate(parts[0], point.__getitem__)
    if abs(slope) < 1e-6:
        return  # it vanishes at this point only
    point["x"] = evaluate(found, point.__getitem__)
    assert evaluate(left, point.__getitem__) == pytest.approx(evaluate(right, point.__getitem__), rel=1e-8, abs=1e-8)


@pytest.mark.parametrize(("left", "right"), [(X, A + B), (A + B, X), (X, call("sin", A))])
def test_explicit_equations_stay_as_written(left: Expression, right: Expression) -> None:
    assert solve_affine(left, right, X) == (right if left == X else left)


@pytest.mark.parametrize(("left", "right"), [(X, X), (A, B), (X * X, A), (X, X + A)])
def test_no_unique_solution(left: Expression, right: Expression) -> None:
    assert solve_affine(left, right, X) is None


def test_x_on_both_sides() -> None:
    found = solve_affine(2 * X, X + A, X)
    assert found is not None and evaluate(found, {"a": 5.0}.__getitem__) == 5.0


def test_long_sums_cost_their_length() -> None:
    terms: list[Expression] = [multiply(Number(2.0), Symbol(i)) for i in range(3000)]
    found = affine_parts(Apply("add", (*terms, X)), X)
    assert found is not None and found[0] == Number(1.0)


def test_slopes_by_several_symbols() -> None:
    law = 2 * X + A * Symbol("y") - B / 3 + (X + call("sin", A)) * B
    found = jointly_affine(law, [X, Symbol("y")])
    assert found is not None
    slopes, rest = found
    for a, b in ((1.5, -2.0), (0.3, 4.0)):
        values = [evaluate(part, {"a": a, "b": b}.__getitem__) for part in (*slopes, rest)]
        assert values == pytest.approx([2 + b, a, -b / 3 + math.sin(a) * b], rel=1e-14)
    assert jointly_affine(A * B, [X]) == ([ZERO], A * B) and jointly_affine(A * X, []) == ([], A * X)


@pytest.mark.parametrize("law", [X * Symbol("y"), A * X * Symbol("y") + X, X + Symbol("y") ** 2, X**2 + Symbol("y"), X / Symbol("y"), Symbol("y") / X])  # fmt: skip
def test_what_is_affine_in_each_symbol_alone_is_not_so_in_all(law: Expression) -> None:
    assert jointly_affine(law, [X, Symbol("y")]) is None and jointly_affine(law, [Symbol("y"), X]) is None
