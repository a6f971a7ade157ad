"""Products of powers of one quantity have one inverse if their exponents are odd together."""

from __future__ import annotations

import pytest

from compiler.algebra.expression import Apply, Expression, Number, Symbol, call, evaluate
from compiler.algebra.invert import _power_of, solve_nonlinear

X, Y, A, B = map(Symbol, "xyab")
SIGN, SIZE = call("sign", X), call("abs", X)
KNOWN = {"a": 1.7, "b": 0.6}


@pytest.mark.parametrize(
    "law",
    [
        SIGN * call("sqrt", SIZE), A * SIGN * call("sqrt", SIZE) / B, X * SIZE, A * X * SIZE, X * SIZE**0.5, X * call("sqrt", SIZE), SIGN * SIZE**1.8, X**3 * SIZE, X**3 * SIZE**0.25, Apply("multiply", (X, X, X)), X**2 * SIGN,
        SIGN * SIZE**0.5 * SIZE, Apply("multiply", (X**3, SIGN, SIGN)), (X - A) * call("abs", X - A), A * (X / B) * call("abs", X / B) + 1.0, call("exp", X * SIZE), X**5 * SIZE**-0.5, call("tanh", X) * call("abs", call("tanh", X)), X**-1 * SIZE**3,
    ],
    ids=str,
)  # fmt: skip
def test_a_product_that_is_odd_is_solved(law: Expression) -> None:
    found = solve_nonlinear(Y, law, X)
    assert found is not None
    for x in (-2.3, -0.4, 0.2, 0.9, 2.5):
        y = evaluate(law, (KNOWN | {"x": x}).__getitem__)
        assert evaluate(found, (KNOWN | {"y": y}).__getitem__) == pytest.approx(x, rel=1e-12)


@pytest.mark.parametrize(
    "law",
    [
        SIZE * SIZE, Apply("multiply", (X, X)), X * SIZE * SIGN, X * (X + 1), X * call("sin", X), X * call("abs", X + A), SIGN * SIZE**-0.5, Apply("multiply", (SIGN, SIGN)), Apply("multiply", (SIGN, X**0.5)), X * X**0.5,
        Apply("multiply", (SIGN, SIGN, SIGN)), X**-3 * SIZE, X**2 * SIZE, X * SIZE**-1, X * SIZE**A, X**A * SIZE, X * call("sqrt", X),
    ],
    ids=str,
)  # fmt: skip
def test_a_product_that_is_not_odd_has_no_one_inverse(law: Expression) -> None:
    assert solve_nonlinear(Y, law, X) is None


@pytest.mark.parametrize("exponent", [1.5, 0.3, -0.4, 2.5])
def test_a_power_with_a_fraction_is_solved_on_positive_numbers(exponent: float) -> None:
    found = solve_nonlinear(Y, A * X**exponent, X)
    assert found is not None
    for x in (0.3, 2.0):
        assert evaluate(found, {"a": 1.7, "y": 1.7 * x**exponent}.__getitem__) == pytest.approx(x, rel=1e-13)


def test_factors_as_powers() -> None:
    """The quantity, the exponent of its size, and 1 if its sign counts."""
    assert _power_of(SIGN) == (X, 0.0, 1) and _power_of(SIZE) == (X, 1.0, 0) and _power_of(X) == (X, 1.0, 1)
    assert _power_of(call("sqrt", SIZE)) == (X, 0.5, 0) and _power_of(SIZE**0.3) == (X, 0.3, 0)
    assert _power_of(X**2) == (X, 2.0, 0) and _power_of(X**3) == (X, 3.0, 1) and _power_of(X**-3) == (X, -3.0, 1)
    assert _power_of(X**0.3) == (X**0.3, 1.0, 1) and _power_of(X ** Number(1.5)) == (X**1.5, 1.0, 1)
