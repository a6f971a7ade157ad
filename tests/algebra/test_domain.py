"""An expression is total if it has a value for all values of what varies: surely so where it is said, and not said where it is false."""

from __future__ import annotations

import pytest

from compiler.algebra.domain import is_total
from compiler.algebra.expression import Apply, Expression, Number, Symbol, call, power, select

U, V, P = Symbol("u"), Symbol("v"), Symbol("p")
SIZE = call("abs", U)

TOTAL: list[Expression] = [
    U, P, Number(2.0), U + V, U * V, U / P, U / 2, U**2, U**3, P**-1, P**0.5, 1 / P, SIZE**0.5, call("exp", U) ** 1.5, call("cosh", U) ** 0.5, SIZE**P, call("sqrt", SIZE), call("sqrt", P), call("root", SIZE, Number(3.0)), call("log", P),
    call("asin", P), call("tan", P), call("tanh", U), call("erf", U), call("sin", U / P), call("atan2", U, V), select(call("less", U, V), U, P), call("min", U, V), power(SIZE, Number(2.5)), call("exp", U * V), P * U, Apply("power", (P, U)),
    call("root", P, Number(2.0)), call("sign", U), Apply("power", (U, Number(0.0))), SIZE ** Number(0.25),
]  # fmt: skip
NOT_TOTAL: list[Expression] = [
    1 / U, P / V, U / (U + P), 1 / (P * U), U**-1, U**-2, U**0.5, U**1.5, SIZE**-1, SIZE**-0.5, U**P, (U + 1) ** 0.5, SIZE**U, Apply("power", (U, V)), Apply("power", (SIZE + 1, V)), call("sqrt", U), call("sqrt", U + P), call("log", U), call("log", SIZE),
    call("asin", U), call("acos", V), call("acosh", U), call("atanh", U), call("tan", U), call("root", U, Number(3.0)), call("sin", 1 / U), 2 + call("log", P * U), call("asin", SIZE), call("acosh", call("cosh", U)), call("sqrt", call("sqrt", U)), call("tan", SIZE), Apply("power", (call("sqrt", P - U), P)),
    Apply("sqrt", (call("sqrt", U),)),
]  # fmt: skip


def varies(symbol: Symbol) -> bool:
    return symbol != P


@pytest.mark.parametrize("x", TOTAL, ids=str)
def test_a_value_everywhere(x: Expression) -> None:
    assert is_total(x, varies)


@pytest.mark.parametrize("x", NOT_TOTAL, ids=str)
def test_no_value_somewhere(x: Expression) -> None:
    assert not is_total(x, varies)
    assert is_total(x, lambda symbol: False), "where nothing varies nothing is lost"
