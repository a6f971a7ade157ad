"""The text for diffsol: its rates, outputs and starts against those of the module for numpy, and solved where diffsol is installed."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest

import bondgraph
from compiler.compilation import Compilation
from compiler.errors import CompilationFailed
from tests.codegen.test_numpy_text import module_of
from tests.compiling import MODELS, compiled

FUNCTIONS = {
    name: getattr(math, name) for name in ("sin", "cos", "exp", "log", "log10", "sqrt", "sinh", "cosh", "tanh")
}
FUNCTIONS |= {"arcsinh": math.asinh, "arccosh": math.acosh, "abs": abs, "min": min, "max": max, "pow": math.pow}

MODEL = """plain model M {
  parameter k = 3, m = 2, r = 0.5 "of the damper // and more", t = 0.25
  input push = 4
  I mass : p = m*f { start p = 1 + t^-3 }
  C spring : e = k*q + t*q^3 + asinh(q)/(1 + q^12) { start q = 2*t }
  R damper : e = r*f*abs(f) + f^2.5 + tanh(f) + 1/3*f
  MSe drive : e = push*exp(-time)*log10(2 + time)
  drive -> 1(mass, spring, damper)
  output q = spring.q, least = min(spring.q, mass.f), most = max(spring.q, mass.f)
}
"""


def evaluated(text: str, time: float, states: Any) -> dict[str, Any]:
    """Return all lines of a text by name at scaled states; vectors as lists."""
    text = re.sub(r"//.*", "", text)
    known: dict[str, Any] = {**FUNCTIONS, "t": time}
    known |= {f"z{i}": value for i, value in enumerate(states)}
    for name, body in re.findall(r"(\w+) \{(.*?)\}", text, re.DOTALL):
        parts = [part.strip() for part in re.split(r",\s*\n", body) if part.strip()]
        values = [eval(part.split(" = ")[-1], {"__builtins__": {}}, known) for part in parts]
        known[name] = values if name.endswith("_i") else values[0]
        if name == "in_i":
            known |= {f"p{i}": value for i, value in enumerate(values)}
    return known


def same(compilation: Compilation, *scales: float) -> None:
    """Compare the text with the module for numpy, with scaled states."""
    text, numpy = compilation.text("diffsl"), module_of(compilation)
    for place, scale in enumerate(scales):
        text, count = re.subn(rf"^scale{place} {{ 1.0 }}", f"scale{place} {{ {scale!r} }}", text, flags=re.MULTILINE)
        assert count == 1
    p, states = numpy.Parameters(), np.array([0.7, 1.3, 0.4, 2.1][: len(scales)])
    found = evaluated(text, 0.6, states / scales)
    np.testing.assert_allclose(np.multiply(found["F_i"], scales), numpy.derivative(0.6, states, p), rtol=1e-12)
    np.testing.assert_allclose(found["out_i"], numpy.outputs(0.6, states, p), rtol=1e-12)
    np.testing.assert_allclose(np.multiply(found["u_i"], scales), numpy.start(p), rtol=1e-12)


def test_functions_powers_and_inputs() -> None:
    same(compiled(MODEL, free=("*",)), 1.0, 1.0)
    same(compiled(MODEL, free=("*",)), 1e-3, 50.0)


@pytest.mark.parametrize("name", ["pendulum", "lotka_volterra", "solenoid"])
def test_models(name: str) -> None:
    compilation = compiled(MODELS / f"{name}.bg")
    same(compilation, *(0.5 for _ in module_of(compilation).STATES))


@pytest.mark.parametrize(
    "law",
    ["f if f > 0 else 2*f", "atan(f)", "linear(f, (0, 1), (0, 2))", "f*floor(time)", "sign(f)", "f*step(time - 1)"],
)
def test_what_the_language_does_not_have_is_refused(law: str) -> None:
    text = f"plain model M {{ I m : p = f {{ start p = 1 }}\n MR r : e = {law} + f*time\n 1 j\n j -> m, r\n output f = m.f }}"
    with pytest.raises(CompilationFailed, match="cannot be written in DiffSL"):
        compiled(text).text("diffsl")


def test_loops_and_events_are_refused() -> None:
    loop = "plain model M { Se s : e = 1\n R a : e = f + f^3\n R b : f = e + e^3\n 0 n\n s -> 1(a) -> n -> b\n C c : e = q\n n -> c\n output e = b.e }"
    with pytest.raises(CompilationFailed, match="cannot be written in DiffSL"):
        compiled(loop.replace("n -> c", "1 k\n R d : e = f + f^5\n n -> k -> d\n k -> c")).text("diffsl")
    ball = "plain model M { I m : p = f { start p = 1 }\n C h : e = q\n 1 j\n j -> m, h\n when h.q > 1 { m.p = 0 }\n output f = m.f }"
    with pytest.raises(CompilationFailed, match="Events, switched junctions and delays cannot be written in DiffSL"):
        compiled(ball).text("diffsl")


def test_diffsol_solves_it() -> None:
    pytest.importorskip("pydiffsol")
    found = bondgraph.load(MODELS / "van_der_pol.bg").benchmark(rounds=1)
    errors = [point.error for point in found.points if point.solver == "diffsol BDF" and not point.failure]
    assert len(errors) >= 8 and errors[-1] < 1e-6
