"""Tables of two variables: values and slopes against independent interpolation, bounds, units, files, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, RegularGridInterpolator

import bondgraph
from bondgraph.errors import RunFailed
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
        ("monotone(1, (0, 2), 1, (0, 1), ((1, 2), (3, 4)))", "BG151", "one variable"),
        ("linear(1, (0, 2), 1, (0, 1))", "BG108", "3 arguments"),
    ],
)  # fmt: skip
def test_refusals(call: str, code: str, words: str) -> None:
    found = mistake(f"model M {{\n  output y = {call}\n}}", code)
    assert words in f"{found.sentence} {found.help}"
