"""Resistors of very different size in series and in parallel: runs that are right and short, for any ratio.

Computed in the wrong direction, a flow is a difference of nearly equal efforts divided by the small resistance. Its round-off is noise on
the right side, and at a ratio of 1e10 the solver does not come to an end.
"""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from bondgraph.simulation.integrators import exponential
from compiler.causality import CausalGraph, StrokeReason
from tests.compiling import compiled

RATIOS = [1e0, 1e2, 1e4, 1e6, 1e8, 1e10, 1e12]


def line(small: float, *, dual: bool, gear: float | None = None, swapped: bool = False) -> str:
    """A supply fills a storage through a large and a small resistor in series (dual: in parallel), with a leak at the end."""
    e, f, one, zero, source, storage = "ef10" + "SC" if not dual else "fe01" + "SI"
    first, last = (1e10, small) if not swapped else (small, 1e10)
    stored = "e = 1e13*q" if not dual else "f = 1e13*p"
    law = f"TF gear : e1 = {gear}*e2" if not dual else f"TF gear : f1 = {gear}*f2"
    between = "between -> gear -> second" if gear else "between -> second"
    scale = 1.0 if gear is None else gear**2
    return "\n".join(
        [
            "plain model A {",
            f"  {source}{e} supply : {e} = 8e6",
            f"  R throttle : {e} = {first}*{f}",
            f"  R nipple : {f} = {e}/{last / scale!r}",
            f"  R leak : {e} = {1e16 / scale!r}*{f}",
            f"  {storage} oil : {stored}",
            f"  {zero} chamber",
            f"  {one} between, second",
            f"  {law}" if gear else "",
            f"  supply -> {one}(throttle) -> between",
            f"  {between}",
            "  second -> nipple, chamber",
            "  chamber -> oil, leak",
            f"  output P = oil.{e}, Q = nipple.{f}",
            "}",
            "",
        ]
    )


