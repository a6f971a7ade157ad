"""Laws of states with kinks: their cost in digits and in steps, with and without a step that ends there. And pulses that a step could miss."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph
from bondgraph.errors import RunFailed
from bondgraph.simulation.integrators.steps import radau_step

BOUNCE = """
model Bounce {
  "A mass that falls slowly and bounces on a spring without loss."
  I mass   : p = 1 kg*v                  { start v = 1 [m/s] }
  C spring : F = 1000 [N/m]*min(x, 0 m)  { start x = 0.3 m }
  Se weight : F = -0.981 N
  1 body
  weight -> body -> mass, spring
  output x = spring.x
}
"""
LAWS = {
    "min": "1000 [N/m]*min(x, 0 m)", "abs": "5 N*abs(x/1 m) + 40 [N/m]*x", "max": "1000 [N/m]*max(x - 0.1 m, 0 m) + 20 [N/m]*x",
    "linear": "linear(x, (-9 m, -0.2 m, 0.2 m, 9 m), (-900 N, -2 N, 2 N, 900 N))",
}  # fmt: skip


def bounced(times: np.ndarray) -> np.ndarray:
    """Parabolas above zero, arcs of a sine about -a/w^2 below: x, v at each start of a piece from the end of the one before."""
    a, w = 0.981, math.sqrt(1000)
    c = a / w**2
    x, v, begun, flying, found = 0.3, 1.0, 0.0, True, []

    def after(s: float) -> tuple[float, float]:
        if flying:
            return x + v * s - a * s * s / 2, v - a * s
        return c * math.cos(w * s) + v / w * math.sin(w * s) - c, -c * w * math.sin(w * s) + v * math.cos(w * s)

    for t in times:
        while True:  # an arc is symmetric about its turn, where tan(w s) = v/(c w)
            length = (v + math.sqrt(v * v + 2 * a * x)) / a if flying else 2 * (math.pi + math.atan(v / (c * w))) / w
            if t <= begun + length:
                break
            x, v = 0.0, after(length)[1]
            begun, flying = begun + length, not flying
        found.append(after(t - begun)[0])
    return np.array(found)


def errors(tolerances: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Errors of x, and how often the rates were asked."""
    model = bondgraph.load(BOUNCE)
    results = [model.simulate(to=20, rtol=r, points=101, target="numpy") for r in tolerances]
    exact = bounced(results[0].time)
    worst = np.array([np.abs(r["x"] - exact).max() for r in results])
    return worst, np.array([r.evaluations["derivative"] for r in results])


