"""Runs with events in machine code against the same runs in Python: the same steps, the same instants, the same things kept where a run is cut."""

from __future__ import annotations

import signal
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.compiled_scene import TARGETS, chosen_target
from bondgraph.errors import RunFailed, RunInterrupted
from bondgraph.results.result import Result
from bondgraph.simulation.events.events import Events
from bondgraph.simulation.integration import passed_events
from tests.stress.events import STICK_SLIP

BOTH = [pytest.param(t, marks=pytest.mark.machine_code) if t == "native" else t for t in TARGETS]

BALL = """model Ball {
  parameter m = 0.1 kg, bounce = 0.9
  1  ball    { active = not resting }
  I  mass    : p = m*v
  Se weight  : F = -m*10 [m/s^2]
  R  drag    : F = 0.02 [N*s/m]*v
  weight -> ball -> mass, drag
  output height = integral(ball.v, 1 m), v = mass.v
  mode resting = false
  when height < 0 m { mass.v = -bounce*mass.v; resting = abs(mass.v) < 10 [mm/s] }
}
"""
RECTIFIER = """model Rectifier {
  Se mains : u = 10 V*sin(2*pi*50*time/1 s)
  R source : u = 1 [ohm]*i
  R diode  : i = u/1 [mohm] if u > 0 V else 0 A
  C store  : u = q/20 [mF]
  R load   : u = 10 [ohm]*i
  mains -> 1(source, diode) -> 0(store, load)
  output u = store.u
}
"""
SAMPLED = """plain model Sampled {
  "A hysteresis that heats, a counter that is sampled, and a condition that only an event asks for, whose flips cut no step."
  mode heats = true, count = 0
  signal warm = integral((3 if heats else 0) - warm + 0.1*sin(7*time), 0)
  when warm > 2 { heats = false }
  when warm < 1 { heats = true }
  when sin(40*time) > 0.99*warm + 0.01 and count < 1000 { count = count + 1 }
  every 0.37 { count = floor(count/2) }
  output y = warm, n = count
}
"""
RUNS = {
    "ball": (BALL, 12.0),
    "stick and slip": (STICK_SLIP, 8.0),
    "rectifier": (RECTIFIER, 0.06),
    "sampled": (SAMPLED, 9.0),
}


@pytest.mark.few(4)
@pytest.mark.machine_code
@pytest.mark.parametrize("solver", ["automatic", "radau", "rodas"])
@pytest.mark.parametrize("name", RUNS)
def test_both_ways_take_the_same_steps(name: str, solver: str) -> None:
    text, to = RUNS[name]
    native, numpy = (run(text, to, target=target, solver=solver, energy=True, points=101) for target in TARGETS)
    assert native.solver == numpy.solver.replace("numpy", "native") and "native" in native.solver
    if name == "stick and slip":  # where it sticks, slopes are zero but for rounding, by which a first step is chosen
        assert native.steps == pytest.approx(numpy.steps, rel=0.05)
    else:
        assert native.steps == numpy.steps and dict(native.evaluations) == dict(numpy.evaluations)
    assert [e.condition for e in native.events] == [e.condition for e in numpy.events]
    close = (
        1e-9 if solver == "rodas" else 1e-11
    )  # its slopes in time are differences, by whose rounding first steps behind events differ
    np.testing.assert_allclose([e.time for e in native.events], [e.time for e in numpy.events], rtol=close)
    near = 1e-8 if solver == "rodas" else 1e-9
    np.testing.assert_allclose(native.values, numpy.values, rtol=near, atol=near * np.abs(numpy.values).max())
    assert native.notes == numpy.notes and native.warnings == numpy.warnings
    assert native.energy is not None and numpy.energy is not None
    for kind in ("supplied", "stored", "dissipated"):
        assert getattr(native.energy, kind) == pytest.approx(getattr(numpy.energy, kind), rel=1e-7, abs=1e-12)


