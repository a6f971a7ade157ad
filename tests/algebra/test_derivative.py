"""Derivatives against central differences, one-sided at kinks, finite where the language promises it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from compiler.algebra.derivative import derivative
from compiler.algebra.expression import (
    ONE,
    ZERO,
    Apply,
    Expression,
    Number,
    Symbol,
    add,
    call,
    divide,
    evaluate,
    multiply,
    power,
    select,
    value_of,
)
from compiler.algebra.operators import OPERATORS

X, Y = Symbol("x"), Symbol("y")

# Where each function is smooth: an interval for each operand.
DOMAINS: dict[str, tuple[tuple[float, float], ...]] = {
    "divide": ((-3, 3), (0.2, 3)), "power": ((0.2, 3), (-2, 2)), "sin": ((-6, 6),), "cos": ((-6, 6),), "tan": ((-1.2, 1.2),), "asin": ((-0.9, 0.9),), "acos": ((-0.9, 0.9),),
    "atan": ((-5, 5),), "atan2": ((0.2, 3), (-3, 3)), "sinh": ((-3, 3),), "cosh": ((-3, 3),), "tanh": ((-3, 3),), "asinh": ((-4, 4),), "acosh": ((1.2, 4),), "atanh": ((-0.9, 0.9),),
    "exp": ((-3, 3),), "erf": ((-2, 2),), "log": ((0.2, 4),), "log10": ((0.2, 4),), "sqrt": ((0.2, 4),), "abs": ((0.1, 3),), "sign": ((0.1, 3),), "floor": ((0.1, 0.9),), "ceil": ((0.1, 0.9),),
    "min": ((-2, 0), (0.1, 2)), "max": ((-2, 0), (0.1, 2)),
    "root": ((0.2, 3), (1.1, 1.9)),
}  # fmt: skip
CONDITIONS = {"less", "less_equal", "equal", "and", "or", "not", "select"}


def slope(x: Expression, symbol: Symbol, at: dict[str, float]) -> float:
    return evaluate(derivative(x, symbol), at.__getitem__)


def difference(x: Expression, symbol: Symbol, at: dict[str, float], h: float = 1e-5) -> float:
    """The central difference of fourth order."""

    def f(step: float) -> float:
        return evaluate(x, {**at, symbol.key: at[symbol.key] + step}.__getitem__)

    return (8 * (f(h) - f(-h)) - (f(2 * h) - f(-2 * h))) / (12 * h)


def test_every_function_is_tried() -> None:
    assert set(DOMAINS) == {name for name, row in OPERATORS.items() if row.arity} - CONDITIONS


@pytest.mark.few(14)
@pytest.mark.parametrize("operator", sorted(DOMAINS))
@given(data=st.data())
def test_every_function_against_central_differences(operator: str, data: st.DataObject) -> None:
    """In each operand, at random points of its domain; once more inside another function, for the chain rule."""
    intervals = DOMAINS[operator]
    at = {name: data.draw(st.floats(*interval)) for name, interval in zip("xy", intervals, strict=False)}
    at.setdefault("y", 0.5)
    plain = Apply(operator, (X, Y)[: len(intervals)])
    for symbol in (X, Y)[: len(intervals)]:
        assert slope(plain, symbol, at) == pytest.approx(difference(plain, symbol, at), rel=1e-6, abs=1e-7)
        chained = multiply(Y, call("sin", plain), X)
        assert slope(chained, symbol, at) == pytest.approx(difference(chained, symbol, at), rel=1e-6, abs=1e-6)


@st.composite
def smooth(draw: st.DrawFn, depth: int = 3) -> Expression:
    """A smooth expression of x and y without poles near the points that are tried."""
    kind = draw(
        st.sampled_from(
            ["x", "y", "number"] if depth == 0 else ["x", "add", "multiply", "divide", "power", "function", "number"]
        )
    )
    if kind in "xy":
        return X if kind == "x" else Y
    if kind == "number":
        return Number(draw(st.sampled_from([0.5, 2.0, -1.5, 1.0, 0.0])))
    a = draw(smooth(depth - 1))
    if kind == "function":
        return call(draw(st.sampled_from(["sin", "cos", "atan", "tanh", "asinh"])), a)
    if kind == "power":
        return power(a, Number(draw(st.sampled_from([2.0, 3.0]))))
    b = draw(smooth(depth - 1))
    if kind == "divide":
        return divide(a, add(Number(2.0), multiply(b, b)))
    return add(a, b) if kind == "add" else multiply(a, b)


@given(smooth(), st.floats(-1.5, 1.5), st.floats(-1.5, 1.5))
def test_compositions(x: Expression, a: float, b: float) -> None:
    at = {"x": a, "y": b}
    assume(abs(evaluate(x, at.__getitem__)) < 1e3)
    for symbol in (X, Y):
        numeric = difference(x, symbol, at, 1e-4)
        assert slope(x, symbol, at) == pytest.approx(numeric, rel=1e-5, abs=1e-5 * (1 + abs(numeric)))


@given(smooth(), smooth())
def test_linearity_and_the_product_rule(a: Expression, b: Expression) -> None:
    at = {"x": 0.3, "y": -0.7}
    da, db = slope(a, X, at), slope(b, X, at)
    va, vb = evaluate(a, at.__getitem__), evaluate(b, at.__getitem__)
    assert slope(add(a, b), X, at) == pytest.approx(da + db, rel=1e-9, abs=1e-9)
    assert slope(multiply(a, b), X, at) == pytest.approx(da * vb + va * db, rel=1e-9, abs=1e-9)


class TestKinks:
    """From the right; no distributions."""

    @pytest.mark.parametrize(
        ("x", "point", "expected"),
        [
            (call("abs", X), 0.0, 1.0), (call("abs", X), -1e-300, -1.0), (call("sign", X), 0.0, 0.0), (call("floor", X), 1.0, 0.0), (call("ceil", X), 1.0, 0.0),
            (call("max", X, ZERO), -1.0, 0.0),
            (call("sqrt", X), 0.0, 0.0), (call("sqrt", call("abs", X)), 0.0, 0.0), (select(call("less", X, ZERO), -X, 2 * X), 0.0, 2.0), (select(call("less", ZERO, X), 3 * X, 5 * X), 1.0, 3.0),
            (call("abs", X * X), 0.0, 0.0), (X * call("abs", X), 0.0, 0.0), (call("abs", X) ** 2, 0.0, 0.0), (call("abs", X) ** 3, 0.0, 0.0), (call("abs", X - 1), 1.0, 1.0),
        ],
    )  # fmt: skip
    def test_one_sided_slopes(self, x: Expression, point: float, expected: float) -> None:
        assert slope(x, X, {"x": point}) == expected

    @pytest.mark.parametrize(
        ("x", "sides"),
        [
            (call("abs", X), (-1.0, 1.0)),
            (call("max", X, 2 * X), (1.0, 2.0)),
            (call("min", X, 2 * X), (2.0, 1.0)),
            (call("abs", call("sin", X)), (-1.0, 1.0)),
        ],
    )
    def test_both_sides_of_a_kink(self, x: Expression, sides: tuple[float, float]) -> None:
        assert (slope(x, X, {"x": -1e-9}), slope(x, X, {"x": 1e-9})) == pytest.approx(sides)

    @pytest.mark.parametrize(
        "x", [call("max", X, ZERO), call("max", ZERO, X), call("min", X, ZERO), call("min", ZERO, X)]
    )
    def test_a_tie_takes_one_of_the_sides(self, x: Expression) -> None:
        """Not their mean, and no NaN."""
        assert slope(x, X, {"x": 0.0}) in (0.0, 1.0)

    @pytest.mark.parametrize("operator", ["less", "less_equal", "equal"])
    def test_conditions_have_no_slope(self, operator: str) -> None:
        assert derivative(Apply(operator, (X, Y)), X) == ZERO
        assert derivative(Apply("and", (call("less", X, Y), call("less", Y, X))), X) == ZERO


class TestTheControllerOfTheManipulator:
    """V = gain sqrt(abs(c)) sign(c), which starts at c = 0, and V^2: finite, as sympy's are not."""

    gain = Number(19400.0)
    voltage = multiply(gain, call("sqrt", call("abs", X)), call("sign", X))

    @pytest.mark.parametrize("c", [0.0, -0.0, 1e-300, -1e-300, 1e-12, -1e-12, 8e-6, -8e-6])
    def test_finite_everywhere(self, c: float) -> None:
        for x in (
            self.voltage,
            power(self.voltage, Number(2.0)),
            self.voltage * self.voltage,
            call("max", self.voltage, ZERO) ** 2,
        ):
            assert math.isfinite(slope(x, X, {"x": c}))

    def test_the_square_is_right(self) -> None:
        """d(V^2)/dc = gain^2 sign(c), from the right at 0."""
        squared = power(self.voltage, Number(2.0))
        for c, expected in ((0.0, 1.0), (1e-6, 1.0), (-1e-6, -1.0)):
            assert slope(squared, X, {"x": c}) == pytest.approx(expected * 19400.0**2, rel=1e-12)

    def test_right_away_from_zero(self) -> None:
        for c in (4e-6, -4e-6):
            assert slope(self.voltage, X, {"x": c}) == pytest.approx(19400.0 / (2 * math.sqrt(4e-6)), rel=1e-12)

    def test_written_in_other_ways(self) -> None:
        """gain*abs(c)^0.5*sign(c), and one branch for each sign as the feed-forward writes it."""
        other = multiply(self.gain, power(call("abs", X), Number(0.5)), call("sign", X))
        branches = select(call("less", ZERO, X), multiply(self.gain, call("sqrt", X)), ZERO)
        for x in (other, other * other, branches, branches * branches):
            assert math.isfinite(slope(x, X, {"x": 0.0}))


