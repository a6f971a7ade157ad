"""`when`, `mode`, `active`: their form in the graph, and errors of those without effect."""

from __future__ import annotations

import pytest

import bondgraph
from compiler.graph.network import Quantity, Reading
from tests.compiling import compiled, mistake, mistakes

MODEL = """model A {{
  I mass : p = 1 kg*v
  C spring : F = 10 [N/m]*x
  1 body
  body -> mass, spring
  signal s = integral(mass.v, 0 m)
  mode on = false, gear = 1, level: mm = 3
  {}
  output y = spring.x
}}
"""


def test_what_an_event_holds() -> None:
    graph = compiled(
        MODEL.format("when spring.x > 1 mm and not on { mass.v = 0; on = true; level = 2 mm; s = 0 m }")
    ).whole_graph
    (event,) = graph.events
    assert (event.name, event.words) == ("", "spring.x > 1 mm and not on")
    targets = [action.target for action in event.actions]
    assert targets == [Reading("mass", "", "f"), Quantity("on"), Quantity("level"), Quantity("s")]
    assert [graph.quantities[n].role for n in ("on", "gear", "level")] == ["mode"] * 3
    assert graph.quantities["level"].unit == "m"


def test_events_of_instances_and_loops_carry_their_names() -> None:
    text = """model Part {
  parameter high = 2
  mode on = false
  signal x = integral(1 [1/s], 0)
  when x > high { on = true }
  output state = on
}
model A {
  for i in 1..3 {
    Part part[i] { high = i }
    mode seen[i] = 0
    when part[i].state { seen[i] = i }
  }
  output y = seen[1] + seen[2] + seen[3]
}
"""
    graph = compiled(text).whole_graph
    assert [e.name for e in graph.events] == ["", "", "", "part[1]", "part[2]", "part[3]"] or len(graph.events) == 6
    assert {a.target for e in graph.events for a in e.actions} == {
        *(Quantity(f"part[{i}].on") for i in (1, 2, 3)),
        *(Quantity(f"seen[{i}]") for i in (1, 2, 3)),
    }


def test_a_switched_junction() -> None:
    graph = compiled(
        MODEL.format("0 gap : translation { active = gear == 2 and spring.x > 0 m }\n  body -> gap")
    ).whole_graph
    (switch,) = graph.switches
    assert switch.junction == "gap"
    assert switch.active.arguments == (Quantity("gear"), Reading("spring", "", "q"))


def test_a_run_needs_only_the_events_that_set_what_it_reads() -> None:
    text = MODEL.format("when spring.x > 1 mm { gear = 2 }\n  when spring.x < 0 m { spring.x = 1 um }")
    space = compiled(text).state_space
    assert [e.words for e in space.events] == ["spring.x < 0 m"]
    assert not space.discretes
    assert len(compiled(text.replace("y = spring.x", "y = spring.x, g = gear")).state_space.events) == 2


@pytest.mark.parametrize(
    ("statement", "code", "words"),
    [
        ("when spring.x { gear = 2 }", "BG111", "A condition is expected here"),
        ("when spring.x > 1 { gear = 2 }", "BG103", "cannot be compared"),
        ("when spring.x > 1 mm { body.v = 2 [m/s] }", "BG153", "`body.v` cannot be set"),
        ("when spring.x > 1 mm { mass.F = 2 N }", "BG153", "`mass.F` cannot be set"),
        ("when spring.x > 1 mm { spring.v = 2 [m/s] }", "BG153", "`spring.v` cannot be set"),
        ("when spring.x > 1 mm { y = 2 mm }", "BG153", "`y` cannot be set"),
        ("when spring.x > 1 mm { gear = 2; gear = 3 }", "BG153", "`gear` is set twice at one instant"),
        ("when spring.x > 1 mm { gear = 2 mm }", "BG103", "`gear` is a bare number"),
        ("when spring.x > 1 mm { on = 1 }", "BG111", "A condition is expected here"),
        ("when spring.x > 1 mm { gear = on }", "BG111", "A number is expected here"),
        ("when spring.x > 1 mm { nothing = 1 }", "BG101", "nothing"),
        ("every 0 s { gear = 2 }", "BG111", "A time is expected here"),
        ("every 2 { gear = 2 }", "BG103", "What stands after `every`"),
        ("every spring.x/(1 [m/s]) { gear = 2 }", "BG106", "must be known before the run"),
        ("output late = delay(spring.x, 0 s)", "BG111", "A time is expected here"),
        ("output late = delay(spring.x, 2)", "BG103", "A delay"),
        ("output late = delay(spring.x, mass.v/(1 [m/s^2]))", "BG106", "must be known before the run"),
        ("output late = delay(spring.x)", "BG108", "delay(x, 1 ms)"),
        ("mode other = spring.x > 1 mm", "BG106", "The mode `other`"),
        ("0 gap : translation { active = 1 }\n  body -> gap", "BG111", "A condition is expected here"),
        ("0 gap : translation { active = on, active = on }\n  body -> gap", "BG120", "active"),
    ],
)  # fmt: skip
def test_what_is_wrong(statement: str, code: str, words: str) -> None:
    found = mistakes(MODEL.format(statement))
    assert [d.code for d in found] == [code] and words in found[0].sentence + found[0].help, [
        (d.code, d.sentence) for d in found
    ]


def test_a_law_that_reads_a_mode_is_modulated() -> None:
    found = mistake(MODEL.format("R brake : F = 2 [N*s/m]*v if on else 0 N\n  body -> brake"), "BG117")
    assert "brake" in found.sentence
    assert not mistakes(MODEL.format("MR brake : F = 2 [N*s/m]*v if on else 0 N\n  body -> brake"))


def test_an_experiment_starts_a_mode() -> None:
    text = MODEL.format("experiment e { start gear = 4; start on = true; simulate 0 .. 1 s }").replace(
        "y = spring.x", "y = gear"
    )
    program = compiled(text, experiment="e").program
    assert program.hybrid is not None
    assert program.hybrid.start(program.constants(list(program.defaults))).tolist() == [4.0]
    wrong = MODEL.format("experiment e { start gear = spring.x/(1 m); simulate 0 .. 1 s }")
    assert [d.code for d in mistakes(wrong)] == ["BG106"]


def test_the_stage_of_the_graph_tells_events() -> None:
    text = MODEL.format(
        "when spring.x > 1 mm { gear = 2; on = true }\n  every 1 ms { level = 2 mm }\n  0 gap : translation { active = on }\n  body -> gap"
    )
    shown = bondgraph.load(text).show("graph")
    assert "  when spring.x > 1 mm: sets gear, on  # text:8" in shown
    assert "  every 1 ms: sets level  # text:9" in shown
    assert "  switched gap  # text:10" in shown
