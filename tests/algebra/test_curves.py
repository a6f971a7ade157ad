"""Values and ranges of curves through points, against one value at a time."""

from __future__ import annotations

import numpy as np
import pytest

from compiler.algebra.curves import curve
from compiler.algebra.operators import value_of


def points_of(kind: str, count: int, falling: bool) -> tuple[tuple[float, ...], float, float]:
    random = np.random.default_rng(count)
    places, values, slopes = np.cumsum(random.uniform(0.1, 1, count)), *random.normal(size=(2, count))
    lists = (places, values) if kind == "linear" else (places, values, slopes)
    turned = [part[::-1] for part in lists] if falling else lists
    return tuple(np.concatenate(turned).tolist()), float(places[0]), float(places[-1])


@pytest.mark.parametrize("count", [2, 3, 5, 17, 100])
@pytest.mark.parametrize(
    ("kind", "orders", "falling"),
    [("linear", 2, False), ("linear", 2, True), ("cubic", 4, False), ("monotone", 4, False)],
)
def test_values_and_ranges(kind: str, orders: int, falling: bool, count: int) -> None:
    """Ranges hold all values of a box and are no wider than rounding makes them."""
    points, first, last = points_of(kind, count, falling)
    random = np.random.default_rng(7)
    for order in range(orders):
        function = curve(kind, order, points)
        beyond = 1.0 if order else 0.0
        x = random.uniform(first - beyond, last + beyond, 300)
        expected = [value_of(kind, (float(order), float(t), *points)) for t in x]
        np.testing.assert_allclose(function.values(x), expected, rtol=1e-12, atol=1e-11)
        low = random.uniform(first, last, 200)
        high = np.minimum(last, low + random.uniform(0, 1, 200) ** 3 * (last - first))
        least, most = function.over(low, high)
        inside = function.values(low[:, None] + (high - low)[:, None] * np.linspace(0, 1, 801))
        assert (least <= inside.min(axis=1)).all() and (inside.max(axis=1) <= most).all()
        if order == 0:
            narrow = high - low < 0.5
            assert ((most - least) - np.ptp(inside, axis=1) <= 0.02 * np.ptp(expected))[narrow].all()


def test_outside_of_a_table_there_is_no_value() -> None:
    assert np.isnan(curve("linear", 0, (0.0, 1.0, 2.0, 3.0)).values(np.array([-0.1, 1.1]))).all()
    least, most = curve("linear", 0, (0.0, 1.0, 2.0, 3.0)).over(np.array([-np.inf]), np.array([0.5]))
    assert least[0] == -np.inf and most[0] == pytest.approx(2.5)
