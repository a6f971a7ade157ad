"""Integrals and delays of lists: one signal for each number, each in its own unit; against closed forms and signals one by one."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from tests.compiling import mistake, mistakes

SPACE = """
model Space {
  constant A = [[0, 1], [-4 [1/s^2], 0]]
  parameter x_0 = (1 m, 0 [m/s])
  input u = 0 [m/s^2]
  signal x = integral(A*x + [0, u], x_0)
  output y = x, rate = der(x), way = norm(integral((x[1], 2*x[1]), (0, 0 [m*s]))), late = delay((time, -time), 0.5 s)
  experiment go { simulate 0 .. 2 s }
  experiment pushed { set u = 4 [m/s^2]; start x[1] = 0 m; simulate 0 .. 2 s }
}
"""


def test_a_state_space_is_an_integral_of_a_list() -> None:
    result = bondgraph.load(SPACE).simulate("go", rtol=1e-9)
    c, s = np.cos(4), np.sin(4)
    assert [result.final(f"y[{i}]") for i in (1, 2)] == pytest.approx([c, -2 * s], rel=1e-6)
    assert [result.final(f"rate[{i}]") for i in (1, 2)] == pytest.approx([-2 * s, -4 * c], rel=1e-6)
    assert result.final("way") == pytest.approx(np.sqrt(5) * abs(s) / 2, rel=1e-6)
    assert [result.final(f"late[{i}]") for i in (1, 2)] == pytest.approx([1.5, -1.5])
    assert [result.unit(f"y[{i}]") for i in (1, 2)] == ["m", "m/s"]
    pushed = bondgraph.load(SPACE).simulate("pushed", rtol=1e-9)
    assert pushed.final("y[1]") == pytest.approx(1 - c, rel=1e-6)


def test_a_matrix_of_integrals_and_an_event_on_one_of_them() -> None:
    text = """plain model A {
      signal X = integral([[1, 2], [3, 4]]*X, identity(2))
      signal n = integral((1, 1), (0, 0))
      when n[1] > 0.3 { n[1] = 0 }
      output x = X, n = n[1], m = n[2]
      experiment go { simulate 0 .. 1 }
    }""".replace("n = n[1]", "k = n[1]")
    result = bondgraph.load(text).simulate(rtol=1e-10)
    values, shapes = np.linalg.eig(np.array([[1.0, 2], [3, 4]]))
    exact = shapes @ np.diag(np.exp(values)) @ np.linalg.inv(shapes)
    found = [[result.final(f"x[{i}, {j}]") for j in (1, 2)] for i in (1, 2)]
    assert np.array(found) == pytest.approx(exact, rel=1e-6)
    assert result.final("m") == pytest.approx(1)
    assert result.final("k") == pytest.approx(0.1, abs=1e-6)  # set at 0.3, 0.6, 0.9


@pytest.mark.parametrize(
    ("signal", "code", "words"),
    [
        ("integral((1, 2, 3), (0, 0))", "BG111", "A list of 2 is expected here, this is a list of 3"),
        ("integral(1, (0, 0))", "BG111", "A list of 2 is expected here, this is a single number"),
        ("integral((1, 2), 0)", "BG111", "A single number is expected here, this is a list of 2"),
        (
            "integral((1 [m/s], 2 [m/s]), (0 m, 0 [m/s]))",
            "BG103",
            "Item [2] of `(1 [m/s], 2 [m/s])` is in [m/s], but an integral in [m/s] needs in [m/s^2]",
        ),
        ("integral((1 [m/s], 0), (0, 0))", "BG103", "Item [1] of"),
        ("delay((time, 1), 1)", "BG103", ""),
    ],
)
def test_wrong_lists_are_told(signal: str, code: str, words: str) -> None:
    assert words in mistake(f"model A {{\n  output y = {signal}\n}}\n", code).sentence


def test_lists_are_set_and_started_as_wholes() -> None:
    """x' = (1, 2) from (5, 6), and swapped at half a second; modes and what springs store, too: x = x_0 cos 2t with v = 0."""
    text = (
        "model A {\n  parameter n = 2, x_0 = [1 mm, 3 mm]\n  signal x = integral([1 [1/s], 2 [1/s]], [0, 0])\n  for i in 1..2 { mode s[i] = 0 }\n"
        "  when time > 0.5 s { x = [x[2], x[1]]; s = 2*x }\n"
        "  1 body : translation[n]\n  I m(p: translation[n]) : p.p = 2 kg*p.v\n  C k(p: translation[n]) : p.F = 8 [N/m]*p.x\n  body => m, k\n"
        "  output a = x[1], b = x[2], c = s[1], d = s[2], e = k.p.x[2]\n"
        "  experiment go { start x = [5, 6]; start k.p.x = x_0; simulate 0 .. 1 s }\n}\n"
    )
    found = bondgraph.load(text).simulate(rtol=1e-9)
    assert [found.final(n) for n in "abcd"] == pytest.approx([7.5, 6.5, 11, 14], rel=1e-9)
    assert found.final("e") == pytest.approx(3e-3 * np.cos(2), rel=1e-7)
    assert bondgraph.load(bondgraph.load(text).text()).simulate(to=1).final("c") == pytest.approx(
        2 * 0.5, rel=1e-9
    )  # without its experiment


def test_lists_of_one_and_matrices_are_set_as_wholes() -> None:
    """A list of one item is set by a list of one; a matrix by a matrix: x' = 1 from 5, 6 at half a second; y' = ((1, 2), (3, 4)) from ((5, 0), (0, 7))."""
    text = (
        "model A {\n  signal x = integral([1 [1/s]], [0]), y = integral([[1, 2], [3, 4]]/(1 s), [[0, 0], [0, 0]])\n"
        "  when time > 0.5 s { x = [x[1] + 1]; y = [[y[2, 2], 0], [0, y[1, 1]]] }\n"
        "  output a = x[1], b = y[1, 1], c = y[2, 2]\n"
        "  experiment go { start x = [5]; start y = [[5, 0], [0, 7]]; simulate 0 .. 1 s }\n}\n"
    )
    found = bondgraph.load(text).simulate(rtol=1e-9)
    assert [found.final(n) for n in "abc"] == pytest.approx([7, 9.5, 7.5], rel=1e-9)


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("when time > 1 s { x = [[1, 2]] }", "BG111"),
        ("when time > 1 s { x = 3 }", "BG111"),
        ("when time > 1 s { x = [1, 2, 3] }", "BG111"),
        ("when time > 1 s { x = [1 m, 2] }", "BG103"),
        ("when time > 1 s { x = [1, 2]; x[2] = 1 }", "BG153"),
        ("every 1 s { x = [1, 2, 3] }", "BG111"),
        ("experiment e { start x = [1, 2, 3]; simulate 0 .. 1 s }", "BG111"),
        ("experiment e { start x = [1, time]; simulate 0 .. 1 s }", "BG103"),
        ("experiment e { start x = [1, 2]; start x[1] = 1; simulate 0 .. 1 s }", "BG150"),
    ],
)
def test_lists_that_do_not_fit(line: str, code: str) -> None:
    mistake(f"model A {{\n  signal x = integral([1 [1/s], 2 [1/s]], [0, 0])\n  output y = x[1]\n  {line}\n}}\n", code)


def test_a_zero_over_a_unit_has_it() -> None:
    assert mistakes("model A { parameter w = 0/1 s, v = 0*2 m/1 s; output y = w + 1 [1/s], z = v + 1 [m/s] }\n") == ()
    mistake("model A { parameter w = 0/1 s; output y = w + 1 }\n", "BG103")
