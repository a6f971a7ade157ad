"""A law over slots and its arguments: equal laws are one formula, and the arguments give the law back."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, fields

import pytest

from compiler.algebra.expression import Number, Symbol, call
from compiler.algebra.formula import Bound, Formula, bind, leaf, over
from compiler.algebra.operators import OPERATORS

X, Y, A = Symbol("x"), Symbol("y"), Symbol("a")


def test_a_law_and_its_arguments() -> None:
    law = A * call("sin", X) + X / Y
    bound = bind(law)
    assert bound.arguments == ("a", "x", "y") and bound.formula.arity == 3
    slots = [Symbol(i) for i in range(3)]
    assert bound.formula.expression == slots[0] * call("sin", slots[1]) + slots[1] / slots[2]
    assert bound.expression == law
    assert bind(Y * call("sin", A) + A / X).formula == bound.formula, "the same law of other quantities"
    assert bind(Number(2.0)) == Bound(Formula(0, Number(2.0)), ())


def test_numbers_and_names_in_place_of_slots() -> None:
    assert leaf(2.0) == Number(2.0) and leaf("x") == X and leaf(3) == Symbol(3)
    law = Symbol(0) * Symbol(1) + 1
    assert over(law, (2.0, "x")) == 2 * X + 1 and over(law, (2.0, 0.5)) == Number(2.0)
    assert over(law, "xy", lambda key: Symbol(key * 2)) == Symbol("xx") * Symbol("yy") + 1


@pytest.mark.parametrize("noun", [Number(2.0), X, Formula(1, Symbol(0)), bind(X), OPERATORS["sin"]], ids=lambda x: type(x).__name__)  # fmt: skip
def test_a_noun_is_not_changed_and_takes_no_other_attribute(noun: object) -> None:
    """They are keys of tables, and there are very many of them."""
    for field in fields(noun):  # type: ignore[arg-type]
        with pytest.raises(FrozenInstanceError):
            setattr(noun, field.name, None)
    assert not hasattr(noun, "__dict__") and {noun: 1}[noun] == 1
