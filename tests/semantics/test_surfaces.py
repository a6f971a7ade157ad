"""Tables of two variables: values and slopes against independent interpolation, bounds, units, files, and what is refused."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, CubicSpline, RegularGridInterpolator

import bondgraph
from bondgraph.errors import RunFailed
from compiler.algebra.expression import Symbol
from compiler.algebra.interpolate import monotone_slopes, surface_slopes
from compiler.algebra.table import sloped, turned_round
from tests.compiling import mistake

XS, YS = (0.0, 1.0, 2.5, 4.0), (-1.0, 0.5, 3.0)
Z = np.array([[1, 4, 2], [0, 3, 5], [2, -1, 6], [7, 2, 2.5]])


def rows(values: list[list[float]]) -> str:
    return str(tuple(map(tuple, values)))


def surface(kind: str, x: str, y: str) -> str:
    return f"{kind}({x}, {XS}, {y}, {YS}, {rows(Z.tolist())})"


def spline(x: float, y: float) -> float:
    """Splines along y through each row, then one along x through their values."""
    return float(CubicSpline(XS, CubicSpline(YS, Z, axis=1, bc_type="natural")(y), bc_type="natural")(x))


@pytest.mark.parametrize("target", [pytest.param("native", marks=pytest.mark.machine_code), "numpy"])
def test_values_and_rates(target: str) -> None:
    """Along the path x = t, y = 3 cos(t)^2 - 0.9: values, and the rate by the chain rule over both axes."""
    text = (
        f"plain model A {{\n  signal x = integral(1, 0), y = 3*cos(x)^2 - 0.9\n  output l = {surface('linear', 'x', 'y')}, c = {surface('cubic', 'x', 'y')}\n"
        f"  output turned = linear(y, {YS}, x, {XS}, {rows(Z.T.tolist())}), rate = der(c)\n}}\n"
    )
    found = bondgraph.load(text).simulate(to=4, points=41, target=target, rtol=1e-10)
    x, y = found.time, 3 * np.cos(found.time) ** 2 - 0.9
    assert found["l"] == pytest.approx(RegularGridInterpolator((XS, YS), Z)(np.stack([x, y], -1)), abs=1e-12)
    assert found["turned"] == pytest.approx(found["l"], abs=1e-13)
    assert found["c"] == pytest.approx([spline(*at) for at in zip(x, y, strict=True)], abs=1e-11)
    h = 1e-5
    slope = [
        (spline(a + h, 3 * np.cos(a + h) ** 2 - 0.9) - spline(a - h, 3 * np.cos(a - h) ** 2 - 0.9)) / (2 * h)
        for a in x[1:-1]
    ]
    assert found["rate"][1:-1] == pytest.approx(slope, abs=1e-6)


def test_an_energy_is_kept_on_a_surface() -> None:
    text = (
        "model A {\n  C s(x: translation, y: translation) : energy = cubic(x, (-1 m, 0 m, 1 m), y, (-1 m, 0 m, 2 m), "
        "((5 J, 2 J, 4 J), (4 J, 0, 3 J), (7 J, 2 J, 6 J)))\n"
        "  I m(x: translation, y: translation) : energy = (x^2 + y^2)/(2*1 kg) { start x.v = 0.5 [m/s] }\n  1(m.x) -> s.x\n  1(m.y) -> s.y\n  output x = s.x\n}\n"
    )
    found = bondgraph.load(text).simulate(to="3 s", energy=True, rtol=1e-9)
    assert abs(found.energy.stored) < 1e-8 and np.ptp(found["x"]) > 0.1


def test_a_valve_is_asked_for_its_pressure() -> None:
    text = (
        "model A {\n  parameter wide: L/s = 2\n  signal hole = time/3 s\n"
        "  MR valve : Q = linear(P, (-1 bar, 0 bar, 1 bar), hole, (0, 1), ((-1 [L/s], -wide), (0, 0), (1 [L/s], wide)))\n"
        "  Sf pump : Q = 0.9 [L/s]\n  pump -> valve\n  output P = valve.P\n}\n"
    )
    found = bondgraph.load(text).simulate(to="3 s", points=4, settings={"wide": "3 [L/s]"})
    assert found["P"] == pytest.approx(0.9e5 / (1 + 2 * found.time / 3), rel=1e-9)


def test_bounds_and_flat_text() -> None:
    text = "model A {\n  signal x = integral(1 [m/s], 0 m)\n  output y = linear(2*x, (0 m, 9 m), x, (0 m, 1 m), ((1, 2), (3, 4)))\n}\n"
    with pytest.raises(RunFailed, match="from 0 to 1 m"):
        bondgraph.load(text).simulate(to="2 s")
    flat = bondgraph.load(text).text()
    assert bondgraph.load(flat).simulate(to="1 s").final("y") == bondgraph.load(text).simulate(to="1 s").final("y")


def monotone(x: np.ndarray, y: np.ndarray, xs: list[float], ys: list[float], z: np.ndarray) -> np.ndarray:
    """Values of a monotone surface at all pairs of places, by scipy's curves through points with slopes."""
    across, along, twists = (np.array(part) for part in surface_slopes(xs, ys, z.tolist()))
    rows, slopes = CubicHermiteSpline(ys, z, along, axis=1)(y), CubicHermiteSpline(ys, across, twists, axis=1)(y)
    return CubicHermiteSpline(xs, rows, slopes, axis=0)(x)


