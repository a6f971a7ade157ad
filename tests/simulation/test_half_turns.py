"""Starts of attitudes of bodies behind other joints: turned about one axis, by up to half a turn."""

from __future__ import annotations

import math

import pytest

import bondgraph

TEXT = """model A {
  multibody s : spatial {
    body a { mass = 1 kg, inertia = (0.1 [kg*m^2], 0.2 [kg*m^2], 0.3 [kg*m^2]), at = (0.25 m, 0, 0) }
    body b { mass = 1 kg, inertia = (0.1 [kg*m^2], 0.2 [kg*m^2], 0.3 [kg*m^2]), at = (1 m, 0, 0), start attitude = (W, X, Y, Z) }
    FIRST
    SECOND { at = (0.5 m, 0, 0) }
  }
  output w = s.b.attitude.w, x = s.b.attitude.x, y = s.b.attitude.y, z = s.b.attitude.z
}"""


@pytest.mark.parametrize(
    ("first", "second", "angle"),
    [
        ("hinge h : ground to a { at = (0, 0, 0), about = (0, 1, 0) }", "ball j : a to b", 180), ("weld h : ground to a", "ball j : b to a", 180),
        ("slide h : ground to a { along = (1, 0, 0) }", "ball j : a to b", 170), ("ball h : a to ground { at = (0, 0, 0) }", "ball j : b to a", 180),
    ],
)  # fmt: skip
def test_a_body_behind_a_ball_starts_turned(first: str, second: str, angle: float) -> None:
    """Its components went in straight lines, which end before half a turn: "the model ties them to each other"."""
    half = math.radians(angle / 2)
    wanted = math.cos(half), 0.6 * math.sin(half), 0.8 * math.sin(half), 0.0
    text = TEXT.replace("FIRST", first).replace("SECOND", second)
    for letter, number in zip("WXYZ", wanted, strict=True):
        text = text.replace(letter, repr(float(number)), 1)
    run = bondgraph.load(text).simulate(to="1 ms", points=2)
    assert [abs(run[name][0]) for name in "wxyz"] == pytest.approx([abs(x) for x in wanted], abs=1e-9)
