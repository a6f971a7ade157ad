"""Curves and conditions of laws, as text and back."""

from __future__ import annotations

import pytest

from compiler.unparse import write_text
from tests.compiling import compiled, outputs_of
from tests.unparse.test_models import again

MODEL = """model M {{
  parameter a = 2 mm, p = 3 N, k = 4 [N/m]
  signal t = time
  C c : F = {}
  R r : F = 1 [N*s/m]*v
  1 j : translation
  j -> c, r
  output F = c.F, x = c.x
}}"""


@pytest.mark.parametrize(
    "law",
    [
        "linear(x, (0, 1 mm, 2 mm), (0 N, 2 N, 5 N))",
        "linear(x, (0, 1 mm, a), (0 N, 2 N, 5 N))",
        "cubic(x, (-1 mm, 1 mm, 2 mm), (0 N, p, 5 N)) + p",
        "monotone(x, (-1 mm, 1 mm, a), (0 N, p, 5 N))*sin(x/a)",
        "k*linear(x, (0, 1 mm, 2 mm), (0 mm, 2 mm, a))",
        "k*linear(x/a, (0, 1, 2), (0 mm, 2 mm, 5 mm)) + linear(x/a, (-1, 1, 2), (p, p, 2*p))",
        "2*linear(x, (0, 1 mm, 2 mm), (0 N, 2 N, 5 N)) + linear(x, (0, 1 mm), (0 N, 1 N))",
        "p*linear(x/a, (0, 1, 2), (0, 2, 5))",
        "p*sqrt(linear(x/a, (0, 1, 2), (1, 2, 5)))",
        "sqrt(linear(x, (0, 1 mm), (1 [N^2], p*p)))",
        "abs(linear(x, (0, 1 mm), (1 N, 2 N)))",
        "max(p, linear(x, (0, 1 mm), (1 N, 4 N)))",
    ],
)
def test_a_curve_is_read_back_with_its_units(law: str) -> None:
    original = compiled(MODEL.format(law), everything=True)
    reread = again(original)
    for x in (0.1e-3, 0.4e-3, 1.7e-3):
        assert outputs_of(reread, {"c.x": x}) == pytest.approx(outputs_of(original, {"c.x": x}), rel=1e-13)


@pytest.mark.parametrize("condition", ["true", "false"])
def test_a_condition_without_names_is_true_or_false(condition: str) -> None:
    text = f'plain model M {{ parameter a = 1; output y = a; require {condition} "always" }}'
    graph = compiled(text).whole_graph
    assert f"require {condition}" in write_text(graph)
    again(compiled(text, everything=True))
