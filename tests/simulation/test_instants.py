"""Conditions on time: every instant at which one changes is found, for any distance of two instants, in every form of the condition.

The witnesses are closed forms: for how long a condition holds, and the signal that it passes.
"""

from __future__ import annotations

import math
import random
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import linprog

import bondgraph
from bondgraph.numerics.indicators import DEGREES, GRID, ON_GRID
from bondgraph.simulation.events.bounds import BEYOND
from bondgraph.simulation.segments import resolution
from bondgraph.simulation.segments import timeline as segment_search
from bondgraph.simulation.segments.timeline import Signals, follower, segments, timeline
from compiler.codegen.ranges import Ranges
from tests.compiling import MODELS, Running, compiled
from tests.stress.ways import Way, ways

CLOSE = 1e-11  # of a duration: what rounding of an instant leaves


def held(conditions: list[str], start: float, stop: float, declared: str = "") -> tuple[list[float], list[list[float]]]:
    """For how long each condition holds in a run, and all instants within it, from the segments and their modes."""
    lines = [f"  signal x{i} = integral(1 if {c} else 0, 0)\n  output y{i} = x{i}" for i, c in enumerate(conditions)]
    program = compiled(f"plain model Held {{\n{declared}" + "\n".join(lines) + "\n}\n").program
    constants = program.constants(np.array(program.defaults))
    state = np.zeros(len(conditions))
    total = np.zeros(len(conditions))
    parts = segments(program, constants, start, stop)
    assert parts[0].start == start
    assert parts[-1].stop == stop
    for part in parts:
        middle = 0.5 * (part.start + part.stop)
        rates = program.derivative(middle, state, np.array(program.input_defaults), constants, part.mode)
        total += (part.stop - part.start) * np.asarray(rates)
    return total.tolist(), [[p.start for p in parts[1:]]]


DUTIES = [0.001, 0.003, 0.01, 0.0317, 0.1, 0.25, 0.5, 0.75, 0.9, 0.99, 0.997, 0.999]


@pytest.mark.parametrize("frequency", [5, 20, 50, 200, 1000])
def test_a_gate_is_open_for_its_duty(frequency: int) -> None:
    """cos(2 pi f t) > cos(pi d) holds for d of each period; the rounding of the threshold changes this by 1e-16/(pi d)^2."""
    gates = [f"cos(2*pi*{frequency}*time) > cos(pi*{duty})" for duty in DUTIES]
    total, _ = held(gates, 0.0, 1.0)
    assert total == pytest.approx(DUTIES, rel=1e-10)


@pytest.mark.parametrize("duty", [0.001, 0.4, 0.999])
def test_a_gate_of_many_periods(duty: float) -> None:
    """20 000 periods in a run: 40 000 instants, each once."""
    total, (instants,) = held([f"cos(2*pi*20000*time) > cos(pi*{duty})"], 0.0, 1.0)
    assert total == pytest.approx([duty], rel=1e-7)  # a time of 1 s is rounded by 1e-16, an open time is 5e-8
    assert len(instants) == 40_000
    assert np.diff(instants).min() > 0.9 * min(duty, 1 - duty) / 20000


WINDOWS = {
    "distance": "abs(time - c) < w",
    "square": "(time - c)^2 < w^2",
    "product": "(time - c)*(time - c) < w*w",
    "bell": "exp(-((time - c)/w)^2) > exp(-1)",
    "Lorentz": "1/(1 + ((time - c)/w)^2) > 0.5",
    "two sides": "time > c - w and time < c + w",
    "factors": "(time - c + w)*(c + w - time) > 0",
    "root": "sqrt(abs(time - c)) < sqrt(w)",
    "power": "((time - c)^2)^1.5 < w^3",
    "hyperbola": "cosh((time - c)/w) < cosh(1)",
    "arc": "abs(atan((time - c)/w)) < pi/4",
    "difference of steps": "tanh((time - c)/w + 1) - tanh((time - c)/w - 1) > tanh(2)",
    "distance of another scale": "max(time - c, c - time)/w <= 1",
    "turned round": "not (abs(time - c) >= w)",
    "chosen": "(c - time if time < c else time - c) < w",
}


