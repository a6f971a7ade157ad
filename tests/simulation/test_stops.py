"""`stop when`: runs that a condition ends, at instants in closed form, and what is reported of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bondgraph
from bondgraph import Graph
from bondgraph.results.result import Result
from compiler.metamorphosis.printing import statement
from compiler.source import Source
from compiler.syntax import parse

TEXT = """model M {{
  signal x = integral({rate}, 0)
  {more}
  output y = x
  experiment e {{ simulate 0 .. 2 s {{ points = 11 }}; {steps} }}
}}"""
METHODS = [
    *(pytest.param(solver, "native", marks=pytest.mark.machine_code) for solver in ("explicit", "radau", "rodas")),
    ("explicit", "numpy"),
]


def model(steps: str, more: str = "", rate: str = "1 [1/s]") -> bondgraph.Model:
    return bondgraph.load(TEXT.format(steps=steps, more=more, rate=rate))


def ends(result: Result, time: float, value: float) -> None:
    """The last instant is that of the condition, those before it are the regular ones."""
    assert result.stopped_by is not None and result.stopped_by.stops and result.stopped_by.time == result.time[-1]
    assert result.time[-1] == pytest.approx(time, abs=1e-9) and result.final("y") == pytest.approx(value, abs=1e-9)
    regular = np.linspace(0, 2, 11)
    np.testing.assert_array_equal(result.time[:-1], regular[regular < time - 1e-9])
    assert result.stopped == "" and any("stop when" in note for note in result.notes)


@pytest.mark.parametrize(("solver", "target"), METHODS)
def test_a_state_ends_a_run(solver: str, target: str) -> None:
    """x = 1 - exp(-t) reaches 0.7 at ln(1/0.3)."""
    result = model("stop when x > 0.7", rate="(1 - x)/1 s").simulate(solver=solver, target=target, rtol=1e-10)
    ends(result, math.log(1 / 0.3), 0.7)


CASES = {
    "between instants": ("stop when x > 0.55", "", 0.55, 0.55),
    "at an instant": ("stop when x >= 1", "", 1.0, 1.0),
    "time": ("stop when time > 0.73 s", "", 0.73, 0.73),
    "time at an instant": ("stop when time >= 1 s", "", 1.0, 1.0),
    "true at the start": ("stop when x >= 0", "", 0.0, 0.0),
    "of a parameter": ("stop when p > 0.5", "parameter p = 1", 0.0, 0.0),
    "the first of two": ("stop when x > 1.5; stop when x > 0.7", "", 0.7, 0.7),
    "what else acts there": ("stop when x > 0.5", "when x > 0.5 { x = 3 }", 0.5, 3.0),
    "after what else acts": ("stop when x > 2.5", "when x > 0.5 { x = 3 }", 0.5, 3.0),
    "of a mode": ("stop when n > 3", "mode n = 0\n every 0.25 s { n = n + 1 }", 0.75, 0.75),
    "of a count": ("stop when floor(10*x) == 7", "", 0.7, 0.7),
    "of both": ("stop when x > 0.5 and time > 1.2 s", "", 1.2, 1.2),
    "of the past": ("stop when d > 0.5", "signal d = delay(x, 0.3 s)", 0.8, 0.8),
    "at the very end": ("stop when x >= 2", "", 2.0, 2.0),
}


@pytest.mark.parametrize("case", CASES)
def test_conditions(case: str) -> None:
    steps, more, time, value = CASES[case]
    ends(model(steps, more).simulate(), time, value)


def test_a_condition_that_stays_false_ends_nothing() -> None:
    result = model("stop when x > 5").simulate()
    assert result.stopped_by is None and len(result.time) == 11 and result.events == ()


def test_a_run_from_rest_and_one_without_states() -> None:
    steps = "experiment e { equilibrium; simulate 0 .. 2 s { points = 11 }; stop when x > 0.5 }"
    ends(
        bondgraph.load(f"model M {{ signal x = integral((1 - x)/1 s, 0)\noutput y = x\n{steps} }}").simulate(), 0.0, 1.0
    )
    text = "model M { output y = sin(time/1 s)\nexperiment e { simulate 0 .. 2 s { points = 11 }; stop when y > 0.5 } }"
    ends(bondgraph.load(text).simulate(), math.asin(0.5), 0.5)


def test_with_junctions_that_switch_and_an_energy_balance() -> None:
    more = "1 j { active = x < 0.5 }\n Se s : F = 1 N\n I m : p = 1 kg*v\n s -> j -> m\n output p = m.p"
    result = model("stop when x > 0.9", more).simulate(energy=True)
    ends(result, 0.9, 0.9)
    assert result.final("p") == 0.0 and result.energy is not None  # the junction holds the mass from 0.5 s on
    assert result.energy.supplied == pytest.approx(0.125, rel=1e-9)  # p^2/2 m, up to there
    assert abs(result.energy.residual) < 1e-9


def test_a_run_goes_on_beyond_its_end() -> None:
    short = model("stop when x > 0.8").simulate()
    whole = model("stop when x > 0.8").simulate(start=short)
    assert whole.stopped_by is None and whole.final("y") == pytest.approx(2.0, abs=1e-12)
    np.testing.assert_allclose(whole.time, [*short.time, *np.linspace(0, 2, 11)[5:]], atol=1e-9)


def test_many_runs_share_their_instants() -> None:
    runs = bondgraph.load(TEXT.format(steps="stop when x > 0.75", more="parameter k = 1", rate="k*1 [1/s]"))
    found = runs.simulate_many([{"k": k} for k in (0.1, 0.5, 2.0)], workers=1)
    np.testing.assert_allclose(found.final("y"), [0.2, 0.75, 0.75], atol=1e-9)
    np.testing.assert_array_equal(found.time, np.linspace(0, 2, 11))
    grid = np.linspace(0, 2, 11)
    for row, (k, end) in zip(found["y"], [(0.1, 2.1), (0.5, 1.5), (2.0, 0.375)], strict=True):
        np.testing.assert_allclose(row, np.where(grid < end, k * grid, np.nan), atol=1e-9)


def test_check_and_error_compare_the_ends() -> None:
    result = model("stop when x > 0.7", rate="(1 - x)/1 s").simulate(check=True, error=True)
    assert result.check is not None and result.check.holds and result.error is not None and not result.error.failure


def test_texts() -> None:
    """Printed, and by the builder, it is the same step; the flat text of a graph has no experiments, and no `when` of one."""
    text = TEXT.format(steps="stop when x > 0.7", more="", rate="1 [1/s]")
    tree = parse(Source("m.bg", text)).models["M"]
    assert "stop when x > 7e-1" in statement(tree.statements[-1], "")
    assert "when" not in bondgraph.load(text).text()
    graph = Graph("Built")
    graph.signal("x", "integral(1 [1/s], 0)")
    graph.output("y", "x")
    graph.experiment("e", 2, points=11, stop_when="x > 0.7")
    ends(graph.model().simulate(), 0.7, 0.7)


def test_an_end_at_the_first_instant_after_the_start_has_a_magnitude() -> None:
    """The values at the end count: of an output that is zero before, they are all there is."""
    text = "model M {\n  signal x = integral(2 [1/s], 0)\n  output y = x, t = time\n  experiment e { simulate 0 .. 5 s { points = 11 }; stop when x > 1 }\n}"
    check = bondgraph.load(text).simulate(check=True).check
    assert check is not None and check.holds, check
    assert {row.name: row.magnitude for row in check.outputs} == pytest.approx({"y": 1.0, "t": 0.5})
