"""Modes that are one of several words, and their transitions: the events that they stand for, counted and placed exactly."""

from __future__ import annotations

import pytest

import bondgraph
from bondgraph.errors import RunFailed
from compiler.unparse import write_text
from tests.compiling import compiled, mistake

MACHINE = """
model Machine {
  input u = 0
  parameter first: { off, on, worn } = off
  mode state: { off, on, worn } = first {
    off -> on  when u > 0.5
    on  -> off when u < 0.2 { }
  }
}
"""
WRITTEN = """model A {{
  mode n = 0
  signal s = sin(2*pi*time/1 s)
  {machine}
  signal busy = 1 if state == {b} else 0
  output work = integral(busy*(1 [1/s]), 0), k = n, worn = state == {c}
  experiment go {{ simulate 0 .. 2.2 s }}
}}
"""
SUGAR = WRITTEN.format(
    b="b", c="c",
    machine="mode state: { a, b, c } = a { a -> b when s > 0.5; b -> a when s < 0 { n = n + 1 }; a, b -> c when n > 1 }",
)  # fmt: skip
PLAIN = WRITTEN.format(
    b="2", c="3",
    machine="mode state = 1\n  when state == 1 and s > 0.5 { state = 2 }\n  when state == 2 and s < 0 { n = n + 1; state = 1 }\n"
    "  when (state == 1 or state == 2) and n > 1 { state = 3 }",
)  # fmt: skip


@pytest.mark.parametrize("target", [pytest.param("native", marks=pytest.mark.machine_code), "numpy"])
def test_transitions_are_the_events_that_they_stand_for(target: str) -> None:
    """It is in b from a twelfth to a half of each period, twice; then it is worn, at the same instant."""
    sugar, plain = (bondgraph.load(text).simulate(target=target, points=23) for text in (SUGAR, PLAIN))
    for name in ("work", "k", "worn"):
        assert (sugar[name] == plain[name]).all()
    assert [e.time for e in sugar.events] == [e.time for e in plain.events]
    assert [e.time for e in sugar.events] == pytest.approx([1 / 12, 0.5, 13 / 12, 1.5, 1.5], abs=1e-9)
    assert [sugar.final(n) for n in ("work", "k", "worn")] == pytest.approx([5 / 6, 2, 1], abs=1e-9)
    assert sugar.events[0].condition == "s > 0.5, a -> b"


def test_flat_text_and_any_order() -> None:
    model = bondgraph.load(SUGAR)
    flat = model.text()
    assert "mode state = 1" in flat and bondgraph.load(flat).text() == flat
    assert bondgraph.load(flat).simulate(to=2.2).final("work") == pytest.approx(5 / 6, abs=1e-9)


def test_in_instances_and_rounds() -> None:
    """A machine of its own in each instance; one that begins on, one in each round; and a word that is a name elsewhere."""
    text = (
        MACHINE
        + "model A {\n  parameter on = 7\n  Machine one { u = time/1 s }\n  Machine two { first = on; u = 0.3 }\n"
        "  for i in 1..2 { mode stage[i]: { low, high } = low { low -> high when time > i*0.4 s } }\n"
        "  output a = one.state == on, b = two.state == on, c = stage[1] == high, d = stage[2] == high, e = on\n"
        "  experiment go { start two.state = worn; simulate 0 .. 0.6 s }\n}\n"
    )
    found = bondgraph.load(text, "A").simulate(points=2)
    assert [found.final(n) for n in "abcde"] == [1, 0, 1, 0, 7]
    found = bondgraph.load(text, "A").simulate(None, to=0.9, points=2)
    assert [found.final(n) for n in "abcde"] == [1, 1, 1, 1, 7]


def test_words_in_events_and_samples() -> None:
    text = (
        "model A {\n  mode s: { a, b } = a, n = 0\n  when time > 0.45 s { n = 10 }\n  every 0.2 s { s = b if s == a else a; n = n + 1 }\n"
        "  output y = s == b, k = n\n}\n"
    )
    found = bondgraph.load(text).simulate(to=1, points=11)
    assert found["y"].tolist() == [1, 1, 0, 0, 1, 1, 0, 0, 1, 1, 0]
    assert found.final("k") == 13


def test_two_ways_out_at_one_instant_are_refused() -> None:
    body = "mode s: { a, b, c } = a { a -> b when time > 0.3 s; a -> c when time > 0.3 s }\n  output y = s == b"
    with pytest.raises(RunFailed, match="at one instant"):
        bondgraph.load(f"model A {{\n  {body}\n}}\n").simulate(to=1)


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("mode s: { a, b } = a { a -> d when time > 1 s }", "BG111"),
        ("mode s: { a, b } = a { d -> a when time > 1 s }", "BG111"),
        ("mode s: { a, b } = a { a -> b when time }", "BG111"),
        ("mode s: { a, b } = a { a -> b when time > 1 s { s = a } }", "BG153"),
        ("mode s: { a, b } = 2", "BG122"),
        ("mode s: { a, b }", "BG110"),
        ("mode s: { a, a } = a", "BG104"),
        ("mode s: { a, b } = a\n  when time > 1 s { s = 2 }", "BG111"),
        ("mode s: { a, b } = a\n  if s == a { output x = 1 }", "BG106"),
        ("mode s: { a, b } = a\n  output x = s", "BG111"),
        ("mode s: { a, b } = a\n  experiment e { start s = c; simulate 0 .. 1 s }", "BG111"),
        ("signal s: { a, b } = a", "BG111"),
    ],
)
def test_wrong_states(line: str, code: str) -> None:
    assert (
        "--set" not in mistake(f"model A {{\n  {line}\n  output y = time\n}}\n", code).help
    )  # modes are not set from outside


def test_the_graph_is_that_of_numbers() -> None:
    assert write_text(compiled(SUGAR).graph).replace("# A", "") == write_text(compiled(PLAIN).graph).replace("# A", "")
