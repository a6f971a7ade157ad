"""Pulses of time that are smooth, and however narrow: no step goes over them, and they tell how large a state will be."""

from __future__ import annotations

import math

import pytest

import bondgraph

AT, END, DRAG = 3.1234, 6.0, 1e-3
TEXT = """model Struck {{
  parameter w = 1 s
  I  mass : p = 1 kg*v
  R  drag : F = {drag} [kg/m]*v*abs(v)
  Se push : F = 1 N*{shape}/(w/1 s)
  push -> 1(mass, drag)
  output v = mass.v
}}
"""
SHAPES = {
    "bell": (f"exp(-((time - {AT} s)/w)^2)", math.sqrt(math.pi)),
    "bell of a product": (f"exp(-(time - {AT} s)*(time - {AT} s)/w^2)", math.sqrt(math.pi)),
    "Lorentz": (f"1/(1 + ((time - {AT} s)/w)^2)^2", math.pi / 2),
    "slope of tanh": (f"(1 - tanh((time - {AT} s)/w)^2)", 2.0),
}


@pytest.mark.parametrize("width", [5e-2, 1e-2, 1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("shape", SHAPES)
def test_a_narrow_pulse_gives_its_momentum(shape: str, width: float) -> None:
    """m v' = F - c v^2: after a short blow v0 at t0, v = v0/(1 + c v0 (t - t0)); the drag within the blow is below c v0 w."""
    formula, v0 = SHAPES[shape]
    found = bondgraph.load(TEXT.format(drag=DRAG, shape=formula)).simulate(settings={"w": width}, to=END, points=2)
    expected = v0 / (1 + DRAG * v0 * (END - AT))
    assert found.final("v") == pytest.approx(expected, rel=1e-5 + 3 * DRAG * v0 * width)
    assert found.steps < 400


def test_a_linear_model_meets_it_too() -> None:
    """Without drag the rates are linear and forced by the pulse."""
    text = TEXT.format(drag=DRAG, shape=SHAPES["bell"][0]).replace("*v*abs(v)", "*v*0 [m/s]")
    found = bondgraph.load(text).simulate(settings={"w": 1e-4}, to=END, points=2)
    assert found.final("v") == pytest.approx(math.sqrt(math.pi), rel=1e-5)


def test_a_root_of_time_begins_where_it_has_no_slope() -> None:
    """v' = sqrt(max(t - t0, 0)): v = 2/3 (t - t0)^1.5."""
    text = f"plain model A {{\n  signal v = integral(sqrt(max(time - {AT}, 0)) - 1e-9*v^3, 0)\n  output y = v\n}}\n"
    found = bondgraph.load(text).simulate(to=END, points=2)
    assert found.final("y") == pytest.approx(2 / 3 * (END - AT) ** 1.5, rel=1e-5)
