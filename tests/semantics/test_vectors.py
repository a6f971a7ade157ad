"""Functions of vectors: scalar and vector product, length; units of each component, in laws, mechanisms and functions."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from tests.compiling import compiled, mistake, numbers, outputs_of

TARGETS = ["numpy", pytest.param("native", marks=pytest.mark.machine_code)]


def test_against_numpy() -> None:
    rng = np.random.default_rng(1)
    for _ in range(5):
        a, b, c = rng.normal(size=(3, 3))
        texts = ["(" + ", ".join(repr(float(x)) for x in v) + ")" for v in (a, b, c)]
        lines = " ".join(f"constant {n} = {t};" for n, t in zip("abc", texts, strict=True))
        text = f"model A {{ {lines}\n constant p = cross(a, b), q = cross(a, cross(b, c)) - dot(a, c)*b + dot(a, b)*c\n"
        text += " output x = p[1], y = p[2], z = p[3], s = dot(a, b), l = norm(c), triple = dot(a, cross(b, c))\n"
        text += " output plane = cross((a[1], a[2]), (b[1], b[2])), zero = norm(q) }"
        found = numbers(text)
        assert [found[n] for n in "xyz"] == pytest.approx(np.cross(a, b), rel=1e-14, abs=1e-15)
        assert found["s"] == pytest.approx(a @ b, rel=1e-14, abs=1e-15)
        assert found["l"] == pytest.approx(np.linalg.norm(c), rel=1e-15)
        assert found["triple"] == pytest.approx(np.linalg.det([a, b, c]), rel=1e-12, abs=1e-14)
        assert found["plane"] == pytest.approx(a[0] * b[1] - a[1] * b[0], rel=1e-14, abs=1e-15)
        assert found["zero"] < 1e-14


def test_units_of_each_component() -> None:
    text = "model A { constant r = (3 m, 4 m), F = (0, 2 N), mixed = (1 m, 2 rad), dual = (3 N, 4 [N*m])\n"
    text += " output M = cross(r, F), P = dot(mixed, dual), l = norm(r), zero = norm((0, 0)) }"
    compilation = compiled(text)
    assert outputs_of(compilation) == {"M": 6.0, "P": 11.0, "l": 5.0, "zero": 0.0}
    assert list(compilation.program.outputs.units) == ["N*m", "N*m", "m", "1"]


@pytest.mark.parametrize(
    ("value", "code"),
    [
        ("dot((1 m, 2 m), (1, 2, 3))", "BG111"),
        ("dot((1 m, 2), (1, 2))", "BG103"),
        ("norm((1 m, 2))", "BG103"),
        ("norm(3)", "BG111"),
        ("cross((1, 2, 3, 4), (1, 2, 3, 4))", "BG111"),
        ("cross((1 m, 2 s), (1 m, 2 s)) + 1 m", "BG103"),
        ("dot((1, 2))", "BG108"),
        ("dott((1, 2), (1, 2))", "BG109"),
        ("rotate((1, 2), 3 m)[1]", "BG001"),
    ],
)
def test_what_does_not_fit_is_told(value: str, code: str) -> None:
    mistake(f"model A {{ output y = {value} }}", code)


def test_a_function_of_the_author_s_own_comes_first() -> None:
    assert numbers("model A { function norm(x) = 2*x\n output y = norm(4) }") == {"y": 8.0}


@pytest.mark.parametrize("target", TARGETS)
def test_in_a_law_with_its_slopes(target: str) -> None:
    """A mass in the plane on a spring of length l to the origin: E = k/2 (|r| - l)^2; straight out it swings as on a line."""
    text = """
    model A {
      parameter l = 1 m, k = 100 [N/m]
      C spring(x: translation, y: translation) : energy = k/2*(norm((3/5*l + x, 4/5*l + y)) - l)^2
      I mass(x: translation, y: translation) : energy = dot((x, y), (x, y))/(2*1 kg) { start x.v = 0.6 [m/s], start y.v = 0.8 [m/s] }
      1(mass.x) -> spring.x
      1(mass.y) -> spring.y
      output x = spring.x, y = spring.y, spin = cross((0.6 m + spring.x, 0.8 m + spring.y), (mass.x.v, mass.y.v))
    }
    """
    found = bondgraph.load(text).simulate(to=0.5, points=6, rtol=1e-10, target=target)
    assert found["x"] == pytest.approx(0.06 * np.sin(10 * found.time), abs=1e-9)
    assert found["y"] == pytest.approx(0.08 * np.sin(10 * found.time), abs=1e-9)
    assert found["spin"] == pytest.approx(0, abs=1e-9)
