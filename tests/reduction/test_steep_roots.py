"""Roots as unknowns: with the root as the unknown's value the residual is zero and the rates are those of the law as written."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from compiler.compilation import Compilation
from compiler.scene import Scene
from compiler.source import Source
from tests.compiling import Running

LAWS = [  # with the number of unknowns
    ("R o : f = sign(e)*sqrt(abs(e))", 1),
    ("R o : e = f^3", 1),
    ("R o : f = 3*sign(e)*abs(2*e)^0.4/7", 1),
    ("R o : f = sign(e)*abs(e)^0.25", 0),
    ("R o : f = e/sqrt(abs(e))", 1),
    ("R o : f = sqrt(e) if e > 0 else -0.2*sqrt(-e)", 1),
    ("R o : f = sqrt(2*(e - 1)) if e > 1 else 0", 1),
    ("MR o : f = (2 + sin(time))*sign(e)*sqrt(abs(e)/(3 + cos(time))) + 1e-3*e", 1),
    ("MR o : f = sqrt(abs(time - 1))*e", 0),
    ("R o : f = e*sqrt(1 + e^2)", 0),
]


@pytest.mark.parametrize(("law", "unknowns"), LAWS)
def test_rates_are_those_of_the_law(law: str, unknowns: int) -> None:
    text = f"plain model M {{\n  C t : q = 0.5*e\n  Sf s : f = sin(time)\n  {law}\n  s -> 0(t, o)\n  output f = o.f\n}}"
    written = Compilation(Source("made.bg", text), Scene())
    rooted = replace(written, scene=Scene(steep=True))
    assert written.facts.steep == (unknowns > 0)
    assert written.facts.identity == rooted.facts.identity
    assert len(rooted.program.unknowns.names) == unknowns
    plain, implicit = Running(written), Running(rooted)
    for q in (-1.3, -0.2, 0.0, 0.4, 1.7):
        rate = plain.rates({"t.q": q}, 0.7)["t.q"]

        def values(u: float, q: float = q) -> Any:
            arguments = implicit.arguments(0.7, {"t.q": q}, None)
            return implicit.program.derivative(arguments[0], np.array([q, *[u] * unknowns]), *arguments[2:])

        u = brentq(lambda u: values(u)[1], -10, 10, xtol=1e-14) if unknowns else 0.0
        assert values(u)[0] == pytest.approx(rate, abs=1e-9)
