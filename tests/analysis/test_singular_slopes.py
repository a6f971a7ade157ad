"""Slopes at a root of zero and on the boundary of conditions: those around the point, or refused; never the 0 that keeps steps of a run finite."""

from __future__ import annotations

import pytest

import bondgraph
from bondgraph.errors import RunFailed

TEXT = """model S {{
  parameter a = 1
  C spring : F = {law}
  I mass : p = 1 kg*v
  R loss : F = 1 [N*s/m]*v
  Se push : F = 0 N
  push -> 1(spring, mass, loss)
  output x = spring.x
}}
"""
INFINITE = [
    "2 N*sqrt(abs(x/1 m))*sign(x)",
    "2 N*sqrt(x/1 m)",
    "2 N*(x/1 m)^(1/3)",
    "-2 N*sqrt(-x/1 m)",
    "3 N*sign(x)*abs(x/1 m)^0.25",
    "1 N*sqrt(abs(x/1 m))*sign(x) + 5 [N/m]*x",
    "1 N*asin(sqrt(abs(x/1 m)))*sign(x)",
    "a*2 N*sqrt(abs(x/1 mm))*(1 if x > 0 m else -1)",
    "(2 N*sqrt(x/1 m) if x > 0 m else -2 N*sqrt(-x/1 m))",
    "2 N*sqrt(abs(tanh(x/1 m)))*sign(x)",
]
FINITE = [
    ("2 [N/m]*x", 2.0),
    ("2 [N/m]*abs(x)*sign(x)", 2.0),
    ("2 [N/m^2]*x*abs(x)", 0.0),
    ("2 [N/m]*x*sqrt(abs(x/1 m))", 0.0),
    ("3 [N/m]*x + 1 [N/m]*x*sqrt(abs(x/1 m))", 3.0),
    ("2 N*tanh(x/1e-9 [m])", 2e9),
    ("2 [N/m]*abs(x)*(1 if x > 0 m else -1)", 2.0),
    ("7 [N/m]*abs(abs(x)*sign(x))*sign(x)", 7.0),
    ("4 N*sqrt(abs(x/1 m))*sqrt(abs(x/1 m))*sign(x)", 4.0),
    ("1 N*((x/1 m)^2 + 1e-12)^0.5*sign(x)*x/1 m", 0.0),
    ("5 [N/m]*max(x, 0 m) + 5 [N/m]*min(x, 0 m)", 5.0),
    ("5 [N/m]*max(x, 0 m) - 5 [N/m]*max(-x, 0 m)", 5.0),
    ("2 [N/m]*(x if x > 0 m else abs(x)*sign(x))", 2.0),
]


@pytest.mark.parametrize("law", INFINITE)
def test_an_infinite_slope_is_refused(law: str) -> None:
    model = bondgraph.load(TEXT.format(law=law))
    for analysis in (model.linearize, model.modes):
        with pytest.raises(RunFailed, match="no finite slope"):
            analysis()


@pytest.mark.parametrize(("law", "slope"), FINITE)
def test_a_finite_slope_is_that_of_both_sides(law: str, slope: float) -> None:
    linear = bondgraph.load(TEXT.format(law=law)).linearize()
    assert linear.A[1, 0] == pytest.approx(-slope, rel=1e-6, abs=1e-5)
