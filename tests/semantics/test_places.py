"""An error inside a part is reported with the lines where its instances are declared, from outside to inside."""

from __future__ import annotations

import bondgraph
from compiler.errors import render

PART = "model Part { port a: hydraulic; parameter n = 2; R r : Q = 1 [L/s]*(P/(1 bar))^n; a -> r }\n"
HOLDER = "model Holder { port a: hydraulic; Part inner; a -> inner.a }\n"
WHOLE = "model A {\n  Sf pump : Q = 0.1 [L/s]\n  %s valve\n  pump -> valve.a\n  output q = pump.Q, P = pump.P\n}\n"


def test_where_the_part_stands() -> None:
    (found,) = bondgraph.check(PART + WHOLE % "Part")
    assert found.code == "BG604" and found.span.line == 1
    assert [(why, span.line) for span, why in found.stands] == [("`valve` stands here", 4)]
    shown = render(found).splitlines()
    at = next(i for i, line in enumerate(shown) if "stands here" in line)
    assert shown[at].startswith("text:4:") and shown[-1].startswith("  help: ")


def test_parts_in_parts_from_outside_to_inside() -> None:
    (found,) = bondgraph.check(PART + HOLDER + WHOLE % "Holder")
    told = [(why, span.line) for span, why in found.stands]
    assert told == [("`valve` stands here", 5), ("`valve.inner` stands here", 2)]


def test_nothing_is_added_to_what_stands_in_the_model_itself() -> None:
    text = "model A {\n  parameter n = 2\n  Sf s : Q = 0.1 [L/s]\n  R r : Q = 1 [L/s]*(P/(1 bar))^n\n  s -> r\n  output P = r.P\n}\n"
    (found,) = bondgraph.check(text)
    assert found.code == "BG604" and found.stands == ()