def run(text: str, to: float, **more: Any) -> Result:
    return bondgraph.load(text).simulate(to=to, rtol=1e-7, **more)


SAW = """plain model Saw {
  "It rises by one in a second and falls back at one: events at all whole seconds."
  parameter most = 1
  mode count = 0
  signal x = integral(1 + 1e-30*x^3, 0)
  when x > most { x = x - most; count = count + 1 }
  output y = x, n = count
}
"""


@pytest.mark.parametrize("target", BOTH)
def test_thousands_of_events(target: str) -> None:
    to = 2000.5 if target == "native" else 100.5
    found = run(SAW, to, target=target, points=7)
    times = np.array([e.time for e in found.events])
    np.testing.assert_allclose(times, np.arange(1, int(to) + 1), rtol=1e-12)
    assert found.final("n") == int(to) and found.final("y") == pytest.approx(0.5, abs=1e-8)


TOUCH = """plain model Touch {
  "A root that is below zero for a small part of each turn, which is less than what a step looks at."
  parameter least = 1e-3
  mode count = 0
  signal x = integral(y, 1), y = integral(-x, 0)
  when (x + 1)^2 + y^2 < least { count = count + 1 }
  output n = count
}
"""


@pytest.mark.parametrize("target", BOTH)
@pytest.mark.parametrize("least", [1e-3, 1e-5])
def test_a_root_that_only_dips_below_zero_is_seen(target: str, least: float) -> None:
    """(x + 1)^2 + y^2 = 2 + 2 cos t is below it near t = pi for 2 sqrt(least): each turn once."""
    found = run(TOUCH, 20 * np.pi, target=target, points=3, settings={"least": least})
    assert found.final("n") == 10
    first = 2 * np.arcsin(np.sqrt(least) / 2)
    np.testing.assert_allclose([e.time for e in found.events], np.pi * (2 * np.arange(10) + 1) - first, atol=1e-4)


@pytest.mark.parametrize("target", BOTH)
def test_nothing_is_seen_behind_an_event(target: str) -> None:
    """A limit that the step leaves, but behind the event that ends it; and one that it leaves before."""
    text = SAW.replace("  output", "  require x < {limit}\n  output")
    assert not run(text.replace("{limit}", "1.0001"), 20.5, target=target).warnings
    (left,) = run(text.replace("{limit}", "0.9999"), 20.5, target=target).warnings
    assert left.time == pytest.approx(0.9999, abs=1e-9)


@pytest.mark.parametrize("target", BOTH)
def test_what_an_event_breaks_keeps_what_came_before(target: str) -> None:
    text = SAW.replace("x = x - most;", "x = x - most + (0 if count < 29 else sqrt(count - 30));")
    with pytest.raises(RunFailed, match=r"at t = 30 s the new value of `x` \(text:6\) is not finite") as failed:
        run(text, 100, target=target, points=1001)
    result = failed.value.result
    assert result is not None and result.checkpoint is not None and len(result.events) == 29
    assert 29 < result.checkpoint.time < 30 and 29 < result.time[-1] <= result.checkpoint.time
    beside = np.abs(result.time - np.round(result.time)) > 0.01
    np.testing.assert_allclose(result["y"][beside], (result.time % 1)[beside], atol=1e-8)


