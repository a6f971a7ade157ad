"""Whole numbers of time and of states (`floor`, `ceil`, `mod`, `stairs`, `pwm`): closed forms, all solvers, both targets."""

from __future__ import annotations

import math
import random
from itertools import pairwise

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed
from bondgraph.results.result import Result
from tests.compiling import compiled

METHODS = [
    *(pytest.param(solver, "native", marks=pytest.mark.machine_code) for solver in ("explicit", "radau", "rodas")),
    ("explicit", "numpy"),
]
every_method = pytest.mark.parametrize(("solver", "target"), METHODS)
RAMP = "signal x = integral({rate} [1/s], {start})\n"


def run(body: str, to: float = 2.0, points: int = 5, **options: object) -> Result:
    return bondgraph.load(f"model M {{\n{body}\n}}").simulate(to=to, points=points, **options)  # type: ignore[arg-type]


# ---------------------------------------------------------------------- of time

TIMED = """
  parameter T = 0.1 s, d = 0.3
  signal n = integral(floor(time/T), 0 [s]), on = integral(pwm(time, T, d), 0 [s]), rest = integral(mod(time, T), 0 [s^2])
  output k = floor(time/T), late = floor((time - 3*T)/T), back = floor(-time/T), up = ceil(time/T), tread = stairs(time, T), q = pwm(time, T, d)
  output n_ = n, on_ = on, rest_ = rest, within = mod(time, T)
"""


def test_counts_of_time_are_exact_at_reported_instants() -> None:
    """k T, as `numpy.linspace` rounds it, is the instant of the k-th jump, for any T; a signal has the value from there on."""
    model, draw = bondgraph.load(f"model M {{{TIMED}}}"), random.Random(20)
    for number in range(12):
        period = draw.choice([draw.uniform(1e-6, 3), 10 ** draw.uniform(-9, 2), 0.7, 0.3, 1 / 7, 1e-4 / 3])
        duty = [0.0, 1.0, 0.5, 1e-9, 1 - 1e-9, -0.5, 1.5, *(draw.random() for _ in range(5))][number]
        found = model.simulate(settings={"T": period, "d": duty}, to=20 * period, points=21)
        k, share = np.arange(21.0), min(max(duty, 0.0), 1.0)
        for name, expected in {
            "k": k,
            "late": k - 3,
            "back": -k - 1,
            "up": k + 1,
            "q": np.full(21, float(share > 0)),
        }.items():
            np.testing.assert_array_equal(found[name], expected, name)
        np.testing.assert_allclose(found["tread"], k * period, rtol=1e-15)
        np.testing.assert_allclose(found["within"], 0.0, atol=1e-13 * period)
        np.testing.assert_allclose(found["n_"], k * (k - 1) / 2 * period, rtol=1e-12, atol=1e-14 * period)
        np.testing.assert_allclose(found["on_"], share * k * period, rtol=1e-12, atol=2e-13 * period)
        np.testing.assert_allclose(found["rest_"], k * period**2 / 2, rtol=1e-12)


@every_method
def test_a_function_of_time_that_is_not_linear(solver: str, target: str) -> None:
    """floor(3.3 sin t) and a duty that is a sine: instants in closed form, and as the roots of u - d(u)."""
    found = run(
        "signal n = integral(floor(3.3*sin(time/1 s)), 0 [s]), m = integral(pwm(time, 1 s, 0.5 + 0.5*sin(time/1 s)), 0 [s])\noutput n_ = n, m_ = m",
        to=math.pi, solver=solver, target=target,
    )  # fmt: skip
    assert found.final("n_") == pytest.approx(sum(math.pi - 2 * math.asin(j / 3.3) for j in (1, 2, 3)), rel=1e-9)
    falls = []  # in each second the duty is met once: t - k = 0.5 + 0.5 sin t
    for k in range(4):
        low, high = float(k), float(k + 1)
        for _ in range(80):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if middle - k < 0.5 + 0.5 * math.sin(middle) else (low, middle)
        falls.append(low - k)
    assert found.final("m_") == pytest.approx(sum(falls[:3]) + min(falls[3], math.pi - 3), rel=1e-9)


