"""Jumps in time: no step passes over one."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed
from bondgraph.simulation.integrators import exponential

PUSHED = """
model Pushed {{
  Se push : F = {force}
  1  body
  I  mass : p = 1 kg*v
  push -> body -> mass
  output v = mass.v, force = push.F
}}
"""


def run(force: str, **options: object) -> bondgraph.Result:
    return bondgraph.load(PUSHED.format(force=force)).simulate(to=1.0, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("start", ["0.5 s", "1 s - 1 ns", "0 s", "0.123456789 s"])
def test_a_pulse_of_a_nanosecond_and_area_one(start: str) -> None:
    result = run(f"1e9 N*pulse(time, {start}, {start} + 1 ns)")
    # An instant of 0.5 s in a double is known to 1e-16 s, a nanosecond from it to 2e-7 of itself.
    assert result.final("v") == pytest.approx(1.0, rel=5e-7)


def test_many_pulses_at_once() -> None:
    force = " + ".join(f"1e6 N*pulse(time, {0.1 * i} s, {0.1 * i} s + 1 us)" for i in range(1, 10))
    result = run(f"{force} + 1e6 N*pulse(time, 0.5 s, 0.5 s + 1 us)")
    assert result.final("v") == pytest.approx(10.0, rel=1e-9)


@pytest.mark.parametrize(
    ("force", "momentum"),
    [
        ("2 N*step(time - 0.3 s)", 1.4),
        ("2 N*step(0.3 s - time)", 0.6),
        ("1 N*ramp(time, 0.2 s, 0.6 s)", 0.6),
        ("1 N*smoothstep3(time, 0.2 s, 0.6 s)", 0.6),
        ("1 N*smoothstep5(time, 0.2 s, 0.6 s)", 0.6),
        ("3 N if time < 0.25 s else 1 N", 1.5),
        ("1 N*abs(time/1 s - 0.5)", 0.25),
        ("1 N*max(0, time/1 s - 0.75)", 0.03125),
        ("1 N*sign(time/1 s - 0.4)", 0.2),
        ("1 N if sin(2*pi*time/0.4 s) > 0 else 0 N", 0.6),
        ("1 N if 0.2 s < time and time < 0.5 s or time > 0.9 s else 0 N", 0.4),
    ],
)
def test_momentum_of_what_jumps_and_bends(force: str, momentum: float) -> None:
    assert run(force).final("v") == pytest.approx(momentum, rel=1e-6)


def test_the_value_at_a_jump_is_that_after_it() -> None:
    result = run("2 N*step(time - 0.5 s)", points=3)
    assert result["force"].tolist() == [0.0, 2.0, 2.0]
    assert run("2 N*step(time - 1 s)", points=3)["force"].tolist() == [0.0, 0.0, 2.0]


@pytest.mark.parametrize(("exactly", "most"), [(True, 4), (False, 18)])
def test_stopping_at_a_jump_costs_a_fixed_number_of_steps(
    exactly: bool, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two stretches; one of them has a reported instant within. First steps go by rates alone, so that units of time change nothing."""
    if not exactly:
        monkeypatch.setattr(exponential, "linear_form", lambda *_: None)
    counts = {run("2 N*step(time - 0.3 s)", points=3).steps for _ in range(2)}
    assert len(counts) == 1
    assert counts.pop() <= most


def test_a_jump_through_parameters_and_signals() -> None:
    text = """
    model Inner { parameter at: s, high: N = 1
      input shift = 0 s
      port out: translation
      signal edge = at + shift
      MSe push : F = high*step(time - 2*edge)
      push -> out }
    model Outer {
      Inner late { at = 0.1 s, shift = 0.05 s, high = 4 N }
      1 body : translation
      I mass : p = 2 kg*v
      late.out -> body -> mass
      output v = mass.v
    }"""
    assert bondgraph.load(text).simulate(to=1.0).final("v") == pytest.approx(4 * 0.7 / 2, rel=1e-9)


def test_a_jump_that_needs_the_search_is_found_to_rounding() -> None:
    result = run("1 N if exp(time/1 s) > 2 else 0 N")
    assert result.final("v") == pytest.approx(1 - np.log(2), rel=1e-9)


def test_conditions_within_conditions() -> None:
    text = """
    model Nested {
      signal saw = time if time < 0.5 s else time - 0.5 s
      MSe push : F = 1 N*step(saw - 0.2 s) if saw < 0.4 s else 3 N*abs(saw/1 s)
      1 body
      I mass : p = 1 kg*v
      push -> body -> mass
      output v = mass.v
    }"""
    # Twice: 0.2 s of 1 N, then 3 t from 0.4 s to 0.5 s.
    assert bondgraph.load(text).simulate(to=1.0).final("v") == pytest.approx(2 * (0.2 + 1.5 * (0.25 - 0.16)), rel=1e-9)


@pytest.mark.few(3)
@pytest.mark.parametrize("law", ["u = 1 kohm*i", "u = 1 kohm*i + 1e-9 [ohm/A^2]*i^3"], ids=["exactly", "by steps"])
@pytest.mark.parametrize("periods", [20, 256, pytest.param(1500, marks=pytest.mark.machine_code)])
def test_a_square_wave_from_a_sine_misses_no_edge(law: str, periods: int) -> None:
    """A half period charges by E = exp(-1): the last peak is tanh(1/2) of the steady wave, for any number of periods.

    256 periods look like none on a regular grid of 256 places.
    """
    text = f"""model Wave {{
      Se s : u = 1 V if sin(2*pi*time/(2 ms)) > 0 else -1 V
      R r : {law}
      C c : u = q/1 uF
      s -> 1(r, c)
      output u = c.u
    }}"""
    result = bondgraph.load(text).simulate(to=periods * 2e-3, points=5)
    assert result.final("u") == pytest.approx(-np.tanh(0.5), abs=2e-5)


@pytest.mark.machine_code
def test_a_condition_that_changes_too_often_is_told() -> None:
    with pytest.raises(RunFailed, match="changes too often"):
        run("2 N if sin(1e9 [1/s]*time) > 0 else 0 N")
