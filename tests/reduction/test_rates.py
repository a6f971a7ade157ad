"""`der(x)`: exact rates, against closed forms; what has none is refused by name."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed
from compiler.algebra.expression import ONE, Expression, Symbol, call, multiply, select
from compiler.reduction.differentiate import jumps_of, surely
from tests.compiling import compiled, mistake, numbers, refused

CAR = """
  I body : p = 300 kg*v
  C spring : F = 20 [kN/m]*x
  R damper : F = 2 [kN*s/m]*v
  MSf road : v = der(height)
  road -> 0(1(spring, damper)) -> body
"""
M, K, R = 300.0, 20e3, 2e3


def car(height: str, outputs: str) -> bondgraph.Model:
    return bondgraph.load(f"model Car {{\n  signal height = {height}{CAR}  output {outputs}\n}}")


@pytest.mark.parametrize("target", [pytest.param("native", marks=pytest.mark.machine_code), "numpy"])
def test_a_quarter_car_on_a_tabled_road(target: str) -> None:
    """From a flat road onto a slope: the spring feels a step of velocity, x = U s/wd exp(-d t) sin(wd t)."""
    model = car("linear(5 [m/s]*time, (0 m, 1 m, 11 m), (0 m, 0 m, 2 m))", "x = spring.x, rise = height")
    found = model.simulate(to="2 s", points=41, target=target, energy=True)
    t = np.maximum(found.time - 0.2, 0.0)
    d = R / (2 * M)
    w = np.sqrt(K / M - d * d)
    assert found["x"] == pytest.approx(5 * 0.2 / w * np.exp(-d * t) * np.sin(w * t), rel=1e-9, abs=1e-11)
    assert found["rise"] == pytest.approx(np.maximum(found.time - 0.2, 0.0), abs=1e-12)
    assert abs(found.energy.residual) < 1e-6 * max(1.0, found.energy.stored)


def test_a_quarter_car_on_waves() -> None:
    """After its start has died away it moves as its transfer function says; its acceleration and jerk are derivatives of that."""
    model = car(
        "0.05 m*sin(2*pi*1.5 Hz*time)", "v = body.v, a = der(body.v), jerk = der(der(body.v)), same = body.F/(300 kg)"
    )
    found = model.simulate(to="10 s", points=401, rtol=1e-10)
    last = found.time > 9
    s = 2j * np.pi * 1.5
    waves = 0.05 * (K + R * s) / (M * s * s + R * s + K) * np.exp(s * found.time[last])
    for name, order in (("v", 1), ("a", 2), ("jerk", 3)):
        expected = (s**order * waves).imag
        assert found[name][last] == pytest.approx(expected, abs=1e-8 * np.abs(expected).max()), name
    assert found["same"].tolist() == pytest.approx(found["a"].tolist(), rel=1e-12, abs=1e-12)


def test_rates_of_what_is_known() -> None:
    found = numbers(
        "model A {\n  parameter k: m/s^2 = 3\n  signal x = 1 [m/s]*(time + 2 s)\n"
        "  output a = der(k), b = der(time), c = der(k*time^2/2), d = der(7 m), e = der(der(x*x)), f = der(5*x) + der(3*x)\n}\n"
    )
    assert found == {"a": 0.0, "b": 1.0, "c": 0.0, "d": 0.0, "e": 2.0, "f": 8.0}


def test_the_chain_rule_over_states() -> None:
    text = (
        "model A {\n  signal x = integral(-2 [1/s]*x, 3 m), y = integral(1 [m/s], 1 m)\n"
        "  output a = der(x^2*y), b = der(der(x)), c = der(exp(x/y)), d = der(abs(x - y))\n  experiment go { simulate 0 .. 1 s }\n}\n"
    )
    found = bondgraph.load(text).simulate(points=21, rtol=1e-11)
    t = found.time
    x, y = 3 * np.exp(-2 * t), 1 + t
    assert found["a"] == pytest.approx(-4 * x * x * y + x * x, rel=1e-9)
    assert found["b"] == pytest.approx(4 * x, rel=1e-9)
    assert found["c"] == pytest.approx(np.exp(x / y) * (-2 * x * y - x) / y**2, rel=1e-9)
    assert found["d"] == pytest.approx(np.sign(x - y) * (-2 * x - 1), rel=1e-9)


def test_a_force_that_reads_the_acceleration_it_causes() -> None:
    """F - m2 der(v) on m1: an added mass, which the linear loop solves: a = F/(m1 + m2)."""
    text = (
        "model A {\n  1 b\n  I m : p = 2 kg*v\n  Se F : F = 10 N\n  MSe added : F = -3 kg*der(b.v)\n"
        "  F -> b -> m\n  added -> b\n  output a = der(b.v), F2 = der(m.p), v = b.v\n}\n"
    )
    found = bondgraph.load(text).simulate(to="3 s", points=4, energy=True)
    assert found["a"] == pytest.approx(2.0, rel=1e-14) and found["F2"] == pytest.approx(4.0, rel=1e-14)
    assert found.final("v") == pytest.approx(6.0, rel=1e-9)
    assert abs(found.energy.residual) < 1e-9 * found.energy.stored


def test_of_a_law_that_the_run_solves() -> None:
    """3 v + v^3 = F: der(v) = F'/(3 + 3 v^2)."""
    text = "model A {\n  R d : F = 3 [N*s/m]*v + 1 [N*s^3/m^3]*v^3\n  Se F : F = 10 N*sin(time/1 s)\n  F -> d\n  output v = d.v, a = der(d.v)\n}\n"
    found = bondgraph.load(text).simulate(to="3 s", points=13)
    assert found["a"] == pytest.approx(10 * np.cos(found.time) / (3 + 3 * found["v"] ** 2), rel=1e-9)


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        ("output y = der(delay(time, 1 s))", "BG506", "the past"),
        ("mode on = false; when time > 1 s { on = true }; output y = der(2*time if on else time)", "BG506", "`on`"),
        ("output y = der(step(time - 1 s))", "BG507", "a step"),
        ("output y = der(mod(time, 1 s))", "BG507", "`mod`"),
        ("signal x = integral(1 [m/s], 0 m); output y = der(x*sign(x - 1 m))", "BG507", "`sign`"),
        ("signal x = integral(1 [m/s], 0 m); output y = der(der(linear(x, (0 m, 1 m, 9 m), (0, 1, 3))))", "BG507", "`linear`"),
        ("MSe s : F = -2 kg*der(r.v); R r : F = 3 [N*s/m]*v; s -> r; output y = r.v", "BG508", "without end"),
        ("signal x = 1 - 2 s*der(x); output y = x", "BG508", "integral"),
        ("output y = der(time > 1 s)", "BG111", "a condition"),
        ("output y = der(time, 2)", "BG108", "der(x)"),
        ("function f(x) = der(x); output y = f(time)", "BG130", "Differentiate where"),
        ("parameter a = der(time); output y = a", "BG106", "before the run"),
        ("output y: m/s = der(time*1 m)", "BG103", "m/s"),
    ],
)  # fmt: skip
def test_refusals(line: str, code: str, words: str) -> None:
    found = mistake(f"model M {{\n{line}\n}}", code)
    assert words in f"{found.sentence} {found.help}"