@pytest.mark.parametrize("width", [1e-2, 1e-4, 1e-6, 1e-9])
@pytest.mark.parametrize("start", [0.0, -3.0, 1e6])
def test_a_window_anywhere(width: float, start: float) -> None:
    """2 w, at a random place of a run of 1 s, up to the rounding of the instants."""
    place = start + random.Random(f"{width} {start}").uniform(0.05, 0.95)
    declared = f"  parameter c = {place!r}\n  parameter w = {width!r}\n"
    total, _ = held(list(WINDOWS.values()), start, start + 1.0, declared)
    rounding = 16 * float(np.spacing(max(abs(start), 1.0)))
    for name, duration in zip(WINDOWS, total, strict=True):
        assert duration == pytest.approx(2 * width, rel=1e-7, abs=rounding), name


def test_windows_at_the_ends() -> None:
    """Open to one side, and of the length of the run."""
    conditions = ["abs(time) < 1e-9", "abs(time - 2) < 1e-9", "abs(time - 1) < 1", "abs(time - 1) <= 1", "time^2 < 4", "cos(time*pi) > -2"]  # fmt: skip
    total, _ = held(conditions, 0.0, 2.0)
    assert total == pytest.approx([1e-9, 1e-9, 2, 2, 2, 2], rel=1e-6)


def test_products_and_sums_of_gates() -> None:
    """Gates of two frequencies: the product is open where both are, the sum above one half where either is."""
    slow, fast = "cos(2*pi*5*time) > cos(pi*0.2)", "cos(2*pi*500*time) > cos(pi*0.01)"
    product = f"(1 if {slow} else 0)*(1 if {fast} else 0) > 0.5"
    either = f"(1 if {slow} else 0) + (1 if {fast} else 0) > 0.5"
    both = f"({slow}) and ({fast})"
    total, _ = held([slow, fast, product, either, both], 0.0, 1.0)
    centres = np.arange(501) / 500
    open_at = np.abs((centres * 5 + 0.5) % 1 - 0.5) / 5
    halves = np.where((centres == 0) | (centres == 1), 0.5, 1.0)
    overlap = np.clip(0.02 - open_at + 1e-5, 0, 2e-5)  # the slow gate ends in the middle of a fast one
    expected = float((overlap * halves).sum())
    assert total[2] == pytest.approx(expected, rel=1e-9)
    assert total[4] == pytest.approx(expected, rel=1e-9)
    assert total[3] == pytest.approx(0.2 + 0.01 - expected, rel=1e-9)


def test_conditions_at_single_instants_and_equal_sides() -> None:
    """A condition that holds only at single instants takes no time; sides that are equal over an interval satisfy `<=` and not `<`."""
    conditions = [
        "cos(2*pi*50*time) >= 1", "abs(time - 0.3) <= 0", "(time - 0.3)^2 <= 0", "sin(time) > 1",
        "max(time - 0.25, 0) > 0", "max(time - 0.25, 0) <= 0", "min(time, 0.75) < 0.75", "ramp(time, 0.2, 0.4) >= 1",
        "(time - 0.3)^3 > 0", "max(time - 0.7, 0) - max(0.4 - time, 0) >= 0", "max(time - 0.7, 0) - max(0.4 - time, 0) > 0",
        "smoothstep3(time, 0.2, 0.4) < 1", "time*time*time - time*time*time > 0",
    ]  # fmt: skip
    total, _ = held(conditions, 0.0, 1.0)
    expected = [0, 0, 0, 0, 0.75, 0.25, 0.75, 0.6, 0.7, 0.6, 0.3, 0.4, 0]
    assert total == pytest.approx(expected, abs=1e-7)


def test_nested_conditions() -> None:
    """A gate inside of a window inside of a gate."""
    inner = "(1 if cos(2*pi*1000*time) > cos(pi*0.01) else 0)"
    window = f"({inner} if abs(time - 0.5) < 0.05 else -1)"
    total, _ = held([f"{window} > 0.5", f"{window} > -0.5", f"{window}*sin(pi*time) > 0.99*0.99"], 0.0, 1.0)
    assert total[0] == pytest.approx(99 * 1e-5 + 1e-5, rel=1e-9)
    assert total[1] == pytest.approx(0.1, rel=1e-12)
    centres = np.arange(450, 551) / 1000
    reach = math.acos(0.99 * 0.99) / math.pi
    assert total[2] == pytest.approx(
        1e-5 * float((np.abs(centres - 0.5) < min(reach, 0.05 - 1e-9)).sum() + 1), rel=1e-9
    )


