"""Analyses with settings: numbers are arguments of one program, and results equal those of a text with these numbers."""

from __future__ import annotations

import re

import numpy as np
import pytest

import bondgraph
from bondgraph.analysis.modes import moving_frequencies
from bondgraph.analysis.placement import operating_point
from bondgraph.analysis.sensitivity import balanced_step
from bondgraph.keywords import AnalysisRequest
from tests.compiling import MODELS

TEXT = """
model Loaded {
  parameter k: N/m = 3, k3: N/m^3 = 5, m = 2 kg, r: N*s/m = 0.1, load: N = 4
  parameter stiff = 2*k
  Se push : F = load
  I mass : p = m*v
  R drag : F = r*v
  C spring : F = k*x + k3*x^3
  C second : F = stiff*x
  push -> 1(mass, drag, spring, second)
  output x = spring.x, both = spring.F + second.F
}
"""


def written(**values: float) -> str:
    text = TEXT
    for name, value in values.items():
        old = next(part for part in ("k: N/m = 3", "k3: N/m^3 = 5", "load: N = 4") if part.startswith(f"{name}:"))
        text = text.replace(old, old.rpartition("=")[0] + f"= {value}")
    return text


def test_settings_are_arguments_of_one_program() -> None:
    model = bondgraph.load(TEXT)
    values = [{"k": 3.0 + i, "load": 1.0 + i} for i in range(5)]
    found = [model.equilibrium(settings=s) for s in values]
    programs = lambda: sum("lowered" in c.__dict__ for c in model._compilations.values())  # noqa: E731
    assert programs() == 1
    for settings, here in zip(values, found, strict=True):
        k, x = settings["k"], here["x"]
        assert 3 * k * x + 5 * x**3 == pytest.approx(settings["load"], rel=1e-12)
        alone = bondgraph.load(written(**settings)).equilibrium()
        assert alone["x"] == pytest.approx(x, rel=1e-14) and alone.growth == pytest.approx(here.growth, rel=1e-9)
    for settings in values:
        model.modes(settings=settings)
        model.linearize(("load",), settings=settings)
        model.sensitivity(("load", "m"), settings={"k": settings["k"]})
    assert programs() == 4  # of what is set, of it with the slopes by a load; of `k` alone, and with its slopes


def test_what_is_set_is_told_and_differentiated_by() -> None:
    model = bondgraph.load(TEXT)
    linear = model.linearize(("load", "k"), ("x",), settings={"k": 5.0, "load": "6 N"})
    assert linear.u.tolist() == [6.0, 5.0]
    x = linear.y[0]
    slopes = linear.C @ balanced_step(linear.A, linear.B)[0] + linear.D
    tangent = 3 * 5.0 + 15 * x**2
    assert slopes[0] == pytest.approx([1 / tangent, -3 * x / tangent], rel=1e-12)
    found = model.sensitivity(("k",), of="modes", settings={"k": 5.0})
    natural = np.sqrt((3 * 5.0 + 15 * model.equilibrium(settings={"k": 5.0})["x"] ** 2) / 2) / (2 * np.pi)
    assert found.values[0] == pytest.approx(natural, rel=1e-9) and found.at.tolist() == [5.0]


def test_zeros() -> None:
    """A spring that is linear, and one that gives nothing: as good as any other number."""
    model = bondgraph.load(TEXT)
    assert model.equilibrium(settings={"k3": 0.0, "load": 4.0})["x"] == pytest.approx(4 / 9, rel=1e-14)
    assert model.equilibrium(settings={"k": 0.0})["x"] == pytest.approx((4 / 5) ** (1 / 3), rel=1e-12)
    assert model.modes(settings={"r": 0.0})[-1].damping == pytest.approx(0.0, abs=1e-12)


def test_frequencies_alone_are_those_of_the_modes() -> None:
    model = bondgraph.load(MODELS / "manipulator.bg")
    settings = {"d[1]": 1.9e-6, "E[2]": "150 GPa", "f": 0.42}
    whole = model.modes(settings=settings)
    alone = moving_frequencies(operating_point(model, AnalysisRequest(settings=settings)))
    assert alone == [m.frequency for m in whole if m.frequency > 0] and len(alone) == 6
    text = (MODELS / "manipulator.bg").read_text(encoding="utf-8")
    text = text.replace("(1.95, 1.75, 1.75)", "(1.9, 1.75, 1.75)").replace("(130, 158, 158)", "(130, 150, 158)")
    copy = bondgraph.load(MODELS / "manipulator.bg")
    copy = bondgraph.Model(
        type(copy.source)("manipulator.bg", text.replace("f      = 0.4375", "f      = 0.42"), MODELS / "manipulator.bg")
    )
    assert [m.frequency for m in copy.modes()] == pytest.approx(alone, rel=1e-12)


