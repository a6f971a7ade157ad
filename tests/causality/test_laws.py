"""Properties of laws that the choice of causality reads."""

from __future__ import annotations

import pytest

from compiler.causality.laws import is_linear
from tests.compiling import compiled

LINEAR = (
    "u = 4 [ohm]*i",
    "u - 2 [ohm]*i = 2 [ohm]*i",
    "u + 2 [ohm]*i = 6 [ohm]*i",
    "i = u/(4 [ohm])",
    "2*u - 5 [ohm]*i = u - 1 [ohm]*i",
)
BENT = ("u = 4 [ohm/A]*i*abs(i)", "u - 2 [ohm]*i = 2 [ohm/A]*i^2", "i = 1 [A]*sinh(u/(1 V))")
CIRCUIT = (
    "model A {{\n  Se s : u = 10 V\n  R r : {law}\n  R q : u = 5 [ohm]*i\n  s -> 1(r) -> q\n  output i = r.i\n}}\n"
)


@pytest.mark.parametrize(("law", "linear"), [*((x, True) for x in LINEAR), *((x, False) for x in BENT)])
def test_a_law_is_linear_wherever_its_variables_stand(law: str, linear: bool) -> None:
    graph = compiled(CIRCUIT.format(law=law)).whole_graph
    (resistor,) = (n for n in graph.nodes if n.name == "r")
    assert is_linear(resistor) is linear  # type: ignore[arg-type]