@pytest.mark.parametrize(
    ("x", "point"),
    [
        (power(X, Number(1.5)), 0.0),
        (power(X, Number(2.0)), 0.0),
        (power(X, Number(3.0)), -2.0),
        (power(X, Number(-2.0)), -2.0),
        (X * call("log", X * X + 1), 0.0),
    ],
)
def test_powers_where_the_value_is_finite(x: Expression, point: float) -> None:
    assert slope(x, X, {"x": point}) == pytest.approx(difference(x, X, {"x": point}, 1e-6) if point else 0.0, rel=1e-6)


def test_what_does_not_depend_has_no_slope() -> None:
    assert derivative(call("exp", Y) + 3, X) == ZERO
    assert derivative(X, X) == ONE
    assert derivative(Number(4.0), X) == ZERO


def test_a_shared_subexpression_is_differentiated_once() -> None:
    x: Expression = X
    for _ in range(60):
        x = Apply("multiply", (Number(0.5), Apply("add", (x, x))))
    assert slope(x, X, {"x": 3.0}) == 1.0


def _solved(x: Expression, t: float) -> float:
    """The value of an expression over one symbol, unknowns of linear systems among its operands."""
    if not isinstance(x, Apply):
        return evaluate(x, lambda key: t)
    if x.operator == "item":
        system, number = x.operands
        assert isinstance(system, Apply)
        entries = [_solved(o, t) for o in system.operands]
        count = math.isqrt(len(entries))
        matrix = np.array(entries[: count * count]).reshape(count, count)
        return float(np.linalg.solve(matrix, entries[count * count :])[int(_solved(number, t))])
    return value_of(x.operator, [_solved(o, t) for o in x.operands])