def test_an_input_from_outside_has_no_rate() -> None:
    text = "model A {\n  input u = 1 V\n  output y = der(u)\n}\n"
    assert "`u`" in refused(compiled(text, free=("*",)), "BG506").sentence
    assert bondgraph.load(text).simulate(settings={"u": "2 [V/s]*time"}, to="1 s").final("y") == 2.0


@pytest.mark.parametrize(
    ("output", "place"),
    [
        ("der(x if x < 1.5 m else 2*x)", "t = 1.5 s"),
        ("der(der(abs(x - 0.5 m)))", "t = 0.5 s"),
        ("der(time if time < 1 s else 2*time)", "t = 1 s"),
    ],
)
def test_a_run_finds_a_jump(output: str, place: str) -> None:
    model = bondgraph.load(f"model A {{\n  signal x = integral(1 [m/s], 0 m)\n  output y = {output}\n}}")
    with pytest.raises(RunFailed, match="its rate would be an impulse") as told:
        model.simulate(to="2 s")
    assert place in str(told.value) and told.value.code == "BR765"


def test_branches_that_join_have_a_rate() -> None:
    text = "model A {\n  signal x = integral(1 [m/s], -1 m)\n  output y = der(x^2 if x < 0 m else -x^2), z = der(x*sign(x))\n}\n"
    found = bondgraph.load(text).simulate(to="2 s", points=9)
    assert found["y"] == pytest.approx(-2 * np.abs(found.time - 1), abs=1e-12)
    assert found["z"] == pytest.approx(np.where(found.time < 1, -1.0, 1.0)) and not found.events


