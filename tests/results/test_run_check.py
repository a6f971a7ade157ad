"""A run beside its repetition: covered and uncovered properties, and the report."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.commands import commands
from bondgraph.errors import UsageError
from bondgraph.results.records import Column, EventRecord
from bondgraph.results.result import Result
from bondgraph.results.run_check import FACTOR
from bondgraph.simulation.repetition import compare

OSCILLATOR = """model A {
  I m : p = 1 kg*v { start v = 1 [m/s] }
  C s : F = 4 [N/m]*x + 1 [N/m^3]*x^3
  1(m) -> s
  mode n = 0
  when s.x > 0.2 m { n = n + 1 }
  output x = s.x, count = n
  experiment go { simulate 0 .. 10 s }
}
"""


def result(x: list[float], events: list[float], rtol: float = 1e-6) -> Result:
    """A run of one output at five instants."""
    time = np.linspace(0, 4, 5)
    told = tuple(EventRecord(t, "x > 0", "", "a.bg:1") for t in events)
    return Result("A", None, time, (Column("x", "m"),), np.array(x)[:, None], rtol=rtol, events=told)


def test_a_run_that_holds() -> None:
    check = bondgraph.load(OSCILLATOR).simulate(check=True).check
    assert check is not None and check.holds and check.solver.startswith("Radau")
    assert check.events[0] == check.events[1] > 2
    assert check.rtol == pytest.approx(1e-7)
    row = check.outputs[0]
    assert row.name == "x" and row.promised == pytest.approx(FACTOR * 1e-6 * row.magnitude)


@pytest.mark.parametrize("solver", ["exponential", "explicit", "radau", "rodas"])
def test_another_family(solver: str) -> None:
    lines = OSCILLATOR.replace(" + 1 [N/m^3]*x^3", "").replace(", count = n", "").splitlines()
    text = "\n".join(line for line in lines if "n = " not in line)
    found = bondgraph.load(text).simulate(solver=solver, check=True)
    assert found.check is not None and found.check.holds
    assert found.check.solver.split()[0] != found.solver.split()[0]


def test_differences_that_the_tolerance_does_not_cover() -> None:
    here = result([0, 1, 2, 1, 0], [0.5])
    assert compare(here, result([0, 1, 2 + 1e-5, 1, 0], [0.5]), 1e-7).holds
    wrong = compare(here, result([0, 1, 2.1, 1, 0], [0.5]), 1e-7)
    assert not wrong.holds and "`x` differs by 0.1 m" in wrong.sentence
    assert "0 events" in compare(result([0, 1, 2, 1, 0], []), here, 1e-7).sentence
    late = compare(here, result([0, 1, 2, 1, 0], [0.6]), 1e-7)
    assert not late.holds and "0.1 s" in late.sentence
    assert not compare(here, result([0, 1, np.nan, 1, 0], [0.5]), 1e-7).holds


def test_an_instant_of_an_event_belongs_to_both_sides() -> None:
    assert compare(result([0, 0, 1, 1, 1], [2.0]), result([0, 0, 0, 1, 1], [2.0]), 1e-7).holds
    assert not compare(result([0, 0, 1, 1, 1], [2.5]), result([0, 0, 0, 1, 1], [2.5]), 1e-7).holds


def test_told_on_the_command_line(tmp_path: Path) -> None:
    path = tmp_path / "a.bg"
    path.write_text(OSCILLATOR)
    run = CliRunner().invoke(commands, ["run", str(path), "--check"])
    assert run.exit_code == 0 and "The check holds" in run.stdout and "events: " in run.stdout
    told = json.loads(CliRunner().invoke(commands, ["run", str(path), "--check", "--json"]).stdout)["check"]
    assert told["holds"] and set(told["outputs"]) == {"x", "count"} and told["events"][0] > 2


def test_a_chaotic_run_does_not_hold(tmp_path: Path) -> None:
    """Three bodies of the equations of Lorenz: after 40 time units nothing is left of six digits."""
    path = tmp_path / "lorenz.bg"
    path.write_text(
        """plain model Lorenz {
  signal x = integral(10*(y - x), 1), y = integral(x*(28 - z) - y, 1), z = integral(x*y - 8*z/3, 1)
  output X = x
  experiment go { simulate 0 .. 40 }
}
"""
    )
    run = CliRunner().invoke(commands, ["run", str(path), "--check"])
    assert run.exit_code == 3 and "The check does not hold: `X` differs" in run.stdout


def test_what_goes_on_from_a_result_is_not_checked() -> None:
    model = bondgraph.load(OSCILLATOR)
    with pytest.raises(UsageError, match="cannot be checked"):
        model.simulate(start=model.simulate(to=1), to=2, check=True)


def test_a_run_that_ends_at_its_start_is_repeated_without_steps() -> None:
    model = bondgraph.load(
        "model N { signal x = integral(1 [1/s], 0)\n output y = x\n experiment e { simulate 0 .. 2 s; stop when x > -1 } }"
    )
    assert "repeated with no steps, rtol" in model.simulate("e", check=True).summary()
