"""Names of operators in other languages, and operators that have a value for all numbers."""

from __future__ import annotations

import pytest

from compiler.algebra.expression import Number, Symbol, apply, evaluate, lift
from compiler.algebra.operators import OPERATORS, Operator, value_of

OF_ONE = [row for row in OPERATORS.values() if row.arity == 1 and row.kind == "function"]


def test_names_that_differ_from_the_language() -> None:
    differ = {name: row.in_c for name, row in OPERATORS.items() if row.in_c != name}
    assert differ == {
        "power": "pow", "abs": "fabs", "min": "lesser", "max": "greatest", "select": "chosen",
        "less": "<", "less_equal": "<=", "equal": "==", "and": "&&", "or": "||", "not": "!",
    }  # fmt: skip
    assert OPERATORS["asin"].in_numpy == "np.arcsin" and OPERATORS["sin"].in_numpy == "np.sin"
    assert OPERATORS["abs"].in_sympy == "Abs" and OPERATORS["sin"].in_sympy == "sin"


def test_operators_of_one_number_without_a_value_somewhere() -> None:
    """Tried at many numbers: a row that says that it is total has a value at each of them."""
    for name, row in OPERATORS.items():
        if row.arity != 1 or row.kind == "condition":
            continue
        missing = False
        for k in range(-40, 41):
            try:
                value_of(name, (k / 8,))
            except (ArithmeticError, ValueError):
                missing = True
        assert row.is_total == (not missing and name != "tan"), name
    assert not OPERATORS["root"].is_total and OPERATORS["atan2"].is_total
    assert Number(value_of("sign", (-2.0,))) == Number(-1.0)


def value_or_none(row: Operator, x: float) -> float | None:
    try:
        return float(row.value(x))
    except (ArithmeticError, ValueError):
        return None


@pytest.mark.parametrize("row", OF_ONE, ids=lambda row: row.name)
def test_kinks_and_signs(row: Operator) -> None:
    """The slopes on both sides of a place differ at a kink or jump; values below zero are found if there are any."""
    h, kink = 1e-6, False
    for place in (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0):
        left, here, right = (value_or_none(row, place + d) for d in (-h, 0.0, h))
        if left is not None and here is not None and right is not None:
            kink |= abs((right - here) - (here - left)) > 1e-3 * h or abs(right - left) > 0.1
    assert row.smooth == (not kink)
    values = [v for k in range(-80, 81) if (v := value_or_none(row, k / 16)) is not None]
    assert not row.never_negative or min(values) >= 0
    if row.is_total and row.name != "tan":
        assert row.never_negative == (min(values) >= 0)


def test_functions_of_several_numbers_are_smooth_if_they_are_arithmetic() -> None:
    smooth = {name for name, row in OPERATORS.items() if row.smooth and row.arity != 1}
    assert smooth == {"add", "multiply", "divide", "power"}


def test_how_narrow_a_function_of_time_can_be() -> None:
    """Bells, steps and roots are narrow around a zero; what moves everywhere as it ever does, or at instants, is broad."""
    narrow = {name for name, row in OPERATORS.items() if row.narrow}
    broad = {name for name, row in OPERATORS.items() if row.broad}
    assert narrow - {"multiply"} == {"power", "sqrt", "atan", "exp", "cosh", "tanh", "asinh", "erf"}
    assert broad - {"multiply"} == {"add", "sin", "cos", "abs", "sign", "floor", "ceil", "min", "max", "select", "linear", "cubic", "monotone", "inverse", "noise", "natural_slope", "monotone_slope", "less", "less_equal", "equal", "and", "or", "not"}  # fmt: skip
    assert OPERATORS["multiply"].narrow and OPERATORS["multiply"].broad, "of one factor that moves, or of several"


@pytest.mark.parametrize(("x", "n", "root"), [(8, 3, 2), (-8, 3, -2), (8, -3, 0.5), (-8, -3, -0.5), (-2, 1, -2), (4, 2.5, 4**0.4), (3, 0.5, 9), (0, 3, 0), (0, 1.5, 0)])  # fmt: skip
def test_the_real_root(x: float, n: float, root: float) -> None:
    assert value_of("root", (float(x), float(n))) == pytest.approx(root, rel=1e-15)


@pytest.mark.parametrize(("x", "n"), [(4, 2), (-4, 2), (4, 0), (4, -2), (-4, 2.5), (0, -3)])
def test_no_real_root_or_two(x: float, n: float) -> None:
    with pytest.raises((ValueError, ZeroDivisionError)):
        value_of("root", (float(x), float(n)))


@pytest.mark.parametrize("row", [row for row in OF_ONE if row.inverse], ids=lambda row: row.name)
def test_an_inverse_gives_the_operand_back(row: Operator) -> None:
    assert row.inverse is not None
    back, tried = lift(row.inverse(apply, Symbol("y"))), 0
    for x in (-2.0, -0.75, -0.25, 0.0, 0.3, 0.9, 2.5):
        y = value_or_none(row, x)
        if y is not None:
            assert evaluate(back, {"y": y}.__getitem__) == pytest.approx(x, rel=1e-13, abs=1e-13)
            tried += 1
    assert tried >= 3
