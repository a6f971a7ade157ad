"""Bodies without mass: right between joints; where nothing moves along a coordinate, the coordinate is reported by name."""

from __future__ import annotations

import numpy as np
import pytest

from compiler.errors import CompilationFailed
from tests.compiling import Running
from tests.multibody.drawing import Drawing

SOLID = (0.3, 0.4, 0.5, 0.01, 0.02, -0.03)


def lost(drawn: Drawing) -> str:
    """The coordinate that is reported."""
    with pytest.raises(CompilationFailed) as failed:
        _ = drawn.compiled(everything=True).program
    assert [d.code for d in failed.value.diagnostics] == ["BG202"]
    return str(failed.value.diagnostics[0].coordinate)  # type: ignore[attr-defined]


def test_a_cross_between_two_hinges_is_a_universal_joint() -> None:
    """A massless body that carries the second hinge."""
    rates = []
    for made in (True, False):
        drawn = Drawing(gravity=(1.0, -2.0, -9.0))
        drawn.body("b", 2.0, SOLID, (0.3, 0.2, -0.5))
        if made:
            drawn.body("cross", 0.0)
            drawn.joint("one", "hinge", "ground", "cross", axis=(1, 0, 0))
            drawn.joint("two", "hinge", "cross", "b", axis=(0, 1, 0))
        else:
            drawn.joint("both", "universal", "ground", "b", axis=(1, 0, 0), other=(0, 1, 0))
        running = Running(drawn.compiled(everything=True))
        names = ("m.one.phi", "m.two.phi") if made else ("m.both.phi1", "m.both.phi2")
        state = dict(zip([*names, *(f"{n}.omega" for n in names)], (0.3, -0.7, 1.1, 0.6), strict=True))
        found = running.rates(state)
        rates.append([found[f"{n}.omega"] for n in names])
    np.testing.assert_allclose(rates[0], rates[1], rtol=1e-13)


def test_a_rod_without_inertia_about_itself() -> None:
    """A thin rod swings as a pendulum, on a universal joint across it and on a ball in its end, on which it keeps its spin about itself."""
    thin = (1 / 12, 1 / 12, 0.0, 0.0, 0.0, 0.0)
    drawn = Drawing(gravity=(0, 0, -9.81))
    drawn.body("rod", 1.0, thin, (0, 0, -0.5))
    drawn.joint("top", "universal", "ground", "rod", axis=(1, 0, 0), other=(0, 1, 0))
    rates = Running(drawn.compiled(everything=True)).rates({"m.top.phi1": 0.4})
    assert rates["m.top.phi1.omega"] == pytest.approx(-1.5 * 9.81 * np.sin(0.4), rel=1e-13)
    drawn.joints.clear()
    drawn.joint("top", "ball", "ground", "rod")
    start = {"m.top.attitude.w": np.cos(0.2), "m.top.attitude.x": np.sin(0.2), "m.top.spin.z": 3.0}
    rates = Running(drawn.compiled(everything=True)).rates(start)
    assert rates["m.top.spin.x"] == pytest.approx(-1.5 * 9.81 * np.sin(0.4), rel=1e-13)
    assert rates["m.top.spin.z"] == pytest.approx(0.0, abs=1e-12)


def test_combinations_that_move_nothing() -> None:
    """Two hinges about one slanted axis with nothing between; a slide without mass on one with; four hinges for a point's three ways."""
    slanted = Drawing()
    slanted.body("a", 0.0)
    slanted.body("b", 1.0, SOLID, (0.5, 0.1, 0.2))
    slanted.joint("one", "hinge", "ground", "a", axis=(1, 2, 3))
    slanted.joint("two", "hinge", "a", "b", axis=(1, 2, 3))
    assert lost(slanted) == "one.phi"
    point = Drawing()
    for name in "abc":
        point.body(name, 0.0)
    point.body("d", 1.0, at=(0.3, 0.2, 0.9))
    ends = ["ground", "a", "b", "c", "d"]
    places = [(0, 0, 0), (0.5, 0, 0.1), (0.2, 0.4, 0.3), (0.1, 0.1, 0.5)]
    axes = [(0, 0, 1), (0, 1, 0), (1, 0, 0), (1, 1, 0)]
    for i, (at, axis) in enumerate(zip(places, axes, strict=True)):
        point.joint(f"j{i}", "hinge", ends[i], ends[i + 1], at, axis)
    assert lost(point) == "j0.phi"
    slide = Drawing()
    slide.body("a", 1.0)
    slide.body("b", 0.0)
    slide.joint("one", "slide", "ground", "a", axis=(0, 1, 0))
    slide.joint("two", "slide", "a", "b", axis=(1, 1, 0))
    assert lost(slide) == "two.x"


def test_scales_from_a_crane_to_a_tip() -> None:
    """A tip of 1 ng on a crane of 1 t is determined."""
    drawn = Drawing(gravity=(0, 0, -9.81))
    drawn.body("crane", 1e3, (1e3, 1e3, 1e3, 0, 0, 0), (0, 0, 1))
    drawn.body("tip", 1e-12, (1e-23,) * 3 + (0, 0, 0), (3, 0, 2))
    drawn.joint("mast", "hinge", "ground", "crane", axis=(0, 0, 1))
    drawn.joint("wrist", "hinge", "crane", "tip", at=(3, 0, 2.000001), axis=(1, 0, 0))
    rates = Running(drawn.compiled(everything=True)).rates({"m.wrist.phi": 0.1})
    expected = -9.81 * 1e-6 * np.sin(0.1) / (1e-12 + 1e-11)
    assert rates["m.wrist.phi.omega"] == pytest.approx(expected, rel=1e-9)
