"""States selected again in a run: two capacitors behind a transformer whose ratio runs over many decades, against a closed form."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed

A, B = 2.0, 3.0


def pair(ratio: str, extra: str = "") -> str:
    """u_a = n(t) u_b: the charge of a follows from that of b, or the reverse."""
    return f"""model Pair {{
      signal n = {ratio}
      0 left, right : electric
      C a : q = {A} F*u {{ start u = 1 V }}
      C b : q = {B} F*u
      MTF t : u1 = n*u2
      left -> t -> right
      left -> a
      right -> b
      {extra}
      output ua = a.u, ub = b.u
    }}
    """


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("ratio", "n"),
    [
        ("exp(12*sin(time/1 s))", lambda t: np.exp(12 * np.sin(t))),
        ("exp(-12*sin(time/1 s))", lambda t: np.exp(-12 * np.sin(t))),
        ("cos(time/1 s)", np.cos),
        ("1e-3 + time/1 s*1e3", lambda t: 1e-3 + 1e3 * t),
    ],
)
def test_two_capacitors(ratio: str, n: object) -> None:
    """No power is supplied, so u_b^2 (B + A n^2) is constant; for small n the charge is in b, for large n in a."""
    assert callable(n)
    found = bondgraph.load(pair(ratio)).simulate(to=6, points=121, rtol=1e-9, energy=True)
    ratios = n(found.time)
    constant = (B + A * ratios[0] ** 2) / ratios[0] ** 2  # u_a starts at 1 V
    ub = np.sqrt(constant / (B + A * ratios**2)) * np.sign(ratios[0])
    assert np.abs(found["ub"] - ub).max() < 1e-6 * np.abs(ub).max()
    assert np.abs(found["ua"] - ratios * ub).max() < 1e-6 * np.abs(ratios * ub).max()
    assert abs(found.energy.residual) < 1e-7 * 0.5 * constant


def test_who_is_the_state_changes() -> None:
    """At the start a is the state; once n has left its decades behind, b is: seen by the legs that a run has."""
    from bondgraph.simulation.phase import Phase

    begun: list[tuple[str, ...]] = []
    original = Phase.go

    def go(leg: Phase) -> None:
        begun.append(leg.program.states.names)
        original(leg)

    Phase.go = go  # type: ignore[method-assign]
    try:
        bondgraph.load(pair("exp(12*sin(time/1 s))")).simulate(to=6, points=7)
    finally:
        Phase.go = original  # type: ignore[method-assign]
    assert {("a.q",), ("b.q",)} <= set(begun) and 2 <= len(begun) <= 6


def test_no_other_choice_is_told() -> None:
    """b must be in derivative form: where n passes zero the run stops and says so."""
    text = pair("cos(time/1 s)").replace(f"C b : q = {B} F*u", f"C b : q = {B} F*u {{ require = derivative }}")
    with pytest.raises(RunFailed, match=r"`b` follows from `a` so steeply"):
        bondgraph.load(text).simulate(to=6)


def test_constant_ratios_cost_nothing() -> None:
    """A slope that does not change in a run is not looked at."""
    model = bondgraph.load(pair("2").replace("MTF", "TF").replace("n*u2", "2*u2").replace("signal n = 2", ""))
    assert model.compilation().program.sensitivity_pattern[0].size == 0


def test_what_follows_from_a_loop_does_not_choose() -> None:
    """Behind a stop, momenta follow by the solution of a nonlinear loop, which is no state: what is left moves on with the momentum that it had."""
    found = bondgraph.load(
        """plain model Stopped {
          I far(x, y) : energy = 0.8*(x^2 + y^2) + 0.2*(x^2 + y^2)^2
          I near(x, y) : x = 1.5*x.f + 0.1*y.f, y = 0.1*x.f + 1.6*y.f
          R loss : e = f
          1 a, b
          0 stop { active = time > 0.5 }
          a -> far.x, near.x, stop
          b -> far.y, near.y, loss
          output v = a.f, moved = far.y + near.y + integral(b.f, 0), left = b.f
          experiment go { simulate 0 .. 1; start near.x = 1; start near.y = 2 }
        }"""
    ).simulate(rtol=1e-8)
    assert found["v"][0] > 0.1 and found.final("left") > 0.1
    assert found.final("v") == pytest.approx(0.0, abs=1e-9)
    assert found.final("moved") == pytest.approx(found["moved"][0], rel=1e-7)
