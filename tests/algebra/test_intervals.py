"""Ranges hold every value, are no wider than the rounding of their operations, and say where there is a pole, a jump or no value at all."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise, product
from typing import Any

import mpmath
import numpy as np
import pytest

from compiler.algebra import interpolate
from compiler.algebra.intervals import EVERYTHING, PLAIN, TABLE, Interval, _steepest, is_still, plain
from compiler.algebra.operators import OPERATORS, value_of

INF, NAN, PI, ULP = math.inf, math.nan, math.pi, 2.0**-52
ONE_ROUNDING, LIBRARY_ROUNDING = ULP, 2.0**-50
ALL, NONE = (-INF, INF), (NAN, NAN)


@pytest.fixture(autouse=True)
def _division_by_zero_is_a_value() -> Iterator[None]:
    with np.errstate(all="ignore"):
        yield


def box(low: float, high: float) -> Interval:
    return np.array([low]), np.array([high])


def still(value: float) -> Interval:
    return value, value


def range_of(operator: str, *operands: Interval) -> tuple[float, float]:
    low, high = TABLE[operator](*operands)
    return float(np.reshape(low, -1)[0]), float(np.reshape(high, -1)[0])


def outward(low: float, high: float, part: float) -> tuple[float, float]:
    return low - part * abs(low), high + part * abs(high)


def same(found: tuple[float, float], expected: tuple[float, float]) -> bool:
    return bool(np.array_equal(found, expected, equal_nan=True))


# ---------------------------------------------------------------- every value is inside, and the ends are reached

PLACES = np.linspace(0.0, 1.0, 129)
BOXES = [(-7.0, -3.2), (-2.5, -0.4), (-1.2, 0.9), (0.3, 0.9), (0.25, 4.5), (1.5, 2.75), (3.0, 13.0)]
OF_ONE = sorted(n for n, r in OPERATORS.items() if r.arity == 1 and n in TABLE and n not in ("not", "sign", "floor", "ceil"))  # fmt: skip


def value_or_none(operator: str, *operands: float) -> float:
    try:
        return value_of(operator, operands)
    except (ArithmeticError, ValueError):
        return NAN


@pytest.mark.parametrize("operator", OF_ONE)
def test_a_function_of_one_number(operator: str) -> None:
    """Its extrema over a box are at the ends, or at a multiple of a quarter turn, or at zero."""
    for low, high in BOXES:
        quarters = [k for k in range(-5, 9) if low < k * PI / 2 < high]
        inside = [*(k * PI / 2 for k in quarters), *np.clip(low + (high - low) * PLACES, low, high).tolist()]
        values = [value_or_none(operator, x) for x in inside]
        found = range_of(operator, box(low, high))
        if all(map(math.isnan, values)):
            assert same(found, NONE)
        elif any(map(math.isnan, values)) or (operator == "tan" and any(k % 2 for k in quarters)):
            assert same(found, ALL)
        else:
            least, most = min(values), max(values)
            assert found[0] <= least and most <= found[1]
            assert found == pytest.approx((least, most), rel=8 * ULP, abs=1e-15)


PAIRS = list(product([(-3.0, -1.5), (-2.0, 1.0), (0.5, 0.75), (2.0, 5.0), (-1.0, 0.0), (0.0, 2.0)], repeat=2))


def on_a_grid(operator: str, a: tuple[float, float], b: tuple[float, float]) -> list[float]:
    return [value_or_none(operator, x, y) for x, y in product(np.linspace(*a, 13), np.linspace(*b, 13))]


@pytest.mark.parametrize("operator", ["add", "multiply", "divide", "atan2", "min", "max"])
def test_a_function_of_two_numbers_has_its_extrema_at_corners(operator: str) -> None:
    for a, b in PAIRS:
        found = range_of(operator, box(*a), box(*b))
        through_zero = b[0] <= 0 <= b[1]
        if operator == "atan2" and a[0] <= 0 <= a[1] and b[0] <= 0:
            assert same(found, ALL), "a cut like a pole"
        elif operator == "divide" and through_zero and not (0 in b and (a[0] > 0 or a[1] < 0)):
            assert found[0] == -INF or found[1] == INF
        elif operator == "divide" and through_zero:
            end = min(abs(x / y) for x in a for y in b if y)
            positive = (a[0] > 0) == (b[1] > 0)
            assert found == pytest.approx((end, INF) if positive else (-INF, -end), rel=8 * ULP)
        else:
            values = on_a_grid(operator, a, b)
            assert found[0] <= min(values) and max(values) <= found[1]
            assert found == pytest.approx((min(values), max(values)), rel=8 * ULP, abs=0)


@pytest.mark.parametrize(
    ("top", "bottom", "expected"),
    [
        ((1, 2), (0, 4), (0.25, INF)), ((1, 2), (-4, 0), (-INF, -0.25)), ((-2, -1), (0, 4), (-INF, -0.25)), ((1, 2), (-4, 1), ALL), ((1, 2), (0, 0), ALL), ((1, 2), (-0.0, 4), (0.25, INF)),
        ((1, 2), (-4, -0.0), (-INF, -0.25)), ((0, 0), (-1, 1), (0, 0)), ((-1, 2), (0, 4), ALL), ((1, 1), (2, INF), (0, 0.5)), ((1, 1), (NAN, 2), NONE), ((1, 1), (0, 0.5), (2, INF)), ((1, 1), (-0.5, 0), (-INF, -2)),
    ],
)  # fmt: skip
def test_a_quotient_with_a_pole(top: Sequence[float], bottom: Sequence[float], expected: tuple[float, float]) -> None:
    found = range_of("divide", box(*top), box(*bottom))
    assert found == pytest.approx(expected, rel=8 * ULP, abs=0, nan_ok=True)


@pytest.mark.parametrize("base", [(0.5, 3.0), (-2.0, -0.5), (-2.0, 1.5), (0.0, 2.0), (1.0, 1.25)])
@pytest.mark.parametrize("exponent", [0.0, 2.0, 3.0, 4.0, 5.0, -1.0, -2.0, -3.0, 0.5, 1.5, -0.5, -1.5])
def test_a_power_of_a_number(base: tuple[float, float], exponent: float) -> None:
    values = [value_or_none("power", x, exponent) for x in (0.0, *np.linspace(*base, 29)) if base[0] <= x <= base[1]]
    found = range_of("power", box(*base), still(exponent))
    whole = exponent == int(exponent)
    if base[0] < 0 < base[1] and exponent < 0 and exponent == -2.0:
        assert found[0] <= 0.25 and found[1] == INF, "a pole where both sides go up"
    elif (base[0] < 0 < base[1] and exponent < 0) or (not whole and base[0] < 0 < base[1]):
        assert same(found, ALL)
    elif not whole and base[1] < 0:
        assert same(found, NONE)
    else:
        numbers = [v for v in values if not math.isnan(v)]
        most = INF if exponent < 0 and base[0] == 0 else max(numbers)
        assert found[0] <= min(numbers) and found[1] >= most
        assert found == pytest.approx((min(numbers), most), rel=24 * ULP, abs=0)


def test_a_power_whose_exponent_moves() -> None:
    """b^e is exp(e log b)."""
    assert range_of("power", box(2.0, 3.0), box(1.0, 2.0)) == pytest.approx((2.0, 9.0), rel=1e-14)
    assert range_of("power", box(0.5, 3.0), box(-1.0, 2.0)) == pytest.approx((0.25, 9.0), rel=1e-14)
    assert same(range_of("power", box(-1.0, 3.0), box(1.0, 2.0)), (0.0, INF))
    assert same(range_of("power", box(-2.0, -1.0), box(1.0, 2.0)), NONE)


@pytest.mark.parametrize(
    ("x", "degree", "expected"),
    [
        ((-8, 27), 3, (-2, 3)), ((1, 32), 5, (1, 2)), ((-8, -1), 3, (-2, -1)), ((-8, 27), 1, (-8, 27)), ((8, 27), -3, (1 / 3, 0.5)), ((-8, 27), -3, ALL), ((0, 8), -3, (0.5, INF)),
        ((2, 4), -1, (0.25, 0.5)), ((-4, -2), -1, (-0.5, -0.25)), ((4, 32), 2.5, (4**0.4, 4)), ((-1, 4), 2.5, ALL), ((2, 3), 0.5, (4, 9)), ((-2, 3), 0.5, (0, 9)), ((1, 4), 2, ALL), ((1, 4), 0, ALL), ((1, 4), -2, ALL),
    ],
)  # fmt: skip
def test_a_root(x: Sequence[float], degree: float, expected: tuple[float, float]) -> None:
    assert range_of("root", box(*x), still(float(degree))) == pytest.approx(expected, rel=16 * ULP, abs=0)


def test_a_root_whose_degree_moves() -> None:
    boxes = np.array([1.0, 2.0]), np.array([3.0, 4.0])
    assert TABLE["root"](boxes, boxes) == EVERYTHING == ALL


# ---------------------------------------------------------------- rounding


def test_ends_move_outward_by_the_rounding_of_one_operation() -> None:
    x, y = box(1.0, 3.0), box(-5.0, 7.0)
    for operator, operands, exact, part in [
        ("add", (x, y), (-4, 10), ONE_ROUNDING), ("multiply", (x, y), (-15, 21), ONE_ROUNDING), ("multiply", (x, still(2.0)), (2, 6), ONE_ROUNDING), ("multiply", (still(-2.0), y), (-14, 10), ONE_ROUNDING),
        ("sqrt", (box(4.0, 9.0),), (2, 3), LIBRARY_ROUNDING), ("exp", (box(0.0, 0.0),), (1, 1), LIBRARY_ROUNDING), ("acos", (box(-1.0, 0.0),), (PI / 2, PI), LIBRARY_ROUNDING), ("cosh", (box(-0.0, 0.0),), (1, 1), LIBRARY_ROUNDING),
        ("power", (y, still(2.0)), (0, 49), LIBRARY_ROUNDING), ("power", (y, still(3.0)), (-125, 343), LIBRARY_ROUNDING), ("root", (box(-1.0, 1.0), still(3.0)), (-1, 1), LIBRARY_ROUNDING),
        ("atan2", (box(-1.0, 1.0), x), (-PI / 4, PI / 4), LIBRARY_ROUNDING), ("tan", (box(0.5, 1.0),), (math.tan(0.5), math.tan(1.0)), LIBRARY_ROUNDING), ("sin", (box(0.5, 1.0),), (math.sin(0.5), math.sin(1.0)), LIBRARY_ROUNDING),
        ("noise", (still(0.0), box(3.0, 3.0), still(5.0)), (interpolate.random_number(3, 5),) * 2, 4 * LIBRARY_ROUNDING),
    ]:  # fmt: skip
        assert range_of(operator, *operands) == outward(*exact, part), operator


def test_ends_of_many_terms_and_factors() -> None:
    x = box(1.0, 2.0)
    assert range_of("add", still(1.0), x, still(2.0), box(-8.0, 8.0)) == pytest.approx((-4, 13), rel=4 * ULP, abs=0)
    assert range_of("multiply", still(0.5), x, still(-4.0), box(1.0, 3.0)) == pytest.approx((-12, -2), rel=4 * ULP)
    assert range_of("multiply", x, box(3.0, 5.0), box(-1.0, 7.0)) == pytest.approx((-10, 70), rel=4 * ULP)
    assert range_of("multiply", still(1.0), x) == (1.0, 2.0), "one drops"
    assert range_of("multiply", still(1.0), x, still(3.0)) == pytest.approx((3, 6), rel=4 * ULP)


def test_equal_factors_are_a_power() -> None:
    x, y = box(-2.0, 1.0), box(-2.0, 1.0)
    assert range_of("multiply", x, x) == pytest.approx((0, 4), rel=8 * ULP)
    assert range_of("multiply", x, x, x) == pytest.approx((-8, 1), rel=8 * ULP)
    assert range_of("multiply", x, y, x) == pytest.approx((-8, 4), rel=8 * ULP)
    assert range_of("multiply", x, y) == pytest.approx((-2, 4), rel=8 * ULP), "equal ends are not one quantity"


def test_zero_times_infinity_is_zero_and_no_number_stays_none() -> None:
    for a, b, expected in [
        (still(0.0), box(-INF, INF), (0, 0)), (box(0.0, 1.0), box(1.0, INF), (0, INF)), (box(-1.0, 0.0), box(-INF, 2.0), (-2, INF)), (still(INF), box(0.0, 1.0), (0, INF)), (still(-INF), box(0.0, 1.0), (-INF, 0)),
        (still(0.0), box(NAN, 1.0), NONE), (box(0.0, 1.0), box(NAN, NAN), NONE), (box(NAN, NAN), still(2.0), NONE), (box(NAN, NAN), box(0.0, INF), NONE), (still(INF), box(-1.0, 0.0), (-INF, 0)),
    ]:  # fmt: skip
        found = range_of("multiply", a, b)
        assert found == pytest.approx(expected, rel=8 * ULP, abs=0, nan_ok=True)


def test_a_number_for_all_boxes_is_still() -> None:
    array = np.array([1.0, 2.0])
    assert is_still(still(1.0)) and not is_still((1.0, 2.0)) and not is_still((array, array))


# ---------------------------------------------------------------- waves and poles


@pytest.mark.parametrize(("operator", "shift"), [("sin", 0.0), ("cos", PI / 2)])
def test_crests_and_troughs(operator: str, shift: float) -> None:
    """Boxes with ends 0.01 beside each multiple of a quarter turn hold exactly the crests and troughs between their ends."""
    ends = [k * PI / 2 + d - shift for k in range(-9, 10) for d in (-0.01, 0.01)]
    for low, high in product(ends, ends):
        if low > high:
            continue
        quarters = [k for k in range(-40, 40) if low + shift <= k * PI / 2 <= high + shift]
        crest, trough = any(k % 4 == 1 for k in quarters), any(k % 4 == 3 for k in quarters)
        values = value_of(operator, [low]), value_of(operator, [high])
        expected = -1.0 if trough else min(values), 1.0 if crest else max(values)
        assert range_of(operator, box(low, high)) == pytest.approx(expected, rel=8 * ULP, abs=0)
        assert all(abs(end) <= 1 for end in range_of(operator, box(low, high)))


def test_a_sine_that_ends_beside_its_crest_keeps_within_one() -> None:
    assert range_of("sin", box(1.0, PI / 2 - 1e-9)) == (outward(math.sin(1.0), 0, LIBRARY_ROUNDING)[0], 1.0)
    assert range_of("sin", box(-PI / 2 + 1e-9, 0.0)) == (-1.0, 0.0)


@pytest.mark.parametrize("exponent", range(3, 45))
def test_two_neighbouring_numbers_around_a_crest_or_a_pole(exponent: int) -> None:
    """The crest and the pole lie between them, however far away: the rounding of an angle hides neither."""
    random = np.random.default_rng(exponent)
    for k in random.integers(2 ** (exponent - 3), 2 ** (exponent - 2), 12).tolist():
        for sign in (-1, 1):
            with mpmath.workdps(60):
                exact = sign * (2 * k + mpmath.mpf(1) / 2) * mpmath.pi
                near = float(exact)
                beside = math.nextafter(near, INF if near < exact else -INF)
            around = box(min(near, beside), max(near, beside))
            assert range_of("sin", around)[0 if sign < 0 else 1] == sign
            assert same(range_of("tan", around), ALL)


def test_an_angle_that_is_rounded_by_more_than_a_turn_has_any_sine() -> None:
    limit = 2.0**45
    first = np.array([limit, -limit, math.nextafter(limit, 0), -math.nextafter(limit, 0), 0.5, -limit, NAN, 0.0])
    last = np.array([limit, -limit, math.nextafter(limit, 0), -math.nextafter(limit, 0), 1.0, 1.0, 1.0, limit])
    low, high = TABLE["sin"]((first, last))
    assert low[[0, 1, 5, 7]].tolist() == [-1.0] * 4 and high[[0, 1, 5, 7]].tolist() == [1.0] * 4
    assert (high - low)[2:5] == pytest.approx([0, 0, math.sin(1) - math.sin(0.5)], abs=1e-2)
    assert np.isnan(low[6]) and np.isnan(high[6])
    for i in (0, 1, 5, 7):  # one after the other, too
        assert range_of("sin", box(first[i], last[i])) == (-1.0, 1.0)


@pytest.mark.parametrize("period", [0, 1, -3])
def test_a_tangent_between_its_poles(period: int) -> None:
    left, right = period * PI - PI / 2, period * PI + PI / 2
    low, high = range_of("tan", box(left + 1e-3, right - 1e-3))
    assert (low, high) == pytest.approx((-1e3, 1e3), rel=1e-6)
    assert same(range_of("tan", box(left - 1e-3, left + 1e-3)), ALL) and same(range_of("tan", box(left, right)), ALL)


# ---------------------------------------------------------------- ends of domains, jumps


@pytest.mark.parametrize(
    ("operator", "x", "expected"),
    [
        ("sqrt", (-1, 4), ALL), ("sqrt", (-2, -1), NONE), ("sqrt", (-1, 0), ALL), ("sqrt", (0, 4), (0, 2)), ("asin", (-1, 1), (-PI / 2, PI / 2)), ("asin", (0, 1.5), ALL), ("asin", (1, 2), ALL), ("asin", (1.5, 2), NONE),
        ("asin", (-2, -1.5), NONE), ("acos", (-1, 1), (0, PI)), ("acos", (-2, 0), ALL), ("acos", (-3, -2), NONE), ("acos", (0.5, 2), ALL), ("log", (0, 1), (-INF, 0)), ("log", (-1, 1), ALL), ("atanh", (-1, 0), (-INF, 0)),
        ("acosh", (0, 2), ALL), ("acosh", (1, 1), (0, 0)), ("exp", (-INF, 0), (0, 1)), ("exp", (NAN, NAN), NONE), ("tanh", (-INF, INF), (-1, 1)),
        ("floor", (0.25, 0.75), (0, 0)), ("floor", (0.25, 1), ALL), ("ceil", (0.25, 1), (1, 1)), ("ceil", (0, 1), ALL), ("sign", (-2, -1), (-1, -1)), ("sign", (-1, 0), ALL), ("sign", (1, 2), (1, 1)), ("sign", (0, 0), (0, 0)),
    ],
)  # fmt: skip
def test_ends_of_domains_and_jumps(operator: str, x: Sequence[float], expected: tuple[float, float]) -> None:
    assert range_of(operator, box(*x)) == pytest.approx(expected, rel=8 * ULP, abs=0, nan_ok=True)


# ---------------------------------------------------------------- conditions

SMALL = [(a, b) for a, b in product(range(4), repeat=2) if a <= b]


@pytest.mark.parametrize("operator", ["less", "less_equal", "equal"])
def test_a_comparison_is_sure_if_all_numbers_agree(operator: str) -> None:
    for a, b in product(SMALL, SMALL):
        truths = [value_of(operator, (x, y)) for x, y in product(np.linspace(*a, 7), np.linspace(*b, 7))]
        truths += [value_of(operator, (x, x)) for x in range(4) if a[0] <= x <= a[1] and b[0] <= x <= b[1]]
        assert range_of(operator, box(*a), box(*b)) == (min(truths), max(truths)), (a, b)


TRUTHS = [(0.0, 0.0), (0.0, 1.0), (1.0, 1.0)]


@pytest.mark.parametrize("operator", ["and", "or"])
def test_joined_conditions(operator: str) -> None:
    for a, b in product(TRUTHS, TRUTHS):
        truths = [value_of(operator, pair) for pair in product(a, b)]
        assert range_of(operator, box(*a), box(*b)) == (min(truths), max(truths))


def test_the_opposite_and_a_choice() -> None:
    assert [range_of("not", box(*x)) for x in TRUTHS] == [(1.0, 1.0), (0.0, 1.0), (0.0, 0.0)]
    chosen = [range_of("select", box(*x), box(1.0, 5.0), box(-2.0, 3.0)) for x in TRUTHS]
    assert chosen == [(-2.0, 3.0), (-2.0, 5.0), (1.0, 5.0)]
    assert range_of("select", box(0.0, 1.0), box(-2.0, 3.0), box(1.0, 5.0)) == (-2.0, 5.0)


# ---------------------------------------------------------------- curves and noise


@pytest.mark.parametrize(("kind", "points"), [("linear", (0, 1, 3, 5, 9, 6)), ("cubic", (0, 1, 3, 5, 9, 6, 4, 1, -2)), ("monotone", (0, 1, 3, 5, 9, 6, 4, 0, -2))])  # fmt: skip
@pytest.mark.parametrize("order", [0, 1])
def test_a_curve(kind: str, points: Sequence[float], order: int) -> None:
    values = [value_of(kind, (order, x, *points)) for x in np.linspace(0.5, 2.5, 20_001)]
    found = range_of(kind, still(float(order)), box(0.5, 2.5), *(still(float(p)) for p in points))
    assert found[0] <= min(values) and max(values) <= found[1]
    assert found == pytest.approx((min(values), max(values)), rel=1e-6)
    assert TABLE[kind](still(0.0), box(0.5, 2.5), box(0, 1), *map(still, points[1:])) == EVERYTHING


SEED = 11.0
EXTREMES = [
    1.0,
    15 / 8,
    10 / math.sqrt(3),
    60.0,
    360.0,
    720.0,
]  # of the smooth step 6 s^5 - 15 s^4 + 10 s^3 and its derivatives


def test_the_steepest_part_of_a_smooth_step() -> None:
    for order, extreme in enumerate(EXTREMES[1:], 1):
        assert _steepest(order) == pytest.approx(1.01 * extreme, rel=1e-6)


@pytest.mark.parametrize("order", range(6))
def test_a_noise_holds_all_its_values(order: int) -> None:
    random = np.random.default_rng(order)
    low = np.concatenate([random.uniform(-9, 9, 60), [-1.0, 0.0, 2.0]])
    high = low + np.concatenate([random.uniform(0, 1, 30), random.uniform(0, 2.5, 30), [1.0, 0.0, 2.0]])
    least, most = TABLE["noise"](still(float(order)), (low, high), still(SEED))
    for i in range(len(low)):
        values = [interpolate.noise_at(order, float(x), SEED) for x in low[i] + (high[i] - low[i]) * PLACES]
        assert least[i] <= min(values) and max(values) <= most[i]
        numbers = [interpolate.random_number(math.floor(low[i]) + k, int(SEED)) for k in range(3)]
        pieces = math.floor(high[i]) - math.floor(low[i])
        if pieces > 1:
            reach = 1.0 if order == 0 else 2 * 1.01 * EXTREMES[order]
            assert (least[i], most[i]) == pytest.approx((-reach, reach), rel=1e-6)
        elif order == 0:
            inside = [values[0], values[-1], *numbers[1 : 1 + pieces]]
            assert (least[i], most[i]) == pytest.approx((min(inside), max(inside)), rel=1e-14)
        else:
            rises = [1.01 * EXTREMES[order] * (b - a) for a, b in pairwise(numbers[: 2 + pieces])]
            bounds = (min(0, *rises), max(0, *rises)) if order == 1 else (-max(map(abs, rises)), max(map(abs, rises)))
            assert (least[i], most[i]) == pytest.approx(bounds, rel=1e-6, abs=1e-12)


def test_a_noise_far_away_has_any_of_its_values() -> None:
    limit = 2.0**45
    places = np.array([limit, math.nextafter(limit, 0), -limit])
    low, high = TABLE["noise"](still(0.0), (places, places), still(SEED))
    assert low[[0, 2]].tolist() == [-1.0, -1.0] and high[[0, 2]].tolist() == [1.0, 1.0]
    assert high[1] - low[1] < 1e-13


# ---------------------------------------------------------------- values of arrays


@pytest.mark.parametrize("operator", sorted(n for n, r in OPERATORS.items() if r.arity))
def test_values_of_arrays_are_those_of_numbers(operator: str) -> None:
    """NaN where there is no value."""
    random = np.random.default_rng(1)
    operands: list[Any] = [random.uniform(-2, 2, 40) for _ in range(OPERATORS[operator].arity)]
    if OPERATORS[operator].kind == "condition" or operator == "select":
        operands[0] = np.round(operands[0])
    expected = [value_or_none(operator, *(float(x[i]) for x in operands)) for i in range(40)]
    np.testing.assert_allclose(np.asarray(plain(operator, operands), dtype=float), expected, rtol=1e-14)


def test_values_of_sums_products_curves_and_noise() -> None:
    x, y = np.array([1.0, -2.0]), np.array([0.5, 4.0])
    assert plain("add", (x, 3.0, y)).tolist() == [4.5, 5.0] and plain("multiply", (x, 3.0, y)).tolist() == [1.5, -24.0]
    points = (0.0, 1.0, 3.0, 5.0, 9.0, 6.0, 4.0, 1.0, -2.0)
    for kind, count in (("linear", 6), ("cubic", 9), ("monotone", 9)):
        for order in (0.0, 1.0):
            found = plain(kind, (order, y / 2, *points[:count]))
            expected = [value_of(kind, (order, place, *points[:count])) for place in (0.25, 2.0)]
            np.testing.assert_allclose(found, expected, rtol=1e-14)
            assert plain(kind, (order, 0.25, *points[:count])) == expected[0], "a number gives a number"
    moving = plain("linear", (0.0, y / 2, 0.0, 1.0, 3.0, 5.0, x, 6.0))
    np.testing.assert_allclose(moving, [4.0, 2.0], rtol=1e-14)
    assert plain("noise", (0.0, y, 3.0)).tolist() == [interpolate.noise_at(0, 0.5, 3), interpolate.noise_at(0, 4.0, 3)]
    assert math.isnan(plain("root", (-4.0, 2.0)))


def test_what_numpy_has_is_taken_from_there() -> None:
    assert PLAIN["asin"] is np.arcsin and PLAIN["less"] is np.less and PLAIN["select"] is np.where
    assert not {"erf", "root", "linear", "noise"} & set(PLAIN)
