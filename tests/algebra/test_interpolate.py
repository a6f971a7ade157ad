"""Curves through points against scipy's, their inverses, and random numbers against the published ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline, PchipInterpolator

from compiler.algebra import interpolate
from compiler.algebra.derivative import derivative
from compiler.algebra.expression import Apply, Expression, Number, Symbol, call, evaluate
from compiler.algebra.invert import obstacle, solve_nonlinear
from compiler.algebra.operators import CURVES
from compiler.algebra.table import lists, table, turned_round

X, Y = Symbol("x"), Symbol("y")
KINDS = ["linear", "cubic", "monotone"]


@st.composite
def points(draw: st.DrawFn, rising: bool = False) -> tuple[list[float], list[float]]:
    """Places that rise, with values (that rise too)."""
    n = draw(st.integers(2, 9))
    steps = st.lists(st.floats(0.1, 3), min_size=n, max_size=n)
    xs = np.cumsum(draw(steps)) + draw(st.floats(-5, 5))
    ys = np.cumsum(draw(steps)) if rising else draw(st.lists(st.floats(-4, 4), min_size=n, max_size=n))
    return xs.tolist(), list(map(float, ys))


def curve(kind: str, xs: list[float], ys: list[float], x: Expression = X) -> Expression:
    return table(kind, x, [Number(v) for v in xs], [Number(v) for v in ys])


def value(x: Expression, at: float) -> float:
    return evaluate(x, lambda key: {"x": at, "y": at}[key])


REFERENCE = {
    "linear": lambda xs, ys: lambda at, order: np.interp(at, xs, ys),
    "cubic": lambda xs, ys: CubicSpline(xs, ys, bc_type="natural"),
    "monotone": PchipInterpolator,
}


@pytest.mark.parametrize("kind", KINDS)
@given(data=st.data())
def test_values_and_slopes_are_those_of_scipy(kind: str, data: st.DataObject) -> None:
    xs, ys = data.draw(points())
    at = data.draw(st.floats(xs[0], xs[-1]))
    reference = REFERENCE[kind](xs, ys)
    found = curve(kind, xs, ys)
    scale = max(1.0, *map(abs, ys))
    assert value(found, at) == pytest.approx(float(reference(at, 0)), rel=1e-9, abs=1e-9 * scale)
    if kind != "linear":
        assert value(derivative(found, X), at) == pytest.approx(float(reference(at, 1)), rel=1e-7, abs=1e-7 * scale)


@given(points())
def test_a_natural_spline_has_no_curvature_at_its_ends(given_points: tuple[list[float], list[float]]) -> None:
    xs, ys = given_points
    second = derivative(derivative(curve("cubic", xs, ys), X), X)
    scale = max(1.0, *map(abs, ys)) / min(np.diff(xs)) ** 2
    assert abs(value(second, xs[0])) <= 1e-12 * scale and abs(value(second, xs[-1])) <= 1e-12 * scale
    inside = xs[len(xs) // 2]
    h = 1e-9 * (xs[-1] - xs[0])
    if xs[0] < inside < xs[-1]:
        assert value(second, inside - h) == pytest.approx(value(second, inside + h), abs=1e-5 * scale)


def test_fritsch_and_butland_by_hand() -> None:
    """h = 1, 2, 1; secants 1, 2, 0: harmonic mean 3*3/(5/1 + 4/2) = 9/7, then 0; ends (4*1 - 2)/3 = ... cut where they turn back."""
    slopes = interpolate.monotone_slopes((0.0, 1.0, 3.0, 4.0), (0.0, 1.0, 5.0, 5.0))
    assert slopes == pytest.approx((((2 * 1 + 2) * 1 - 1 * 2) / 3, 9 / 7, 0.0, 0.0))


@given(points(rising=True), st.floats(0, 1), st.floats(0, 1))
def test_monotone_is_monotone(given_points: tuple[list[float], list[float]], a: float, b: float) -> None:
    xs, ys = given_points
    found = curve("monotone", xs, ys)
    low, high = sorted((xs[0] + a * (xs[-1] - xs[0]), xs[0] + b * (xs[-1] - xs[0])))
    assert value(found, low) <= value(found, high) + 1e-12 * abs(ys[-1])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("kind", ["linear", "monotone"])
@given(given_points=points(rising=True), share=st.floats(0, 1))
def test_turned_round_and_back(
    kind: str, sign: float, given_points: tuple[list[float], list[float]], share: float
) -> None:
    xs, ys = given_points
    found = curve(kind, xs, [sign * y for y in ys])
    assert isinstance(found, Apply)
    back = turned_round(found, Y)
    assert back is not None
    target = sign * (ys[0] + share * (ys[-1] - ys[0]))
    place = value(back, target)
    assert xs[0] - 1e-9 <= place <= xs[-1] + 1e-9
    assert value(found, place) == pytest.approx(target, rel=1e-10, abs=1e-10)
    slope = value(derivative(found, X), place)
    if kind == "monotone" and abs(slope) > 1e-3:
        assert value(derivative(back, Y), target) == pytest.approx(1 / slope, rel=1e-6)


def test_a_law_with_a_table_is_solved() -> None:
    """y = 2*table(3*x) + 1, at a point that is known."""
    law = 2 * curve("monotone", [0, 1, 2], [0, 1, 4], 3 * X) + 1
    found = solve_nonlinear(Y, law, X)
    assert found is not None and value(found, 3.0) == pytest.approx(1 / 3)


def test_what_turns_back_is_not_turned_round() -> None:
    for kind in KINDS:
        found = curve(kind, [0, 1, 2], [0, 2, 1])
        assert isinstance(found, Apply) and turned_round(found, Y) is None
        assert solve_nonlinear(Y, found, X) is None and "rise or fall" in obstacle([Y, found])
    swinging = curve("cubic", [0, 1, 2, 3], [0, 0.01, 5, 5.01])  # its points rise, the spline does not
    assert isinstance(swinging, Apply) and turned_round(swinging, Y) is None
    straight = curve("cubic", [0, 1, 2, 3], [0, 1, 2.1, 3])
    assert isinstance(straight, Apply)
    back = turned_round(straight, Y)
    assert back is not None and value(straight, value(back, 1.7)) == pytest.approx(1.7, rel=1e-12)
    assert obstacle([X * X, Y]) == ""


@pytest.mark.parametrize("kind", KINDS)
def test_a_table_has_no_value_outside_of_its_places(kind: str) -> None:
    found = curve(kind, [0, 1, 3], [0, 1, 4])
    for outside in (-0.001, 3.001):
        with pytest.raises(interpolate.OutsideTable, match="from 0 to 3"):
            value(found, outside)
    assert value(found, 3 + 1e-9) == pytest.approx(4), "rounding is no step outside"


@pytest.mark.parametrize("kind", KINDS)
def test_points_that_are_symbols_give_the_same(kind: str) -> None:
    """Slopes are then operations of the points."""
    names = [Symbol(f"p{i}") for i in range(8)]
    numbers = [0.0, 1.0, 2.5, 4.0, 0.5, 1.0, -1.0, 3.0]
    known = {s.key: v for s, v in zip(names, numbers, strict=True)} | {"x": 1.7}
    found = table(kind, X, names[:4], names[4:])
    assert evaluate(found, known.__getitem__) == pytest.approx(value(curve(kind, numbers[:4], numbers[4:]), 1.7))
    assert isinstance(found, Apply) and len(lists(found)[0]) == 4


class TestPowers:
    """A power with an exponent that is a symbol."""

    @pytest.mark.parametrize(("base", "n"), [(2.0, 1.4), (0.3, -2.5), (-2.0, 3.0), (-0.5, -1.0), (0.0, 3.0)])
    def test_turned_round(self, base: float, n: float) -> None:
        found = solve_nonlinear(Y, call("power", X, Symbol("n")), X)
        assert found is not None
        if base or n > 0:
            assert evaluate(found, {"y": base**n, "n": n}.__getitem__) == pytest.approx(base)

    @pytest.mark.parametrize(("y", "n"), [(4.0, 2.0), (4.0, 0.0), (-4.0, 1.5), (4.0, -2.0)])
    def test_no_value_where_there_is_not_one_inverse(self, y: float, n: float) -> None:
        with pytest.raises(ValueError, match=r"."):
            evaluate(call("root", Y, Symbol("n")), {"y": y, "n": n}.__getitem__)


class TestNoise:
    def test_splitmix64(self) -> None:
        """The stream of seed 1234567 as published with the algorithm; ours starts it from a mixed seed."""
        state, found = 1234567, []
        for _ in range(3):
            state = (state + 0x9E3779B97F4A7C15) % 2**64
            found.append(interpolate.mixed(state))
        assert found == [6457827717110365317, 3203168211198807973, 9817491932198370423]

    def test_uniform_between_minus_one_and_one(self) -> None:
        numbers = np.array([interpolate.random_number(k, 5) for k in range(-20_000, 20_000)])
        assert numbers.min() >= -1 and numbers.max() < 1
        counts = np.histogram(numbers, 20, (-1, 1))[0]
        assert np.sum((counts - 2000) ** 2 / 2000) < 45, "chi squared of 19 degrees of freedom"
        assert abs(np.mean(numbers[1:] * numbers[:-1])) < 0.01, "neighbours know nothing of each other"

    def test_moments_as_the_reference_says(self) -> None:
        """Variance 1/3 at whole periods, 0.2612 on average."""
        u = np.arange(0, 20_000, 0.25)
        values = np.array([interpolate.noise_at(0, x, 3) for x in u])
        assert np.mean(values) == pytest.approx(0, abs=0.02)
        assert np.var(values[::4]) == pytest.approx(1 / 3, rel=0.03)
        step = np.linspace(0, 1, 20001)
        smooth = 10 * step**3 - 15 * step**4 + 6 * step**5
        assert np.mean(smooth**2 + (1 - smooth) ** 2) / 3 == pytest.approx(0.2612, abs=1e-4)

    @given(st.floats(-50, 50), st.integers(-(2**53), 2**53))
    def test_derivatives(self, at: float, seed: int) -> None:
        x = call("noise", Number(0.0), X, Number(float(seed)))
        for _ in range(3):
            slope = derivative(x, X)
            h = 1e-5
            if abs(at - round(at)) > 3 * h:
                difference = (value(x, at + h) - value(x, at - h)) / (2 * h)
                assert value(slope, at) == pytest.approx(difference, rel=1e-4, abs=1e-3)
            x = slope

    @pytest.mark.parametrize("order", range(6))
    def test_the_same_for_machine_code(self, order: int) -> None:
        """The derivatives of a step of the fifth degree from one random number to the next."""
        step = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
        steps = [float(c) for c in interpolate.SMOOTH_STEP[order]]
        for place in (-7.25, -1.0, -0.125, 0.0, 0.5, 3.0, 12.875, 1e9 + 0.5):
            first, second = (interpolate.random_number(math.floor(place) + k, 21) for k in range(2))
            slope = (step.deriv(order) if order else step)(place - math.floor(place)) * (second - first)
            expected = pytest.approx(slope + (0 if order else first), rel=1e-12, abs=1e-12)
            assert interpolate.noise(order, place, 21.0, steps, len(steps)) == expected
            assert interpolate.noise_at(order, place, 21.0) == expected

    def test_no_random_number_beyond_the_integers_of_machine_code(self) -> None:
        steps = [float(c) for c in interpolate.SMOOTH_STEP[0]]
        for limit in (2.0**62, -(2.0**62), math.inf, math.nan):
            assert math.isnan(interpolate.noise(0, limit, 1.0, steps, 6))
        for place in (math.nextafter(2.0**62, 0), -math.nextafter(2.0**62, 0)):
            expected = interpolate.random_number(int(place), 1)
            assert interpolate.noise(0, place, 1.0, steps, 6) == expected

    def test_two_continuous_derivatives(self) -> None:
        for order in range(3):
            before, after = (interpolate.noise_at(order, 7 + h, 1) for h in (-1e-12, 1e-12))
            assert before == pytest.approx(after, abs=1e-8)

    def test_the_operators_are_all_tried_here(self) -> None:
        assert set(CURVES) == {*KINDS, "inverse", "noise"}