CURVES = {
    "table": ("linear(time, (0, 0.5, 0.5001, 0.5002, 1), (0, 0, 1, 0, 0)) > 0.5", 1e-4),
    "spline": ("monotone(time, (0, 0.5, 0.5001, 0.5002, 1), (0, 0, 1, 0, 0)) > 0.5", 1e-4),
    "table of a sine": (
        "linear(sin(2*pi*10*time), (-1, 0.9999, 1), (0, 0, 1)) > 0.5",
        10 * 2 * math.acos(0.99995) / (20 * math.pi),
    ),
    "logarithm": ("abs(log(1 + time) - log(1.5)) < 1e-6", 1.5 * (math.exp(1e-6) - math.exp(-1e-6))),
    "arc": ("atan2(sin(20*pi*time), cos(20*pi*time)) > pi - 1e-4*pi", 0.5e-4),
    "chirp": ("sin(2*pi*(time + 10*time^2)) > 1", 0.0),
    "exponential": ("exp(-50*time)*cos(2*pi*100*time) > exp(-50*time)*cos(pi*0.02)", 0.02),
    "sum of two": (
        "cos(2*pi*50*time) + cos(2*pi*100*time) > 1.9999",
        math.acos((math.sqrt(1 + 8 * 2.9999) - 1) / 4) / math.pi,
    ),
    "power": ("cos(2*pi*50*time)^101 > cos(pi*0.002)^101", 0.002),
}


@pytest.mark.parametrize("kind", CURVES)
def test_conditions_through_functions(kind: str) -> None:
    """Narrow windows through each function that has a range."""
    condition, expected = CURVES[kind]
    total, _ = held([condition], 0.0, 1.0)
    assert total == pytest.approx([expected], rel=1e-6, abs=1e-12)


def test_noise_crosses_as_often_as_it_does() -> None:
    """Between two whole places noise is monotone: its crossings of a level are counted by their random numbers."""
    text = "plain model N {\n  signal x = integral(1 if noise(time, 1e-3, 7) > 0.8 else 0, 0)\n  output y = x\n}\n"
    program = compiled(text).program
    constants = program.constants(np.array(program.defaults))
    found = timeline(program, constants, 0.0, 0.5)
    values = np.array([program.crossings(t, constants, np.zeros(1))[0] for t in np.arange(0, 501) * 1e-3])
    assert not found.notes
    assert len(found.segments) - 1 == int((np.sign(values[1:]) != np.sign(values[:-1])).sum())


def test_a_second_search_is_not_made() -> None:
    """The same numbers give the same segments; others give others."""
    text = "plain model A {\n  parameter d = 0.1\n  signal x = integral(1 if cos(2*pi*50*time) > cos(pi*d) else 0, 0)\n  output y = x\n}\n"
    program = compiled(text).program
    for duty in (0.1, 0.1, 0.3, 0.1):
        parts = segments(program, program.constants(np.array([duty])), 0.0, 1.0)
        assert sum(p.stop - p.start for p in parts if p.mode[0]) == pytest.approx(duty, rel=1e-12)


def test_a_model_without_conditions_on_time_carries_nothing() -> None:
    """A broad signal has no part that a run would look at."""
    text = "model A {\n  Se e : u = 1 V*sin(2*pi*50 Hz*time)\n  R r : u = 1 ohm*i\n  C c : u = q/1 [F]\n  e -> 1(r) -> c\n}\n"
    assert compiled(text).program.time_functions is None


# ---------------------------------------------------------------- whole runs, by every solver on every back-end

GATES = """model Gates {
  parameter f = 50 Hz, duty = 0.01
  Se gate : F = 1 N if cos(2*pi*f*time) > cos(pi*duty) else 0
  Se wide : F = 1 N if abs(time - 0.512345 s) < 1 ms else 0
  Se bump : F = 1 N if exp(-((time - 0.312345 s)/1 ms)^2) > 0.5 else 0
  Se both : F = 1 N if cos(2*pi*f*time) > cos(pi*duty) and sin(2*pi*3 Hz*time) > 0.5 else 0
  for k in 1..4 { I m[k] : p = 1 kg*v }
  gate -> 1(m[1])
  wide -> 1(m[2])
  bump -> 1(m[3])
  both -> 1(m[4])
  output gate_ = m[1].p, wide_ = m[2].p, bump_ = m[3].p, both_ = m[4].p
  experiment go { simulate 0 .. 1 s { points = 11 } }
}
"""


