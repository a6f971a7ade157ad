"""The matrix exponential from event to event: against closed forms, other methods at tight tolerances, and its limits; counts of evaluations."""

from __future__ import annotations

from math import log
from typing import Any

import numpy as np
import pytest

import bondgraph

PULSED = """model Buck {
  parameter T = 10 us, duty = 0.4, load = 5 ohm
  Se s : u = 24 V
  mode on = true
  signal saw = integral(1 - 0*time/1 s, 0 s)
  every T { on = true; saw = 0 s }
  when saw > duty*T { on = false }
  0 n : electric
"""
IDEAL = (
    "import IdealDiode, Switch from electric\n"
    + PULSED
    + """  IdealDiode d
  Switch sw { closed = 1 if on else 0 }
  I l : lambda = 100 uH*i
  C c : u = q/(100 uF)
  R r : u = load*i
  Se gnd : u = 0 V
  s -> 1(sw.pins) -> n
  gnd -> 1(d.pins) -> n
  n -> 1(l) -> 0(c, r)
  output u = c.u, i = l.i
}"""
)
RESISTIVE = (
    PULSED
    + """  MR sw : i = u/(10 mohm) if on else u/(100 kohm)
  R d : i = u/(20 mohm) if u > 0 V else u/(100 kohm)
  C snub : u = q/(1 nF)
  R r_snub : u = 10 ohm*i
  C node : u = q/(200 pF)
  I l : lambda = 100 uH*i
  C c : u = q/(100 uF)
  R r : u = load*i
  Se gnd : u = 0 V
  s -> 1(sw) -> n
  gnd -> 1(d) -> n
  n -> node
  n -> 1(snub, r_snub)
  n -> 1(l) -> 0(c, r)
  output u = c.u, i = l.i
}"""
)
SLIP = """model Slip {
  I mass : p = 1 kg*v
  C spring : F = 100 [N/m]*x
  R damp : F = 0.5 [N*s/m]*v
  R rub : F = 1000 [N*s/m]*v if v*v < 4.9e-5 [m^2/s^2] else
    (7 N - 1 [N*s/m]*(v - 0.007 [m/s]) if v > 0 [m/s] else -7 N - 1 [N*s/m]*(v + 0.007 [m/s]))
  Sf belt : v = 0.1 [m/s]
  1 body : translation
  0 contact
  belt -> contact -> body -> mass, spring, damp
  contact -> rub
  output x = spring.x, v = mass.v
}"""
RELAY = """model Relay {{
  "Between 1 V and 2 V with a time constant of 1 s; the source is at 3 V or at 0 V."
  mode on = true
  MSe s : u = {source} if on else 0 V
  R r : u = 1 ohm*i
  C c : u = q/1 F {{ start u = 1 V }}
  s -> 1(r, c)
  when c.u > 2 V {{ on = false }}
  when c.u < 1 V {{ on = true }}
  output u = c.u, i = r.i
}}"""


def run(text: str, solver: str = "automatic", **options: Any) -> bondgraph.Result:
    return bondgraph.load(text).simulate(solver=solver, **options)


def evaluations(found: bondgraph.Result) -> int:
    return sum(found.evaluations.values())


def agree(found: bondgraph.Result, other: bondgraph.Result, within: float) -> None:
    """Values relative to the largest of each output, and the instants of all events relative to the run."""
    for name in (column.name for column in found.columns):
        np.testing.assert_allclose(found[name], other[name], rtol=0, atol=within * np.abs(other[name]).max())
    assert [e.condition for e in found.events] == [e.condition for e in other.events]
    instants = ([e.time for e in result.events] for result in (found, other))
    np.testing.assert_allclose(*instants, rtol=0, atol=within * found.time[-1])


@pytest.mark.parametrize("target", ["numpy", pytest.param("native", marks=pytest.mark.machine_code)])
def test_instants_of_a_relay(target: str) -> None:
    """From 1 V to 2 V takes ln 2, from 2 V to 1 V too; three evaluations of the rates in each segment, whatever the tolerance."""
    found = run(RELAY.format(source="3 V"), to=10.0, points=11, rtol=1e-3, target=target)
    instants = [e.time for e in found.events]
    np.testing.assert_allclose(instants, log(2) * np.arange(1, 15), rtol=1e-14)
    assert found.solver.startswith("matrix exponential, ")
    assert found.steps <= 2 * 15 and found.evaluations["derivative"] <= 3 * found.steps


def test_a_ramp_is_exact() -> None:
    """u' = 3 V (1 + t) - u from 1 V: u = 3 t + exp(-t)."""
    text = RELAY.format(source="3 V").replace(
        "s -> 1(r, c)", "Se ramp : u = 3 V*time/1 s\n  1 loop\n  s -> loop -> r, c\n  ramp -> loop"
    )
    found = run(text, to=0.4, points=3, rtol=1e-3)
    assert found.solver.startswith("matrix exponential, ")
    np.testing.assert_allclose(found["u"], 3 * found.time + np.exp(-found.time), rtol=1e-14)
    agree(*(run(text, solver, to=3.0, points=3, rtol=1e-12) for solver in ("automatic", "explicit")), 1e-11)


