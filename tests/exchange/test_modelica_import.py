"""Flat Modelica as OpenModelica and rumoca write it, imported: readable texts that run as closed forms or scipy say; what is not in the subset is refused."""

from __future__ import annotations

import time
from collections.abc import Callable
from math import exp, log
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

import bondgraph
from bondgraph.exchange.modelica import import_modelica
from bondgraph.exchange.modelica.units import unit_dimension
from compiler.api import CompilationFailed, Source
from tests.compiling import MODELS
from tests.conftest import Golden
from tests.event_models import BALL, HEATER, servo

FILES = sorted((Path(__file__).parent / "flat_modelica").glob("*.mo"))
Curve = Callable[[np.ndarray], np.ndarray]


def imported(text: str) -> str:
    return import_modelica(Source("m.mo", text))


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_texts_are_readable(path: Path, golden: Golden) -> None:
    golden(path.with_suffix(".bg"), imported(path.read_text(encoding="utf-8")))


# ------------------------------------------------------------ numbers by other means


def solved(rates: Callable[[float, np.ndarray], Any], start: list[float], *ends: float) -> Curve:
    """The first state by scipy, in pieces between jumps."""

    def curve(times: np.ndarray) -> np.ndarray:
        begin, state, values = 0.0, np.array(start), np.empty_like(times)
        for end in ends:
            run = solve_ivp(
                rates, (begin, end), state, method="DOP853", rtol=1e-11, atol=1e-12, dense_output=True, args=()
            )
            inside = (times >= begin) & (times <= end)
            values[inside] = run.sol(times[inside])[0]
            begin, state = end, run.y[:, -1]
        return values

    return curve


def ball(times: np.ndarray) -> np.ndarray:
    begin, v, heights = -((2 / 9.81) ** 0.5), (2 * 9.81) ** 0.5, np.zeros_like(times)
    while v > 1e-3:
        t = times - begin
        heights = np.where(t >= 0, v * t - 9.81 / 2 * t**2, heights)
        begin, v = begin + 2 * v / 9.81, 0.7 * v
    return heights


def level(times: np.ndarray) -> np.ndarray:
    low, high = 200 * log(2), 200 * log(4.5 / 3)
    t = np.where(times < low, 0, (times - low) % (high + 200 * log(4)))
    return 0.01 * np.where(
        times < low, np.exp(-times / 200), np.where(t < high, 5 - 4.5 * np.exp(-t / 200), 2 * np.exp(-(t - high) / 200))
    )


def temperature(times: np.ndarray) -> np.ndarray:
    rise, fall = 100 * log(12 / 9), 100 * log(11 / 9)
    cycle = 100 * log(11 / 9)
    t = np.where(times < rise, 0, (times - rise) % (fall + cycle))
    return np.where(
        times < rise,
        30 - 12 * np.exp(-times / 100),
        np.where(t < fall, 10 + 11 * np.exp(-t / 100), 30 - 11 * np.exp(-(t - fall) / 100)),
    )


def sampled(times: np.ndarray) -> np.ndarray:
    x = s = 0.0
    values = np.zeros_like(times)
    for k in range(31):
        s += (1 - x) * 0.1 / 0.5
        u = 2 * (1 - x + s)
        values = np.where(times >= k * 0.1, u + (x - u) * np.exp(-(times - k * 0.1)), values)
        x = u + (x - u) * exp(-0.1)
    return values


def motor(times: np.ndarray) -> np.ndarray:
    matrix = np.array([[-1000, -50], [500, -1]])
    rest = np.linalg.solve(matrix, [-12000, 0])
    return np.array([(rest - expm(matrix * t) @ rest)[1] for t in times])


def rlc(times: np.ndarray) -> np.ndarray:
    root = (1e6 - 500.0**2) ** 0.5
    return 5 - 5 * np.exp(-500 * times) * (np.cos(root * times) + 500 / root * np.sin(root * times))


def charging(t: float, v: np.ndarray) -> float:
    drop = 5 * np.sin(314 * t) + 5 - v[0]
    u = brentq(lambda u: u + 1000 * 1e-12 * (exp(u / 0.025) - 1) - drop, -20, 1.0, xtol=1e-15)
    return float(((drop - u) / 1000 - v[0] / 2000) / 1e-6)