def test_the_derivative_of_a_run_by_a_period() -> None:
    text = """model M { parameter T = 0.3 s, d = 0.4, tau = 0.5 s
    signal y = integral((pwm(time, T, d) + 0.1*stairs(time, T)/1 s - y)/tau, 0)
    output z = y }"""
    model, at = bondgraph.load(text), {"T": 0.3, "d": 0.4, "tau": 0.5}
    found = model.sensitivity_of_run(to=1.0, points=2)
    for name, value in at.items():
        ends = [
            model.simulate(settings={name: value + h}, to=1.0, points=2, rtol=1e-12).final("z") for h in (1e-5, -1e-5)
        ]
        assert found.of("z", name)[-1] == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-6)


def test_more_jumps_than_a_run_holds_are_refused() -> None:
    with pytest.raises(RunFailed, match="an event every 1e-09 s for 2 s acts more than 1000000 times"):
        run("signal n = integral(floor(time/1 ns), 0 [s])\noutput y = n")


# ---------------------------------------------------------------------- of states


@every_method
@pytest.mark.parametrize("start", [0, 1, -2, 3])
@pytest.mark.parametrize("rate", [0.0, 0.7, -0.7])
def test_a_state_that_starts_at_a_whole_number(rate: float, start: int, solver: str, target: str) -> None:
    body = (
        RAMP.format(rate=rate, start=start)
        + "signal n = integral(floor(x), 0 [s]), c = integral(ceil(x), 0 [s])\noutput n_ = n, c_ = c"
    )
    found = run(body, solver=solver, target=target)
    late = 2 - 1 / 0.7  # for so long x is beyond the next whole number
    low = 2 * start + (late if rate > 0 else -2 - late if rate < 0 else 0)
    high = 2 * start + (2 + late if rate > 0 else -late if rate < 0 else 0)
    assert found.final("n_") == pytest.approx(low, abs=1e-7) and found.final("c_") == pytest.approx(high, abs=1e-7)


OF_STATES = {  # what stands behind the rate of a signal while x rises from 0 to 2, or `x` as given, and its integral
    "small treads": ("stairs(x, 0.01)", 2 - 0.01),
    "counts of counts": ("floor(floor(4*x)/2)", 3.0),
    "sign": ("sign(floor(x - 1))", -1.0),
    "a condition on a count": ("(1 if floor(4*x) >= 5 else 0)", 0.75),
    "equality": ("(1 if floor(4*x) == 5 else 0)", 0.25),
    "a condition on a remainder": ("(1 if mod(x, 0.5) < 0.3 else 0)", 1.2),
    "a negative remainder": ("mod(-x, 0.5)", 0.5),
    "a product": ("x*floor(2*x)", (0.75 / 2 + 2 * 1.25 / 2 + 3 * 1.75 / 2)),
    "a negative length": ("mod(x, -0.5)", -0.5),
    "with time": ("floor(x + time/0.5 s)", (0 + 1 + 2 + 3 + 4 + 5) / 3),
}


@pytest.mark.few(20)
@every_method
@pytest.mark.parametrize("case", OF_STATES)
def test_counts_of_a_state_behind_a_rate(case: str, solver: str, target: str) -> None:
    law, expected = OF_STATES[case]
    found = run(
        RAMP.format(rate=1, start=0) + f"signal n = integral({law}, 0 [s])\noutput y = n",
        solver=solver,
        target=target,
        rtol=1e-9,
    )
    assert found.final("y") == pytest.approx(expected, abs=2e-8)


