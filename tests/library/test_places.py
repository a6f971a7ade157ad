"""A mistake that shows inside a part of the library is told with the line of the user's file where the part stands."""

from __future__ import annotations

import pytest

import bondgraph
from compiler.errors import render

FORCED = """import Capacitor from electric
model A {
  Capacitor smoothing
  Se mains : u = 20 V*sin(2*pi*50 Hz*time)
  mains -> smoothing.pins
  output i = smoothing.plates.i
}
"""
ROW = """import Valve from hydraulic
model A {
  Se pump : P = 10 bar
  Se tank : P = 0 bar
  Valve first, second
  pump -> first.a
  first.b -> second.a
  second.b -> tank
  output Q = first.flow
}
"""
INSIDE = """import Conductor from thermal
model Wall { port a: thermal, b: thermal; Conductor brick, plaster; a -> brick.a; brick.b -> plaster.a; plaster.b -> b }
model A {
  Se hot : T = 300 K
  Se cold : T = 280 K
  Wall wall
  hot -> wall.a
  wall.b -> cold
  output Q = wall.brick.heat_flow
}
"""


@pytest.mark.parametrize(
    ("text", "codes", "lines"),
    [(FORCED, {"BG503"}, [("`smoothing` stands here", 3)]), (ROW, {"BG501"}, [("`first` stands here", 5)])],
)
def test_where_the_part_stands(text: str, codes: set[str], lines: list[tuple[str, int]]) -> None:
    (found,) = bondgraph.check(text)
    assert {found.code} == codes and found.span.source.name != "text"
    assert [(why, span.line) for span, why in found.stands] == lines
    assert all(span.source.name == "text" for span, _ in found.stands)
    shown = render(found).splitlines()
    at = next(i for i, line in enumerate(shown) if "stands here" in line)
    assert shown[at].startswith(f"text:{lines[0][1]}:") and shown[-1].startswith("  help: ")


def test_parts_in_parts_from_outside_to_inside() -> None:
    found = bondgraph.check(INSIDE)
    assert found
    for item in found:
        assert [why for _, why in item.stands][0] == "`wall` stands here"
        assert len(item.stands) == 2 and item.stands[0][0].line == 6


def test_nothing_is_added_to_what_stands_in_the_model_itself() -> None:
    text = "model A {\n  Se s : u = 1 V*sin(time/1 s)\n  C c : q = 1 F*u\n  s -> c\n  output u = c.u, i = c.i\n}\n"
    (found,) = bondgraph.check(text)
    assert found.code == "BG503" and found.stands == ()
