"""Laws with a root that passes through zero: one form, `sign(x) f(abs(x))`, for every way of writing; other laws stay as they are."""

from __future__ import annotations

import math
from random import Random

import pytest

from compiler.algebra.expression import ZERO, Apply, Expression, Number, Symbol, call, evaluate, operations, select
from compiler.algebra.odd_roots import EQUAL, _agree, _factors, _has_root, with_odd_roots

X, Y, A, B, C = map(Symbol, "xyabc")
HALF, THIRD = Number(0.5), Number(1 / 3)
SIGN = call("sign", X)
ABOVE, BELOW = call("less", ZERO, X), call("less", X, ZERO)
ODD = SIGN * call("sqrt", call("abs", X))


def root(x: Expression) -> Expression:
    return call("sqrt", x)


def magnitude(x: Expression) -> Expression:
    return call("abs", x)


def positive(x: Expression) -> Expression:
    return call("max", x, ZERO)


# The forms of one law, and the odd root that they are.
FORMS: list[tuple[Expression, Expression]] = [
    # two sides
    (select(ABOVE, root(X), -root(-X)), ODD),
    (select(BELOW, -root(-X), root(X)), ODD),
    (select(call("less_equal", ZERO, X), root(X), -root(-X)), ODD),
    (select(call("less_equal", X, ZERO), -root(-X), root(X)), ODD),
    (select(ABOVE, root(X), select(BELOW, -root(-X), ZERO)), ODD),
    (select(BELOW, -root(-X), select(ABOVE, root(X), ZERO)), ODD),
    (select(ABOVE, A * root(2 * X / B), -A * root(-2 * X / B)), SIGN * (A * root(2 * magnitude(X) / B))),
    (select(ABOVE, root(2 * X / B), -root(2 * magnitude(X) / B)), SIGN * root(2 * magnitude(X) / B)),
    (select(ABOVE, X**0.75, -((-X) ** 0.75)), SIGN * magnitude(X) ** 0.75),
    (select(ABOVE, root(X**3 + X), -root(-(X**3) - X)), SIGN * root(magnitude(X) ** 3 + magnitude(X))),
    # a quotient
    (X / root(magnitude(X)), ODD),
    (X * magnitude(X) ** -0.5, ODD),
    (A * X / root(magnitude(X)), A * ODD),
    (X / magnitude(X) ** 0.25, SIGN * magnitude(X) ** 0.75),
    (X / root(2 * magnitude(X)), 0.5 * SIGN * root(2 * magnitude(X))),
    (X / root(A * magnitude(X) / B), SIGN * root(A * magnitude(X) / B) / (A / B)),
    (3 * X / root(magnitude(2 * X)), 1.5 * call("sign", 2 * X) * root(magnitude(2 * X))),
    (X / (B * root(magnitude(X))), ODD / B),
    ((A * X / C) / (root(magnitude(X)) * B), A * ODD / (B * C)),
    # halves
    (root(positive(X)) - root(positive(-X)), ODD),
    (Y + root(positive(X)) - root(positive(-X)), ODD + Y),
    (A * root(positive(X)) - A * root(positive(-X)) + call("max", Y, ZERO), A * ODD + call("max", Y, ZERO)),
    (positive(X) ** 0.75 - positive(-X) ** 0.75, SIGN * magnitude(X) ** 0.75),
    (root(call("max", ZERO, X)) - root(call("max", ZERO, -X)), ODD),
]


@pytest.mark.parametrize(("law", "expected"), FORMS, ids=lambda x: str(x)[:60])
def test_every_form_is_the_odd_root(law: Expression, expected: Expression) -> None:
    """It has the value of the law on both sides, and zero at zero, and no condition and no quotient of zeros are left."""
    found = with_odd_roots(law)
    random = Random(1)
    for _ in range(10):
        point = {name: random.uniform(0.3, 4.0) for name in "yabc"}
        for x in (-2.5, -0.3, 0.4, 3.0):
            value = evaluate(law, (point | {"x": x}).__getitem__)
            assert evaluate(found, (point | {"x": x}).__getitem__) == pytest.approx(value, rel=1e-13)
            assert evaluate(expected, (point | {"x": x}).__getitem__) == pytest.approx(value, rel=1e-13)
    rest = evaluate(found, {"x": 0.0, "y": 0.0, "a": 1.5, "b": 2.0, "c": 0.7}.__getitem__)
    assert rest == 0.0
    assert any(node == call("sign", node.operands[0]) for node in operations(found))
    assert not any(node.operator == "select" for node in operations(found))
    assert with_odd_roots(found) == found, "nothing is left to do"


@pytest.mark.parametrize("law", [FORMS[0][0], FORMS[10][0], FORMS[19][0]], ids=["sides", "quotient", "halves"])
def test_a_law_within_a_law(law: Expression) -> None:
    assert with_odd_roots(call("exp", A + 2 * law)) == call("exp", A + 2 * with_odd_roots(law))
    assert with_odd_roots(law) == ODD


def test_both_roots_of_a_sum() -> None:
    law = select(ABOVE, root(X), -root(-X)) + Y / root(magnitude(Y))
    expected = ODD + call("sign", Y) * root(magnitude(Y))
    assert with_odd_roots(law) == expected