@pytest.mark.parametrize("target", BOTH)
def test_an_interrupted_run_with_events_goes_on(target: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C in the middle of it, while a step is looked for and while an event acts: nothing is lost, nothing counted twice."""
    from bondgraph.simulation.events.events import Events
    from bondgraph.simulation.integration.event_integrator import EventIntegrator

    whole = run(SAW, 60.5, target=target, points=122)
    for home, name in ((EventIntegrator, "follow"), (Events, "happen"), (Events, "just_after")):
        original, left = getattr(home, name), [True]

        def interrupted(
            self: Any, at: Any, *given: Any, original: Any = original, left: Any = left, **more: Any
        ) -> Any:
            if left and getattr(at, "time", at) > 45.2:  # a look ahead ends before
                left.clear()
                signal.raise_signal(signal.SIGINT)
            return original(self, at, *given, **more)

        monkeypatch.setattr(home, name, interrupted)
        before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a process in the background ignores it
        try:
            with pytest.raises(RunInterrupted) as stopped:
                run(SAW, 60.5, target=target, points=122)
        finally:
            signal.signal(signal.SIGINT, before)
        monkeypatch.undo()
        result = stopped.value.result
        assert result is not None and result.checkpoint is not None
        assert 0 <= result.checkpoint.time - result.time[-1] < 1.1 and 44 <= len(result.events) <= 46
        rest = run(SAW, 60.5, target=target, points=122, start=result)
        np.testing.assert_allclose([e.time for e in rest.events], [e.time for e in whole.events], rtol=1e-9)
        np.testing.assert_allclose(rest.values, whole.values, atol=1e-7)


@pytest.mark.machine_code
def test_delays_are_stepped_through_in_python() -> None:
    text = "plain model Late {\n signal x = integral(-delay(x, 1), 1)\n when x < 0 { x = 1 }\n output y = x\n}\n"
    assert "numpy (delays)" in run(text, 3.0).solver
    assert chosen_target(None) == "native"


THERMOSTAT = """model Thermostat {
  mode heats = true, starts = 0
  when T < 293 K { heats = true; starts = starts + 1 }
  when T > 295 K { heats = false }
  signal T = integral(((100 W if heats else 0 W) - 2 [W/K]*(T - 280 K) - 1e-3 [W/K^2]*(T - 280 K)^2)/1 [kJ/K], 280 K)
  output y = T, count = starts
}
"""
TWO_BALLS = """model TwoBalls {
  1 a
  1 b
  I one : p = 0.1 kg*v
  I two : p = 0.2 kg*v
  Se pull_one : F = -1 N
  Se pull_two : F = -1.7 N
  R drag : F = 0.03 [N*s/m]*v
  pull_one -> a -> one, drag
  pull_two -> b -> two
  mode hits = 0, passes = 0
  output x = integral(a.v, 1 m), y = integral(b.v, 1.3 m), n = hits, k = passes
  when x < 0 m { one.v = -0.95*one.v; hits = hits + 1 }
  when y < 0 m { two.v = -1*two.v }
  when x > y { passes = passes + 1 }
}
"""


@pytest.mark.machine_code
@pytest.mark.parametrize(
    ("text", "to", "solver"),
    [
        (BALL, 8.0, "automatic"),
        (BALL, 8.0, "radau"),
        (THERMOSTAT, 6000.0, "radau"),
        (TWO_BALLS, 9.0, "radau"),
        (TWO_BALLS, 9.0, "explicit"),
        (RECTIFIER, 0.06, "automatic"),
    ],
)
def test_events_that_machine_code_passes_are_those_of_python(
    text: str, to: float, solver: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the last bit: instants, states, counts of work, records of events, and the checkpoint at the end."""
    seen = []
    happen = Events.happen

    def counted(*arguments: Any, **named: Any) -> Any:
        seen[-1] += 1
        return happen(*arguments, **named)

    monkeypatch.setattr(Events, "happen", counted)
    runs = []
    for passes in (passed_events.is_passable, lambda stepper: False):
        monkeypatch.setattr(passed_events, "is_passable", passes)
        seen.append(0)
        found = bondgraph.load(text).simulate(to=to, points=301, rtol=1e-8, solver=solver)
        runs.append((found.values.tobytes(), found.steps, found.evaluations, found.events, found.notes, repr(found.checkpoint)))  # fmt: skip
    assert runs[0] == runs[1]
    assert len(runs[0][3]) > 10 or text == RECTIFIER
    assert text == RECTIFIER or seen[0] < 0.6 * seen[1]  # most of them without Python
