"""Values in sympy, and the closed solutions that come from there: never a wrong one, never one of several."""

from __future__ import annotations

import math
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from compiler.algebra.expression import (
    ONE,
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
    power,
    select,
)
from compiler.algebra.invert import solve_nonlinear
from compiler.algebra.operators import OPERATORS
from compiler.algebra.sympy_form import to_sympy

X, Y, A = Symbol("x"), Symbol("y"), Symbol("a")
NAMES = {k: sympy.Symbol(k, real=True) for k in "xya"}
POINTS = [{"x": 0.7, "y": 0.3, "a": 2.0}, {"x": -0.4, "y": 0.9, "a": 0.5}, {"x": 0.2, "y": -0.8, "a": 1.5}]
CONDITIONS = ("less", "less_equal", "equal", "and", "or", "not")


@contextmanager
def no_hanging(seconds: int = 4) -> Iterator[None]:
    """Every call of sympy returns: a file must not be able to hang its reader."""
    if not hasattr(signal, "SIGALRM"):
        yield
        return

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise TimeoutError(f"no answer within {seconds} s")

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def in_sympy(x: Expression, point: dict[str, float]) -> float:
    """Value of the expression in sympy."""
    return float(to_sympy(x, NAMES.__getitem__).subs({NAMES[k]: sympy.Float(v, 17) for k, v in point.items()}))


def same(x: Expression) -> None:
    """Values in sympy are those of the language, wherever it has one."""
    for point in POINTS:
        try:
            value = evaluate(x, point.__getitem__)
        except (ValueError, ArithmeticError):
            continue
        assert in_sympy(x, point) == pytest.approx(value, rel=1e-12, abs=1e-13)


@pytest.mark.parametrize(
    "operator", sorted({name for name, row in OPERATORS.items() if row.arity} - {"select", *CONDITIONS})
)
def test_every_function(operator: str) -> None:
    count = OPERATORS[operator].arity
    inner: tuple[Expression, ...] = (X + 1.5 if operator == "acosh" else X, Y)[:count]
    x = Apply(operator, inner)
    same(x)


@pytest.mark.parametrize(
    ("operator", "negated"),
    [("less", False), ("less", True), ("less_equal", False), ("less_equal", True), ("equal", False)],
)
def test_conditions(operator: str, negated: bool) -> None:
    condition = call(operator, X, Y)
    x = select(call("not", condition) if negated else condition, X + 1, Y * 2)
    same(x)
    equal = {"x": 0.5, "y": 0.5, "a": 1.0}
    assert in_sympy(x, equal) == evaluate(x, equal.__getitem__)


@pytest.mark.parametrize("operator", ["and", "or"])
def test_joined_conditions(operator: str) -> None:
    x = select(call(operator, call("less", X, Y), call("less_equal", ZERO, A - 1)), X, select(call("less", Y, A), Y, A))
    same(x)


@st.composite
def expressions(draw: st.DrawFn, depth: int = 3) -> Expression:
    kind = draw(
        st.sampled_from(
            ["symbol", "number"]
            if depth == 0
            else ["symbol", "add", "multiply", "divide", "power", "function", "select", "number"]
        )
    )
    if kind == "symbol":
        return draw(st.sampled_from([X, Y, A]))
    if kind == "number":
        return Number(draw(st.sampled_from([2.0, -1.0, 0.5, 1e-12, 8.8541878128e-12, 3.0, 0.1])))
    a, b = draw(expressions(depth - 1)), draw(expressions(depth - 1))
    match kind:
        case "add":
            return add(a, b)
        case "multiply":
            return multiply(a, b)
        case "divide":
            return divide(a, 2 + b * b)
        case "power":
            return power(a, Number(draw(st.sampled_from([2.0, 3.0]))))
        case "select":
            return select(call("less", X, Y), a, b)
    return call(draw(st.sampled_from(["sin", "atan", "tanh", "abs"])), a)


@settings(max_examples=40)
@given(expressions(2))
def test_values_are_equal(x: Expression) -> None:
    for point in POINTS:
        value = evaluate(x, point.__getitem__)
        assert in_sympy(x, point) == pytest.approx(value, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    "value", [8.8541878128e-12, 38e-6, 1e-300, 1e300, 0.1, 1 / 3, 2.0, -7.0, 1e15, 123456789.123456789, 5e-324]
)
def test_numbers_keep_all_their_digits(value: float) -> None:
    assert in_sympy(Number(value) * X, {"x": 1.0}) == value