OTHER_LAWS: list[Expression] = [
    X,
    Number(2.0),
    X * Y,
    select(ABOVE, X, 2 * X),
    root(X),
    select(ABOVE, root(X), root(-X)),  # even
    select(ABOVE, root(X), -2 * root(-X)),  # not symmetric
    select(ABOVE, root(X + 1), -root(1 - X)),  # not zero at zero
    select(ABOVE, X * root(X + 1), -X * root(1 - X)),  # the root is not zero at zero
    select(ABOVE, root(X) + 1, -root(-X) - 1),  # a jump
    select(call("less", ZERO, 2 * X), root(X), -root(-X)),
    select(call("less", Y, X), root(X), -root(-X)),
    select(call("less", Number(1.0), X), root(X), -root(-X)),
    select(call("equal", X, ZERO), root(X), -root(-X)),
    select(call("equal", ZERO, X), root(X), -root(-X)),
    select(call("not", BELOW), root(X), -root(-X)),
    select(call("and", ABOVE, call("less", Y, A)), root(X), -root(-X)),
    select(ABOVE, root(X), select(BELOW, -root(-X), Y)),
    select(ABOVE, root(X), select(call("less", X, Y), -root(-X), ZERO)),
    select(ABOVE, X**1.5, -((-X) ** 1.5)),  # smooth enough
    select(ABOVE, X**2.0, -((-X) ** 2.0)),
    select(ABOVE, X**0.5 * Y, X),
    X / magnitude(X),
    X / root(X),
    X / root(magnitude(X) + 1),
    X / root(magnitude(X) * magnitude(Y)),
    X / root(magnitude(X + 1)),
    (X + 1) / root(magnitude(X)),
    X * root(magnitude(X)),
    X / magnitude(X) ** 1.5,
    X / magnitude(X) ** A,
    X / root(X * magnitude(X)),
    Y / root(magnitude(X)),
    X**2 / root(magnitude(X)),
    X / root(magnitude(X) ** 2 + 1),
    1 / root(magnitude(X)),
    root(positive(X)) + root(positive(-X)),
    root(positive(X)) - root(positive(-Y)),
    root(positive(X)) - 2 * root(positive(-X)),
    root(positive(X)) - Y,
    positive(X) - positive(-X),
    root(positive(X) + 1) - root(positive(-X) + 1),
    root(call("max", X, Number(1.0))) - root(call("max", -X, Number(1.0))),
]


@pytest.mark.parametrize("law", OTHER_LAWS, ids=lambda x: str(x)[:60])
def test_another_law_stays(law: Expression) -> None:
    assert with_odd_roots(law) == law


def test_a_coefficient_without_a_value_keeps_having_none() -> None:
    """sqrt(2 x/b) has no value for a negative b, on either side."""
    found = with_odd_roots(select(ABOVE, root(2 * X / B), -root(-2 * X / B)))
    with pytest.raises(ValueError, match=r"."):
        evaluate(found, {"x": 2.0, "b": -1.0}.__getitem__)


@pytest.mark.parametrize(("difference", "agree"), [(0.7 * EQUAL, True), (1.5 * EQUAL, False)])
def test_coefficients_that_differ_by_rounding_are_equal(difference: float, agree: bool) -> None:
    law = select(ABOVE, root(X), -(1 + difference) * root(-X))
    assert (with_odd_roots(law) == ODD) == agree
    assert EQUAL == 1e-11


def test_sides_agree_if_they_have_equal_values_where_both_have_one() -> None:
    assert _agree(X * Y, Y * X, X) and not _agree(X * Y, Y * X + 1e-9, X)
    assert _agree(root(Y) * X, X * root(Y), X), "no value for a negative y on both sides"
    assert not _agree(root(Y * Y), Y, X) and not _agree(root(Y), Y / root(Y) * call("exp", root(X - 20)), X)
    assert not _agree(root(-X), root(-X), X), "no value anywhere"
    assert _agree(magnitude(X), X, X) and not _agree(magnitude(Y), Y, X), "only the variable is positive"
    assert not _agree(root(-X), X, X), "a value on one side only"
    assert _agree(ZERO, ZERO, X) and not _agree(ZERO, Number(1e-290), X)
    assert not _agree(call("sign", X - 9.5), Number(-1.0), X) or not _agree(call("sign", 0.2 - X), Number(-1.0), X)


def test_a_root_is_one_that_is_zero_with_the_law() -> None:
    assert _has_root(root(X), X) and _has_root(X**0.9, X) and _has_root(A * root(B * X), X)
    assert not _has_root(X**1.0, X) and not _has_root(root(X + 1), X) and not _has_root(root(Y), X)
    assert not _has_root(1 + root(X), X) and not _has_root(X**1.5, X) and not _has_root(root(A) * X, X)
    assert not _has_root(Apply("power", (X, ZERO)) * X, X) and not _has_root(X**A, X)
    assert not _has_root(Apply("power", (X, Number(1.0))), X)


def test_factors_above_and_below_the_line() -> None:
    assert _factors((X / Y) / (A / B) * C) == ([X, B, C], [Y, A])
    assert _factors(X + Y) == ([X + Y], [])
    assert _factors(Apply("divide", (Apply("multiply", (X, Apply("divide", (Y, A)))), B))) == ([X, Y], [A, B])


def test_the_flow_out_of_a_tank_ends_at_zero() -> None:
    """The slope of the rewritten law is that of A sqrt(2 x/rho), from both sides."""
    law = with_odd_roots(select(ABOVE, A * root(2 * X / B), -A * root(-2 * X / B)))
    for x in (1e-12, 1e-3, 2.0):
        expected = 0.3 * math.sqrt(2 * x / 1000.0)
        for sign in (-1, 1):
            point = {"x": sign * x, "a": 0.3, "b": 1000.0}
            assert evaluate(law, point.__getitem__) == pytest.approx(sign * expected, rel=1e-14)