def clutch(t: float, w: np.ndarray) -> list[float]:
    slip = 3 * max(min(w[0] - w[1], 1), -1) if t > 0.5 else 0
    drive = np.sin(2 * np.pi * t) if t > 1 else 0 if t > 0.5 else t % 0.2
    return [drive - slip, (slip - 0.1 * w[1]) / 2]


EXACT: dict[str, tuple[str, Curve]] = {
    "bouncing_ball": ("h", ball),
    "clutch": ("w1", solved(clutch, [10, 0], 0.2, 0.4, 0.5, 1, 2)),
    "dc_motor": ("w", motor),
    "diode": ("vc", solved(charging, [0.3], 0.02)),
    "relay": ("T", temperature),
    "rlc": ("capacitor_v", rlc),
    "sampled": ("x", sampled),
    "steady": ("y", lambda t: np.where(t < 1, 3, 6 - (3 + 6 * (t - 1)) * np.exp(-2 * (t - 1)))),
    "tank": ("outflow", level),
    "van_der_pol": ("x", solved(lambda t, x: [x[1], (1 - x[0] ** 2) * x[1] - x[0]], [2, 0], 5)),
}  # fmt: skip


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_runs_are_those_of_other_means(path: Path) -> None:
    output, curve = EXACT[path.stem]
    result = bondgraph.load(path.with_suffix(".bg")).simulate(points=23, rtol=1e-8)
    assert result[output] == pytest.approx(curve(result.time), rel=1e-6, abs=1e-7 * np.ptp(result[output]))


# ---------------------------------------------------------------------- round trip


def outputs_of(text: str | Path, to: float) -> tuple[Any, Any]:
    """A run of a model, and one of what is read back of it in Modelica."""
    model = bondgraph.load(text)
    copy = bondgraph.load(imported(model.compile("modelica")))
    return [m.simulate(None, to=to, points=21, rtol=1e-7) for m in (model, copy)]


def compare(text: str | Path, to: float) -> None:
    ours, again = outputs_of(text, to)
    for name in ours.names:
        word = name.replace(".", "_").replace("[", "_").replace("]", "")
        values = next(again[w] for w in (f"{word}_output", f"{word}_2", word) if w in again.names)
        assert values == pytest.approx(ours[name], rel=1e-6, abs=1e-6 * np.abs(ours[name]).max() + 1e-12), name


TANK = """model Tank {
  mode open = false
  Sf pump : Q = 1 [m^3/s]
  C vessel : P = 1 [Pa/m^3]*V { start V = 0.3 m^3 }
  R drain : P = 0.2 [Pa*s/m^3]*Q
  0 node : hydraulic
  1 valve : hydraulic { active = open }
  pump -> node -> vessel, valve
  valve -> drain
  when vessel.V > 0.5 m^3 { open = true }
  when vessel.V < 0.25 m^3 { open = false }
  output V = vessel.V, Q = drain.Q
}"""


@pytest.mark.parametrize("text", [BALL, servo(" offset 3 ms"), HEATER.replace("290 K", "294 K"), TANK], ids=["ball", "servo", "heater", "tank"])  # fmt: skip
def test_events_come_back(text: str) -> None:
    compare(text, 1.4)


@pytest.mark.few(4)
@pytest.mark.parametrize("name, to", [
    ("active_filter", 0.008), ("batch_tank", 1000), ("brake", 60), ("chain", 1), ("coupled_coils", 0.002), ("coupled_tanks", 1800), ("crane", 20), ("dc_motor", 0.5),
    ("drag", 2), ("duffing", 5), ("end_stops", 0.0035), ("feed_forward", 0.02), ("field_oriented", 0.05), ("flexure", 0.1), ("gyrator", 0.005),
    ("gyroscope", 1), ("helmholtz", 0.1), ("hydraulic_press", 1.5), ("inverse_kinematics", 1), ("lotka_volterra", 60), ("loudspeaker", 0.2),
    ("manipulator", 0.02), ("oscillator", 5), ("pendulum", 2), ("pid_dc_motor", 2), ("plates", 0.003), ("quarter_car", 5), ("rc_driven", 10),
    ("rc_ladder", 0.02), ("reaction", 10), ("rectifier", 0.06), ("resonators", 1), ("rlc", 0.02), ("rough_pipe", 20), ("side_instability", 0.002),
    ("slider_crank", 0.5), ("solenoid", 0.3), ("step_down", 0.002), ("stiffness_frames", 1), ("surge_tank", 600), ("sweep", 20),
    ("thermoelectric_cooler", 1200), ("transformer", 0.06), ("van_der_pol", 20), ("vibration_absorber", 8), ("published/hires", 300),
    ("published/robertson", 1e4), ("published/transistor_amplifier", 0.02),
])  # fmt: skip
def test_models_come_back(name: str, to: float) -> None:
    compare(MODELS / f"{name}.bg", to)