def test_it_rises_and_falls_only_where_its_points_do() -> None:
    """Random grids: rising in both directions, with flat parts, and such as rise along some lines only."""
    random = np.random.default_rng(5)
    smaller = 0
    for kind in range(120):
        xs, ys = (np.cumsum(random.exponential(1, n) + 0.05).tolist() for n in random.integers(2, 6, 2))
        z = random.normal(size=(len(xs), len(ys))) ** 3
        both = np.sort(np.sort(z, 0), 1)
        z = (both, np.round(both)[::-1], np.round(2 * z), np.sort(z, 0))[kind % 4]
        at = [np.unique(np.concatenate([np.linspace(a, b, 9) for a, b in pairwise(p)])) for p in (xs, ys)]
        fine = monotone(*at, xs, ys, z)
        assert fine[::8, ::8] == pytest.approx(z, abs=1e-12)
        plain = np.array([monotone_slopes(tuple(ys), tuple(row)) for row in z.tolist()])
        smaller += bool(np.any(plain != np.array(surface_slopes(xs, ys, z.tolist())[1])))
        for values, surface in ((z, fine), (z.T, fine.T)):
            rises = np.diff(values, axis=0)
            for sign in (1, -1):
                both = np.minimum(sign * rises[:, :-1], sign * rises[:, 1:]) >= 0
                steps = sign * np.diff(surface, axis=0)
                for i, j in zip(*np.nonzero(both), strict=True):
                    assert steps[8 * i : 8 * i + 8, 8 * j : 8 * j + 9].min() > -1e-12 * max(np.ptp(z), 1)
    assert smaller > 40  # the slopes of curves alone are not enough


def test_slopes_of_opposite_signs_share_what_their_rows_are_apart() -> None:
    """The condition itself, which is sufficient: where it holds for both slopes alone only, the surface may be monotone all the same."""
    z = [[-150.0, -100.0, -99.55], [-50.0, 0.0, 0.45], [51.0, 1.0, 0.55], [151.0, 101.0, 100.55]]
    across = monotone_slopes((0.0, 1.0, 2.0, 3.0), tuple(row[1] for row in z))
    _, along, _ = surface_slopes((0.0, 1.0, 2.0, 3.0), (0.0, 1.0, 2.0), z)
    assert along[1][1] > 0.1 and along[2][1] < -0.1
    assert along[1][1] - along[2][1] <= 3 * (z[2][1] - z[1][1]) - max(across[1:3]) + 1e-12


def test_one_axis_alone_is_the_curve_and_a_product_of_lines_is_exact() -> None:
    row, xs, ys = (0.0, 0.1, 4.0, 4.0, 9.0), (-1.0, 0.0, 3.0), (0.0, 1.0, 1.5, 3.0, 4.0)
    across, along, twists = surface_slopes(xs, ys, [row] * 3)
    assert not np.any([across, twists]) and along == [monotone_slopes(ys, row)] * 3
    across, along, twists = surface_slopes(xs, ys, [[2 * x * (y - 1) + 3 * y for y in ys] for x in xs])
    assert np.array(across) == pytest.approx(np.array([[2 * (y - 1) for y in ys]] * 3))
    assert np.array(along) == pytest.approx(np.array([[2 * x + 3] * 5 for x in xs]))
    assert np.array(twists) == pytest.approx(np.full((3, 5), 2.0))


