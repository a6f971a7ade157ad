"""Mechanisms and functions in the rounds of a `for`: each has its own, and what it reads is that of its round."""

from __future__ import annotations

import re

import pytest

import bondgraph
from compiler.unparse import write_text
from tests.compiling import compiled, mistake, mistakes, outputs_of

ROWS = """
model A {
  parameter n = 3, g = 10 [m/s^2]
  function weight(m) = m*g
  for i in 1..n {
    constant l = i*1 m
    function half(x) = x*l/(2 m) + 0*weight(x)/g
    function twice(x) = half(half(x)) + 0*i
    multibody arm[i] : planar {
      gravity = (0, -g)
      constant mass = i*1 kg
      body bar { mass = mass, inertia = 0, at = (2*half(1 m), 0) }
      hinge pin : ground to bar { at = (0, 0) }
      for j in 1..i { frame f[j] : bar { at = (j*l, 0) } }
    }
    C coil[i] : M = i*phi*1 [N*m]
    arm[i].pin -> coil[i]
    output w[i] = arm[i].pin.phi.omega, q[i] = twice(4), x[i] = arm[i].f[i].x, E[i] = coil[i].M
  }
  R last : M = 0 [N*m*s]*omega
  arm[2].pin -> last
  experiment fall { simulate 0 .. 1 ms { rtol = 1e-10, points = 2 } }
}
"""


def test_each_round_has_a_mechanism_of_its_own() -> None:
    """A mass at the distance l = i falls with g/l about its pin."""
    result = bondgraph.load(ROWS).simulate()
    for i in (1, 2, 3):
        assert result.final(f"w[{i}]") == pytest.approx(-10 / i * 1e-3, rel=1e-6)
        assert result.final(f"x[{i}]") == pytest.approx(i * i, rel=1e-6)
        assert result.final(f"q[{i}]") == 4 * (i / 2) ** 2


def test_the_flat_text_has_the_same_mechanisms() -> None:
    flat = write_text(compiled(ROWS).whole_graph)
    assert len(re.findall(r"^ *multibody ", flat, re.MULTILINE)) == 3
    assert mistakes(flat) == ()
    once, again = (re.sub(r" *#.*", "", text) for text in (flat, write_text(compiled(flat).whole_graph)))
    assert once == again
    assert len(compiled(flat).program.states.names) == len(compiled(ROWS).program.states.names) == 6


def test_a_function_reads_its_round_and_not_that_of_the_caller() -> None:
    text = """
    model A {
      parameter k = 100
      function outer(x) = k*x
      for i in 1..2 {
        constant c = 10*i
        function f(x) = c*x + outer(i)
        for j in 1..2 { constant k = 7; constant c = 1000; output y[i, j] = f(j) + outer(0) }
      }
      for i in 1..1 { function f(x) = -x; output z[i] = f(i) }
    }
    """
    assert outputs_of(compiled(text)) == {
        "y[1, 1]": 110.0, "y[1, 2]": 120.0, "y[2, 1]": 220.0, "y[2, 2]": 240.0, "z[1]": -1.0
    }  # fmt: skip


def test_a_function_of_a_round_is_known_there_only() -> None:
    mistake("model A { for i in 1..2 { function f(x) = i*x }\n output y = f(1) }", "BG109")


@pytest.mark.parametrize(
    "line",
    [
        "function f(x) = x; for i in 1..2 { function f(x) = 2*x }",
        "for i in 1..2 { function f(x) = x; function f(x) = 2*x }",
        "for i in 1..2 { constant f = 2; function f(x) = 2*x }",
        "parameter f = 2; for i in 1..2 { function f(x) = 2*x }",
        "for i in 1..2 { function f(x) = x; for j in 1..2 { function f(x) = 2*x } }",
    ],
)
def test_one_name_is_one_function(line: str) -> None:
    mistake(f"model A {{ {line} }}", "BG104")


def test_a_mechanism_in_a_loop_carries_an_index() -> None:
    body = "{ body b { mass = 1 kg, inertia = 1 [kg*m^2] }; hinge p : ground to b { at = (0, 0) } }"
    found = mistake(f"model A {{ for i in 1..2 {{ multibody arm : planar {body} }} }}", "BG111")
    assert "arm[i]" in found.help
    mistake(f"model A {{ for i in 1..2 {{ multibody arm[1] : planar {body} }} }}", "BG104")
    mistake(f"model A {{ multibody arm[2] : planar {body}\n output y = arm[1].p.phi }}", "BG112")
    found = mistake(f"model A {{ for i in 1..2 {{ multibody arm[i] : planar {body} }}\n output y = arm.p }}", "BG111")
    assert "arm.p[1]" in found.help