@pytest.mark.parametrize("number", [0, 1, 2])
def test_unknowns_of_a_linear_system(number: int) -> None:
    """A(t) u = r(t): u' against differences of a solution by numpy."""
    t = Symbol("t")
    a = [t + 4, call("sin", t), Number(1.0), Number(0.5), t * t + 3, call("cos", t), Number(0.0), -t, Number(5.0)]
    right = [call("exp", t), t * 2, Number(1.0)]
    x = Apply("item", (Apply("solve", (*a, *right)), Number(float(number))))
    for at in (-0.7, 0.3, 1.9):
        h = 1e-5
        quotient = (_solved(x, at + h) - _solved(x, at - h)) / (2 * h)
        assert _solved(derivative(x, t), at) == pytest.approx(quotient, rel=1e-8, abs=1e-9)
    assert (
        derivative(Apply("item", (Apply("solve", (*map(Number, (2.0, 1.0, 1.0, 3.0, 1.0, 1.0)),)), Number(0.0))), t)
        == ZERO
    )


@pytest.mark.parametrize(("x", "n", "slope_at"), [(0.0, 3.0, 0.0), (0.0, -3.0, 0.0), (8.0, 3.0, 1 / 12), (-8.0, 3.0, 1 / 12), (1e-30, 3.0, 1e20 / 3)])  # fmt: skip
def test_the_slope_of_a_root_is_zero_at_zero_alone(x: float, n: float, slope_at: float) -> None:
    assert slope(call("root", X, Number(n)), X, {"x": x}) == pytest.approx(slope_at, rel=1e-14)