# ------------------------------------------------------------------------- refusals

REFUSED = {
    "equations constrain `x`, `y`": "Real x, y, u, v, F; equation der(x) = u; der(y) = v; der(u) = -x*F; der(v) = -y*F - 9.81; x^2 + y^2 = 1;",
    "no equation is left that gives `y`": "Real x, y; equation der(x) = y;",
    "one too many": "Real x; equation x = 1; x = 2;",
    "`algorithm` cannot": "Real x; algorithm x := 1;",
    "the record `R`": "record R Real a; end R; Real x; equation x = 1;",
    "the function `f`": "function f input Real x; output Real y; external \"C\"; end f; Real x; equation x = 1;",
    "the array `x` is not flattened": "Real x[3]; equation x = {1, 2, 3};",
    "the type `Modelica.Units.SI.Voltage`": "Modelica.Units.SI.Voltage u; equation u = 1;",
    "the call `f(…)`": "Real x; equation x = f(2);",
    "`connect` as an equation": "Real a, b; equation connect(a, b); a = 1;",
    "`loop` as an equation": "Real x; equation for i in 1:3 loop x = i; end for;",
    "`der(…)`": "Real x, y; equation der(x*y) = 1; x = y;",
    "is declared twice": "Real x; Real x; equation x = 1;",
    "`enumeration`": "type E = enumeration(a, b); Real x; equation x = 1;",
    "different numbers of equations": "Real x, y; equation if time > 1 then x = 1; y = 2; else x = 2; end if;",
    "what a `when` does": "Real x; equation der(x) = 1; when x > 1 then terminate(\"end\"); end when;",
    "gives no start": "Real x, y; initial equation x*y = 1; equation der(x) = 1; der(y) = x;",
    "`u`, which changes, before the run": "input Real u; parameter Real p = 2*u; Real x; equation x = p;",
    "`a` may be set at the same instant": "discrete Real a, b; equation when sample(0, 1) then a = pre(a) + 1; end when; when sample(0, 2) then b = a; end when;",
    "`b` may be set at the same instant": "Real x(start = 0); discrete Real a, b; equation der(x) = 1; when x > 1 then b = 1; end when; when x > 1 then a = b; end when;",
    "moves with what is set": "discrete Real a, b; equation when time > 1 then a = b; b = a + 1; end when;",
    "`edge` cannot be imported here": "Boolean b; Real x; equation b = time > 1; x = if edge(b) then 1 else 0;",
    "too large a number": "Real x; equation x = 1e999;",
    "`change(…)`": "discrete Real n, m; equation when time > 1 then n = 1; end when; when change(n) then m = 2; end when;",
    "the function `g`": "function g input Real x; output Real y; algorithm y := 0; for i in 1:3 loop y := y + x; end for; end g; Real x; equation x = g(1);",
    "`t` has no value here": "function f input Real x; output Real y; protected Real t; algorithm y := t*x; end f; Real x, t = 1; equation x = f(2);",
    "the call `h(…)`, as it is here": "function h input Real x; output Real y; algorithm y := x; end h; Real x; equation x = h(1, z = 2);",
    "nested too deep": "function f input Real x; output Real y; algorithm y := f(x - 1); end f; Real x; equation x = f(2);",
    "`s` cannot be imported here": "Boolean s; discrete Real n; equation s = sample(0, 1); when {s, time > 3} then n = time; end when;",
    "set different things by `sample` or `change`": "Real x, y; equation der(x) = 1; der(y) = 1; when sample(0, 1) then reinit(x, 0); elsewhen y > 1 then reinit(y, 0); end when;",
    "`StopTime` is not a number": "Real x; equation x = 1; annotation(experiment(StopTime = T));",
    "`M` ends as `N`": "Real x; equation x = 1; end N; model M2 Real x; equation x = 1;",
}  # fmt: skip


