"""Signals that depend on themselves: linear loops exactly, others by Newton's method, across instances; and what has no solution."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed
from tests.compiling import mistake, numbers


def test_linear_loops() -> None:
    found = numbers(
        "model A {\n  parameter K = 4\n  output y = K*(1 m - y)\n  signal a = 2*b, b = a/4 + 1 [m/s], c: N = 0.5*c + 3 N\n"
        "  output p = a, q = b, r = c\n"
        "  signal u = 1e3*(1 V - v), v = w/10, w = u\n  output gain = u\n}\n"
    )
    assert found == pytest.approx({"y": 0.8, "p": 4.0, "q": 2.0, "r": 6.0, "gain": 1e3 / 101}, rel=1e-14)


@pytest.mark.parametrize("target", [pytest.param("native", marks=pytest.mark.machine_code), "numpy"])
def test_keplers_equation(target: str) -> None:
    """E - e sin(E) = t, and its rate 1/(1 - e cos(E)) by the implicit law; Dottie's number."""
    text = "plain model A {\n  signal E = time + 0.3*sin(E)\n  output e = E, rate = der(E), z = cos(z)\n}\n"
    found = bondgraph.load(text).simulate(to=6, points=25, target=target)
    assert found["e"] - 0.3 * np.sin(found["e"]) == pytest.approx(found.time, abs=1e-9)
    assert found["rate"] == pytest.approx(1 / (1 - 0.3 * np.cos(found["e"])), rel=1e-8)
    assert found.final("z") == pytest.approx(0.7390851332151607, rel=1e-12)


def test_an_equation_written_as_a_signal() -> None:
    """z exp(z) = 1 + t: Lambert's function, 0.5671432904097838 at 1."""
    text = "plain model A {\n  signal z = z - (z*exp(z) - 1 - time)\n  output w = z\n}\n"
    found = bondgraph.load(text).simulate(to=3, points=4)
    assert found["w"][0] == pytest.approx(0.5671432904097838, rel=1e-9)
    assert found["w"] * np.exp(found["w"]) == pytest.approx(1 + found.time, rel=1e-9)


def test_a_loop_behind_a_state() -> None:
    """v' = -y, y = v + 0.5 sin(y): dv = (1 - 0.5 cos y) dy, so ln tan(y/2) falls as -t + …: checked as dy/dt (1 - 0.5 cos y) = -y."""
    text = "plain model A {\n  signal v = integral(-y, 1), y = v + 0.5*sin(y)\n  output a = v, b = y, c = der(y)\n}\n"
    found = bondgraph.load(text).simulate(to=3, points=13, rtol=1e-9)
    assert found["c"] * (1 - 0.5 * np.cos(found["b"])) == pytest.approx(-found["b"], rel=1e-8)
    assert found["b"] - 0.5 * np.sin(found["b"]) == pytest.approx(found["a"], rel=1e-8)
    inside = np.linspace(*np.log(found["b"][[-1, 0]]), 4001)
    assert np.trapezoid(1 - 0.5 * np.cos(np.exp(inside)), inside) == pytest.approx(3.0, rel=1e-6)


@pytest.mark.parametrize("order", ["b = 1 - a/2, a = b > 0.7", "a = b > 0.7, b = 1 - a/2"])
def test_a_truth_in_a_loop(order: str) -> None:
    """b = 1 is above 0.7, and 1/2 is not: nothing holds, in any order of the text."""
    with pytest.raises(RunFailed):
        bondgraph.load(f"plain model A {{\n  signal {order}\n  output y = b\n}}\n").simulate(to=1)


def test_between_instances_and_bonds() -> None:
    text = (
        "model Gain { input u = 0 V; parameter k = 2; output y = k*u }\n"
        "model M {\n  Gain a { u = 1 V*time/1 s - b.y }\n  Gain b { u = a.y, k = 3 }\n"
        "  MSe s : F = 10 N - 2 [N*s/m]*f\n  signal f = r.v + 0.5*g, g = f - 1 [m/s]\n  R r : F = 3 [N*s/m]*v\n  s -> r\n  output y = a.y, v = r.v\n}\n"
    )
    model = bondgraph.load(text)
    for m in (model, bondgraph.load(model.text())):
        found = m.simulate(settings={"b_k" if m is not model else "b.k": 3}, to="7 s")
        assert found.final("y") == pytest.approx(2 * 7 / 7, rel=1e-12)
        assert found.final("v") == pytest.approx(12 / 7, rel=1e-12)  # f = 2 v - 1, so 3 v = 10 - 4 v + 2


def test_several_solutions_are_told() -> None:
    with pytest.raises(RunFailed, match=r"more than one solution: `x` = 0\.112702; `x` = 0\.887298"):
        bondgraph.load("plain model A {\n  signal x = x^2 + 0.1\n  output y = x\n}\n").simulate(to=1)


@pytest.mark.parametrize(
    ("body", "code", "words"),
    [
        ("signal x = x + 1 m; output y = x", "BG502", "`x`"),
        ("signal x = x; output y = x", "BG407", "unchanged"),
        ("signal a = b, b = a; output y = a", "BG407", "unchanged"),
        ("signal x = 2 m*x/1 s; output y = x", "BG103", "depends on itself"),
        ("signal x: m = 2*x/1 s; output y = x", "BG103", "[m/s]"),
        ("signal a = (b[1], 2), b = (a[1], 3); output y = b[1]", "BG107", "a -> b"),
        ("parameter a = b, b = a; output y = a", "BG107", "depend on each other"),
    ],
)
def test_refusals(body: str, code: str, words: str) -> None:
    found = mistake(f"model M {{\n{body}\n}}", code)
    assert words in f"{found.sentence} {found.help}"


def test_a_loop_in_a_block_of_samples_is_that_of_its_beginning() -> None:
    """m = 3 m + 1 each time: the second line reads what the loop x = 0.5 x + m, so 2 m, was when the block began."""
    text = "plain model A {\n  mode m = 0\n  signal x = 0.5*x + m\n  every 1 {\n    m = m + 1\n    m = m + x\n  }\n  output n = m\n}\n"
    assert bondgraph.load(text).simulate(to=3).final("n") == 40.0
    assert math.isclose(numbers("plain model A {\n  signal x = 0.5*x + 1\n  output y = x\n}\n")["y"], 2.0)