def test_a_buck_converter_with_ideal_switches() -> None:
    found, other = (run(IDEAL, solver, to=3e-4, points=61) for solver in ("automatic", "explicit"))
    agree(found, other, 1e-12)
    assert found.solver.startswith("matrix exponential, ")
    assert 4 * evaluations(found) < evaluations(other)


@pytest.mark.machine_code  # the reference takes minutes as Python
def test_a_buck_converter_with_resistances() -> None:
    """Time constants from 2 ps on: a seventh of the evaluations of Radau, and a hundredth of its error."""
    truth = run(RESISTIVE, "radau13", to=1e-4, points=61, rtol=1e-12)
    found, other = (run(RESISTIVE, solver, to=1e-4, points=61) for solver in ("automatic", "radau"))
    agree(found, truth, 1e-11)
    assert found.solver.startswith("matrix exponential, ")
    assert 5 * evaluations(found) < evaluations(other) and 2 * found.steps < other.steps


@pytest.mark.machine_code
def test_stick_and_slip() -> None:
    truth, other = (run(SLIP, "explicit", to=10.0, points=201, rtol=rtol) for rtol in (1e-12, 1e-6))
    found = run(SLIP, to=10.0, points=201)
    agree(found, truth, 1e-11)
    assert 10 * evaluations(found) < evaluations(other)


@pytest.mark.machine_code
@pytest.mark.parametrize("text", [RESISTIVE, IDEAL, SLIP], ids=["resistive", "ideal", "slip"])
def test_machine_code_and_python_agree(text: str) -> None:
    to = 1.0 if text is SLIP else 2.5e-5
    found, other = (run(text, to=to, points=26, target=target) for target in ("native", "numpy"))
    agree(found, other, 1e-12)
    assert found.steps == other.steps and found.evaluations == other.evaluations


@pytest.mark.machine_code
def test_values_set_at_run_time() -> None:
    """Other values give other matrices in one program; each agrees with its own text."""
    model = bondgraph.load(RESISTIVE)
    for load in (5.0, 50.0, 5.0):
        found = model.simulate(settings={"load": load}, to=3e-5, points=7)
        own = run(RESISTIVE.replace("load = 5 ohm", f"load = {load} ohm"), to=3e-5, points=7)
        agree(found, own, 1e-13)


def test_energy_balance_and_going_on() -> None:
    model = bondgraph.load(IDEAL)
    whole = model.simulate(to=1e-4, points=11, energy=True)
    assert whole.energy is not None and abs(whole.energy.residual) < 1e-9 * 24 * 10 * 1e-4
    half = model.simulate(to=4.2e-5, points=5)
    rest = model.simulate(to=1e-4, points=5, start=half)
    assert rest.final("u") == pytest.approx(whole.final("u"), rel=1e-13)
    assert rest.solver.startswith("matrix exponential")


def test_an_estimate_of_the_error_is_not_zero() -> None:
    """A repetition with another tolerance would be the same run: it is made in other parts of time."""
    found = run(RELAY.format(source="3 V"), to=10.0, points=101, error=True)
    assert found.error is not None and found.error.worst is not None
    assert 0.0 < found.error.worst.share < 1e-13


def test_a_nonlinear_indicator() -> None:
    """The search for events reads values of the condition, of whatever form."""
    text = RELAY.format(source="3 V").replace("c.u > 2 V", "exp(c.u/1 V) - 1 > 6.38905609893065")
    found = run(text, to=1.0, points=3)
    assert found.solver.startswith("matrix exponential, ")
    assert found.events[0].time == pytest.approx(log(2), rel=1e-13)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (("u = 1 ohm*i", "u = 1 ohm*i + 1e-9 [ohm/A^2]*i^3"), "affine"),
        (("u = 1 ohm*i", "u = 1 ohm*max(i, 0.5*i)"), "affine"),
        (("3 V if", "3 V*sin(time/1 s) if"), "signals that vary"),
        (("3 V if", "2 V + delay(c.u, 0.1 s) if"), "delayed"),
    ],
    ids=["nonlinear", "kink", "sine", "delay"],
)
def test_refusals_name_their_reason(change: tuple[str, str], word: str) -> None:
    text = RELAY.format(source="3 V").replace(*change)
    with pytest.raises(bondgraph.UsageError, match=word):
        run(text, "exponential", to=1.0, points=3)
    assert not run(text, to=1.0, points=3).solver.startswith("matrix exponential")


def test_a_segment_with_a_moving_signal_goes_by_steps() -> None:
    """The source swings while it is on; off, the model is linear again, and another method has stepped before."""
    text = RELAY.format(source="3 V*(1 + 0.1*sin(time/0.1 s))")
    found, truth = run(text, to=4.0, points=41), run(text, "explicit", to=4.0, points=41, rtol=1e-12)
    assert "Dormand-Prince 8" in found.solver and "matrix exponential" in found.solver
    agree(found, truth, 1e-6)


@pytest.mark.parametrize("solver", ["exponential", "explicit"])
def test_a_crossing_on_a_place_of_the_search(solver: str) -> None:
    """Rounding may hide that a polynomial crosses zero at a place of the grid: the next place is then behind the crossing, not before it."""
    found = run(IDEAL, solver, to=1.4e-4, points=2, rtol=1e-12)
    opened = np.array([e.time for e in found.events if e.condition.startswith("saw")])
    np.testing.assert_allclose(opened, (np.arange(14) + 0.4) * 1e-5, rtol=1e-12)
