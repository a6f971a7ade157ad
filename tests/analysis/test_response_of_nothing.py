"""Responses whose terms cancel, of which rounding leaves no response; and peaks of poles that rounding alone keeps apart."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph

TWO = """model B {
  parameter r = 3.3
  input u = 1 N
  MSe pa : F = u
  MSe pb : F = r*u
  1 a
  1 b
  I ma : p = 1 [kg]*v
  I mb : p = r*1 [kg]*v
  C ka : F = 10 [N/m]*x
  C kb : F = r*10 [N/m]*x
  R ra : F = 0.1 [N*s/m]*v
  R rb : F = r*0.1 [N*s/m]*v
  pa -> a -> ma, ka, ra
  pb -> b -> mb, kb, rb
  output d = ka.x - kb.x, near = ka.x - (1 + 1e-12)*kb.x, x = ka.x
}"""


@pytest.mark.parametrize("ratio", ["3.3", "0.7", "1e-3", "1e7"])
def test_a_difference_of_equal_responses_is_none(ratio: str) -> None:
    """Five peaks of 3e-14 m/N were told, and phases of seven turns."""
    model = bondgraph.load(TWO)
    found = model.response(["u"], ["d", "near", "x"], settings={"r": ratio}, points=30)
    assert not found.of("u", "d").any() and not found.extrema_of("u", "d")
    size = np.abs(found.of("u", "x"))
    assert np.abs(found.of("u", "near")).max() < 1e-11 * size.max()  # a part of 1e-12 is none that rounding leaves
    assert np.abs(np.abs(found.of("u", "near"))[0] / size[0] - 1e-12) < 1e-13
    assert [e.kind for e in found.extrema_of("u", "x")] == ["peak"]
