"""New values of an event: a storage is set by what it stores, or by its other variable, by way of its law."""

from __future__ import annotations

import pytest

import bondgraph
from tests.compiling import compiled

TEXT = """plain model A {{
  parameter k = 1
  mode d = 0
  {storage}
  0 n
  1 m
  Sf j : f = time - time
  Se s : e = time - time
  j -> n -> c
  s -> m -> l
  when time > 1 {{ {action} }}
  output q = c.q, p = l.p, v = d
}}"""
CASES = {
    # storages, action, expected charge and momentum at the end
    "what is stored": ("C c : e = q/2\n I l : p = 4*f", "c.q = 7; l.p = -3", 7.0, -3.0),
    "a linear law": ("C c : e = q/2\n I l : p = 4*f", "c.e = 5; l.f = -0.5", 10.0, -2.0),
    "a law with a parameter": ("C c : q = 2*e + k\n I l : f = p/(1 + k)", "c.e = 5; l.f = 3", 11.0, 6.0),
    "a law that gives what is stored": ("C c : q = e + e^3\n I l : p = 4*f + f^3", "c.e = 2; l.f = 2", 10.0, 16.0),
    "a law that cannot be solved": ("C c : e = q^5 + q + 1\n I l : f = p^5 + 2*p", "c.e = 3; l.f = 3", 1.0, 1.0),
    "a value of both": ("C c : e = q/2\n I l : p = 4*f", "c.e = l.p + 6; l.f = c.q + 3", 12.0, 12.0),
    "a storage of two ports": ("C c(x, y) : x.e = x.q, y.e = 2*y.q\n I l : p = 4*f", "c.x.q = 3; l.p = 1", 3.0, 1.0),
}


@pytest.mark.parametrize("case", CASES)
def test_values_after_an_event(case: str) -> None:
    storage, action, charge, momentum = CASES[case]
    text = TEXT.format(storage=storage, action=f"{action}; d = 4")
    if "c(x, y)" in text:
        text = text.replace("n -> c", "n -> c.x\n n -> 1(c.y)").replace("c.q, p", "c.x.q, p")
    found = bondgraph.load(text).simulate(to=2.0, points=3, rtol=1e-10)
    assert [found.final(name) for name in "qpv"] == pytest.approx([charge, momentum, 4.0], rel=1e-9)


def test_rows_of_events_and_switches() -> None:
    """An assignment by way of a law has the stored quantity as its target, one that no law solves the variable as written."""
    text = TEXT.format(storage="C c : e = q/2\n I l : f = p^5 + 2*p", action="c.e = 5; l.f = 3")
    text = text.replace(
        "output", "every 0.5 { d = d + 1 }\n 1 w { active = time < 1 }\n n -> w -> r\n R r : e = f\n output"
    )
    system = compiled(text).equations
    once, sampled = system.events
    names = [[system.variables[s.target].name for s in event.settings] for event in (once, sampled)]
    assert names[0][0] == "c.q" and names[0][1] != "l.p" and names[1] == ["d"]
    assert not once.sampling and sampled.sampling
    assert system.variables[once.condition].name == "when time > 1"
    (switch,) = system.switches
    assert (switch.junction, system.variables[switch.condition].name) == ("w", "w is active")


@pytest.mark.parametrize("output", ["c.q", "c.e", "time"])
def test_what_never_moves_cannot_be_set(output: str) -> None:
    """No flow ever goes into the storage, so that no state stands behind its effort; whoever reads it or not is told so."""
    text = f"""plain model A {{
  C c : e = q^5 + q + 1
  0 n
  Sf j : f = 0
  j -> n -> c
  when time > 1 {{ c.e = 3 }}
  output y = {output}
}}"""
    with pytest.raises(bondgraph.RunFailed, match=r"events cannot set `c\.e`"):
        bondgraph.load(text).simulate(to=2.0, points=3)
