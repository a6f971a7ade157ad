"""Functions of time over instants and boxes, against their expressions evaluated at single instants."""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np
import pytest

from compiler.algebra.expression import Apply, Expression, Number, Symbol, add, call, divide, evaluate, multiply, power
from compiler.codegen.events import Located
from compiler.codegen.limits import Leaf
from compiler.codegen.lowered import Lowered
from compiler.codegen.program import NarrowCondition
from compiler.codegen.ranges import Ranges
from compiler.codegen.time_functions import is_narrow, narrow_conditions, time_functions_of, time_roots

T, X, Y = Symbol(Leaf("time", 0)), Symbol(Leaf("state", 0)), Symbol(Leaf("state", 1))
A, M, U = Symbol(Leaf("parameter", 0)), Symbol(Leaf("mode", 1)), Symbol(Leaf("input", 0))
CONSTANT = 1.75


def numbers(*values: float) -> list[Expression]:
    return [Number(v) for v in values]


def curve(kind: str, x: Expression, first: Expression) -> Expression:
    """A curve whose first value is given: of a parameter it is known when a run begins."""
    values = [first, *numbers(0.5, 2.0, -1.0)]
    slopes = [] if kind == "linear" else numbers(1.0, -0.5, 0.25, 2.0)
    return Apply(kind, (Number(0.0), x, *numbers(-1.0, 0.5, 2.0, 3.0), *values, *slopes))


def ranges(*roots: Expression) -> Ranges:
    lowered = Lowered(cast(Any, None))
    lowered.time_roots = tuple(x for root in roots for x in (root, root))
    lowered.crossings = list(roots)
    lowered.crossing_places = [cast(Any, ("owner", None, ""))] * len(roots)
    found = time_functions_of(lowered, [A])
    assert found is not None
    return Ranges(found, [c.place for c in found.crossings], [CONSTANT])


FUNCTIONS = {
    "time": T,
    "sum": add(T, X, Number(2.0)),
    "of the mode": multiply(M, T, T),
    "with a constant": multiply(A, call("sin", add(T, A))),
    "quotient": divide(T, add(Number(3.0), call("abs", Y))),
    "states": multiply(X, Y),
    "linear": curve("linear", T, Number(-0.5)),
    "cubic": curve("cubic", multiply(Number(0.5), T), Number(0.25)),
    "monotone": curve("monotone", T, A),
    "of a curve": call("exp", curve("linear", X, A)),
    "constant": multiply(A, A),
    "a curve of a constant": curve("cubic", A, Number(0.25)),
}


def value(x: Expression, time: float, mode: float, states: Any) -> float:
    given = {
        "time": lambda _: time,
        "state": lambda i: states[i],
        "mode": lambda _: mode,
        "parameter": lambda _: CONSTANT,
    }
    return evaluate(x, lambda leaf: float(given[leaf.role](leaf.position)))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_values_at_instants(name: str) -> None:
    x, rng = FUNCTIONS[name], np.random.default_rng(1)
    found = ranges(x, add(x, T))
    times, modes, states = rng.uniform(-1, 3, 20), rng.normal(size=(20, 2)), rng.uniform(-1, 3, (20, 2))
    for given, mode_of in ((modes, lambda i: modes[i, 1]), (modes[0], lambda i: modes[0, 1])):
        one, other = found.values(times, given, states)
        expected = [value(x, times[i], mode_of(i), states[i]) for i in range(20)]
        assert np.broadcast_to(one, 20) == pytest.approx(expected, rel=1e-13, abs=1e-14)
        assert np.broadcast_to(other, 20) == pytest.approx(np.array(expected) + times, rel=1e-13, abs=1e-14)


def within(low: float, high: float, count: int) -> list[float]:
    """Points of an interval with the places of the curves in it."""
    return [*np.linspace(low, high, count), *(k for k in (0.5, 1.0, 2.0, 3.0) if low < k < high)]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_ranges_over_boxes_hold_all_values_and_are_reached(name: str) -> None:
    """Each function rises or falls with each argument or reads it once, so that its range is that of its values."""
    x, rng = FUNCTIONS[name], np.random.default_rng(2)
    found = ranges(x)
    low, modes = rng.uniform(0, 1.2, 8), rng.normal(size=(8, 2))
    high, base = low + rng.uniform(0.1, 1.5, 8), rng.uniform(0.1, 2, (8, 2))
    states = {i: (base[:, i], base[:, i] + 0.4) for i in range(2)}
    ((least, most),) = found.over(low, high, modes, states)
    least, most = np.broadcast_to(least, 8), np.broadcast_to(most, 8)
    for i in range(8):
        inside = [
            value(x, t, modes[i, 1], (a, b))
            for t in within(low[i], high[i], 41)
            for a in within(base[i, 0], base[i, 0] + 0.4, 3)
            for b in within(base[i, 1], base[i, 1] + 0.4, 3)
        ]
        size = max(1e-12, max(inside) - min(inside))
        assert least[i] <= min(inside) and max(inside) <= most[i]
        assert least[i] >= min(inside) - 0.01 * size and most[i] <= max(inside) + 0.01 * size