def test_a_jump_that_states_decide_is_an_impulse_too() -> None:
    """A velocity that jumps where a spring passes a place, forced on a mass."""
    text = (
        "model A {\n  MSf road : v = 1 [m/s]*(1 if c.x > 0.5 m else 0)\n  I m : p = 1 kg*v\n  road -> m\n"
        "  Sf w : v = 0.5 [m/s]\n  C c : F = 3 [N/m]*x\n  w -> c\n  output F = m.F\n}\n"
    )
    with pytest.raises(RunFailed, match=r"t = 1 s `m\.v`"):
        bondgraph.load(text).simulate(to="2 s")


def test_a_mode_on_a_storage_has_no_rate() -> None:
    text = "model A {\n  mode volt = 1 V\n  MSe s : u = volt\n  C c : u = q/1 [F]\n  s -> c\n  every 1 s { volt = volt + 1 V }\n  output i = c.i\n}\n"
    assert "`volt`" in mistake(text, "BG506").sentence


def test_delays_within_delays() -> None:
    text = "model A {\n  output y = delay(delay(time, 1 s), 0.5 s)\n}\n"
    assert bondgraph.load(text).simulate(to="4 s").final("y") == pytest.approx(2.5, rel=1e-9)


def test_in_flat_text() -> None:
    text = "model A {\n  signal x = integral(1 [m/s], 0 m), v = der(2*x)\n  output a = der(v*x) + v*der(x), b = der(der(x^2))\n}\n"
    flat = bondgraph.load(text).text()
    assert "der(2*x)" in flat and "der(der(x^2))" in flat
    again = bondgraph.load(flat)
    assert again.text() == flat and again.simulate(to="2 s").final("b") == 2.0


def _step(x: Expression, low: Expression, high: Expression) -> Expression:
    return select(call("less", x, ONE), low, high)


def test_what_may_jump() -> None:
    x, y = Symbol(0), Symbol(1)
    both = frozenset({x, y})
    for smooth in (_step(x, x * x, x), multiply(call("sign", x), call("sqrt", call("abs", x))), call("abs", x)):
        assert jumps_of(smooth, both) == ()
    (step,) = jumps_of(_step(x, x, y), both)
    assert not surely(step) and jumps_of(_step(x, x, y), frozenset({y})) == ()
    assert all(map(surely, jumps_of(call("floor", x) + _step(y, ONE, 2 * ONE), both)))


@pytest.mark.parametrize(
    "height",
    [
        "0.1 m*smoothstep5(time, 0.2 s, 0.7 s)",
        "0.1 m*(smoothstep5(time, 0.1 s, 0.4 s) - smoothstep5(time, 0.7 s, 1.1 s))",
        "0.1 m*(1 - cos(2*pi*(time - 0.1 s)/0.6 s)) if time > 0.1 s and time < 0.7 s else 0 m",
    ],
)
def test_a_velocity_that_ends_at_zero_to_rounding_does_not_jump(height: str) -> None:
    text = f"model A {{\n  signal h = {height}\n  MSf s : v = der(h)\n  I m : p = 2 kg*v\n  s -> m\n  output x = integral(m.v, 0 m) - h, F = m.F\n}}\n"
    result = bondgraph.load(text).simulate(to="1.3 s", points=14, rtol=1e-9)
    assert abs(result["x"]).max() < 1e-9 and abs(result["F"]).max() > 1
