"""Junctions whose condition reads constants alone: they are on or off for the whole run, without an event."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph

TEXT = """model Act {
  parameter flag = 1, twice = 2*flag
  constant least = 1.5
  mode open = false
  Se drive : F = 1 N
  1 a { active = CONDITION }
  I m1 : p = 1 kg*v
  C k1 : F = 4 [N/m]*x
  C k2 : F = 9 [N/m]*x               { start x = 1 m }
  I m2 : p = 2 kg*v
  1 b
  drive -> a -> m1, k1
  a -> 0(b)
  b -> k2, m2
  when time > 10 s { open = true }
  output x1 = k1.x, x2 = k2.x, v = m1.v
  experiment go { simulate 0 .. 2 s }
  experiment without { set flag = 0; simulate 0 .. 2 s }
}
"""
ON, OFF = "flag > 0", "flag < 0"


def model(condition: str, text: str = TEXT) -> bondgraph.Model:
    return bondgraph.load(text.replace("CONDITION", condition))


def junctions(found: bondgraph.Model, experiment: str = "go", **settings: float) -> int:
    """Number of junctions that a run may switch."""
    return len(found.compilation(found.scene(experiment, settings)).state_space.switches)


@pytest.mark.parametrize("condition", [ON, "twice > least", "twice/flag == 2", "1 < 2", "not flag < 0"])
@pytest.mark.parametrize("target", ["native", "numpy"])
def test_a_junction_that_is_always_on(condition: str, target: str) -> None:
    """Its run is that of the junction without a condition, and that of a condition that only events could change."""
    found = model(condition)
    assert junctions(found) == 0 and junctions(model("not open")) == 1
    plain = model("", TEXT.replace("{ active = CONDITION }", ""))
    values = found.simulate(target=target, rtol=1e-11).values
    assert np.array_equal(values, plain.simulate(target=target, rtol=1e-11).values)
    assert np.abs(values - model("not open").simulate(target=target, rtol=1e-11).values).max() < 1e-9


@pytest.mark.parametrize("condition", [OFF, "twice < least", "2 < 1"])
@pytest.mark.parametrize("target", ["native", "numpy"])
def test_a_junction_that_is_always_off(condition: str, target: str) -> None:
    found, switched = model(condition), model("open")
    assert junctions(found) == 0 and junctions(switched) == 1
    values = found.simulate(target=target, rtol=1e-11).values
    assert np.abs(values - switched.simulate(target=target, rtol=1e-11).values).max() < 1e-9


def test_values_that_are_set_decide() -> None:
    """A value from outside is an argument of the program: the junction can then switch, and the run is that of the text with the value."""
    found = model(ON)
    assert junctions(found, flag=0.0) == 1
    for flag in (0.0, 1.0, -1.0):
        written = model(ON, TEXT.replace("flag = 1", f"flag = {flag:g}")).simulate(rtol=1e-11)
        assert np.abs(found.simulate(settings={"flag": flag}, rtol=1e-11).values - written.values).max() < 1e-9
        many = found.simulate_many([{"flag": flag}, {"flag": 1.0}], rtol=1e-11)
        assert np.abs(many["x1"][0] - written["x1"]).max() < 1e-9


def test_values_of_an_experiment_decide() -> None:
    found = model(ON)
    assert junctions(found, "without") == 0
    off = model(OFF).simulate(rtol=1e-11)
    assert np.abs(found.simulate("without", rtol=1e-11).values - off.values).max() < 1e-9


@pytest.mark.parametrize("condition", ["open", "not open", "m1.v > 0.1 [m/s]", "time > 1 s", "flag > 0 and not open"])
def test_what_may_change_switches(condition: str) -> None:
    assert junctions(model(condition)) == 1
