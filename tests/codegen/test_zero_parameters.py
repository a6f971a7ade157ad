"""Programs for all values of parameters whose values in the text are zeros by which such a program would divide: those stay zero, as in the text."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph
from compiler.api import load_module

CASES = {
    "mass before the mass that moves": "parameter extra: kg = 0; I more : p = extra*v; body -> more",
    "spring": "parameter k: N/m = 0; C spring : F = k*x; body -> spring",
    "loss beside a spring": "parameter r: N*s/m = 0; 1 side : translation; 0 node : translation; R slip : F = r*v; C soft : F = 8 [N/m]*x; body -> node -> side -> slip; node -> soft",
    "lever": "parameter n = 0; TF lever : v2 = n*v1; R far : F = 3 [N*s/m]*v; body -> lever -> far",
    "two masses": "parameter g: kg = 0, h: kg = 0; I a : p = g*v; I b : p = h*v; body -> a, b",
    "two masses in a chain": "parameter g: kg = 0; I a : p = g*v; 1 other : translation; 0 node : translation; R r : F = 3 [N*s/m]*v; other -> a; body -> node -> r; node -> other",
}
MODEL = """model Z {{
  parameter m = 2 kg
  1 body
  {part}
  I mass : p = m*v {{ start v = 1 [m/s] }}
  R loss : F = 0.5 [N*s/m]*v
  body -> mass, loss
  output v = body.v
}}
"""


@pytest.mark.parametrize("name", CASES)
def test_what_is_zero_in_the_text_stays_zero(name: str) -> None:
    model = bondgraph.load(MODEL.format(part=CASES[name]))
    module = load_module("generated", model.compile())
    p = module.Parameters()
    with np.errstate(divide="raise", invalid="raise"):
        made = solve_ivp(module.derivative, (0.0, 1.0), module.start(p), "Radau", args=(p,), rtol=1e-9, atol=1e-12)
        v = module.outputs(1.0, made.y[:, -1], p)[0]
    assert v == pytest.approx(model.simulate(to=1, rtol=1e-10).final("v"), rel=1e-6)