@pytest.mark.parametrize("words", REFUSED)
def test_what_is_not_in_the_subset_is_named(words: str) -> None:
    with pytest.raises(CompilationFailed) as failed:
        imported(f"model M {REFUSED[words]} end M;")
    assert all(d.code == "BG801" and d.span.line == 1 and d.help for d in failed.value.diagnostics)
    assert words in " ".join(d.sentence for d in failed.value.diagnostics)


def test_all_is_refused_at_once_with_its_place() -> None:
    text = 'model M\n  Real[2] x;\n  String s;\nequation\n  x[1] = foo(1);\nalgorithm\n  s := "";\nend M;\n'
    with pytest.raises(CompilationFailed) as failed:
        imported(text)
    assert [(d.span.line, d.span.column) for d in failed.value.diagnostics] == [
        (2, 11),
        (3, 3),
        (5, 3),
        (5, 10),
        (7, 3),
    ]


HOSTILE = {
    "brackets": "Real x; equation x = " + "(" * 2_000 + "1" + ")" * 2_000 + ";",
    "calls": "Real x; equation x = " + "sin(" * 2_000 + "1" + ")" * 2_000 + ";",
    "doubled": "Real x; equation x = " + "mod(" * 60 + "1" + ", 2)" * 60 + ";",
    "truths": "Boolean x; equation x = " + "(true == " * 60 + "true" + ")" * 60 + ";",
    "set by what is set": "discrete Real a0" + "".join(f", a{i}" for i in range(1, 60)) + "; equation when time > 1 then a0 = 1;"
    + "".join(f"a{i} = a{i - 1} + a{i - 1};" for i in range(1, 60)) + " end when;",
    "long chain": "Real x0" + "".join(f", x{i}" for i in range(1, 1500)) + "; equation x0 = 1;" + "".join(f"x{i - 1} = x{i};" for i in range(1, 1500)),
    "long sum": "".join(f"Real x{i} = {i};" for i in range(1000)) + "Real y; equation y = " + " + ".join(f"x{i}" for i in range(1000)) + ";",
    "no end": "Real x; /*" * 1000,
    "names": "Real '__import__(\"os\").system(\"x\")' = 1; Real 'a\x1b[31m' = 2; Real time2(unit = \"]) import os\") = 1; /* \x00 */",
    "conditions": "Real x(start = 1); discrete Real n; equation der(x) = 1; when {" + ", ".join(f"x > {i}" for i in range(1000)) + "} then n = 1; end when;",
    "parameters": "parameter Real p0 = 1;" + "".join(f"parameter Real p{i} = p{i - 1} + p{i - 1};" for i in range(1, 60)) + "Real x(start = 1);"
    " equation der(x) = 1; when x > p59 then reinit(x, 0); end when;",
}  # fmt: skip


@pytest.mark.parametrize("case", HOSTILE)
def test_a_hostile_text_ends(case: str) -> None:
    begin = time.process_time()
    try:
        text = imported(f"model M {HOSTILE[case]} end M;")
        assert "\x1b" not in text
    except CompilationFailed as failed:
        assert failed.diagnostics
    assert time.process_time() - begin < 60


def test_units_as_modelica_writes_them() -> None:
    shown = {
        u: str(unit_dimension(u)) for u in ("kg.m2/(s3.A)", "N.m/rad", "m.s-2", "Ohm", "1", "rad/s", "Hz", "W/(m2.K)")
    }
    assert shown == {"kg.m2/(s3.A)": "V", "N.m/rad": "N*m", "m.s-2": "m/s^2", "Ohm": "ohm", "1": "1", "rad/s": "1/s", "Hz": "1/s", "W/(m2.K)": str(unit_dimension("W/m2/K"))}  # fmt: skip
    assert [unit_dimension(u) for u in ("degC", "bar", "rev/min", "mm", "furlong", "]", "")] == [None] * 7


def test_a_number_in_another_unit_stays_a_number() -> None:
    text = imported(
        'model M parameter Real n(unit = "rev/min") = 60 "speed"; output Real w(unit = "rad/s"); equation w = n*2*3/60; end M;'
    )
    assert 'parameter n = 60 "speed, in rev/min"' in text and "output w = n*2 [1/s]*3/60" in text


def test_a_condition_that_holds_at_the_start_does_not_act_there() -> None:
    """It acts when it holds again: at t = 1.2 s, as x is 0.7 there on its way back."""
    text = "model M Real x(start = 1, fixed = true), y(start = 0, fixed = true); equation der(x) = if time < 0.75 then -1 else 1; der(y) = 1;"
    result = bondgraph.load(imported(f"{text} when x > 0.7 then reinit(y, 0); end when; end M;")).simulate(
        to=2, points=3
    )
    assert result["y"] == pytest.approx([0, 1, 0.8])


