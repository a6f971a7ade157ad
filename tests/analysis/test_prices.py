"""Price list of a run: the price of an output is that of a run with this output alone, that of a zero that of a text with the zero in it."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import replace

import pytest

import bondgraph
from bondgraph.analysis.prices import Price
from compiler.api import cost

TEXT = """
model A {
  parameter r = 2 [N*s/m], k = 8 [N/m], k3 = 5 [N/m^3], m = 1 kg, idle = 0 N
  input push = 3 N
  for i in 1..2 {
    1 body[i]
    MSe drive[i] : F = push + idle
    I mass[i]   : p = m*v
    C spring[i] : F = k*x + k3*x^3 { start x = 1 m }
    R damper[i] : F = r*v
    drive[i] -> body[i] -> mass[i], spring[i], damper[i]
  }
  output x1 = spring[1].x, x2 = spring[2].x
  experiment go { simulate 0 .. 1 s }
}
"""


def price_of(text: str, outputs: tuple[str, ...] | None = None) -> Price:
    model = bondgraph.load(text)
    lowered = model.compilation(replace(model.scene(outputs=outputs), from_start=True)).lowered
    count = cost(lowered)
    return Price(len(lowered.space.states), count.rates, count.jacobian)


def test_outputs_and_zeros_cost_what_their_own_runs_cost() -> None:
    found = bondgraph.load(TEXT).prices()
    assert found.whole == price_of(TEXT) and found.whole.states == 4
    assert found.outputs == {name: price_of(TEXT, (name,)) for name in ("x1", "x2")}
    assert found.outputs["x1"].states == 2
    assert set(found.zeros) == {"r", "k", "k3", "m", "push"}  # `idle` is zero as it is
    for name, written in {
        "r": "r = 2 [N*s/m]",
        "k": "k = 8 [N/m]",
        "k3": "k3 = 5 [N/m^3]",
        "m": "m = 1 kg",
        "push": "push = 3 N",
    }.items():
        unit = written.partition(" = ")[2][2:]
        assert found.zeros[name] == price_of(TEXT.replace(written, f"{name} = 0 {unit}")), name
    saved = [price.rates + price.jacobian for price in found.zeros.values()]
    assert saved == sorted(saved) and saved[-1] < found.whole.rates + found.whole.jacobian


def test_an_output_that_is_asked_for_is_all_that_counts() -> None:
    model = bondgraph.load(TEXT)
    found = model.prices(outputs=("x2",))
    assert found.whole == found.outputs["x2"] and set(found.outputs) == {"x2"}
    assert found.zeros["r"].states == 2


def test_what_is_set_is_no_zero_of_the_text() -> None:
    """A value from outside stays an argument of the program, so a zero of it saves nothing in this run, and would in the text."""
    model = bondgraph.load(TEXT)
    found = model.prices(settings={"r": 0.0})
    assert found.whole == price_of(TEXT)
    assert found.zeros["r"] == model.prices().zeros["r"]


def test_zeros_are_tried_as_long_as_there_is_time() -> None:
    found = bondgraph.load(TEXT).prices(seconds=0.0)
    assert found.untried == ("r", "k", "k3", "m", "push") and not found.zeros
    assert "not tried: r, k, k3, m, push" in found.summary()
    assert "nothing: no zero saves any" in found.summary()


def test_summary_and_json() -> None:
    found = bondgraph.load(TEXT).prices()
    lines = found.summary().splitlines()
    assert lines[0] == "price of each output alone" and lines[1].split()[:1] == ["states"]
    assert lines[2].split() == ["x1", "2", *map(str, (found.outputs["x1"].rates, found.outputs["x1"].jacobian))]
    told = json.loads(json.dumps(found.to_json()))
    assert told["schema"] == "bondgraph-prices/1" and told["whole"]["states"] == 4
    assert told["zeros"]["k3"] == dataclasses.asdict(found.zeros["k3"]) and told["untried"] == []


@pytest.mark.parametrize("experiment", ["nowhere", "x1"])
def test_an_experiment_that_does_not_exist_is_refused(experiment: str) -> None:
    with pytest.raises(bondgraph.CompilationFailed, match="BG"):
        bondgraph.load(TEXT).prices(experiment)