@pytest.mark.parametrize("target", [pytest.param("native", marks=pytest.mark.machine_code), "numpy"])
def test_a_monotone_surface_runs(target: str) -> None:
    """Values, and the rate, which is continuous at the borders of the cells; its flat text is the same surface."""
    xs, ys, z = [0.0, 1.0, 2.5, 4.0], [-1.0, 0.5, 3.0], np.array([[0, 1, 1.2], [0.5, 4, 4], [0.6, 4, 9], [7, 7.2, 9.5]])
    places = "(0 m, 1 m, 2.5 m, 4 m)"
    text = (
        f"model A {{\n  signal x = integral(1 [m/s], 0 m), y = 3*cos(x/1 m)^2 - 0.9\n  output c = monotone(x, {places}, y, {tuple(ys)}, {rows((z * 2).tolist())})*0.5 N\n"
        f"  output turned = monotone(y, {tuple(ys)}, x, {places}, {rows(z.T.tolist())}), rate = der(turned)\n}}\n"
    )
    model = bondgraph.load(text)
    found = model.simulate(to="4 s", points=41, target=target)
    y = 3 * np.cos(found.time) ** 2 - 0.9
    values = np.array([monotone(*at, xs, ys, z) for at in zip(found.time, y, strict=True)])
    assert found["c"] == pytest.approx(values, abs=1e-12) and found["turned"] == pytest.approx(values, abs=1e-12)
    again = bondgraph.load(model.text()).simulate(to="4 s", points=41, target=target)
    assert again["c"] == pytest.approx(found["c"], rel=1e-13)
    h = 1e-6
    for k, t in ((10, 1.0), (25, 2.5)):  # at a border of cells, from both sides
        sides = [float(monotone(t + s, 3 * np.cos(t + s) ** 2 - 0.9, xs, ys, z)) for s in (-h, 0.0, h)]
        assert np.diff(sides) / h == pytest.approx([found["rate"][k]] * 2, abs=1e-4)
    with pytest.raises(RunFailed, match=r"`monotone\(…\)`.* from 0 to 4 m"):
        model.simulate(to="5 s", target=target)


def test_a_curve_with_slopes_of_its_own() -> None:
    """A cubic Hermite curve; where causality asks for its argument, it is turned round only if it does not turn back."""
    law = "monotone({}, (0 m, 1 m, 3 m), (0 N, 2 N, 3 N), (1 [N/m], {} [N/m], 0 [N/m]))"
    text = f"model A {{\n  signal x = integral(1 [m/s], 0 m)\n  output y = {law.format('x', 4)}\n}}"
    found = bondgraph.load(text).simulate(to="3 s", points=13)
    assert found["y"] == pytest.approx(CubicHermiteSpline((0, 1, 3), (0, 2, 3), (1, 4, 0))(found.time), abs=1e-12)
    x = Symbol("x")
    assert turned_round(sloped(x, (0, 1, 3), (0, 2, 3), (1, 1, 0)), x) is not None
    assert turned_round(sloped(x, (0, 1, 3), (0, 2, 3), (1, 9, 0)), x) is None


@pytest.mark.parametrize(
    ("call", "code", "words"),
    [
        ("linear(1, (0, 2), 3, (0, 1), ((1, 2), (3, 4)))", "BG151", "3 lies outside"),
        ("linear(1, (0, 2), 1, (0, 1), (1, 2))", "BG111", "z11"),
        ("linear(1, (0, 2), 1, (0, 1), 3)", "BG111", "z11"),
        ("linear(1, (0, 2), 1, (0, 1), ((1, 2), (3, 4, 5)))", "BG151", "a row of 3"),
        ("linear(1, (0, 2), 1, (0, 1), ((1, 2), (3, 4), (5, 6)))", "BG151", "3 rows"),
        ("linear(1, (0, 2), 1 m, (0, 1), ((1, 2), (3, 4)))", "BG103", "`1 m`"),
        ("linear(1, (0, 2), 1, (0, 1), ((1, 2), (3 m, 4)))", "BG103", "The values"),
        ("cubic(1, (2, 0), 1, (0, 1), ((1, 2), (3, 4)))", "BG151", "must rise"),
        ("cubic(1, (0, 2), 1, (0, time/1 s), ((1, 2), (3, 4)))", "BG106", "before the run"),
        ("monotone(1, (0, 2), 1, (0, 1), ((1, 2), (p, 4)))", "BG151", "numbers, not parameters"),
        ("monotone(1, (0, 2), 1, (0, p), ((1, 2), (3, 4)))", "BG151", "numbers, not parameters"),
        ("monotone(1, (0, 2), 3, (0, 1), ((1, 2), (3, 4)))", "BG151", "3 lies outside"),
        ("monotone(1, (0, 2), 1, (0, 1), ((1, 2), (3 m, 4)))", "BG103", "The values"),
        ("monotone(1, (0, 2), (0, 1), (1, 1, 1))", "BG151", "one slope"),
        ("monotone(1, (0, 2), (0, 1), (p, 1))", "BG151", "not parameters"),
        ("monotone(1, (0, 2), (0, 1), (1 [1/m], 1))", "BG103", "its slopes, times a place,"),
        ("monotone(1, (0, 2), (0, 1), 1)", "BG111", "A list"),
        ("cubic(1, (0, 2), (0, 1), (1, 1))", "BG108", "3 arguments"),
        ("linear(1, (0, 2), 1, (0, 1))", "BG108", "3 arguments"),
    ],
)  # fmt: skip
def test_refusals(call: str, code: str, words: str) -> None:
    found = mistake(f"model M {{\n  parameter p = 3\n  output y = {call}\n}}", code)
    assert words in f"{found.sentence} {found.help}"