SPATIAL = (MODELS / "spatial_slider_crank.bg").read_text(encoding="utf-8")
VALUES = {"r": 85e-3, "l": 0.31, "beside": 90e-3, "above": 110e-3, "J": 2.2e-3, "m_rod": 0.35, "J_rod": 3e-5}


def test_geometry_in_space_is_an_argument() -> None:
    """Places, axes and inertias: one program for all of them, and the rates that a text with these numbers gives."""
    model = bondgraph.load(SPATIAL)
    asked = AnalysisRequest(None, VALUES, state="start")
    found = operating_point(model, asked)
    model.operating_point(AnalysisRequest(None, {n: 1.01 * v for n, v in VALUES.items()}, state="start"))
    assert sum("lowered" in c.__dict__ for c in model._compilations.values()) == 1
    written, metres, moment = SPATIAL, "[m]", "[kg*m^2]"
    for name, unit in {
        "r": metres,
        "l": metres,
        "beside": metres,
        "above": metres,
        "J": moment,
        "m_rod": "kg",
        "J_rod": moment,
    }.items():
        written, count = re.subn(
            rf"\b{name} = [-0-9.e]+ (\[[^]]*\]|\w+)", f"{name} = {VALUES[name]!r} {unit}", written, count=1
        )
        assert count == 1
    alone = bondgraph.load(written).operating_point(AnalysisRequest(None, state="start"))
    assert alone.program.states.names == found.program.states.names
    assert found.state == pytest.approx(alone.state, rel=1e-12, abs=1e-15)
    assert found.rates == pytest.approx(alone.rates, rel=1e-10, abs=1e-12)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"J": -1e-3}, "The inertia of `crank` is impossible"),
        ({"m_rod": -0.1}, "The mass of `rod` is negative"),
        ({"r": -120e-3, "beside": 1e-320}, "Both axes of the universal joint `eye` are parallel"),
    ],
)
def test_what_a_run_sets_is_refused_as_a_text_would_be(settings: dict[str, float], told: str) -> None:
    with pytest.raises(bondgraph.CompilationFailed, match=told):
        bondgraph.load(SPATIAL).equilibrium(settings=settings)


def test_a_root_of_what_is_set_is_no_defect() -> None:
    """`sqrt(coupler^2 - …)` where nobody knows the lengths before the run."""
    model = bondgraph.load(MODELS / "four_bar.bg")
    found = model.operating_point(AnalysisRequest(None, {"rocker": 0.36}, state="start"))
    alone = model.operating_point(AnalysisRequest(None, {"rocker": "0.3 m + 0.06 m"}, state="start"))
    assert found.rates == pytest.approx(alone.rates, rel=1e-9, abs=1e-12)


PARALLEL = """
model Parallel {
  parameter n = 2, k: N/m = 3, load: N = 4
  Se push : F = load
  1 body
  push -> body
  for i in 1..n { C spring[i] : F = k*x;  R drag[i] : F = 1 [N*s/m]*v;  body -> spring[i], drag[i] }
  output x = spring[1].x
}
"""


def test_what_is_compiled_at_each_value_is_told() -> None:
    """n springs side by side: x = load/(n k)."""
    model = bondgraph.load(PARALLEL)
    found = model.sweep({"n": "1, 3", "load": "1 N, 2 N"}, of="equilibrium")
    assert found("x") == pytest.approx(found("load") / (3 * found("n")), rel=1e-12)
    (note,) = found.notes
    assert note.startswith("`n` is compiled into the model anew at each of its 2 values") and "`for i in 1..n {" in note
    assert note in found.summary() and found.to_json()["notes"] == [note]
    assert model.sweep({"k": "1 N/m, 2 N/m", "load": "1 N, 2 N"}, of="equilibrium").notes == ()
    study = model.montecarlo({"k": "uniform(3 N/m, 4 N/m)"}, of="equilibrium", samples=4, indices=0)
    assert study.notes == ()
