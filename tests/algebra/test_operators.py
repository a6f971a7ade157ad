"""Names of operators in other languages, and operators that have a value for all numbers."""

from __future__ import annotations

from compiler.algebra.expression import Number
from compiler.algebra.operators import OPERATORS, value_of


def test_names_that_differ_from_the_language() -> None:
    differ = {name: row.in_c for name, row in OPERATORS.items() if row.in_c != name}
    assert differ == {
        "power": "pow", "abs": "fabs", "min": "least", "max": "greatest", "select": "chosen",
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
