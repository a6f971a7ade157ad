"""Jumps and kinks: what items of the mode stand for gives the expression again, and its instants are known."""

from __future__ import annotations

import random
from typing import Any, cast

import pytest

from compiler.algebra.derivative import derivative
from compiler.algebra.expression import Expression, Number, Symbol, add, call, evaluate, multiply, power, symbols
from compiler.algebra.table import table
from compiler.codegen.limits import Leaf
from compiler.codegen.lowered import Lowered
from compiler.codegen.switching import Switching
from compiler.equations.system import Assignment
from compiler.errors import CompilationFailed
from compiler.source import Source, Span
from tests.compiling import Running, compiled

T, X, Y = Symbol(Leaf("time", 0)), Symbol(Leaf("state", 0)), Symbol(Leaf("state", 1))
A, L, U = Symbol(Leaf("parameter", 0)), Symbol(Leaf("parameter", 1)), Symbol(Leaf("input", 0))
FIRST = 3  # place of the first item in the mode
SPAN = Span(Source("t.bg", "law"), 0, 3)


def switching(behind: bool = True) -> Switching:
    found = Switching(Lowered(cast(Any, None)), FIRST)
    found.at(cast(Any, Assignment(0, cast(Any, None), (), SPAN, "owner")), behind, False)
    return found


def numbers(*values: float) -> list[Expression]:
    return [Number(v) for v in values]


KNOTS, VALUES = (1.0, 2.0, 3.5, 4.0), (0.5, -1.0, 2.0, 2.5)
CURVES = {kind: table(kind, T, numbers(*KNOTS), numbers(*VALUES)) for kind in ("linear", "cubic", "monotone")}


def repeated(x: Expression, order: int) -> Expression:
    for _ in range(order):
        x = derivative(x, T)
    return x


@pytest.mark.parametrize(
    ("kind", "order"), [("linear", 1), ("cubic", 2), ("cubic", 3), ("monotone", 2), ("monotone", 3)]
)
def test_a_derivative_that_jumps_at_knots_is_affine_between_them(kind: str, order: int) -> None:
    """Items of the mode from the middle of a segment hold in all of it; a second derivative of a cubic does not jump."""
    found = switching()
    x = repeated(CURVES[kind], order)
    y = found.replaced(x)
    for low, high in zip((0.0, *KNOTS), (*KNOTS, 6.0), strict=True):
        mode = {i: evaluate(found.opened[i], lambda _, t=(low + high) / 2: t) for i in found.opened}

        def at(t: float, mode: dict[int, float] = mode) -> Any:
            return lambda leaf: mode[leaf.position] if leaf.role == "mode" else t

        for t in (low + 0.01, low + 0.3 * (high - low), high - 0.01):
            assert evaluate(y, at(t)) == pytest.approx(evaluate(x, lambda _, t=t: t), rel=1e-12, abs=1e-12)
    assert sorted(evaluate(i, lambda _: 0.0) for i in found.result.instants) == list(KNOTS)
    jumps = (kind, order) != ("cubic", 2)
    assert len(found.opened) == (0 if not jumps else 2 if (kind, order) == ("monotone", 2) else 1)
    assert [*found.opened] == [*range(FIRST, FIRST + len(found.opened))] == found.result.events.timed
    assert found.result.switches == [*found.opened.values()] and found.next == FIRST + len(found.opened)
    if jumps:
        assert {s.key.role for s in symbols(y)} == ({"mode", "time"} if len(found.opened) == 2 else {"mode"})
    assert found.replaced(x) == y
    assert found.replaced(multiply(Number(2.0), x)) == multiply(Number(2.0), y)
    assert found.next == FIRST + len(found.opened)


@pytest.mark.parametrize(("operator", "lands"), [("less", False), ("less_equal", True)])
@pytest.mark.parametrize("scale", [2.0, -2.0, A], ids=["positive", "negative", "parameter"])
def test_a_window_is_two_conditions_that_cross_zero_straight(operator: str, lands: bool, scale: Any) -> None:
    """`a*x^2 < l`: an indicator that is zero counts as true for `less_equal` alone."""
    found = switching()
    condition = call(
        operator, multiply(scale if isinstance(scale, Expression) else Number(scale), power(X, Number(2.0))), L
    )
    y = found.replaced(condition)
    located = found.result.events.located
    assert len(located) == 2 and [i.note.position for i in located] == [FIRST, FIRST + 1]
    assert [i.note.strict for i in located] == [not lands] * 2
    rng = random.Random(1)
    truths = set()
    for number in range(200):
        a = scale if isinstance(scale, float) else rng.choice([-1.0, 0.0, 1.0]) * rng.uniform(0.5, 2)
        leaves: dict[Any, float] = {
            X.key: rng.uniform(-2, 2), A.key: a, L.key: rng.choice([-1, 1]) * rng.uniform(0.1, 4)
        }  # fmt: skip
        if number % 4 == 0:  # at the edge, whose numbers are exact
            leaves |= {X.key: 1.5, A.key: a if a == 0 else 2.0, L.key: 4.5 if a > 0 else -4.5}
            leaves[A.key] = -2.0 if a < 0 else leaves[A.key]
        known = dict(leaves)
        for item in located:
            root = evaluate(item.root, leaves.__getitem__)
            known[item.symbol.key] = float(root < 0 or (root == 0 and not item.note.strict))
        assert evaluate(y, known.__getitem__) == evaluate(condition, leaves.__getitem__), leaves
        truths.add(evaluate(y, known.__getitem__))
    assert truths == {0.0, 1.0}