@pytest.mark.few(4)
@pytest.mark.parametrize("way", [w for w in ways() if w.solver != "energy"], ids=lambda way: way.name)
def test_every_solver_stops_at_them(way: Way) -> None:
    """Momenta that windows of a force leave behind."""
    found = bondgraph.load(GATES).simulate(**way.arguments)
    centres = np.arange(51) / 50
    open_too = np.sin(6 * np.pi * centres) > 0.5
    assert found.final("gate_") == pytest.approx(0.01, rel=1e-10)
    assert found.final("wide_") == pytest.approx(2e-3, rel=1e-10)
    assert found.final("bump_") == pytest.approx(2e-3 * math.sqrt(math.log(2)), rel=1e-10)
    assert found.final("both_") == pytest.approx(2e-4 * int(open_too.sum()), rel=1e-10)


SWITCHED = """model Switched {
  Se s : u = 1 V
  R r : u = 1 ohm*i
  C c : u = q/1 [F]
  1 w : electric { active = cos(2*pi*50*time/1 s) > 0.999 }
  s -> w -> r, c
  output q = c.q
  experiment go { simulate 0 .. 0.2 s { points = 3 } }
}
"""


def test_a_junction_switches_with_time() -> None:
    """On for acos(0.999)/pi of each period."""
    share = math.acos(0.999) / math.pi
    assert bondgraph.load(SWITCHED).simulate().final("q") == pytest.approx(1 - math.exp(-0.2 * share), rel=1e-8)


@pytest.mark.parametrize("width", [1e-2, 3e-3, 1e-5])
@pytest.mark.parametrize("frequency", [5, 50, 200])
def test_an_event_acts_each_time(frequency: int, width: float) -> None:
    """It is true at the start, and once for each period."""
    text = (
        f"plain model Strobe {{\n  mode n = 0\n  when cos(2*pi*{frequency}*time) > cos(pi*{width}) {{ n = n + 1 }}\n  output k = n\n"
        "  experiment go { simulate 0 .. 1.001 { points = 3 } }\n}\n"
    )
    assert bondgraph.load(text).simulate().final("k") == frequency + 1


# ---------------------------------------------------------------- the edges of a derivative

RISES = {
    "ramp": "ramp(time, {a} s, {b} s)",
    "smoothstep3": "smoothstep3(time, {a} s, {b} s)",
    "smoothstep5": "smoothstep5(time, {a} s, {b} s)",
    "smoothstep7": "smoothstep7(time, {a} s, {b} s)",
    "smoothstep9": "smoothstep9(time, {a} s, {b} s)",
    "clip": "min(max((time - {a} s)/({b} s - {a} s), 0), 1)",
    "clip the other way": "max(min((time - {a} s)/({b} s - {a} s), 1), 0)",
    "table": "linear(time, (0 s, {a} s, {b} s, 2 s), (0, 0, 1, 1))",
    "smooth clip": "sin(0.5*pi*min(max((time - {a} s)/({b} s - {a} s), 0), 1))",
}


@pytest.mark.parametrize("rise", [1e-1, 1e-3, 1e-5, 1e-7])
def test_the_force_of_a_rise_is_integrated(rise: float) -> None:
    """m dv/dt over a rise of 2 m/s: 6 N s, however short it is, from a source onto a mass in derivative form."""
    lines = []
    for i, law in enumerate(RISES.values()):
        lines.append(
            f"  Sf s{i} : v = 2 [m/s]*{law.format(a=1.1, b=1.1 + rise)}\n  I m{i} : p = 3 kg*v\n  s{i} -> m{i}"
        )
        lines.append(f"  output j{i} = integral(m{i}.F, 0 [N*s])")
    text = "model Rise {\n" + "\n".join(lines) + "\n  experiment go { simulate 0 .. 2 s { points = 5 } }\n}\n"
    found = bondgraph.load(text).simulate()
    for i, name in enumerate(RISES):
        assert found.final(f"j{i}") == pytest.approx(6.0, rel=1e-6), name


