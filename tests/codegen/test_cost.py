"""Operations counted by how often they are done: they fall with fewer requests, and those of the manipulator must not rise."""

from __future__ import annotations

from collections import Counter

import pytest

import compiler.algebra.derivative as derivatives
from compiler.algebra.expression import (
    Apply,
    Expression,
    Number,
    Symbol,
    add,
    call,
    multiply,
    negate,
    operations,
    symbols,
)
from compiler.codegen import lower
from compiler.codegen.cost import _operations, cost
from compiler.codegen.limits import Leaf
from compiler.codegen.peaks import peaks
from tests.benchmarks import large_models
from tests.compiling import MODELS, compiled

HANDFUL = """
model A {
  parameter m = 2 kg, k = 8 [N/m], r = 1 [N*s/m]
  input push = 0 N
  for i in 1..2 {
    1 body[i]
    MSe drive[i] : F = push*sin(3 [1/s]*time)
    I mass[i]   : p = m*v
    C spring[i] : F = k*x
    R damper[i] : F = r*v^3/1 [m^2/s^2]
    drive[i] -> body[i] -> mass[i], spring[i], damper[i]
  }
  output x1 = spring[1].x, x2 = spring[2].x, power = damper[1].F*damper[1].v
}
"""


def test_each_operation_counts_once_where_it_is_first_needed() -> None:
    """Operations on time alone or on parameters alone do not count for an evaluation."""
    found = cost(compiled(HANDFUL, {"push": "1 N*exp(-time/1 s)"}, outputs=("x1",)).lowered)
    assert found.with_time == 4  # exp, 3*time, sin, product: what time alone moves; a sign is no operation
    assert dict(found.functions) == {}  # of states: neither exp nor sin is
    assert found.entries == 3  # of x' = v(p), p' = F(p, x)
    more = cost(compiled(HANDFUL, {"push": "1 N*exp(-time/1 s)"}, outputs=("x1", "power")).lowered)
    assert (more.rates, more.outputs) == (found.rates, 1)  # F v; F is there, with a sign in the rate


def test_less_is_computed_where_less_is_asked() -> None:
    one, two, all_of_it = (
        cost(compiled(HANDFUL, {"push": 1.0}, outputs=names).lowered) for names in (("x1",), ("x1", "x2"), None)
    )
    assert 2 * one.rates == two.rates  # two oscillators that know nothing of each other
    assert one.rates < two.rates <= all_of_it.rates + all_of_it.outputs
    assert one.with_time == two.with_time  # one push for both
    assert cost(compiled(HANDFUL, outputs=("x1",)).lowered).with_time == 0  # no push


def test_the_lines_add_up() -> None:
    found = cost(compiled(HANDFUL, {"push": 1.0}).lowered)
    assert sum(line.operations for line in found.lines) == found.rates
    assert list(found.lines) == sorted(found.lines, key=lambda line: -line.operations)


@pytest.mark.parametrize(
    "settings, most", [({}, (204, 481)), ({"fx": 1e-5, "push1": 3.0, "r_phi": 1e-12, "r_x": 1e-6, "r_y": 1e-6}, (254, 595))]
)  # fmt: skip
def test_counts_of_the_manipulator(settings: dict[str, float], most: tuple[int, int]) -> None:
    """These numbers may only fall: operations of the rates, and those that the Jacobian adds."""
    found = cost(compiled(MODELS / "manipulator.bg", settings, experiment="push_x" if not settings else None).lowered)
    assert found.rates <= most[0] and found.jacobian <= most[1], (found.rates, found.jacobian)
    assert found.functions[0] == ("sin", 2)  # of half the angle once for all: turns and springs agree on it


def test_a_junction_of_many_is_differentiated_term_by_term(monkeypatch: pytest.MonkeyPatch) -> None:
    """As many differentiations of terms as there are terms, not as their square."""

    def work(degree: int) -> int:
        calls = 0
        original = lower.derivative

        def counted(x: Expression, symbol: Symbol) -> Expression:
            nonlocal calls
            calls += 1 + sum(1 for _ in operations(x))
            return original(x, symbol)

        lower.partial.cache_clear()
        with monkeypatch.context() as patched:
            patched.setattr(lower, "derivative", counted)
            _ = compiled(large_models.network(large_models.star_edges(degree), degree + 1)).lowered
        return calls

    assert work(200) < 4.5 * work(50)


X, Y = Symbol("x"), Symbol("y")


def _of_an_elimination(count: int) -> int:
    """Products and quotients that bring [A | b] to a triangle, then each operation of the substitution."""
    total = 0
    for k in range(count):
        for _ in range(k + 1, count):
            total += 1 + (count - k - 1) + 1  # the factor, the rest of the row, the right side
    for k in range(count):
        total += 2 * (count - k - 1) + 1  # products and differences, the quotient
    return total


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7, 12])
def test_a_dense_system_costs_its_elimination(count: int) -> None:
    assert _operations(Apply("solve", (X,) * (count * count + count))) == _of_an_elimination(count)


@pytest.mark.parametrize(("count", "lower", "upper"), [(5, 1, 1), (9, 1, 2), (20, 2, 1), (7, 3, 0)])
def test_a_banded_system_costs_each_row_below_a_pivot_of_full_width(count: int, lower: int, upper: int) -> None:
    """With its exchanges a row has lower + upper more columns: a quotient, products and differences; then the substitution."""
    width = lower + upper
    rows = sum(1 + width + width for _ in range(count) for _ in range(lower))
    substitution = sum(2 * width + 1 for _ in range(count))
    sizes = (Number(float(n)) for n in (count, lower, upper))
    assert _operations(Apply("banded", (*sizes, *[X] * (count * (width + 1) + count)))) == rows + substitution


@pytest.mark.parametrize(
    ("x", "count"),
    [
        (Apply("item", (X, Number(0.0))), 0),
        (negate(X), 0),
        (negate(multiply(X, Y)), 1),
        (multiply(X, Y, X), 2),
        (add(X, Y), 1),
        (add(X, Y, call("sin", X)), 2),
        (call("sin", X), 1),
        (call("atan2", X, Y), 1),
        (call("min", X, Y), 1),
    ],
    ids=str,
)
def test_operations_of_one_node(x: Apply, count: int) -> None:
    assert _operations(x) == count


def test_quotients_of_a_mechanism_share_the_search_for_peaks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Slopes of a denominator are formed once, however many rates are divided by it, and what two functions share is differentiated once."""
    a, b = (Symbol(Leaf("state", i)) for i in range(2))
    below = 2 + call("sin", a) * call("cos", b)
    walked: list[Expression] = []
    monkeypatch.setattr(
        derivatives, "_chain", lambda node, inner, chain=derivatives._chain: walked.append(node) or chain(node, inner)
    )
    peaks(
        [(k + a) / denominator for k in range(9) for denominator in (below, 1 + below**2)],
        2,
        lambda x: any(s in (a, b) for s in symbols(x)),
    )
    assert walked and max(Counter(walked).values()) <= 2  # by two states