def test_what_is_fixed_is_computed_once_and_curves_with_fixed_points_are_known() -> None:
    found = ranges(multiply(A, A), curve("linear", T, A), multiply(M, X))
    assert sorted(found.fixed.values()).count(CONSTANT**2) == 1
    assert len(found.curves) == 1 and found.states == [0] and found.moded and not found.unbounded
    assert not ranges(T).moded and ranges(T).states == [] and ranges(T).curves == {}
    assert found.over(0.0, 1.0, np.array([0.0, 2.0]), {0: (1.0, 1.5)})[0] == (CONSTANT**2, CONSTANT**2)


def test_an_operation_over_a_point_is_its_value() -> None:
    """A box of no width has one value, without the rounding that a range is widened by."""
    ((low, high),) = ranges(call("sin", T)).over(0.5, 0.5, np.zeros(2))
    assert low == high == math.sin(0.5)


# ---------------------------------------------------------------- narrow conditions
def located(*roots: Expression) -> Lowered:
    lowered = Lowered(cast(Any, None))
    lowered.events.located = [Located(Symbol(Leaf("mode", i)), root, cast(Any, None)) for i, root in enumerate(roots)]
    return lowered


NARROW = call("exp", multiply(Number(-50.0), X))
SYSTEM = Apply("item", (Apply("solve", (X, Number(2.0))), Number(0.0)))


@pytest.mark.parametrize(
    ("root", "narrow", "ranged"),
    [
        (add(NARROW, Number(-0.5)), (NARROW,), True),
        (add(call("tanh", Y), T), (call("tanh", Y),), True),
        (add(X, Number(1.0)), None, True),
        (call("exp", A), None, True),
        (call("sqrt", X), None, True),
        (divide(X, A), None, True),
        (divide(X, add(A, Number(1.0))), None, True),
        (divide(Number(1.0), Y), (divide(Number(1.0), Y),), True),
        (divide(X, U), None, True),
        (power(X, Number(3.0)), None, True),
        (power(X, Number(5.0)), (power(X, Number(5.0)),), True),
        (add(NARROW, SYSTEM), (NARROW,), False),
        (add(NARROW, U), (NARROW,), True),
    ],
    ids=str,
)
def test_conditions_that_may_have_narrow_peaks(
    root: Expression, narrow: tuple[Expression, ...] | None, ranged: bool
) -> None:
    found = narrow_conditions(located(X, root))
    assert found == (() if narrow is None else ((1, root, narrow if ranged else ()),))


def test_a_delayed_signal_has_no_range() -> None:
    lowered = located(add(NARROW, U))
    assert lowered.delayed_symbol(0) == U
    assert narrow_conditions(lowered) == ((0, add(NARROW, U), ()),)


@pytest.mark.parametrize(
    ("x", "expected"),
    [
        (power(X, Number(2.0)), False),
        (power(X, Number(4.0)), False),
        (power(X, Number(5.0)), True),
        (power(X, Y), True),
        (divide(X, multiply(A, A)), False),
        (divide(A, X), True),
        (call("exp", X), True),
        (multiply(X, Y), False),
    ],
    ids=str,
)
def test_narrow_operations(x: Apply, expected: bool) -> None:
    assert is_narrow(x) is expected


def test_places_of_narrow_conditions() -> None:
    found = time_functions_of(located(X, add(NARROW, Number(-0.5)), add(NARROW, SYSTEM)), [])
    assert found is not None
    first, second = found.conditions
    assert (first.number, second) == (1, NarrowCondition(2, -1, ()))
    (place,) = first.narrow
    evaluated = Ranges(found, [first.place, place], [])
    root, narrow = evaluated.values(0.0, np.zeros(0), np.array([0.01, 0.0]))
    assert (root, narrow) == (math.exp(-0.5) - 0.5, math.exp(-0.5))
    assert time_functions_of(located(), []) is None
    straight = time_functions_of(located(X), [])
    assert straight is not None and (straight.conditions, straight.indicators) == ((), (0,))


def test_a_crossing_knows_its_slope_and_what_it_reads() -> None:
    lowered = Lowered(cast(Any, None))
    lowered.crossings = [call("sin", T), multiply(M, call("cos", T)), call("floor", T)]
    lowered.crossing_places = [cast(Any, (str(i), None, "less")) for i in range(3)]
    lowered.time_roots = time_roots(lowered.crossings)
    found = time_functions_of(lowered, [])
    assert found is not None
    at = Ranges(found, [p for c in found.crossings[:2] for p in (c.place, c.slope)], [])
    assert at.values(0.5, np.array([0.0, 3.0])) == pytest.approx(
        [math.sin(0.5), math.cos(0.5), 3 * math.cos(0.5), -3 * math.sin(0.5)], rel=1e-15
    )
    assert [c.moded for c in found.crossings] == [False, True, False]
    assert [c.owner for c in found.crossings] == ["0", "1", "2"] and found.narrow == () == found.narrow_names