@every_method
def test_counts_along_an_oscillation(solver: str, target: str) -> None:
    """x = sin t: of 3.3 x the floor over half a period, and a duty of states, u = t/T against d(x)."""
    body = "signal x = integral(v, 0), v: 1/s = integral(-x/1 [s^2], 1 [1/s])\n"
    body += "signal n = integral(floor(3.3*x), 0 [s]), m = integral(pwm(time, 1 s, 0.5 + 0.5*x), 0 [s])\noutput n_ = n, m_ = m"
    found = run(body, to=math.pi, solver=solver, target=target, rtol=1e-10)
    timed = run("signal m = integral(pwm(time, 1 s, 0.5 + 0.5*sin(time/1 s)), 0 [s])\noutput m_ = m", to=math.pi)
    assert found.final("n_") == pytest.approx(sum(math.pi - 2 * math.asin(j / 3.3) for j in (1, 2, 3)), rel=1e-8)
    assert found.final("m_") == pytest.approx(timed.final("m_"), rel=1e-8)


@every_method
def test_what_events_set_is_counted_anew(solver: str, target: str) -> None:
    body = (
        RAMP.format(rate=0, start=0.5)
        + "when time > 1 s { x = %s }\nsignal n = integral(floor(x), 0 [s])\noutput y = n"
    )
    for value in (7, 2.5, -3, 6.25):  # whole numbers, another one of the same parity
        assert run(body % value, solver=solver, target=target).final("y") == pytest.approx(math.floor(value), abs=1e-9)


@every_method
def test_an_event_on_a_count(solver: str, target: str) -> None:
    body = RAMP.format(rate=1, start=0) + "mode k = 0\nwhen mod(floor(4*x), 2) == 1 { k = k + 1 }\noutput y = k"
    found = run(body, solver=solver, target=target)
    assert [e.time for e in found.events] == pytest.approx([0.25, 0.75, 1.25, 1.75], abs=1e-9) and found.final("y") == 4


def test_a_count_of_modes_jumps_with_these() -> None:
    body = "mode k = 0.25\nevery 0.5 s { k = k + 0.5 }\nsignal n = integral(floor(k), 0 [s]), m = integral(floor(k + time/0.3 s), 0 [s])"
    found = run(body + "\noutput n_ = n, m_ = m", rtol=1e-10)
    places = sorted(
        {
            0.0,
            2.0,
            0.5,
            1.0,
            1.5,
            *(0.3 * (j - 0.25 * i) for j in range(12) for i in range(-9, 10) if 0 < 0.3 * (j - 0.25 * i) < 2),
        }
    )
    middles = [(b - a, (a + b) / 2) for a, b in pairwise(places)]
    expected = sum(width * math.floor(0.75 + 0.5 * (t // 0.5) + t / 0.3) for width, t in middles)
    assert found.final("n_") == pytest.approx(2.0, abs=1e-9) and found.final("m_") == pytest.approx(expected, abs=1e-8)


def test_a_motion_that_leads_back_to_its_step_is_told() -> None:
    with pytest.raises(RunFailed, match="cannot hold and cannot fail"):
        run("signal x = integral((1 if floor(x) < 1 else -1)*1 [1/s], 0.5)\noutput y = x")


def test_rest_and_slopes_with_a_count() -> None:
    """x' = 2.5 - x - 0.1 floor(x) rests at 2.3, and its slope there is -1; a count at its step has no slope."""
    model = bondgraph.load(
        "model M { parameter p = 2.5\nsignal x = integral((p - x - 0.1*floor(x))/1 s, 1.9)\noutput y = x }"
    )
    rest = model.equilibrium()
    assert rest["y"] == pytest.approx(2.3, rel=1e-9)
    assert model.modes()[0].eigenvalue.real == pytest.approx(-1.0, rel=1e-9)


def test_a_program_without_counts_has_none() -> None:
    program = compiled("model M { signal x = integral(1 [1/s], 0); when x > 1 { x = 0 }; output y = x }").program
    assert program.hybrid is not None and program.hybrid.counted == () and program.recurring is None


def test_units_of_counts() -> None:
    bad = {
        "floor(time)": "bare number",
        "mod(1 m, 1 s)": "one unit",
        "stairs(1 m, 2)": "one unit",
        "pwm(time, 1 m, 0.5)": "one unit",
        "pwm(time, 1 s, 1 s)": "bare number",
    }
    for law, words in bad.items():
        with pytest.raises(bondgraph.CompilationFailed, match=words):
            run(f"output y = {law}")
