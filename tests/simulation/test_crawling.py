"""A run with very many steps reports the mode that limits them, in Hz and by the elements that have its energy, and advice."""

from __future__ import annotations

import math
import re

import pytest

import bondgraph
from bondgraph.errors import RunFailed
from bondgraph.simulation.integration import native_integrator
from bondgraph.simulation.monitors import step_size_diagnosis

# A slow mass on a soft spring, and on it a light one on a stiff spring that rings: 503 Hz, which nothing damps.
RINGING = """model Ringing {{
  parameter m = 1 kg, k: N/m = 1
  I mass   : p = m*v
  C soft   : F = k*x + 0.1 [N/m^3]*x^3 {{ start x = 1 m }}
  I bell   : p = 1e-3 [kg]*v
  C clamp  : F = 1e4 [N/m]*x {{ start x = {start} }}
  1 body, top : translation
  0 joint : translation
  body -> mass, soft, joint
  joint -> clamp, top
  top -> bell
  output x = soft.x
}}"""
FREQUENCY = math.sqrt(1e4 / 1e-3 + 1e4 / 1) / (2 * math.pi)


def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(step_size_diagnosis, "MANY", 300)


@pytest.mark.machine_code
@pytest.mark.parametrize("solver", ["automatic", "radau"])
def test_the_mode_is_named_with_its_frequency_and_elements(solver: str, monkeypatch: pytest.MonkeyPatch) -> None:
    few(monkeypatch)
    found = bondgraph.load(RINGING.format(start="1 mm")).simulate(to=0.3, points=11, solver=solver)
    (note,) = found.notes
    told = re.search(r"oscillation at ([\d.]+) Hz", note)
    assert told and float(told[1]) == pytest.approx(FREQUENCY, rel=1e-3)
    assert "`bell`" in note and "`clamp`" in note and "`soft`" not in note and "rigid" in note


@pytest.mark.machine_code
@pytest.mark.parametrize("width", ["0.1 [ns]", "1 [ns]", "10 [ns]"])
def test_short_steps_at_the_end_are_not_most_steps(width: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A push at the end of the run, within nanoseconds, moves a speck that follows it at once."""
    few(monkeypatch)
    speck = f"I speck : p = 1e-9 kg*v; R oil : F = 1 [N*s/m]*v; Se push : F = 1 N*exp((time - 0.3 s)/({width})); push -> 1(speck, oil); output w = speck.v, x ="
    text = RINGING.format(start="1 mm").replace("output x =", speck)
    (note,) = bondgraph.load(text).simulate(to=0.3, points=11, solver="radau").notes
    assert "an oscillation" in note and "`bell`" in note


def test_who_asks_for_an_explicit_method_is_told_what_it_costs(monkeypatch: pytest.MonkeyPatch) -> None:
    few(monkeypatch)
    found = bondgraph.load(RINGING.format(start="0 m")).simulate(to=1.0, points=11, solver="explicit")
    assert len(found.notes) == 1 and "stability" in found.notes[0] and "`radau`" in found.notes[0]


def test_what_is_followed_because_it_is_all_there_is_is_no_news(monkeypatch: pytest.MonkeyPatch) -> None:
    few(monkeypatch)
    text = "plain model Alone { signal x = integral(v, 1), v = integral(-x - 0.1*x^3, 0); output a = x }"
    found = bondgraph.load(text).simulate(to=400, points=11, rtol=1e-8)
    assert found.steps > 300 and found.notes == ()


def test_few_steps_tell_nothing() -> None:
    assert bondgraph.load(RINGING.format(start="1 mm")).simulate(to=0.1, points=11).notes == ()


def test_at_the_limit_of_steps_the_error_names_the_mode(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native_integrator, "MOST_COMPILED", 500)
    monkeypatch.setattr(native_integrator, "MOST_STEPS", 500)
    with pytest.raises(RunFailed, match=r"Hz, whose energy is mostly in .*`(bell|clamp)`") as failed:
        bondgraph.load(RINGING.format(start="1 mm")).simulate(to=50, points=11, solver="radau")
    told = re.search(r"at ([\d.]+) Hz", str(failed.value))
    assert told and float(told[1]) == pytest.approx(FREQUENCY, rel=1e-3)
