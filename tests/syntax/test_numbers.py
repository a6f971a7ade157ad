"""Numbers and the units that may follow them."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from compiler.errors import CompilationFailed
from compiler.source import Source
from compiler.syntax import parse_expression, tree


def expression(text: str) -> tree.ExpressionSyntax:
    return parse_expression(Source("t.bg", text))


def literal(text: str) -> tree.Literal:
    found = expression(text)
    assert isinstance(found, tree.Literal)
    return found


def unit(text: str) -> tuple[dict[str, Fraction], Fraction]:
    found = literal(text).unit
    assert found is not None
    powers: dict[str, Fraction] = {}
    for name, power, _ in found.factors:
        powers[name] = powers.get(name, Fraction(0)) + power
    return powers, found.number


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0", Fraction(0)), ("7", Fraction(7)), ("007", Fraction(7)), ("1.95", Fraction(195, 100)), ("2.5e-5", Fraction(25, 10**6)),
        ("1e3", Fraction(1000)), ("1E+3", Fraction(1000)), ("0.1", Fraction(1, 10)), ("8.8541878128e-12", Fraction(88541878128, 10**22)),
        ("1e299", Fraction(10**299)), ("1e-299", Fraction(1, 10**299)), ("0e999999999", Fraction(0)),
        ("1e+00003", Fraction(1000)), ("1e-00003", Fraction(1, 1000)),
    ],
)  # fmt: skip
def test_numbers_are_exact(text: str, value: Fraction) -> None:
    assert literal(text).number == value


@given(st.integers(0, 10**18), st.integers(0, 10**12), st.integers(-200, 200))
def test_numbers_are_what_python_reads(whole: int, part: int, exponent: int) -> None:
    text = f"{whole}.{part}e{exponent}"
    assert float(literal(text).number) == float(text)


@pytest.mark.parametrize(
    ("text", "powers", "number"),
    [
        ("3 um", {"um": 1}, 1),
        ("3um", {"um": 1}, 1),
        ("3 [N/m]", {"N": 1, "m": -1}, 1),
        ("3[N/m]", {"N": 1, "m": -1}, 1),
        ("3 [N*s/m]", {"N": 1, "s": 1, "m": -1}, 1),
        ("3 [m/s/s]", {"m": 1, "s": -2}, 1),
        ("3 [m/s*s]", {"m": 1, "s": 0}, 1),
        ("3 [J/(kg*K)]", {"J": 1, "kg": -1, "K": -1}, 1),
        ("3 [(m/s)^2]", {"m": 2, "s": -2}, 1),
        ("3 [V/m^(1/2)]", {"V": 1, "m": Fraction(-1, 2)}, 1),
        ("3 [m^-2]", {"m": -2}, 1),
        ("3 [m^(-1/2)]", {"m": Fraction(-1, 2)}, 1),
        ("3 [1/s]", {"s": -1}, 1),
        ("3 [100*km]", {"km": 1}, 100),
        ("3 [m/60]", {"m": 1}, Fraction(1, 60)),
    ],
)
def test_units(text: str, powers: dict[str, Fraction], number: Fraction) -> None:
    assert unit(text) == (powers, number)
    found = literal(text).unit
    assert found is not None and found.span.text == text.removeprefix("3").strip(" []"), (
        "reports show it as it is written"
    )


def test_nothing_but_a_number_takes_a_unit() -> None:
    """`2*3 N` is a product of 2 and three newtons; `x` takes none."""
    product = expression("2*3 N")
    assert isinstance(product, tree.Product)
    first, second = (f for _, f in product.factors)
    assert isinstance(first, tree.Literal) and first.unit is None
    assert isinstance(second, tree.Literal) and second.unit is not None
    with pytest.raises(CompilationFailed):
        expression("x N")


def test_a_unit_belongs_to_the_number_before_a_power() -> None:
    """`3 um^2` squares three micrometres."""
    found = expression("3 um^2")
    assert isinstance(found, tree.Power) and isinstance(found.base, tree.Literal) and found.base.unit is not None


def test_brackets_after_a_name_are_an_index() -> None:
    found = expression("gap[2]")
    assert isinstance(found, tree.PathSyntax) and isinstance(found.steps[0], tree.Index)


@pytest.mark.parametrize(
    "text", [".5", "5.", "1_000", "1e", "0x10", "1.2.3", "1,5", "²", "3 [N/]", "3 [*N]", "3 [N^]", "3 [N N]", "3 []"]
)
def test_what_is_no_number(text: str) -> None:
    """`1_000` parses as a number with the unit `_000`, which is refused where units are looked up."""
    if text in ("1_000", "1e", "0x10"):
        assert isinstance(expression(text), tree.Literal) and literal(text).unit is not None
        return
    with pytest.raises(CompilationFailed) as failed:
        expression(text)
    assert [d.code for d in failed.value.diagnostics][0] in ("BG001", "BG002")


@pytest.mark.parametrize(
    "text", ["1e301", "1e-305", "1e999999999", "9" * 401, "1" + "0" * 350, "0." + "0" * 350 + "1", "1e0000001"]
)
def test_numbers_out_of_range(text: str) -> None:
    with pytest.raises(CompilationFailed) as failed:
        expression(text)
    assert [d.code for d in failed.value.diagnostics] == ["BG003"]


@pytest.mark.parametrize("text", ["3 [m^21]", "3 [m^(1/21)]", "3 [m^(1/0)]", "3 [m/0]", "3 [m^999999999]", "3 [2^20]"])
def test_units_out_of_range(text: str) -> None:
    with pytest.raises(CompilationFailed):
        expression(text)
