"""Power series in time of lowered expressions, and how each coefficient moves with a start, against sympy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import sympy

from compiler.algebra.expression import Apply, Expression, Number, Symbol, call, power, select
from compiler.codegen.limits import Leaf
from compiler.codegen.series import TaylorSeries

X, T, A = Symbol(Leaf("state", 0)), Symbol(Leaf("time", 0)), Symbol(Leaf("parameter", 0))
x0, t0, h = sympy.symbols("x0 t0 h")
x, t, a = x0 * sympy.exp(h), t0 + h, sympy.Rational(7, 10)  # what the symbols do: x' = x
ORDERS = 4
SYSTEM = Apply("solve", (X + 2, X * X, T + 1, Number(3.0), X, call("sin", T)))
DETERMINANT = 3 * (x + 2) - x**2 * (t + 1)
SOLVED = (3 * x - x**2 * sympy.sin(t)) / DETERMINANT, ((x + 2) * sympy.sin(t) - (t + 1) * x) / DETERMINANT

EXPRESSIONS: dict[str, tuple[Expression, Any]] = {
    "polynomial": (X * X * X + (X**2) * A + power(X, Number(-2)) + 3 / X, x**3 + x**2 * a + x**-2 + 3 / x),
    "quotient": (
        call("sin", X) * call("cos", X * T) / (1 + X * X),
        sympy.sin(x) * sympy.cos(x * t) / (1 + x**2),
    ),
    "growth": (
        call("exp", X * A) * call("sqrt", X + 2) + call("tanh", X) + call("log", X + 3),
        sympy.exp(x * a) * sympy.sqrt(x + 2) + sympy.tanh(x) + sympy.log(x + 3),
    ),
    "powers": (
        power(X + 2, Number(1.7)) + call("power", X, T) + call("root", X, Number(3.0)),
        (x + 2) ** sympy.Rational(17, 10) + x**t + x ** sympy.Rational(1, 3),
    ),
    "angles": (
        call("atan2", X, T + 1) + call("asin", X / 4) + call("tan", X / 3) + call("atan", X),
        sympy.atan(x / (t + 1)) + sympy.asin(x / 4) + sympy.tan(x / 3) + sympy.atan(x),
    ),
    "choice": (select(call("less", X, Number(0.0)), X, call("abs", X) * X) + call("max", X, T), x**2 + t),
    "system": (
        Apply("item", (SYSTEM, Number(0.0))) * X + Apply("item", (SYSTEM, Number(1.0))),
        SOLVED[0] * x + SOLVED[1],
    ),
}
STARTS, INSTANTS = np.linspace(0.2, 0.8, 4), np.linspace(0.9, 1.4, 4)


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_coefficients_and_their_slopes(name: str) -> None:
    ours, reference = EXPRESSIONS[name]
    moving = np.stack([STARTS, np.ones_like(STARTS)])
    expansion = TaylorSeries([ours]).expand({X.key: moving, T.key: INSTANTS[None], A.key: np.array([[0.7]])})
    for k in range(ORDERS):
        if k:
            expansion.advance({X.key: moving / math.factorial(k), T.key: np.ones((1, 1)) if k == 1 else None})
        wanted = sympy.diff(reference, h, k).subs(h, 0) / math.factorial(k)
        for row, formula in enumerate((wanted, sympy.diff(wanted, x0))):
            values = np.broadcast_to(sympy.lambdify((x0, t0), formula)(STARTS, INSTANTS), STARTS.shape)
            assert expansion[0][row] == pytest.approx(values, rel=2e-13, abs=1e-13)


def test_an_order_is_forgotten() -> None:
    """As where the unknowns of a loop are found after what they are missed by."""
    series = TaylorSeries([call("sin", X)])
    expansion = series.expand({X.key: np.array([[0.3], [1.0]])})
    expansion.advance({X.key: np.array([[5.0]])})
    expansion.back()
    expansion.advance({X.key: np.array([[2.0]])})
    assert expansion[0][0] == pytest.approx(2 * math.cos(0.3)) and expansion[0][1] == pytest.approx(-2 * math.sin(0.3))