def test_the_error_follows_the_tolerance(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten bounces: a tenth of the error and fewer evaluations at 1e-6, and no scatter of the error over the tolerance."""
    tolerances = (1e-5, 1e-6, 1e-7, 1e-8)
    found, asked = errors(tolerances)
    slope, start = np.polyfit(np.log10(tolerances), np.log10(found), 1)
    scatter = np.log10(found) - slope * np.log10(tolerances) - start
    assert 0.9 < slope < 1.6 and np.ptp(scatter) < math.log10(5)
    monkeypatch.setattr(radau_step, "first_bend", lambda *_: 1.0)
    plain, more = errors(tolerances[1:2])
    assert found[1] < 0.1 * plain[0] and asked[1] < more[0]


@pytest.mark.machine_code
@pytest.mark.parametrize("law", LAWS)
def test_machine_code_ends_its_steps_at_the_same_bends(law: str) -> None:
    model = bondgraph.load(BOUNCE.replace("1000 [N/m]*min(x, 0 m)", LAWS[law]))
    one, other = (model.simulate(to=4, points=21, target=t) for t in ("numpy", "native"))
    assert (one.steps, one.evaluations) == (other.steps, other.evaluations)
    np.testing.assert_allclose(one["x"], other["x"], rtol=0, atol=1e-9)


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("target", ["numpy", pytest.param("native", marks=pytest.mark.machine_code)])
@pytest.mark.parametrize("solver", ["explicit", "rodas"])
def test_other_methods_end_their_steps_at_bends(rtol: float, target: str, solver: str) -> None:
    """Asked for by name; before, the explicit pair erred by some hundred tolerances at a bounce."""
    found = bondgraph.load(BOUNCE).simulate(to=10, rtol=rtol, points=101, solver=solver, target=target)
    assert np.abs(found["x"] - bounced(found.time)).max() < 10 * rtol


def test_what_does_not_bend_has_no_bends() -> None:
    smooth = bondgraph.load(BOUNCE.replace("min(x, 0 m)", "x")).compilation().program
    assert smooth.bends is None and "def bends(" not in smooth.source


# ---------------------------------------------------------------------- short pulses in long runs

PULSE = """
model Pushed {{
  I mass   : p = 1 kg*v
  C spring : F = 100 [N/m]*x{more}
  R damper : F = 5 [N*s/m]*v
  Se push  : F = 1 N*sin(time/1 s) + 100 N*exp(-((time - 3.1 s)/{width})^2)
  1 body
  push -> body -> mass, spring, damper
  output x = spring.x
}}
"""


@pytest.mark.parametrize("target", ["numpy", pytest.param("native", marks=pytest.mark.machine_code)])
@pytest.mark.parametrize("width", [0.05, 0.003])
@pytest.mark.parametrize("cubic", [0.0, 1.0])
def test_no_step_passes_over_a_pulse(width: float, cubic: float, target: str) -> None:
    """50 ms and 3 ms in 6 s: by the matrix exponential where the spring is linear, else by steps."""
    more = f" + {cubic} [N/m^3]*x^3" if cubic else ""
    found = bondgraph.load(PULSE.format(more=more, width=f"{width} s")).simulate(to=6, points=7, target=target)

    def rates(t: float, y: np.ndarray) -> list[float]:
        return [
            y[1],
            math.sin(t) + 100 * math.exp(-(((t - 3.1) / width) ** 2)) - 100 * y[0] - cubic * y[0] ** 3 - 5 * y[1],
        ]

    state, expected = np.zeros(2), [0.0]
    for begin, end in ((0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 6)):
        longest = width / 2 if begin == 3 else math.inf
        state = solve_ivp(rates, (begin, end), state, "DOP853", rtol=1e-9, atol=1e-11, max_step=longest).y[:, -1]
        expected.append(state[0])
    np.testing.assert_allclose(found["x"], expected, rtol=0, atol=1e-6)


def test_a_pulse_alone_is_no_silence() -> None:
    """With all else exactly zero, the effect of the pulse is its area."""
    text = (
        "model A {\n I m : p = 1 kg*v\n Se a : F = 100 N*exp(-((time - 3.1 s)/(3 ms))^2)\n a -> m\n output v = m.v\n}\n"
    )
    assert bondgraph.load(text).simulate(to=6, points=2).final("v") == pytest.approx(0.3 * math.sqrt(math.pi), rel=1e-9)


def test_steps_get_short_at_once_where_a_stiff_mode_rings() -> None:
    """A jump of force on a stiff mass, 1 MHz beside 1 s: steps that are longer than its period all err alike, which is no round-off."""
    text = """
model Rings {
  I heavy : p = 1 kg*v
  I light : p = 1e-9 [kg]*v
  C stiff : F = 4e4 [N/m]*x + 1e12 [N/m^3]*x^3
  R loss  : F = 1e-4 [N*s/m]*v
  Se push : F = 1 N*step(time - 0.1 s)
  1 a, b
  a -> heavy
  push -> b -> light
  b -> 0(1(stiff, loss)) -> a
  output v = light.v, V = heavy.v
}
"""
    try:
        found = bondgraph.load(text).simulate(to=0.2, points=3)
    except RunFailed as failed:
        pytest.fail(str(failed))
    assert found.final("V") == pytest.approx(0.1, rel=1e-3)
