"""`hysteresis(x, low, high, start)`: instants against closed forms, memory, loops through it, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bondgraph
from tests.compiling import mistake

SINE = "plain model A {\n  output y = hysteresis(sin(time), -0.5, 0.25), z = not hysteresis(sin(time), -0.5, 0.25, true)\n}\n"


def test_it_switches_where_the_limits_are_passed() -> None:
    found = bondgraph.load(SINE).simulate(to=9, points=901)
    on, off = math.asin(0.25), math.pi + math.asin(0.5)
    expected = ((found.time >= on) & (found.time < off)) | (found.time >= on + 2 * math.pi)
    assert (found["y"] == expected).all()
    assert (found["z"] == ((found.time >= off) & (found.time < on + 2 * math.pi))).all()
    times = sorted({round(e.time, 9) for e in found.events})
    assert times == pytest.approx([on, off, on + 2 * math.pi], abs=1e-8)


def test_a_thermostat() -> None:
    """It heats to 295 K, cools to 293 K: exponentials of 500 s between 330 K and 280 K; the same as a mode and two events."""
    body = "signal T = integral(((100 W if heats else 0 W) - 2 [W/K]*(T - 280 K))/1 [kJ/K], 280 K)\n  output y = T\n}\n"
    word = "model A {\n  signal heats = not hysteresis(T, 293 K, 295 K)\n  " + body
    long = (
        "model A {\n  mode heats = true\n  when T < 293 K { heats = true }\n  when T > 295 K { heats = false }\n  "
        + body
    )
    found, other = (bondgraph.load(t).simulate(to="30 min", points=61, rtol=1e-9) for t in (word, long))
    assert found["y"] == pytest.approx(other["y"], rel=1e-9)
    rise, fall, again = 500 * math.log(50 / 35), 500 * math.log(15 / 13), 500 * math.log(37 / 35)
    times = np.array([e.time for e in found.events])[1:5]  # it begins with one, as 280 K lies below both
    assert times == pytest.approx(np.cumsum([rise, fall, again, fall]), rel=1e-7)


def test_two_on_one_line_and_one_within_another() -> None:
    text = (
        "plain model A {\n  signal a = hysteresis(hysteresis(sin(time), -0.5, 0.5) - 0.5, -0.1, 0.1)\n"
        "  output both = a and hysteresis(time, 1, 2), w = integral(hysteresis(sin(2*time), -0.5, 0.5), 0)\n}\n"
    )
    model = bondgraph.load(text)
    found = model.simulate(to=3, points=301)
    assert (found["both"] == (found.time >= 2)).all()
    assert found.final("w") == pytest.approx(math.pi / 2, rel=1e-9)
    flat = bondgraph.load(model.text()).simulate(to=3, points=301)
    assert (flat["both"] == found["both"]).all() and flat.final("w") == pytest.approx(math.pi / 2, rel=1e-9)


def test_rounds_of_a_loop_have_relays_and_events_of_their_own() -> None:
    text = (
        "plain model A {\n  for i in 1..3 {\n    signal a[i] = hysteresis(time, i, 10*i)\n    mode b[i] = 0\n    when time > i/2 { b[i] = i }\n  }\n"
        "  output x = hysteresis(time, 0, 0.7), y = a[1], z = b[1] + 10*b[2] + 100*b[3]\n}\n"
    )
    found = bondgraph.load(text).simulate(to=2, points=9)
    assert found["z"].tolist() == [0, 0, 1, 1, 21, 21, 321, 321, 321]
    assert found.final("x") == 1 and found.final("y") == 0


def test_limits_that_a_run_sets_have_a_gap() -> None:
    model = bondgraph.load("model A {\n  parameter h: V = 2\n  output y = hysteresis(1 [V/s]*time, 1 V, h)\n}\n")
    assert model.simulate(settings={"h": 1.5}, to="2 s").final("y") == 1
    for high in (1, 0.5):
        with pytest.raises(bondgraph.CompilationFailed, match=r"BG153.*not larger"):
            model.simulate(settings={"h": high}, to="2 s")


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        ("output y = hysteresis(time, 2 s, 1 s)", "BG153", "not larger"),
        ("output y = hysteresis(time, 2 s, 3 m)", "BG103", "cannot be compared"),
        ("output y = hysteresis(time, 2 s)", "BG108", "3 or 4 arguments"),
        ("output y = hysteresis(time, 1 s, 2 s, 1)", "BG111", "`true` or `false`"),
        ("output y = hysteresis(time, 1 s, 2 s, time > 1 s)", "BG106", "The start"),
        ("function f(x) = hysteresis(x, 1, 2); output y = f(time/1 s)", "BG130", "where the function is used"),
        ("parameter a = hysteresis(time, 1 s, 2 s); output y = a", "BG106", "before the run"),
        ("output y = der(1 m*hysteresis(time, 1 s, 2 s))", "BG507", "an impulse"),
    ],
)  # fmt: skip
def test_refusals(line: str, code: str, words: str) -> None:
    found = mistake(f"model M {{\n{line}\n}}", code)
    assert words in f"{found.sentence} {found.help}"
