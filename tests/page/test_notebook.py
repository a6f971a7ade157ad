"""Representations in notebooks: models with their picture, results with curves, equations typeset; hostile and very large ones too."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from bondgraph import Graph
from bondgraph.errors import UsageError
from bondgraph.results.records import Column
from bondgraph.results.result import Result
from tests.compiling import MODELS
from tests.page.test_page import HOSTILE, read


def test_a_model() -> None:
    model = bondgraph.load(MODELS / "oscillator.bg")
    shown = model._repr_html_()
    found = read(shown)
    assert "explicit ODE; 2 states" in shown and "k3 = 20000 N/m^3" in shown
    assert found.tags.count("svg") == 1 and model._repr_svg_() in shown


def test_a_wrong_model_tells_what_is_wrong() -> None:
    shown = bondgraph.load("model M { 1 body : translation; C c : F = k*x; body -> c }")._repr_html_()
    assert "line 1, column" in shown and "`k`" in shown


def test_a_hostile_model() -> None:
    found = read(bondgraph.load(HOSTILE)._repr_html_())
    assert not {"script", "img", "b"} & set(found.tags) and found.doing == []


def test_what_is_large_stays_small() -> None:
    parts = "\n".join(f"  1 a{i} : translation; R r{i} : F = {i + 1} [N*s/m]*v; a{i} -> r{i}" for i in range(100))
    model = bondgraph.load(f"model M {{\n{parts}\n}}")
    assert model._repr_svg_() is None and len(model._repr_html_()) < 5_000
    wide = Result("M", None, np.arange(3.0), tuple(Column(f"y{i}", "1") for i in range(900)), np.zeros((3, 900)))
    assert "and 860 more" in wide._repr_html_() and len(wide._repr_html_()) < 120_000


def test_a_result() -> None:
    time = np.linspace(0, 1, 11)
    result = Result(
        "M<b>", "<i>", time, (Column("x<script>", "m"), Column("gap", "1")), np.stack([time**2, time * np.nan], 1)
    )
    shown = result._repr_html_()
    found = read(shown)
    assert "script" not in found.tags and "b" not in found.tags
    assert found.tags.count("path") == 1  # there is no curve of what is no number
    assert "0.5" not in shown.split("<svg")[0] and ">1<" in shown.replace(" ", "")


def test_a_graph_that_is_built() -> None:
    g = Graph("M")
    mass = g.I("mass", "p = 2 [kg]*v", start={"v": "1 [m/s]"})
    body = g.one("body", "translation")
    body >> (mass, g.C("spring", "F = 8 [N/m]*x"))
    assert "<svg" in g._repr_html_() and "2 states" in g._repr_html_()


def test_equations() -> None:
    model = bondgraph.load(MODELS / "oscillator.bg")
    shown = model.state_equations()._repr_latex_()
    assert shown.startswith("$") and shown.endswith("$") and shown.count(r"\frac{\mathrm{d}}{\mathrm{d}t}") == 2
    assert r"\mathrm{spring.x}" in shown and r"\frac{\mathrm{mass.p}}{\mathrm{m}}" in shown
    assert dict(model.state_equations()) == model.state_equations()
    assert model.algebraic_equations() == {} and model.algebraic_equations()._repr_latex_() is None


def test_many_equations_are_cut() -> None:
    import sympy

    from bondgraph.analysis.symbolic import SymbolicEquations

    shown = SymbolicEquations({f"x{i}": sympy.Symbol("y$_{}") for i in range(100)}, rates=True)._repr_latex_()
    assert "and 60 more" in shown and shown.count("$") == 2 + 40 and shown.count(r"\$") == 40


def test_a_bond_graph() -> None:
    shown = bondgraph.load(MODELS / "dc_motor.bg").compilation().whole_graph._repr_html_()
    assert "11 nodes, 10 bonds" in shown and shown.count("<tr>") == 10
    assert "<td>GY motor</td><td>&#8640;</td><td>1 rotor</td><td>rotation</td><td>line 24</td>" in shown
    long = "\n".join(f"  1 a{i} : translation; R r{i} : F = {i + 1} [N*s/m]*v; a{i} -> r{i}" for i in range(100))
    graph = bondgraph.load(f"model M {{\n{long}\n}}").compilation().whole_graph
    assert "and 40 more" in graph._repr_html_() and len(graph._repr_html_()) < 12_000


RC = """model Rc {
  parameter U = 1 V
  Se source : u = U
  1  loop   : electric
  R  r      : u = 1 ohm*i
  C  c      : q = 1 F*u
  source -> loop -> r, c
  output a = c.u, b = r.u, i = loop.i
  experiment go { simulate 0 .. 3 s { points = 7 } }
}
"""


def test_what_an_analysis_shows_is_its_table_and_its_picture() -> None:
    model = bondgraph.load(RC)
    modes, sweep = model.modes(), model.sweep({"U": ["1 V", "2 V"]}, of="equilibrium")
    assert repr(modes) == modes.summary()
    for result in (modes, sweep):
        assert 'src="data:image/png;base64,' in result._repr_html_()


def test_modes_are_lines_over_frequency_and_a_path_is_in_the_units_of_its_report() -> None:
    """The same curves as on the page; into axes of the caller where there are as many as panels."""
    from matplotlib.figure import Figure

    model = bondgraph.load(RC.replace("simulate 0", "report a in mV; simulate 0"))
    shapes = model.modes()
    figure = shapes.plot()
    np.testing.assert_allclose(figure.axes[0].lines[0].get_xydata(), [(0.5 / np.pi, y) for y in (0, 1, np.nan)])
    above, below = panels = Figure().subplots(2)
    assert shapes.plot(ax=above) is above.figure and above.get_xscale() == "log"
    with pytest.raises(UsageError, match="1 panels to draw, one for each unit, and 2 axes"):
        shapes.plot(ax=panels)
    still = bondgraph.load("model M { Se f : F = 0 N; I m : p = 1 [kg]*v; f -> m; output v = m.v }").modes()
    assert "<img" not in still._repr_html_()
    path = model.invert({"a": "1 V*smoothstep9(time, 0 s, 1 s)"}, ["U"], to="1 s", points=5)
    assert path.plot(ax=panels) is below.figure and "<img" in path._repr_html_()
    assert [panel.get_ylabel() for panel in panels] == ["[mV]", "[V]"]
    np.testing.assert_allclose(above.lines[-1].get_ydata(), 1e3 * path["a"])


def test_plots_are_figures_and_go_into_axes() -> None:
    from matplotlib.figure import Figure

    result = bondgraph.load(RC).simulate()
    figure = result.plot()
    assert [panel.get_ylabel() for panel in figure.axes] == ["[V]", "i [A]"]
    panel = Figure().subplots()
    with pytest.raises(bondgraph.UsageError, match="2 panels to draw, one for each unit, and 1 axes"):
        result.plot(ax=panel)
    with pytest.raises(bondgraph.UsageError, match="give `ax` alone"):
        result.plot(over="a", ax=panel)
    both = Figure().subplots(2)
    assert result.plot(ax=both) is both[0].figure and [len(one.lines) for one in both] == [2, 1]
    alone = bondgraph.load(RC.replace(", i = loop.i", "")).simulate()
    assert alone.plot(ax=panel) is panel.figure
    np.testing.assert_array_equal(panel.lines[1].get_ydata(), alone["b"])
    alone.plot(ax=panel)
    assert [text.get_text() for text in panel.get_legend().get_texts()] == ["a", "b", "a", "b"]


def test_sliders_run_the_model_at_their_values() -> None:
    """In the author's unit, first at the model's value; a change makes a new plot; what fails is told in its place."""
    pytest.importorskip("ipywidgets")
    model = bondgraph.load(RC)
    box = model.explore({"U": "500 mV .. 3000 mV"}, outputs=["a"])
    slider, plot, text = box.children
    assert (slider.min, slider.max, slider.value, slider.description) == (500.0, 3000.0, 1000.0, "U [mV]")
    first = plot.value
    slider.value = 2000.0
    assert f"{model.simulate(settings={'U': '2 V'}).final('a'):.6g}" in text.value and plot.value != first
    for wrong, reason in (
        ("2 V .. 1 V", "from low to high"),
        ("2 V", "LOW .. HIGH"),
        ("", "two ends"),
        ("log 0 .. 2 V", "two ends"),
        ("1 m .. 2 m", "no quantity"),
    ):
        with pytest.raises(UsageError, match=reason):
            model.explore({"U": wrong})
    bounded = bondgraph.load(RC.replace("u = U", "u = 1 V*sqrt(2 - U/1 [V])"))
    slider, _, text = bounded.explore({"U": "log 100 mV .. 10 V"}).children
    assert (slider.min, slider.max, slider.value, slider.description) == (-1.0, 1.0, 1.0, "U [V]")
    slider.value = 3.0
    assert "square root" in text.value


def test_studies_are_tables_of_pandas() -> None:
    model = bondgraph.load(RC)
    table = model.sweep({"U": ["1 V", "2 V"]}, of="equilibrium").to_pandas()
    assert list(table["a"]) == [1.0, 2.0] and list(table.index) == [1.0, 2.0]
    runs = model.simulate_many([{"U": 1.0}, {"U": 2.0}]).to_pandas()
    np.testing.assert_allclose(runs.loc[(1.0, 3.0), "a"], 2 * runs.loc[(0.0, 3.0), "a"], rtol=1e-12)


def test_a_cell_of_a_notebook_is_a_model() -> None:
    """`%%bg` in a shell of IPython: the name, the picture, errors that are shown, a name that is none."""
    pytest.importorskip("IPython")
    from IPython.core.interactiveshell import InteractiveShell
    from traitlets.config import Config

    shell = InteractiveShell(
        config=Config({"HistoryManager": {"enabled": False}, "InteractiveShell": {"warn_venv": False}})
    )
    shell.run_line_magic("load_ext", "bondgraph")
    text = (MODELS / "rlc.bg").read_text(encoding="utf-8")
    shell.run_cell_magic("bg", "", text)
    shown = shell.run_cell_magic("bg", "car", text)
    assert shell.user_ns["car"] is shown and shell.user_ns["model"].name == shown.name
    assert "<svg" in shown._repr_html_()
    assert "BG101" in shell.run_cell_magic("bg", "wrong", "model A { C c : F = k*x }")._repr_html_()
    with pytest.raises(UsageError, match="cannot be a name"):
        shell.run_cell_magic("bg", "a b", text)
    assert "a b" not in shell.user_ns