# ---------------------------------------------------------------- what has no bounds

MODULATED = """plain model A {{
  parameter k = 2
  a + b*(1 + 0.5*sin(2*pi*time)) = 1
}}
"""
MODULATED = """model Modulated {
  Se e : u = 1 V*(1 + 0.5*sin(2*pi*50 Hz*time))
  MR a : u = 1 ohm*i*(1 + 0.5*sin(2*pi*3 Hz*time))
  for k in 1..4 { R b[k] : u = 2 ohm*i }
  0 n : electric
  0 m : electric
  e -> 1(a) -> n -> b[1]
  n -> 1(b[2]) -> m -> b[3]
  n -> 1(b[4]) -> m
  signal x = integral(1 if b[3].u > 0.2 V else 0, 0 s)
  output y = x
  experiment go { simulate 0 .. 1 s { points = 3 } }
}
"""


def test_what_has_no_bounds_is_told() -> None:
    """The unknowns of a loop that changes with time: a potential divider, u3 = u/(1 + a (1/2 + 1/3))/3 with a the changing resistance."""
    text = MODULATED.replace(
        "for k in 1..4 { R b[k] : u = 2 ohm*i }", "\n".join(f"R b{k} : u = 2 ohm*i" for k in range(1, 5))
    )
    for k in range(1, 5):
        text = text.replace(f"b[{k}]", f"b{k}")
    found = bondgraph.load(text).simulate()
    assert "no bounds" in " ".join(found.notes)
    assert f"text:{text[: text.index('signal x')].count(chr(10)) + 1}" in " ".join(found.notes)
    t = (np.arange(4_000_000) + 0.5) / 4e6
    a = 1 + 0.5 * np.sin(6 * np.pi * t)
    u = (1 + 0.5 * np.sin(100 * np.pi * t)) / (1 + a * (1 / 2 + 1 / 3)) * 2 / 3  # from n on: 2 ohm beside 1 + 2 ohm
    assert found.final("y") == pytest.approx(float((u > 0.2).mean()), abs=1e-5)


@pytest.mark.parametrize("condition", ["time == 0.5", "(time - 0.5)^2 == 0", "abs(time - 0.5) <= 0", "cos(2*pi*5*time) >= 1", "sin(3*time) == 0.25"])  # fmt: skip
def test_an_event_that_never_holds_is_told(condition: str) -> None:
    """A condition that holds at single instants only: the line, and the first of them."""
    text = f"plain model A {{\n  mode n = 0\n  when {condition} {{ n = n + 1 }}\n  output y = n\n  experiment go {{ simulate 0 .. 1 }}\n}}\n"
    (note,) = bondgraph.load(text).simulate().notes
    assert "(text:3) holds at single instants only" in note


def test_sides_that_are_equal_to_rounding_are_told() -> None:
    """Rounding decides cos^2 + sin^2 > 1, which is reported; nothing is reported if neither rounding nor time can change the truth."""
    text = "plain model A {{\n  signal x = integral(1 if {} else 0, 0)\n  output y = x\n  experiment go {{ simulate 0 .. 1 }}\n}}\n"
    (note,) = bondgraph.load(text.format("cos(time)^2 + sin(time)^2 > 1")).simulate().notes
    assert "`x` (text:2) are equal to within rounding" in note
    assert not bondgraph.load(text.format("cos(time)^2 + sin(time)^2 > 0.9")).simulate().notes


# ---------------------------------------------------------------- narrow signals

