"""Smooth pulses of time, of any width: no step passes over them, and they determine the magnitudes of states."""

from __future__ import annotations

import math

import pytest
from scipy.optimize import brentq

import bondgraph

TARGETS = ["numpy", pytest.param("native", marks=pytest.mark.machine_code)]
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


@pytest.mark.few(6)
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


SQUARE = """model Clocked {
  parameter R = 1 ohm
  Se clock : u = 5 V if sin(2*pi*1 [1/s]*time) > 0 else 0 V
  R wire : u = R*i
  C plates : q = 1 uF*u
  R leak : i = 1e-3 [A/V]*u + 1e-3 [A/V^3]*u^3
  0 n : electric
  clock -> 1(wire) -> n -> plates, leak
  output u = plates.u
}
"""


@pytest.mark.parametrize(("resistance", "rtol"), [(0.338, 1e-4), (0.428, 1e-4), (0.38, 1e-6), (7.27, 1e-6)])
@pytest.mark.parametrize("target", TARGETS)
def test_what_a_jump_leaves_of_a_charge_tells_no_first_step(target: str, resistance: float, rtol: float) -> None:
    """A wire of a microsecond, switched each half second: where a step of 1e-16 s was chosen, it was below round-off of the time."""
    found = bondgraph.load(SQUARE).simulate(
        settings={"R": resistance}, to=20.0, points=81, rtol=rtol, target=target, solver="radau"
    )
    on = brentq(lambda u: (5 - u) / resistance - 1e-3 * u - 1e-3 * u**3, 0, 5)
    assert found["u"][1::4] == pytest.approx(on, rel=5 * rtol)  # in the middle of each half second
    assert abs(found["u"][3::4]).max() < 5 * rtol * on
