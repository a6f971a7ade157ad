"""Instants of events in nonlinear models, against closed forms; most clocks cross where rounding hides it at a place of the search."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from math import acosh, atan, atanh, exp, log, pi, sqrt, tanh
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.compiled_scene import TARGETS
from tests.simulation.test_exponential_events import IDEAL

BOTH = [pytest.param(t, marks=pytest.mark.machine_code) if t == "native" else t for t in TARGETS]
WAYS = [("automatic", 1e-6), ("explicit", 1e-12), ("radau", 1e-6), ("radau", 1e-12), ("radau13", 1e-9), ("rodas", 1e-9)]

CLOCK = """plain model Clock {{
  mode on = 1
  signal saw = integral({sign}1 - 0*time, {start})
  every 1 {{ on = 1; saw = {start} }}
  when {condition} {{ on = 0 }}
  signal u = integral({rate}, 0.3)
  output x = u
}}"""
RATES = ["3*on - u^3 - u", "cos(3*u)*(on + 0.5)", "0.1*(on - exp(u))"]


@pytest.mark.few(5)
@pytest.mark.parametrize("share", [0.1, 0.125, 0.25, 0.3125, 0.5, 0.75])
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("target", BOTH)
def test_a_clock_beside_a_nonlinear_state(rate: str, share: float, target: str) -> None:
    """A switch opened by up to 13 % of a period late, at the default tolerance too, and no note said so."""
    rising = [f"saw > {share}", f"exp(saw) > {exp(share)!r}", f"saw*saw*saw > {share**3!r}"]
    texts = [CLOCK.format(sign="", start=0, condition=c, rate=rate) for c in rising]
    texts += [CLOCK.format(sign="-", start=1, condition=f"saw < {1 - share!r}", rate=rate)]
    for text, (solver, rtol) in product(texts, WAYS if target == "native" else WAYS[2:3]):
        found = bondgraph.load(text).simulate(to=10, points=2, solver=solver, rtol=rtol, target=target)
        instants = [e.time for e in found.events if "saw" in e.condition]
        np.testing.assert_allclose(instants, np.arange(10) + share, rtol=0, atol=1e-12, err_msg=f"{solver} {rtol}")


def flights(count: int) -> Any:
    """Instants at which a ball with the speed 4 comes down: v' = -10 - v |v|/2, and 0.9 of the speed is left."""
    time, speed, end, rate = 0.0, 4.0, sqrt(20), sqrt(5)
    instants = []
    for _ in range(count):
        down = acosh(exp(0.5 * log(1 + (speed / end) ** 2)))
        time += (atan(speed / end) + down) / rate
        instants.append(time)
        speed = 0.9 * end * tanh(down)
    return np.array(instants)


def heated(count: int) -> Any:
    """Instants at which a body under T' = 5 - T^4 or T' = -T^4 is at 1.25 or at 1, from 1 on."""
    end = 5**0.25
    warm, cold = ((atanh(t / end) + atan(t / end)) / (2 * end**3) for t in (1.25, 1.0))
    return np.cumsum(np.where(np.arange(count) % 2, (1 - 1.25**-3) / 3, warm - cold))


def periods(length: float) -> Callable[[int], Any]:
    return lambda count: length * np.arange(1, count + 1)


LAWS: list[tuple[str, Callable[[int], Any]]] = [  # signals, events; the instants of these events
    ("x = integral(x*(1 - x), 0.25)\n when x > 0.75 { x = 0.25 }", periods(log(9))),
    ("x = integral(1 + x*x, -1)\n when x > 1 { x = -1 }", periods(pi / 2)),
    ("x = integral(1 + x*x, 0)\n when x > sqrt(3) { x = 0 }", periods(pi / 3)),
    ("x = integral(-x^3, 1)\n when x < 0.5 { x = 1 }", periods(1.5)),
    ("x = integral(-x^2, 1)\n when x < 0.25 { x = 1 }", periods(3.0)),
    ("x = integral(-sqrt(x), 1)\n when x < 0.25 { x = 1 }", periods(1.0)),
    ("x = integral(-x*ln(x), 0.1)\n when x > 0.9 { x = 0.1 }", periods(log(log(10) / log(1 / 0.9)))),
    ("x = integral(exp(x), -1)\n when x > 0 { x = -1 }", periods(exp(1) - 1)),
    ("x = integral(cosh(x), 0)\n when x > 1 { x = 0 }", periods(2 * atan(tanh(0.5)))),
    ("v = integral(-10 - 0.5*v*abs(v), 4), x = integral(v, 0)\n when x < 0 { v = -0.9*v }", flights),
    ("x = integral(5*on - x^4, 1)\n mode on = 1\n when x > 1.25 { on = 0 }\n when x < 1 { on = 1 }", heated),
]


@pytest.mark.few(11)
@pytest.mark.parametrize("law", LAWS, ids=[law.splitlines()[0] for law, _ in LAWS])
@pytest.mark.parametrize("target", BOTH)
def test_instants_of_nonlinear_laws(law: tuple[str, Callable[[int], Any]], target: str) -> None:
    """Some begin where the condition is on its threshold: on the ground, at the temperature that switches the heater on."""
    text, exact = law
    model = bondgraph.load(f"plain model Law {{\n signal {text}\n output y = x\n}}")
    expected = exact(12)
    for solver, rtol in WAYS if target == "native" else WAYS[2:3]:
        to = expected[-1] + 0.1 * expected[0]
        found = model.simulate(to=to, points=2, solver=solver, rtol=rtol, target=target)
        instants = [e.time for e in found.events]
        np.testing.assert_allclose(instants, expected, rtol=0, atol=max(300 * rtol, 1e-12) * expected[0])


SATURATING = "i = lambda/(100 uH) + 1e8 [A/Wb^3]*lambda^3", "lambda = 100 uH*i + 1 [uH/A^2]*i^3"
LOADS = "u = load*i", "i = u/load + 1e-3 [A/V^3]*u^3", "i = 5 W*u/(u^2 + 1 V^2)"


@pytest.mark.few(2)
@pytest.mark.machine_code
@pytest.mark.parametrize("coil", SATURATING)
@pytest.mark.parametrize("load", LOADS)
def test_a_buck_converter_with_nonlinear_parts(coil: str, load: str) -> None:
    """Ideal switches: the switch opens after its share of each period, whatever the coil and the load are."""
    model = bondgraph.load(IDEAL.replace("lambda = 100 uH*i", coil).replace("u = load*i", load))
    for share, (solver, rtol) in product((0.25, 0.4, 0.5), WAYS[1:4]):
        if solver == "explicit" and coil.startswith("lambda"):  # its current is found with each step
            continue
        found = model.simulate(to=1e-4, points=2, solver=solver, rtol=rtol, settings={"duty": share})
        opened = [e.time for e in found.events if e.condition.startswith("saw")]
        np.testing.assert_allclose(opened, (np.arange(10) + share) * 1e-5, rtol=0, atol=1e-17)