@pytest.fixture(params=["exactly", "by steps"])
def method(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Linear models are solved exactly; here by steps too, which round-off could hold up."""
    if request.param == "by steps":
        monkeypatch.setattr(exponential, "linear_form", lambda *_: None)


@pytest.mark.few(20)
@pytest.mark.usefixtures("method")
@pytest.mark.parametrize("gear", [None, 3.0, 1e-4])
@pytest.mark.parametrize("dual", [False, True], ids=["in series", "in parallel"])
@pytest.mark.parametrize("ratio", RATIOS)
def test_filling_through_two_resistors(ratio: float, dual: bool, gear: float | None) -> None:
    text = line(1e10 / ratio, dual=dual, gear=gear)
    n = gear or 1.0
    capacity = 1e-13 / n**2  # as seen from the supply
    conductance, leak = 1 / (1e10 + 1e10 / ratio), 1e-16
    last, pace = 8e6 * conductance / (conductance + leak), (conductance + leak) / capacity
    end = 20 / pace
    result = bondgraph.load(text).simulate(to=end, rtol=1e-9, points=41)
    pressure = last * (1 - np.exp(-result.time * pace))
    flow = (8e6 - pressure) * conductance
    np.testing.assert_allclose(result["P"], pressure / n, rtol=0, atol=1e-7 * last / n)
    np.testing.assert_allclose(result["Q"], flow * n, rtol=0, atol=1e-7 * 8e-4 * n)
    assert result.steps < 400, "round-off holds the solver up"


@pytest.mark.usefixtures("method")
@pytest.mark.parametrize("dual", [False, True])
def test_the_order_of_the_line_does_not_matter(dual: bool) -> None:
    for swapped in (False, True):
        result = bondgraph.load(line(1.0, dual=dual, swapped=swapped)).simulate(to=0.02, rtol=1e-9, points=5)
        assert result.steps < 400
        assert result.final("P") == pytest.approx(8e6 / (1 + 1e-6), rel=1e-6)


# ---------------------------------------------------------------- who decides


def decided(text: str, settings: dict[str, float] | None = None, free: tuple[str, ...] = ()) -> dict[str, str]:
    """For each resistor the variable that it determines."""
    causal: CausalGraph = compiled(text, settings, free=free, everything=True).causal
    found = {}
    for number, node in enumerate(causal.graph.nodes):
        if node.kind.value == "R":
            (bond,) = causal.graph.incident[number]
            found[node.name] = "effort" if causal.decides_effort(bond, number) else "flow"
    return found


SERIES = "plain model A {\n  parameter big = 1e6, odd = 5\n  Se s : e = 1\n  1 a, b\n  R x : e = 10*f\n  R y : e = big*f\n  R z : e = 0.1*f\n  s -> a -> x, b\n  b -> y, z\n  output o = x.f\n}\n"


class TestRule:
    def test_in_series_the_largest_decides_the_flow(self) -> None:
        """Adjacent equal junctions count as one."""
        assert decided(SERIES) == {"x": "effort", "y": "flow", "z": "effort"}

    def test_in_parallel_the_smallest_decides_the_effort(self) -> None:
        text = SERIES.replace("Se s : e", "Sf s : f").replace("  1 a, b", "  0 a, b")
        assert decided(text) == {"x": "flow", "y": "flow", "z": "effort"}

    def test_settings_of_the_scene_count(self) -> None:
        assert decided(SERIES, {"big": 1e-6}) == {"x": "flow", "y": "effort", "z": "effort"}

    def test_the_order_of_declaration_does_not_count(self) -> None:
        lines = SERIES.split("\n")
        order = [*lines[:4], lines[6], lines[5], lines[4], *lines[7:]]
        assert decided("\n".join(order)) == decided(SERIES)

    def test_what_is_not_linear_or_not_known_goes_as_written(self) -> None:
        nonlinear = SERIES.replace("e = 10*f", "e = 10*f + f^3").replace("e = big*f", "f = e/big")
        assert decided(nonlinear)["x"] == "effort"
        modulated = "plain model A {\n  Se s : e = 1\n  1 a\n  R x : e = 2*f\n  MR y : e = (2 + sin(time))*f\n  s -> a -> y, x\n  output o = x.f\n}\n"
        assert decided(modulated) == {"x": "effort", "y": "flow"}
        assert decided(modulated.replace("e = 2*f", "f = e/2")) == {"x": "flow", "y": "effort"}

    def test_a_wish_of_the_author_is_stronger(self) -> None:
        text = SERIES.replace("R z : e = 0.1*f", "R z : e = 0.1*f { prefer = flow }")
        assert decided(text) == {"x": "effort", "y": "effort", "z": "flow"}

    def test_through_a_gyrator_large_is_small(self) -> None:
        """A GY makes 0.1 on its other side 40, of k = 2: the largest as seen from here, so its flow here decides."""
        text = "plain model A {\n  Se s : e = 1\n  1 a\n  1 b\n  GY g : e1 = 2*f2\n  R x : e = 10*f\n  R y : e = {}*f\n  s -> a -> x, g\n  g -> b -> y\n  output o = x.f\n}\n"
        assert decided(text.replace("{}", "0.1")) == {"x": "effort", "y": "effort"}
        assert decided(text.replace("{}", "1")) == {"x": "flow", "y": "flow"}

    def test_through_a_transformer_by_the_square_of_its_ratio(self) -> None:
        text = "plain model A {\n  Se s : e = 1\n  1 a, b\n  TF g : e1 = 10*e2\n  R x : e = 10*f\n  R y : e = {}*f\n  s -> a -> x, g\n  g -> b -> y\n  output o = x.f\n}\n"
        assert decided(text.replace("{}", "0.2")) == {"x": "effort", "y": "flow"}
        assert decided(text.replace("{}", "0.05")) == {"x": "flow", "y": "effort"}

    @pytest.mark.parametrize("law", ["1e200*e1 = 1e-200*e2", "1e-200*e1 = 1e200*e2"])
    def test_through_a_ratio_without_a_logarithm_none_is_compared(self, law: str) -> None:
        """It rounds to 0 or to infinity: the smaller resistance decides as the larger one."""
        text = "plain model A {\n  Se s : e = 1\n  1 a, b\n  TF g : LAW\n  R x : e = 10*f\n  R y : e = {}*f\n  s -> a -> x, g\n  g -> b -> y\n  output o = x.f\n}\n"
        found = [decided(text.replace("LAW", law).replace("{}", y)) for y in ("0.2", "0.05")]
        assert found[0] == found[1]

    def test_why_is_told(self) -> None:
        causal = compiled(SERIES, everything=True).causal
        assert {r.because for r in causal.reasons} == {
            StrokeReason.SOURCE,
            StrokeReason.CONDITIONED,
            StrokeReason.FOLLOWS,
        }
