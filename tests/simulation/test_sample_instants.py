"""Rates, offsets, delays and jitter of sampled events: instants against exact arithmetic, runs against recursions from instant to instant."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed, UsageError
from bondgraph.simulation.segments.sampling import due_at, ticks, ticks_between
from compiler.algebra.interpolate import random_number
from compiler.source import Source
from compiler.syntax.format import format_text
from tests.compiling import compiled

TARGETS = ["numpy", pytest.param("native", marks=pytest.mark.machine_code)]


def row(period: float, offset: float = 0.0, delay: float = 0.0, jitter: float = 0.0, seed: float = 0.0) -> np.ndarray:
    return np.array([period, offset, delay, jitter, seed])


@pytest.mark.parametrize(("period", "offset"), [(1e-4, 3e-5), (0.1, 0.07), (1 / 3, 0.1), (1e-3, 0.0), (7e-7, 1e-7)])
def test_a_million_ticks_add_up_nothing(period: float, offset: float) -> None:
    """Tick k is k*period + offset to rounding, and is found there and nowhere beside."""
    numbers = np.array([0.0, 1, 2, 3, 999, 123_456, 654_321, 1_000_000])
    rows = row(period, offset)[None, :]
    for k, found in zip(numbers, ticks(rows[0], numbers), strict=True):
        exact = Fraction(period) * int(k) + Fraction(offset)
        assert abs(Fraction(float(found)) - exact) <= 2 * Fraction(math.ulp(float(exact)) if exact else 0)
        assert due_at(rows, float(found)) == [0]
        assert due_at(rows, float(found) + 1e-3 * period) == []


@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_the_instants_of_a_part_of_a_run(jitter: float) -> None:
    """Two parts have the instants of the whole; each lies within its jitter, and is found again."""
    of = row(0.5, 0.1, 0.15, jitter, 4)
    whole = ticks_between(of, 0.0, 50.0)
    parts = [ticks_between(of, *ends) for ends in ((0.0, 20.0), (20.0, 50.0))]
    assert whole.tolist() == np.concatenate(parts).tolist() and len(whole) == 100
    late = whole - (0.5 * np.arange(100) + 0.25)
    assert (late >= -1e-15).all() and (late <= jitter).all() and (np.ptp(late) > 0.8 * jitter or not jitter)
    assert all(due_at(of[None, :], t) == [0] for t in whole.tolist())


def test_jitter_is_of_the_numbers_of_its_seed() -> None:
    k = np.arange(20.0)
    expected = [0.3 * i + (0.05 + 0.1 * (0.5 + 0.5 * random_number(i, 7))) for i in range(20)]
    assert ticks(row(0.3, 0.05, 0, 0.1, 7), k).tolist() == expected
    assert (ticks(row(0.3, 0.05, 0, 0.1, 8), k) != expected).all()


CLOCK = """model Q {{
  parameter T = 0.1 s, o = 0 s
  mode count = 0, seen = 0 s, slow = 0, both = 0
  signal clock = integral(1, 0 s)
  every T{timing} {{ count = count + 1; seen = clock }}
  every 0.3 s {{ slow = count }}
  output n = count, at = seen, s = slow
}}
"""


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize(("timing", "offset"), [("", 0.0), (" offset 0.04 s", 0.04), (" offset o", 0.07)])
def test_ticks_of_a_run(timing: str, offset: float, target: str) -> None:
    model = bondgraph.load(CLOCK.format(timing=timing))
    found = model.simulate(to=9.999, points=334, settings={"o": 0.07}, target=target)
    ticks = np.floor((found.time - offset) / 0.1 + 1e-9)
    np.testing.assert_array_equal(found["n"], np.maximum(ticks + 1, 0))
    np.testing.assert_allclose(found["at"], np.where(ticks < 0, 0, 0.1 * ticks + offset), atol=1e-12)
    # the slow one sees what was before it: at an instant of both, the count of the last tick
    third = np.floor(found.time / 0.3 + 1e-9)
    before = np.ceil((0.3 * third - offset) / 0.1 - 1e-9)
    np.testing.assert_array_equal(found["s"], np.where(third > 0, np.maximum(before, 0), 0))


LAG = """model Lag {{
  parameter K = 2
  mode u = 0, e = 0, last = 0
  signal x = integral((u - x)/(0.5 s), 0)
  every 0.2 s{timing} {{
    e = 1 - x
    u = K*e + 0.3*last
    last = e
  }}
  output y = x, command = u
}}
"""


def lagged(instants: list[float], delay: float, times: np.ndarray) -> np.ndarray:
    """The lag, by exact exponentials from instant to instant."""
    waiting = sorted([(t, 0) for t in instants] + [(t + delay, 1) for t in instants] + [(t, 2) for t in times])
    x, u, e, last, now, computed, found = 0.0, 0.0, 0.0, 0.0, 0.0, (0.0, 0.0), []
    for t, kind in waiting:
        x, now = u + (x - u) * math.exp(-(t - now) / 0.5), t
        if kind == 0:
            e = 1 - x
            computed = 2 * e + 0.3 * last, e
        elif kind == 1:
            u, last = computed
        else:
            found.append(x)
    return np.array(found)


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize(
    ("timing", "offset", "delay", "jitter"),
    [
        ("", 0.0, 0.0, 0.0), (" delay 0.07 s", 0.0, 0.07, 0.0), (" offset 0.05 s delay 0.19 s", 0.05, 0.19, 0.0),
        (" delay 0.05 s jitter 0.1 s seed 5", 0.0, 0.05, 0.1), (" jitter 0.15 s seed 5 offset 0.01 s", 0.01, 0.0, 0.15),
    ],
)  # fmt: skip
def test_a_loop_with_computation_delay(timing: str, offset: float, delay: float, jitter: float, target: str) -> None:
    ticks = [0.2 * k + (offset + jitter * (0.5 + 0.5 * random_number(k, 5))) for k in range(20)]
    found = bondgraph.load(LAG.format(timing=timing)).simulate(to=3.33, points=38, rtol=1e-10, target=target)
    np.testing.assert_allclose(found["y"], lagged(ticks, delay, found.time), atol=2e-9)


def test_a_run_in_two_parts_keeps_what_is_computed_but_not_yet_set() -> None:
    model = bondgraph.load(LAG.format(timing=" delay 0.15 s jitter 0.04 s"))
    whole = model.simulate(to=2.1, points=22)
    first = model.simulate(to=1.1, points=12)  # within the delay of the sample at 1 s
    second = model.simulate(to=2.1, points=22, start=first)
    np.testing.assert_allclose(second["y"][-10:], whole["y"][-10:], atol=1e-12)


def test_the_same_by_a_delayed_signal() -> None:
    """A delay of the block is that of the signal which reads it, where nothing in the block reads it back."""
    block = "model A {\n mode u = 0\n signal x = integral((u - x)/(0.5 s), 0)\n every 0.2 s delay 0.05 s { u = 1 - x }\n output y = x\n}"
    signal = block.replace(" delay 0.05 s", "").replace("(u - x)/", "(delay(u, 0.05 s) - x)/")
    found, other = (bondgraph.load(text).simulate(to=2, points=21, rtol=1e-9) for text in (block, signal))
    late = found.time >= 0.2  # the delayed signal was before the run as it is at its start, behind the first sample
    assert late.sum() == 19 and np.abs(found["y"] - other["y"]).max() > 1e-3
    step = "model A {\n mode u = 0\n signal x = integral((1 - x)/(0.5 s), 0)\n every 0.2 s offset 0.1 s delay 0.05 s { u = 1 - x }\n output y = Y\n}"
    first = bondgraph.load(step.replace("Y", "u")).simulate(to=2, points=401)
    again = bondgraph.load(step.replace(" delay 0.05 s", "").replace("Y", "delay(u, 0.05 s)")).simulate(
        to=2, points=401
    )
    apart = np.abs(((first.time - 0.15) / 0.2 + 0.5) % 1 - 0.5) > 1e-9
    np.testing.assert_allclose(first["y"][apart], again["y"][apart], atol=1e-9)


def test_text_format_and_builder() -> None:
    timing = " offset 0.05 s delay 0.07 s jitter 0.02 s seed 5"
    text = LAG.format(timing=timing)
    expected = bondgraph.load(text).simulate(to=2, points=11)["y"]
    assert format_text(Source("lag.bg", text)) == text
    flat = bondgraph.load(text).text()
    assert timing in flat
    builder = bondgraph.Graph("Lag")
    builder.mode("u", 0), builder.mode("e", 0), builder.mode("last", 0)
    builder.signal("x", "integral((u - x)/(0.5 s), 0)")
    lines = [("e", "1 - x"), ("u", "0"), ("u", "2*e + 0.3*last"), ("last", "e")]
    builder.every(0.2, lines, offset="50 ms", delay=0.07, jitter=0.02, seed=5)
    builder.output("y", "x")
    for model in (bondgraph.load(flat), builder.model()):
        np.testing.assert_array_equal(model.simulate(to=2, points=11)["y"], expected)


def test_what_is_set_from_outside_is_looked_at_by_the_run() -> None:
    model = bondgraph.load(CLOCK.format(timing=" offset o delay 0.05 s"))
    for value in (0.1, -0.01):
        with pytest.raises((RunFailed, bondgraph.CompilationFailed)):
            model.simulate(to=1, settings={"o": value})
    many = model.simulate_many([{"T": 0.2, "o": 0.15}, {"T": 0.2, "o": 0.25}], to=1)
    assert many["n"][0, -1] == 5 and list(many.failures) == [1]


def test_rest_and_linear_analyses() -> None:
    """A rest is that of the same block without delay; its stability is not decided, and a response refused, where they need another model."""
    plain = bondgraph.load(LAG.format(timing="")).equilibrium()
    for timing, decided in ((" offset 0.05 s", True), (" delay 0.1 s", False), (" jitter 0.1 s", False)):
        found = bondgraph.load(LAG.format(timing=timing)).equilibrium()
        assert found["y"] == pytest.approx(plain["y"], rel=1e-12)
        assert (found.stable is plain.stable) == decided
        if decided:
            assert found.growth == pytest.approx(plain.growth, rel=1e-9)
    with pytest.raises(UsageError, match="late by a delay, a jitter"):
        bondgraph.load(LAG.format(timing=" delay 0.1 s").replace("1 - x", "r - x").replace("mode u", "input r = 1; mode u")).response("r", "y", 0.1, 1)  # fmt: skip


@pytest.mark.parametrize("target", TARGETS)
def test_no_delay_is_none(target: str) -> None:
    """A delay that is set to zero from outside leaves the same run as a block without one."""
    text = LAG.format(timing=" delay d").replace("K = 2", "K = 2, d = 0.05 s")
    plain = bondgraph.load(LAG.format(timing="")).simulate(to=2, points=11, target=target)
    model = bondgraph.load(text)
    for settings in ({"d": 0}, {"d": "0 s"}):
        np.testing.assert_array_equal(
            model.simulate(settings=settings, to=2, points=11, target=target)["y"], plain["y"]
        )
    many = model.simulate_many([{"d": 0}, {"d": 0.1}], to=2, points=11)
    np.testing.assert_allclose(many["y"][0], plain["y"], atol=1e-9)
    assert np.abs(many["y"][1] - plain["y"]).max() > 1e-3


def test_samples_may_jump_with_time() -> None:
    """What samples read may be a stair of time or of states."""
    text = (
        "model Q {\n mode n = 0, m = 0\n signal x = integral(1 [1/s], 0)\n signal stair = floor(3.7*time/1 s + 0.1)\n"
    )
    text += " every 0.1 s { n = stair; m = ceil(2.3*x) + abs(floor(time/0.35 s)) }\n output a = n, b = m\n"
    found = bondgraph.load(text + "}").simulate(to=0.95, points=20)
    k = np.arange(10)  # between the samples
    assert found["a"][1::2].tolist() == np.floor(0.37 * k + 0.1).tolist()
    assert found["b"][1::2].tolist() == (np.ceil(0.23 * k) + np.floor(0.1 * k / 0.35)).tolist()


def test_a_late_block_is_told_once() -> None:
    certificate = compiled(LAG.format(timing=" delay 0.1 s")).certificate
    assert [e.partition(" (")[0] for e in certificate.events] == ["every 0.2 s delay 0.1 s"]