def test_an_output_evaluates_its_conditions_and_a_rate_has_them_as_items() -> None:
    condition = call("less", X, L)
    assert switching(behind=False).replaced(condition) == condition
    found = switching()
    assert found.replaced(condition) == Symbol(Leaf("mode", FIRST)) and found.next == FIRST + 1
    assert found.replaced(call("less", T, L)) == Symbol(Leaf("mode", FIRST + 1))
    assert found.result.events.timed == [FIRST + 1]
    assert [evaluate(i, lambda _: 7.0) for i in found.result.instants] == [7.0]


def test_a_count_of_time_is_an_item_with_its_instants() -> None:
    found, turns = switching(), multiply(Number(0.5), T) + 0.25
    assert found.replaced(call("floor", turns)) == Symbol(Leaf("mode", FIRST))
    assert found.replaced(call("ceil", turns)) == Symbol(Leaf("mode", FIRST + 1))
    assert found.result.recurring == [(Number(0.25), Number(0.5))] and not found.result.crossings
    found.replaced(call("floor", multiply(T, T)))
    assert found.result.crossing_places[0][2] == "floor" and len(found.result.recurring) == 1


def test_a_count_of_states_is_an_item_that_two_conditions_tell() -> None:
    found = switching()
    count = found.replaced(call("floor", X))
    (item,) = found.result.events.counts
    assert count == item.symbol == Symbol(Leaf("mode", FIRST + 2)) and found.next == FIRST + 3
    assert found.replaced(call("floor", 0.5 * call("floor", X))) == call(
        "floor", 0.5 * count
    )  # changes with the count alone
    assert (
        found.replaced(call("less", call("floor", X), Number(2.0))) == call("less", count, Number(2.0))
        and len(found.result.events.located) == 2
    )
    for x, sides, expected in (
        (3.0, (1, 1), 3),
        (3 - 1e-9, (0, 1), 3),
        (3 + 1e-9, (1, 0), 2),
        (-1.0, (1, 1), -1),
        (-0.3, (0, 1), -1),
        (0.4, (1, 0), 0),
    ):
        values = {X.key: x, Leaf("mode", FIRST): sides[0], Leaf("mode", FIRST + 1): sides[1]}
        assert evaluate(item.value, values.__getitem__) == expected


def test_a_count_of_states_in_an_output_or_of_parameters_is_none() -> None:
    text = "plain model M { parameter a = 2.5; signal p = integral(floor(a), 0.5); output y = ceil(p), z = p }"
    running = Running(compiled(text))
    assert running.rates() == {"p": 2.0} and running.outputs({"p": 1.25}) == {"y": 2.0, "z": 1.25}


@pytest.mark.parametrize(
    ("place", "period"),
    [(T, 1.0), (multiply(A, T), 0.25), (add(multiply(Number(-2.0), T), X), 0.5), (add(T, U), 1.0), (X, None)],
    ids=str,
)
def test_a_step_is_no_longer_than_a_number_of_a_noise(place: Expression, period: float | None) -> None:
    found = switching()
    noise = call("noise", Number(0.0), place, Number(1.0))
    found.replaced(noise)
    found.replaced(multiply(noise, Y))
    assert [evaluate(p, lambda _: 4.0) for p in found.result.periods] == ([] if period is None else [period])


def test_a_noise_whose_rate_changes_with_time_is_refused_unless_states_change_it() -> None:
    with pytest.raises(CompilationFailed) as failed:
        switching().replaced(call("noise", Number(0.0), multiply(T, T), Number(1.0)))
    assert [d.code for d in failed.value.diagnostics] == ["BG602"]
    found = switching()
    found.replaced(call("noise", Number(0.0), multiply(T, X), Number(1.0)))
    assert found.result.periods == []


@pytest.mark.parametrize(
    ("x", "instants", "crossings"),
    [
        (call("abs", add(T, Number(-2.0))), [2.0], 0),
        (call("min", multiply(Number(3.0), T), Number(6.0)), [2.0], 0),
        (call("max", multiply(T, T), T), [0.0], 1),
        (call("min", call("max", T, Number(1.0)), Number(3.0)), [1.0, 3.0], 0),
        (call("max", Number(0.0), call("min", Number(2.0), multiply(Number(0.5), T))), [4.0, 0.0], 0),
        (call("abs", add(call("max", multiply(Number(2.0), T), T), Number(-4.0))), [0.0, 2.0, 4.0], 0),
        (call("min", call("max", multiply(T, T), Number(4.0)), Number(9.0)), [0.0], 2),
        (call("abs", X), [], 0),
        (call("exp", multiply(Number(-1.0), add(T, Number(-2.0)), add(T, Number(-2.0)))), [2.0], 0),
        (call("exp", multiply(Number(-1.0), T, L)), [0.0], 0),
        (power(add(T, Number(-3.0)), Number(4.0)), [3.0], 0),
    ],
    ids=str,
)
def test_kinks_and_centres_of_pulses_are_instants(x: Expression, instants: list[float], crossings: int) -> None:
    found = switching()
    assert found.replaced(x) == x
    assert [evaluate(i, lambda _: 0.0) for i in found.result.instants] == instants
    assert len(found.result.crossings) == crossings
    assert found.result.bends == ([X] if x == call("abs", X) else [])


def test_a_function_of_many_pieces_is_searched() -> None:
    """A sum of thirty clips has 2^30 pieces, and thirty levels that read the level below twice as many: neither is written out."""
    wide = add(*(call("max", T, Number(float(i))) for i in range(30)))
    deep: Expression = T
    for i in range(30):
        deep = call("min", add(deep, T), multiply(Number(2.0 + i), deep))
    for x, instants in ((wide, 30), (deep, 4)):
        found = switching()
        found.replaced(call("abs", add(x, Number(-0.5))))
        assert len(found.result.crossings) > 0
        assert len(found.result.instants) == instants