BUMPS = {
    "bell": ("exp(-((time - 0.5123456 s)/(w*1 s))^2)", lambda w: w * math.sqrt(math.pi)),
    "bells": ("exp(-(sin(pi*(time - 0.1 s)/0.25 s)/w)^2)", lambda w: w / math.sqrt(math.pi)),
    "bell of a square": ("exp(-(time^2 - 0.25 [s^2])^2/(w*1 [s^2])^2)", lambda w: w * math.sqrt(math.pi)),
    "sech of a sine": ("1/cosh(sin(time/1 s - 0.7)/w)", lambda w: math.pi * w),
    "Lorentz of a sine": ("1/(1 + (sin(time/1 s - 0.7)/w)^2)^2", lambda w: math.pi / 2 * w),
    "slope of tanh of a sine": ("(1 - tanh(sin(time/1 s - 0.7)/w)^2)", lambda w: 2 * w),
    "difference of two tanh": ("(tanh(sin(time/1 s - 0.7)/w) - tanh(sin(time/1 s - 0.7)/w - 4))", lambda w: 8 * w),
    "fold of tanh": ("(1 - abs(tanh(sin(time/1 s - 0.7)/w)))", lambda w: 2 * math.log(2) * w),
}


@pytest.mark.few(4)
@pytest.mark.parametrize("law", ["1e-9 [N*s/m]*v", "1e-9 [N*s^2/m^2]*v*abs(v)"], ids=["linear", "nonlinear"])
@pytest.mark.parametrize(
    "way", [w for w in ways() if w.solver not in ("energy", "exponential")], ids=lambda way: way.name
)
def test_a_narrow_signal_is_never_passed_over(way: Way, law: str) -> None:
    """Momentum of a mass from narrow forces, for any places of their peaks."""
    for name, (force, momentum) in BUMPS.items():
        text = f"model B {{\n  parameter w = 1e-3\n  Se a : F = 1 N*{force}\n  I m : p = 1 kg*v\n  R r : F = {law}\n  a -> 1(m, r)\n  output p = m.p\n}}\n"
        model = bondgraph.load(text)
        for width in (1e-3, 1e-7) if way.target == "native" else (1e-5,):
            found = model.simulate(settings={"w": width}, to=1.0, points=3, **way.arguments)
            assert found.final("p") == pytest.approx(momentum(width), rel=3e-4), (name, width)


BELL, SECANT = "exp(-(sin(pi*{n}*(time - 0.0001 s)/1 s)/1e-6)^2)", "1/cosh(sin(pi*{n}*(time - 0.0001 s)/1 s)/1e-6)"


