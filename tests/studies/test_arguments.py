"""Analyses with settings: numbers are arguments of one program, and what comes out is what a text with these numbers gives."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from bondgraph.analysis.modes import moving_frequencies
from bondgraph.analysis.operating_point import Asked, operating_point
from bondgraph.analysis.sensitivity import balanced_step
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
    alone = moving_frequencies(operating_point(model, Asked(settings=settings)))
    assert alone == [m.frequency for m in whole if m.frequency > 0] and len(alone) == 6
    text = (MODELS / "manipulator.bg").read_text(encoding="utf-8")
    text = text.replace("(1.95, 1.75, 1.75)", "(1.9, 1.75, 1.75)").replace("(130, 158, 158)", "(130, 150, 158)")
    copy = bondgraph.load(MODELS / "manipulator.bg")
    copy = bondgraph.Model(
        type(copy.source)("manipulator.bg", text.replace("f      = 0.4375", "f      = 0.42"), MODELS / "manipulator.bg")
    )
    assert [m.frequency for m in copy.modes()] == pytest.approx(alone, rel=1e-12)