ENDS = {  # x at t = 2 s
    "Real y(start = 3, fixed = true); equation y = 2*x; der(x) = 0;": 1.5,
    "equation der(x) = 1; annotation(experiment(StartTime = -3, StopTime = 4/2));": 5,
    "Real y(start = 0, fixed = true); equation der(x) = 1; der(y) = 1; when x > 1 then reinit(y, -1); elsewhen y > 1 then reinit(x, 7); end when;": 2,
    'Real y "in" + " two"; equation der(x) = y; y = delay(time, 1, 2);': 0.5,
    "equation if time > 1 then der(x) + time = 0; else der(x) - 1 = 0; end if;": -0.5,
    "function f input Real a, b = 3; output Real y; protected Real t = a*b; algorithm t := t + 1; y := t^2; end f; equation der(x) = f(f(1), 0) + f(b = 2, a = time);": 2 + 124/6,
    'parameter Real a(unit = "m7") = 2; parameter Real d = a; equation der(x) = d^3;': 16,
}  # fmt: skip


@pytest.mark.parametrize("body", ENDS)
def test_values_are_those_of_modelica(body: str) -> None:
    result = bondgraph.load(imported(f"model M Real x(start = 0); {body} end M;")).simulate(
        to=None if "experiment" in body else 2, points=3
    )
    assert result["x"][-1] == pytest.approx(ENDS[body], rel=1e-6)


def test_bounds_of_parameters_are_required() -> None:
    text = 'model M parameter Real k(unit = "N", min = 0, max = 2*q) = 3; parameter Real q(unit = "N") = 4; Real x; equation der(x) = 1; end M;'
    model = bondgraph.load(imported(text))
    texts = [[w.text for w in model.simulate(settings={"k": f"{k} N"}, to=1, points=2).warnings] for k in (-1, 8, 9)]
    assert texts == [["min of k"], [], ["max of k"]]


COUNTS = {  # what counts until t = 10 s; sin(time) > 0.5 begins at 0.52 s and 6.81 s, sin(time) > -0.3, which holds at the start, at 5.98 s
    "when {sin(time) > 0.5, sin(time) > -0.3} then n = pre(n) + 1; end when;": 3,
    "when sin(time) > -0.3 then n = pre(n) + 1; end when;": 1,
    "when sample(3, 1.5) then n = pre(n) + 1; end when;": 5,
    "when sample(0, 2.5) then n = pre(n) + 1; end when;": 5,
    "when change(b) then n = pre(n) + 1; end when;": 4,
    "when {b, sin(time) > -0.3} then n = pre(n) + (if edge(b) then 10 else 1); end when;": 21,
    "when sin(time) > 0.5 then m = pre(m) + 1; n = m + pre(m); end when;": 3,
}  # fmt: skip


@pytest.mark.parametrize("when", COUNTS)
def test_events_are_those_of_modelica(when: str) -> None:
    text = f"Real x(start = 0, fixed = true); Boolean b; discrete output Integer n(start = 0), m(start = 0); equation b = sin(time) > 0.5; der(x) = 1; {when}"
    text = text.replace(", m(start = 0)", "") if "m = " not in when else text
    result = bondgraph.load(imported(f"model M {text} end M;")).simulate(to=10, points=3)
    assert result["n"][-1] == COUNTS[when]


def test_bonds_reach_an_imported_model() -> None:
    """A motor turns a wheel in oil: its speed is the flow of a bond, whose effort is its load. The oil adds to the friction of its own."""
    text = (Path(__file__).parent / "flat_modelica" / "dc_motor.bg").read_text(encoding="utf-8")
    plant = "model Plant {\n  DCMotor m { load = shaft.M }\n  MSf shaft : omega = m.w\n  R oil : M = 2 [mN*m*s]*omega\n  shaft -> oil\n  output w = m.w\n}\n"
    speeds = [
        bondgraph.load(t, name).simulate(None, settings=s, to=0.1, points=5)["w"]
        for t, name, s in ((text + plant, "Plant", {}), (text, None, {"b": "2.1 [mN*m*s]"}))
    ]
    assert speeds[0] == pytest.approx(speeds[1], rel=1e-5)
