"""Failures that end a run or prevent its start: reported with place and time, and earlier results are kept."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed
from compiler.errors import CompilationFailed

MODELS = Path(__file__).resolve().parents[2] / "models"
BLOCKED = """model Blocked {
  "A source of flow into a junction that goes off: then nothing is left to decide."
  mode open = true
  Sf push : v = 1 [m/s]
  1 body { active = open }
  C spring : F = 1 [N/m]*x
  R damper : F = 1 [N*s/m]*v
  push -> body -> spring, damper
  output x = spring.x
  when spring.x > 0.5 m { open = false }
}
"""
UNPLACED = {
    "start of a storage": "I mass : p = 1 kg*v  C spring : F = 1 [N/m]*x { start x = 1 m/z }  1(mass) -> spring",
    "start of an integral": "signal x = integral(1 [1/s], 1/z)",
    "angle of a body": "multibody m : planar { body a { mass = 1 kg, at = (1 m, 0), angle = 1/z }  hinge h : ground to a }",
    "start of a joint": "multibody m : planar { body a { mass = 1 kg, at = (1 m, 0) }  hinge h : ground to a { start phi = 1/z } }",
}


def test_what_was_computed_is_kept_where_another_causality_has_no_equations() -> None:
    """The message says when and without what; everything up to then is there."""
    with pytest.raises(RunFailed, match=r"at t = 0\.5 s the model goes on without `body`.*`push`") as failed:
        bondgraph.load(BLOCKED).simulate(to=1.0, points=101)
    kept = failed.value.result
    assert kept is not None and 0.49 <= kept.time[-1] <= 0.5
    assert np.abs(kept["x"] - kept.time).max() < 1e-9


@pytest.mark.parametrize("what", UNPLACED)
def test_a_place_or_start_without_a_value_is_told_where_it_stands(what: str) -> None:
    """A parameter in a denominator is zero; with another value there is no error."""
    lines = UNPLACED[what].replace("  ", "\n")
    text = f"model Unplaced {{\nparameter z = 0\n{lines}\noutput o = 1\n}}\n"
    with pytest.raises(CompilationFailed) as failed:
        bondgraph.load(text).simulate(to=1.0)
    found = failed.value.diagnostics[0]
    assert "no finite value" in found.sentence and "1" in found.span.text and "z = 0" in found.help
    assert bondgraph.load(text.replace("z = 0", "z = 2")).simulate(to=0.1, points=3).time[-1] == 0.1


GROWS = "plain model Grows {{\n  signal x = integral({0}*x*(1 - x), 1e-12)\n  signal y = integral(cos(time) - y^3, 0)\n  output grown = x\n}}\n"


@pytest.mark.parametrize("rate", [1e3, 1e6])
def test_what_grows_is_not_damped_by_long_steps(rate: float) -> None:
    """From 1e-12, far below any tolerance, a logistic growth arrives in 28/rate s; a method for stiff models would rather stay at zero."""
    found = bondgraph.load(GROWS.format(rate)).simulate(to=100 / rate, points=201, solver="radau")
    arrived = float(found.time[np.argmax(found["grown"] > 0.5)])
    assert abs(arrived * rate - math.log(1e12)) < 3  # its error is e-fold by e-fold what is overlooked at 1e-12
    assert abs(found.final("grown") - 1) < 1e-5


@pytest.mark.machine_code
def test_a_long_run_is_as_accurate_at_its_beginning() -> None:
    """A pilot run with steps longer than many swings once found 1e3 rad and more; tolerances were relative to that."""
    model = bondgraph.load(MODELS / "pendulum.bg")
    short, long = model.simulate(to=2.0, points=2, rtol=1e-6), model.simulate(to=1000.0, points=501, rtol=1e-6)
    for name in ("upper", "lower"):
        assert abs(short[name][-1] - long[name][1]) < 2e-5