def test_whole_numbers_are_whole_for_people() -> None:
    assert str(to_sympy(2 * X**2 + X / 3, NAMES.__getitem__)) == "2*x**2 + x/3"
    assert str(to_sympy(0.5 * X, NAMES.__getitem__)) == "x/2"


# Laws as people write them, with the points at which they are tried.
INVERTIBLE: list[tuple[Expression, list[float]]] = [
    (X**3, [-2.0, -0.5, 0.5, 3.0]),
    (A * X**3, [-2.0, 0.5]),
    (X**5, [-1.5, 2.0]),
    (X + X**3, [-2.0, -0.1, 0.0, 0.4, 3.0]),
    (A * X + 2 * X**3, [-2.0, 0.7]),
    (call("exp", X), [-2.0, 0.0, 1.5]),
    (A * (call("exp", X / 0.026) - 1), [-0.1, 0.0, 0.1]),
    (call("log", X), [0.2, 3.0]),
    (call("tanh", X), [-1.0, 0.5]),
    (call("sinh", X), [-1.0, 2.0]),
    (call("asinh", X), [-1.0, 2.0]),
    (call("atan", X), [-1.0, 2.0]),
    (call("sqrt", X), [0.3, 2.0]),
    (ONE / X, [-0.5, 2.0]),
    (A / (1 + X), [-0.5, 2.0]),
    (X**2, [-1.0, 2.0]),
    (call("sin", X), [-0.5, 2.0]),
    (call("cos", X), [0.5, 4.0]),
    (call("cosh", X), [-1.0, 2.0]),
    (X**4 + X, [-0.3, 1.0]),
    (X**3 - X, [-0.4, 0.2, 2.0]),
    (X * call("exp", X), [-0.5, 0.5]),
    (X + call("sin", X), [-1.0, 2.0]),
    (call("tan", X), [-1.0, 0.5]),
    (call("abs", X), [-1.0, 2.0]),
    (select(call("less", X, ZERO), X, 2 * X), [-1.0, 2.0]),
]


@pytest.mark.parametrize(("x", "points"), INVERTIBLE, ids=[str(to_sympy(x, NAMES.__getitem__)) for x, _ in INVERTIBLE])
def test_a_solution_is_the_one_real_solution(x: Expression, points: list[float]) -> None:
    """y = f(x) solved for x gives x back at every point of f's domain, negative ones too; or nothing is given."""
    with no_hanging():
        found = solve_nonlinear(Y, x, X)
    if found is None:
        return
    assert not depends_on(found, X)
    for point in points:
        y = evaluate(x, {"x": point, "a": 2.0}.__getitem__)
        assert evaluate(found, {"y": y, "a": 2.0}.__getitem__) == pytest.approx(point, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    "x", [call("exp", X), A * (call("exp", X / 0.026) - 1), call("log", X), call("sqrt", X), A / (1 + X), X**3], ids=str
)
def test_what_is_solved(x: Expression) -> None:
    """The usual laws are: a diode, a square-root orifice, a saturation, a cubic spring."""
    with no_hanging():
        assert solve_nonlinear(Y, x, X) is not None


@pytest.mark.parametrize(
    "x",
    [
        X**2,
        X**4,
        call("sin", X),
        call("cos", X),
        call("cosh", X),
        X**3 - X,
        X * X - 2 * X,
        call("abs", X),
        call("sign", X),
        call("max", X, A),
    ],
    ids=str,
)
def test_none_of_several(x: Expression) -> None:
    assert solve_nonlinear(Y, x, X) is None


@pytest.mark.parametrize(("left", "right"), [(ZERO, X**2 + 1), (Number(-1.0), call("exp", X)), (X, X), (A, Y)])
def test_none_at_all(left: Expression, right: Expression) -> None:
    assert solve_nonlinear(left, right, X) is None


def test_a_diode() -> None:
    i_s, u_t = Symbol("i_s"), Symbol("u_t")
    found = solve_nonlinear(Y, i_s * (call("exp", X / u_t) - 1), X)
    assert found is not None
    values = {"y": 3e-3, "i_s": 1e-12, "u_t": 0.026}
    assert evaluate(found, values.__getitem__) == pytest.approx(0.026 * math.log(3e-3 / 1e-12 + 1), rel=1e-12)
