"""Readings of the ports of models, which a flat text reads at a node of the bond."""

from __future__ import annotations

import pytest

from compiler.graph.network import Reading
from compiler.unparse.reference_names import seen_at_a_node
from tests.compiling import compiled

GRAPH = compiled(
    """
model Part { port a : translation; C c : F = 2 [N/m]*x; R r : F = 3 [N*s/m]*v; a -> 1(c, r) }
model Whole {
  Part p
  Part q
  Part z
  Se s : F = 3 N
  multibody arm : planar {
    body b { mass = 1 kg }
    free j : ground to b
  }
  0 k : translation
  Sf d : v = 2 [m/s]
  C e : F = 5 [N/m]*x
  s -> p.a
  arm.b.x -> q.a
  d -> k -> z.a, e
}""",
    model="Whole",
).whole_graph


@pytest.mark.parametrize(
    ("part", "variable", "expected"),
    [
        ("p", "e", Reading("s", "", "e")),  # an element has both
        ("p", "f", Reading("s", "", "f")),
        ("q", "e", None),  # the effort at a mechanism has the sign of the part, a 1-junction has none
        ("q", "f", Reading("arm", "b.x", "f")),
        ("z", "e", Reading("k", "", "e")),  # a 0-junction has one effort
        ("z", "f", Reading("z.1(c)", "", "f")),  # and the 1-junction at the other end one flow
    ],
)
def test_the_node_that_shows_a_variable_of_a_port(part: str, variable: str, expected: Reading | None) -> None:
    assert seen_at_a_node(GRAPH, Reading(f"{part}.a", "", variable)) == expected


def test_other_readings_stay() -> None:
    reading = Reading("e", "", "f")
    assert seen_at_a_node(GRAPH, reading) is reading
