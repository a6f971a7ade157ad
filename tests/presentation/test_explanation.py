"""`bondgraph explain`: removed elements, with the parameters that cause it, and the remaining ones."""

from __future__ import annotations

import json
from dataclasses import replace

from bondgraph.presentation.text.explanation import explain
from tests.compiling import MODELS, compiled

TEXT = """
model A {
  parameter loss = 0, friction = loss*2 [N*s/m]
  input push = 0 N
  for i in 1..2 {
    1 body[i]
    MSe drive[i] : F = push
    I mass[i]   : p = 1 kg*v
    C spring[i] : F = 8 [N/m]*x { start x = 1 m }
    R damper[i] : F = friction*v
    drive[i] -> body[i] -> mass[i], spring[i], damper[i]
  }
  output x1 = spring[1].x, x2 = spring[2].x
}
"""


def test_what_gives_nothing_is_told_with_the_zeros_behind_it() -> None:
    """A source of a signal that is zero by its default, a resistor by a parameter of a parameter."""
    found = explain(compiled(TEXT, outputs=("x1",)))
    assert {(x.name, x.because) for x in found.left_out} == {
        ("drive[1]", ("push",)), ("drive[2]", ("push",)), ("damper[1]", ("loss",)), ("damper[2]", ("loss",)),
    }  # fmt: skip
    assert set(found.certificate.unneeded) == {"mass[2].p", "spring[2].x"}
    text = found.text()
    assert "damper[1] (text.bg:10) gives nothing: loss = 0" in text
    assert "no output needs 2 states: mass[2].p, spring[2].x" in text
    assert "3 of 4 entries" not in text and "2 of 4 entries" in text  # x' = p/m and p' = -k x


def test_what_is_set_is_not_left_out() -> None:
    """A value that this run sets allows no specialisation, even if it is zero."""
    found = explain(compiled(TEXT, {"loss": 0.0, "push": 0.0}))
    assert not found.left_out and not found.certificate.unneeded
    assert "nothing: all of the model is needed" in found.text()


def test_as_json() -> None:
    told = json.loads(json.dumps(explain(compiled(MODELS / "manipulator.bg", experiment="push_x")).to_json()))
    assert told["schema"] == "bondgraph-explanation/1" and told["experiment"] == "push_x"
    assert {"name": "push_y", "place": "manipulator.bg:55", "because": ["fy"]} in told["gives_nothing"]
    assert told["operations"]["jacobian_entries"] == 39
    assert sum(line["operations"] for line in told["lines"]) == told["operations"]["rates"]


def test_what_happens_at_instants_is_listed() -> None:
    text = """model A {
  mode count = 0
  C s : F = 100 [N/m]*x if x > 0 m else 50 [N/m]*x { start x = 1 m }
  I m : p = 1 kg*v
  R d : F = 2 N*max(v/1 [m/s], 0)
  1 b
  b -> m, s, d
  every 0.1 s { count = count + 1 }
  when s.x > 1 m { count = 0 }
  output x = s.x, n = count
}
"""
    told = explain(compiled(text))
    assert told.certificate.events == ("every 0.1 s (text.bg:8)", "when s.x > 1 m (text.bg:9)")
    lines = told.text().split("what happens at instants\n")[1].splitlines()
    assert lines[:2] == ["  every 0.1 s (text.bg:8)", "  when s.x > 1 m (text.bg:9)"]
    assert lines[2] == "  a condition on states in `s` (text.bg:3)" and lines[3].startswith("  1 bend of laws")
    assert told.to_json()["certificate"]["events"] == list(told.certificate.events)
    assert "2 events" in told.certificate.line


def test_what_nothing_excites_is_told() -> None:
    """Of a run; the model's own certificate counts all states, as its analyses do."""
    compilation = compiled(TEXT.replace("x { start", "x*i { start").replace("start x = 1 m", "start x = (2 - i)*1 m"))
    assert not explain(compilation).certificate.unexcited
    run = replace(compilation, scene=replace(compilation.scene, from_start=True))
    found = explain(run)
    assert set(found.certificate.unexcited) == {"mass[2].p", "spring[2].x"} and not found.certificate.unneeded
    assert "nothing excites 2 states, at zero in the whole run: mass[2].p, spring[2].x" in found.text()
    assert found.to_json()["unexcited"] == found.to_json()["certificate"]["unexcited"]
