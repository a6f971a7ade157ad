"""Indicators and windows of conditions, against the conditions themselves at random values."""

from __future__ import annotations

import random
from collections.abc import Mapping
from math import log

import pytest

from compiler.algebra.expression import ZERO, Expression, Number, Symbol, add, call, evaluate, multiply, power, symbols
from compiler.codegen.indicators import indicator, window

X, Y, A, B, L = (Symbol(n) for n in "xyabl")
FIXED = {A, B, L}


def is_fixed(x: Expression) -> bool:
    return FIXED.issuperset(symbols(x))


def raised(x: Expression, n: float) -> Expression:
    return power(x, Number(n))


def samples(number: int) -> list[dict[str, float]]:
    rng = random.Random(0)
    return [{n: rng.choice([-1, 1]) * rng.uniform(0.1, 2) for n in "xyabl"} for _ in range(number)]


def value(x: Expression, at: Mapping[str, float]) -> float:
    return evaluate(x, at.__getitem__)


WINDOWS = [
    raised(X, 2.0),
    multiply(X, X),
    raised(X, 4.0),
    multiply(A, raised(X, 2.0)),
    multiply(A, B, raised(X, 2.0), raised(Y, 2.0)),
    multiply(raised(X, 2.0), raised(Y, 4.0)),
    multiply(A, raised(X, 2.0), raised(add(X, Y), 6.0)),
    call("abs", X),
    multiply(A, call("abs", X)),
    multiply(B, call("abs", X), call("abs", add(Y, A))),
    add(multiply(A, raised(X, 2.0)), B, A),
    add(call("abs", X), B),
    call("sqrt", raised(X, 2.0)),
    call("sqrt", raised(X, 4.0)),
    add(call("sqrt", raised(X, 2.0)), A),
]


@pytest.mark.parametrize("moving", WINDOWS, ids=str)
@pytest.mark.parametrize("turned", [False, True])
def test_a_window_holds_where_its_condition_holds(moving: Expression, turned: bool) -> None:
    left, right = (L, moving) if turned else (moving, L)
    found = window(left, right, is_fixed)
    assert found is not None
    assert not is_fixed(found[0]) and all(map(is_fixed, found[1:]))
    held = 0
    for at in samples(200):
        u, r, sign, _ = (value(x, at) for x in found)
        assert sign in (-1.0, 1.0)
        holds = value(left, at) < value(right, at)
        assert (abs(u) < r if sign > 0 else abs(u) > r) == holds
        held += holds
    assert 0 < held < 200


@pytest.mark.parametrize("moving", [multiply(A, raised(X, 2.0)), multiply(A, call("abs", X))], ids=str)
@pytest.mark.parametrize("turned", [False, True])
def test_where_a_factor_is_zero_the_rest_decides(moving: Expression, turned: bool) -> None:
    found = window(*((L, moving) if turned else (moving, L)), is_fixed)
    assert found is not None
    for level in (-2.5, 3.5):
        at = {"x": 1.0, "a": 0.0, "l": level}
        assert value(found[2], at) == 0.0
        assert value(found[3], at) == (-level if turned else level)


@pytest.mark.parametrize(
    ("moving", "u", "r"),
    [
        (raised(X, 4.0), -3.0, 2.0),
        (multiply(raised(X, 2.0), raised(Y, 4.0)), -75.0, 4.0),
        (call("abs", X), -3.0, 16.0),
        (multiply(A, raised(X, 2.0)), -3.0, 2.0**1.5),
        (call("sqrt", raised(X, 2.0)), -3.0, 16.0),
    ],
    ids=str,
)
def test_a_window_has_the_width_of_the_lowest_degree(moving: Expression, u: float, r: float) -> None:
    """A function that crosses its level straight: x against r, not x^4 against r^4."""
    at = {"x": -3.0, "y": 5.0, "a": 2.0, "b": 1.0, "l": 16.0}
    found = window(moving, L, is_fixed)
    assert found is not None and value(found[0], at) == pytest.approx(u, rel=1e-14)
    assert value(found[1], at) == pytest.approx(r, rel=1e-14)


@pytest.mark.parametrize(
    ("left", "right"),
    [
        (A, L),
        (X, Y),
        (raised(X, 2.0), Y),
        (X, L),
        (raised(X, 3.0), L),
        (raised(X, -2.0), L),
        (raised(X, 2.5), L),
        (multiply(raised(X, 2.0), Y), L),
        (multiply(call("abs", X), raised(Y, 2.0)), L),
        (multiply(call("abs", X), raised(call("abs", Y), 3.0)), L),
        (raised(X, 2.0), ZERO),
        (ZERO, call("abs", X)),
        (add(raised(X, 2.0), Number(3.0)), Number(3.0)),
        (call("exp", X), L),
        (add(X, raised(X, 2.0)), L),
    ],
    ids=str,
)
def test_other_forms_have_no_window(left: Expression, right: Expression) -> None:
    assert window(left, right, is_fixed) is None


@pytest.mark.parametrize(
    "moving",
    [
        call("exp", X),
        multiply(A, call("exp", multiply(B, X))),
        multiply(A, B, call("exp", add(X, Y))),
        multiply(A, call("sin", X)),
        multiply(A, call("exp", X), Y),
        add(call("exp", X), Y),
        X,
    ],
    ids=str,
)
@pytest.mark.parametrize("turned", [False, True])
def test_an_indicator_has_the_sign_of_left_less_right(moving: Expression, turned: bool) -> None:
    left, right = (L, moving) if turned else (moving, L)
    found = indicator(left, right, is_fixed)
    signs = set()
    for at in samples(100):
        difference = value(left, at) - value(right, at)
        assert value(found, at) * difference > 0
        signs.add(difference > 0)
    assert signs == {False, True}


@pytest.mark.parametrize("turned", [False, True])
def test_a_bell_against_its_level_is_a_parabola(turned: bool) -> None:
    """-(x/b)^2 - log(l/a) where `a` and `l` have one sign, a constant where not; finite where one is zero."""
    bell = multiply(A, call("exp", multiply(Number(-1.0), raised(X, 2.0), raised(B, -2.0))))
    found = indicator(*((L, bell) if turned else (bell, L)), is_fixed)
    side = -1 if turned else 1
    at = {"x": 1.5, "a": 4.0, "b": 0.5, "l": 0.5}

    assert value(found, at) == pytest.approx(side * (-9 + log(8)), rel=1e-14)
    assert value(found, at | {"a": -4.0, "l": -0.5}) == pytest.approx(-side * (-9 + log(8)), rel=1e-14)
    assert value(found, at | {"l": -0.5}) == side * 4.5
    assert value(found, at | {"l": 0.0}) == side * 4.0
    assert value(found, at | {"a": 0.0}) == side * -0.5
    assert value(found, at | {"a": 1e-300, "l": 1e-300}) == pytest.approx(-9 * side, rel=1e-12)


def test_what_moves_on_both_sides_or_none_is_their_difference() -> None:
    bell = call("exp", X)
    assert indicator(bell, Y, is_fixed) == bell - Y
    assert indicator(A, L, is_fixed) == A - L
    assert indicator(call("exp", A), L, is_fixed) == call("exp", A) - L