@pytest.mark.few(1)
@pytest.mark.interpreted
@pytest.mark.parametrize(("law", "peaks"), [(BELL, 40), (BELL, 90), (SECANT, 90)])
def test_more_narrow_peaks_than_are_resolved_are_told(law: str, peaks: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The signal is named, also in a repeated run; with enough places nothing is told."""
    text = (
        f"model A {{\n  Se drive : F = 1 N*{law.format(n=peaks)}\n  I m : p = 1 kg*v\n  R r : F = 1e-9 [N*s^2/m^2]*v*abs(v)\n"
        "  drive -> 1(m, r)\n  output p = m.p\n}\n"
    )
    for most in (400_000, 500):
        monkeypatch.setattr(resolution, "MOST", most)
        model = bondgraph.load(text)
        for _ in range(2):
            notes = [n for n in model.simulate(to=1.0, points=2, target="numpy").notes if "narrow peaks" in n]
            assert len(notes) == (most == 500)
            assert all("`drive.F` has more narrow peaks between t = 0 s and 1 s" in note for note in notes)


@pytest.mark.machine_code
@pytest.mark.parametrize("model", ["feed_forward", "inverse_kinematics", "manipulator", "car"])
def test_smooth_signals_are_looked_at_a_few_times_only(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bounds that are loose everywhere, and values that only rounding moves, are no peaks; a repeated run searches nothing."""
    boxes: list[int] = []
    over = Ranges.over

    def counted(self: Ranges, low: Any, high: Any, mode: Any) -> Any:
        boxes.append(int(np.size(low)))
        return over(self, low, high, mode)

    monkeypatch.setattr(Ranges, "over", counted)
    loaded = bondgraph.load(MODELS / f"{model}.bg")
    loaded.simulate(points=2)
    assert sum(boxes) < 4000
    boxes.clear()
    loaded.simulate(points=2)
    assert not boxes


def test_a_table_of_hundreds_of_points_is_searched_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The kinks of a curve through 300 points cut a run into as many segments, which share one search for narrow peaks."""
    calls: list[int] = []
    over = Ranges.over

    def counted(self: Ranges, low: Any, high: Any, mode: Any) -> Any:
        calls.append(int(np.size(low)))
        return over(self, low, high, mode)

    monkeypatch.setattr(Ranges, "over", counted)
    places = np.linspace(0, 1, 300)
    xs, ys = (", ".join(f"{v:.17g}" for v in values) for values in (places, np.sin(9 * places)))
    text = (
        f"model A {{\n  Se a : F = 1 N*sqrt(2 + linear(time/1 s, ({xs}), ({ys})))\n  I m : p = 1 kg*v\n"
        "  R r : F = 1 [N*s^2/m^2]*v*abs(v)\n  a -> 1(m, r)\n  output v = m.v\n}\n"
    )
    found = bondgraph.load(text).simulate(to=0.999, points=2, rtol=1e-9)
    expected = solve_ivp(
        lambda t, v: np.sqrt(2 + np.interp(t, places, np.sin(9 * places))) - v * np.abs(v),
        (0, 0.999),
        [0.0],
        rtol=1e-10,
        atol=1e-12,
        max_step=1 / 299,
    )
    assert found.final("v") == pytest.approx(expected.y[0, -1], rel=1e-7)
    assert sum(size >= 32 for size in calls) < 40


@pytest.mark.machine_code
@pytest.mark.parametrize("kinks", [2, 300])
def test_thousands_of_narrow_peaks_are_all_met(kinks: int) -> None:
    """Their number in all segments together is no bound on those of one. The witness: w/sqrt(pi) for each period of the sine, times the table's mean."""
    peaks, w = 3000, 1e-8
    places = np.linspace(0, 1, kinks)
    ys = 1 + 1e-3 * (np.arange(kinks) % 2)
    table = ", ".join(f"({', '.join(f'{v:.17g}' for v in values)})" for values in (places, ys))
    text = (
        f"model A {{\n  Se a : F = 1 N*exp(-(sin(pi*{peaks}*(time - 0.0001 s)/1 s)/{w})^2)*linear(time/1 s, {table})\n"
        "  I m : p = 1 kg*v\n  R r : F = 1e-9 [N*s^2/m^2]*v*abs(v)\n  a -> 1(m, r)\n  output p = m.p\n}\n"
    )
    found = bondgraph.load(text).simulate(to=1.0, points=2)
    assert found.final("p") == pytest.approx(1.0005 * w / math.sqrt(math.pi), rel=3e-4)


@pytest.mark.parametrize("crest", [0.09, 0.35, 0.5, 0.8])
def test_a_step_looks_between_all_its_nodes(crest: float) -> None:
    """A pulse between two nodes of a step, 0, 0.155, 0.645 and 1: the looks alone, without known places of the signal, tell that it is missed."""
    pulse = f"exp(-((time - {crest} s)/0.06 s)^2)"
    running = Running(compiled(f"model A {{ Se a : F = 1 N*{pulse}; I m : p = 1 kg*v; a -> 1(m); output v = m.v }}"))
    stretch = segments(running.program, running.constants, 0.0, 1.0)[0].up_to(0.0, 1.0)
    unknown = Signals(np.array([0.1]), np.empty(0), np.empty((0, 1)), False)
    follows = follower(running.program, running.inputs, running.constants, stretch, unknown)
    assert not follows(0.0, 1.0) and follows(crest - 0.02, crest + 0.02)


def test_what_a_polynomial_reaches_between_the_places_of_its_grid() -> None:
    """The largest of all polynomials of the degree, between places 17 and 18, by linear programming: the bound is above, and hardly."""
    there, within = np.cos(17.5 * np.pi / GRID * DEGREES), np.vstack([ON_GRID, -ON_GRID])
    most = -linprog(-there, within, np.ones(len(within)), bounds=(None, None)).fun
    assert most == pytest.approx(1.06549, abs=1e-5) and most <= 1 + BEYOND <= 1.005 * most


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_zero_at_a_sampled_place_is_a_crossing_between_two_signs(
    side: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    for other, zeros in ((-side, [1.0]), (side, [])):
        values = np.array([[side], [0.0], [other]])
        monkeypatch.setattr(segment_search, "_looked_at", lambda *_, values=values: (np.arange(3.0), values))
        found, _ = segment_search._sampled(None, None, 0, np.array([0.0, 2.0]))  # type: ignore[arg-type]
        assert found == zeros
