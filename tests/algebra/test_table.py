"""What is known of a curve without its values: its lists, its derivatives and where they jump."""

from __future__ import annotations

import pytest

from compiler.algebra.expression import ZERO, Apply, Number, Symbol, evaluate
from compiler.algebra.table import (
    curve_slope,
    domain,
    is_table,
    jumps_at_knots,
    last_derivative,
    lists,
    noise,
    order_of,
    table,
    turned_round,
)

X, Y = Symbol("x"), Symbol("y")
PLACES, VALUES = [Number(v) for v in (0.0, 1.0, 3.0, 4.0)], [Number(v) for v in (0.0, 1.0, 2.0, 5.0)]
KINDS = ["linear", "cubic", "monotone"]


def curve(kind: str, order: float = 0.0) -> Apply:
    found = table(kind, X, PLACES, VALUES)
    assert isinstance(found, Apply)
    return Apply(kind, (Number(order), *found.operands[1:]))


def value(x: Apply, at: float) -> float:
    return evaluate(x, {"x": at}.__getitem__)


def inverse() -> Apply:
    found = turned_round(curve("monotone"), Y)
    assert isinstance(found, Apply)
    return found


def test_curves_and_what_is_none() -> None:
    assert all(is_table(curve(kind)) for kind in KINDS) and is_table(inverse())
    assert not is_table(X) and not is_table(noise(X, Y)) and not is_table(X + Y)


def test_lists_and_the_one_in_which_the_argument_is_looked_up() -> None:
    for kind in KINDS:
        found = lists(curve(kind))
        assert found[:2] == (tuple(PLACES), tuple(VALUES)) and len(found) == (2 if kind == "linear" else 3)
        assert domain(curve(kind)) == tuple(PLACES)
    assert domain(inverse()) == tuple(VALUES) and lists(inverse())[0] == tuple(PLACES)


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_the_order_of_a_derivative(order: int) -> None:
    assert order_of(curve("cubic", float(order))) == order
    assert order_of(Apply("noise", (Number(float(order)), X, Y))) == order


@pytest.mark.parametrize("kind", KINDS)
def test_a_derivative_jumps_where_its_values_do(kind: str) -> None:
    for order in range(4 if kind != "linear" else 2):
        found = curve(kind, float(order))
        jumps = any(abs(value(found, p + 1e-9) - value(found, p - 1e-9)) > 1e-3 for p in (1.0, 3.0))
        assert jumps_at_knots(found) == jumps, order


def test_an_inverse_or_a_noise_jumps_nowhere() -> None:
    assert not any(jumps_at_knots(Apply(kind, (Number(float(order)), X, Y))) for kind in ("inverse", "noise") for order in range(6))  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_the_last_derivative_is_constant_between_points(kind: str) -> None:
    found = last_derivative(curve(kind))
    assert found.operands[1:] == curve(kind).operands[1:]
    for a, b in ((0.0, 1.0), (1.0, 3.0), (3.0, 4.0)):
        values = {value(found, a + share * (b - a)) for share in (0.2, 0.5, 0.9)}
        assert len(values) == 1
    assert any(value(found, at) for at in (0.5, 2.0, 3.5))
    assert curve_slope(found) == ZERO
    before = Apply(kind, (Number(order_of(found) - 1.0), *found.operands[1:]))
    assert curve_slope(before) == found
