"""Pictures of many runs: a curve for each, bands of many, what is told where there is nothing to draw."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed, UsageError
from bondgraph.presentation.plots.families import plot_surface

pytest.importorskip("matplotlib")

TEXT = """model Decay {
  parameter R = 1 ohm
  R r : u = R*i
  C c : q = 1 F*u { start q = 1 C }
  0 n : electric
  n -> r, c
  output u = c.u
  experiment go { simulate 0 .. 2 s { points = 5 }; report u in mV }
}
"""
TIMES = np.linspace(0, 2, 5)


@pytest.fixture(scope="module")
def model() -> Any:
    return bondgraph.load(TEXT)


def texts(panel: Any) -> list[str]:
    return [text.get_text() for text in panel.get_legend().get_texts()]


def test_a_curve_for_each_run(model: Any, tmp_path: Path) -> None:
    found = model.sweep({"R": "1 ohm, 2 ohm, 4 ohm"}, "simulate", experiment="go")
    figure = found.plot_curves(tmp_path / "curves.png")
    (panel,) = figure.axes
    for line, resistance in zip(panel.get_lines(), (1, 2, 4), strict=True):
        np.testing.assert_allclose(line.get_xdata(), TIMES)
        np.testing.assert_allclose(line.get_ydata(), 1e3 * np.exp(-TIMES / resistance), rtol=1e-6)
    assert texts(panel) == ["R = 1 ohm", "R = 2 ohm", "R = 4 ohm"]
    assert panel.get_ylabel() == "u [mV]" and (tmp_path / "curves.png").stat().st_size > 0


def test_bands_of_many(model: Any) -> None:
    resistances = np.linspace(1, 3, 41)
    (panel,) = model.simulate_many([{"R": float(r)} for r in resistances], experiment="go").plot().axes
    curves = 1e3 * np.exp(-TIMES / resistances[:, None])
    (median,) = panel.get_lines()
    np.testing.assert_allclose(median.get_ydata(), np.median(curves, axis=0), rtol=1e-6)
    for band, shares in zip(panel.collections, ((0, 100), (5, 95)), strict=True):
        edge = band.get_paths()[0].vertices[:, 1]
        np.testing.assert_allclose([edge.min(), edge.max()], [np.percentile(curves[:, -1], shares[0]), 1e3], rtol=1e-6)
    assert texts(panel) == ["all runs", "5 to 95 % of the runs", "median"]


def test_runs_that_end_at_other_instants_are_curves(model: Any) -> None:
    text = TEXT.replace("{ simulate", "{ stop when u < 0.5 V; simulate")
    (panel,) = bondgraph.load(text).simulate_many([{"R": 1 + k / 20} for k in range(20)], experiment="go").plot().axes
    assert len(panel.get_lines()) == 20 and not panel.collections
    assert all(line.get_ydata()[-1] == pytest.approx(500) for line in panel.get_lines())


def test_nothing_to_draw(model: Any) -> None:
    with pytest.raises(UsageError, match="nothing is simulated"):
        model.sweep({"R": "1 ohm, 2 ohm"}, "equilibrium").plot_curves()
    with pytest.raises(RunFailed, match="none of the runs"):
        model.simulate_many([{"R": "1/0"}, {"R": 0.0}], experiment="go").plot()


def test_swept_values_are_in_the_units_that_the_author_wrote() -> None:
    """Those of the text, or of a call's values: in tables, in legends, on axes; files are in SI."""
    text = """model M {
      parameter k_s = 10 kN/m, T = 20 degC
      Se push : F = 1 N
      C spring : F = k_s*x
      R air : F = 1 [N*s/m]*v
      push -> 1(spring, air)
      output x = spring.x, hot = T
      experiment stiff { sweep k_s = 10 kN/m, 20 kN/m; equilibrium; report x in um }
    }"""
    model = bondgraph.load(text)
    swept = model.run("stiff")
    rows = [line.split() for line in swept.summary().splitlines()[2:6]]
    assert rows == [["k_s", "x"], ["kN/m", "um"], ["10", "100"], ["20", "50"]]
    figure = swept.plot()
    assert figure.axes[-1].get_xlabel() == "k_s [kN/m]" and list(figure.axes[0].lines[0].get_xdata()) == [10, 20]
    assert list(swept("k_s")) == [10_000, 20_000]
    both = model.sweep({"k_s": "10 N/mm .. 20 N/mm : 2", "T": ["20 degC", "30 degC"]}, of="equilibrium")
    assert [line.split()[:2] for line in both.summary().splitlines()[2:7]] == [
        ["k_s", "T"],
        ["N/mm", "degC"],
        ["10", "20"],
        ["10", "30"],
        ["20", "20"],
    ]
    legend = both.plot().axes[0].get_legend()
    assert legend is not None and [t.get_text() for t in legend.get_texts()] == ["k_s = 10 N/mm", "k_s = 20 N/mm"]
    relief = plot_surface(both, None, "x")
    assert (relief.axes[0].get_xlabel(), relief.axes[0].get_ylabel()) == ("T [degC]", "k_s [N/mm]")


def test_a_response_is_without_dips_to_rounding_and_few_decades_have_ticks_at_1_2_and_5() -> None:
    """An absorber takes the motion at its frequency; a decline over many decades is shown whole."""
    text = """model Absorber {
      input f: N = 0 N
      MSe push : F = f
      I body : p = 1 [kg]*v
      C spring : F = 1000 [N/m]*x
      C hook : F = 100 [N/m]*x
      I ball : p = 1 [kg]*v
      1 frame : translation
      0 joint : translation
      push -> frame -> body, spring, joint
      joint -> hook, ball
      output v = body.v, u = ball.v
    }"""
    response = bondgraph.load(text).response(["f"], low=1.25 / np.pi, high=20 / np.pi, points=5)
    figure = response.plot()
    upper = figure.axes[0]
    values = upper.lines[0].get_ydata()
    at_dip = np.abs(response.frequencies - 5 / np.pi) < 1e-6
    assert response.magnitude[at_dip, 0, 0].max() < 1e-12 and min(values) == pytest.approx(1e-6 * max(values))
    np.testing.assert_array_equal(values[~at_dip], response.magnitude[~at_dip, 0, 0])
    assert texts(upper)[0].startswith("from f") and "cut at" in texts(upper)[0] and texts(figure.axes[2]) == ["from f"]
    ticks = (label.get_text() for minor in (False, True) for label in figure.axes[-1].get_xticklabels(minor=minor))
    assert {"0.5", "1", "2", "5"} <= set(ticks)
