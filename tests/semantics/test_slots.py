"""A slot takes any model with the same ports."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph

PARTS = """
model Soft { port tip: translation; parameter k: N/m = 10; C spring : F = k*x; tip -> spring }
model Hard { port tip: translation; parameter k: N/m = 10; C spring : F = 4*k*x; tip -> spring }
model Odd { port tip: rotation; C spring : M = 1 [N*m]*phi; tip -> spring }
model Arm {
  parameter Joint: model = Soft
  Joint joint { k = 20 [N/m] }
  I mass : p = 0.2 kg*v             { start v = 1 [m/s] }
  1(mass) -> joint.tip
  output x = joint.spring.x
}
"""


def top(value: str) -> str:
    return PARTS + f"model Both {{ Arm left\n Arm right {{ Joint = {value} }}\n output a = left.x, b = right.x }}"


def test_the_default_and_the_replacement_stand_side_by_side() -> None:
    result = bondgraph.load(top("Hard"), "Both").simulate(to=0.3, rtol=1e-9, points=7)
    assert result["a"] == pytest.approx(np.sin(10 * result.time) / 10, abs=1e-8)
    assert result["b"] == pytest.approx(np.sin(20 * result.time) / 20, abs=1e-8)


def test_a_setting_replaces_it_too() -> None:
    result = bondgraph.load(PARTS, "Arm").simulate(settings={"Joint": "Hard"}, to=0.3, rtol=1e-9, points=3)
    assert result.final("x") == pytest.approx(np.sin(6.0) / 20, abs=1e-8)


@pytest.mark.parametrize(("value", "code"), [("Odd", "BG121"), ("Nothing", "BG105"), ("3", "BG105")])
def test_what_does_not_fit_is_told_once(value: str, code: str) -> None:
    found = bondgraph.check(top(value), "Both")
    assert [d.code for d in found] == [code]
