"""4. Where laws bend, jump or lose their slope, where mechanisms pass singular poses, and where everything happens at once."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk, erf

from tests.stress.events import bouncing, rectifier, stick_slip
from tests.stress.report import Section
from tests.stress.trial import Case, run_all
from tests.stress.ways import ways

Formula = Callable[[Any], Any]


def signal(name: str, law: str, start: float, formula: Formula, stop: float, **more: Any) -> Case:
    """x' = law(x, time) as a plain model; a term of no size keeps it from being linear."""
    text = f"plain model Kink {{\n  signal x = integral({law} - 1e-30*x^3, {start:g})\n  output y = x\n}}\n"
    return Case(name, "", 0, text, {}, stop, lambda t: {"y": formula(t)}, **more)


# ---------------------------------------------------------------- functions at their kinks, in time
def folded(t: Any) -> Any:
    """The integral of abs(cos t)."""
    turns = np.floor((t + np.pi / 2) / np.pi)
    return 2 * turns + np.where(turns % 2 == 0, np.sin(t), -np.sin(t))


def in_time() -> Iterator[Case]:
    """Functions of time."""
    yield signal("abs(cos t)", "abs(cos(time))", 0, folded, 20.0)
    yield signal("max(cos t, 0)", "max(cos(time), 0)", 0, lambda t: 0.5 * (folded(t) + np.sin(t)), 20.0)
    yield signal("min(cos t, 0)", "min(cos(time), 0)", 0, lambda t: 0.5 * (np.sin(t) - folded(t)), 20.0)
    yield signal("sign(cos t)", "sign(cos(time))", 0, lambda t: np.arcsin(np.sin(t)), 20.0)
    yield signal(
        "sqrt(abs(t - 1))", "sqrt(abs(time - 1))", 0, lambda t: 2 / 3 * (1 + np.sign(t - 1) * np.abs(t - 1) ** 1.5), 3.0
    )
    yield signal("atan2 over its cut", "atan2(sin(time), cos(time))", 0, _saw_integral, 20.0)
    yield signal("step at the start", "step(time)", 0, lambda t: t, 2.0)
    yield signal("step at the end", "step(time - 2)", 0, lambda t: 0 * t, 2.0)
    together = "step(time - 1) + 2*pulse(time, 1, 2) + ramp(time, 1, 2) + (3 if time > 1 else 0)"
    yield signal("four jumps at one instant", together, 0, _four_jumps, 3.0)
    yield signal(
        "a pulse of 1e-9",
        "1e9*pulse(time, 1, 1 + 1e-9)",
        0,
        lambda t: np.where(t > 1, 1 + 1e-9 / 1e9, 0.0),
        3.0,
        points=4,
    )
    steps = "linear(time, (0, 1, 1.000001, 2, 2.000001, 3), (0, 0, 1, 1, -1, -1))"
    yield signal(
        "table with jumps",
        steps,
        0,
        lambda t: np.clip(t - 1.0000005, 0, 1) - np.clip(t - 2.0000005, 0, 1),
        3.0,
        points=7,
    )
    bell = "exp(-((time - 3.1234)/0.05)^2)/0.05 + exp(-((time - 1.7)/0.00001)^2)/0.00001"
    yield signal(
        "smooth pulses of 5e-2 and 1e-5",
        bell,
        0,
        _bells,
        6.0,
        points=7,
    )


def _bells(t: Any) -> Any:
    """Integral of two bells."""
    return 0.5 * np.sqrt(np.pi) * (2 + erf((t - 3.1234) / 0.05) + erf((t - 1.7) / 1e-5))


def _saw_integral(t: Any) -> Any:
    """The integral of the angle between -pi and pi."""
    s = np.mod(t + np.pi, 2 * np.pi) - np.pi
    return s**2 / 2


def _four_jumps(t: Any) -> Any:
    s = np.clip(t - 1, 0, None)
    inside = np.clip(s, 0, 1)
    return s + 2 * inside + inside**2 / 2 + np.clip(s - 1, 0, None) + 3 * s


# ---------------------------------------------------------------- functions of states
def bilinear(t: Any, soft: float, stiff: float) -> Any:
    """A mass of 1 kg on a spring of two slopes, soft from 1 m on."""
    a, b = np.sqrt(soft), np.sqrt(stiff)
    period = np.pi / a + np.pi / b
    s = np.mod(t + np.pi / (2 * a), period)
    return np.where(s < np.pi / a, np.sin(a * s), -a / b * np.sin(b * (s - np.pi / a)))


def spring(name: str, law: str, formula: Formula, stop: float, extra: str = "") -> Case:
    text = f"""model Spring {{
  I mass : p = 1 kg*v
  C spring : F = {law} {{ start x = 1 m }}
  1(mass) -> spring
  output x = spring.x
{extra}}}
"""
    return Case(name, "", 0, text, {}, stop, lambda t: {"x": formula(t)})


def in_states() -> Iterator[Case]:
    """Springs and motions with bends, jumps and roots."""
    for stiff in (9.0, 1e4, 1e6):
        half, half_less = 0.5 * (stiff + 1), 0.5 * (stiff - 1)
        laws = {
            "max": f"1 [N/m]*max(x, 0 m) + {stiff:g} [N/m]*min(x, 0 m)",
            "abs": f"{half!r} [N/m]*x - {half_less!r} [N/m]*abs(x)",
            "if": f"1 [N/m]*x if x > 0 m else {stiff:g} [N/m]*x",
            "table": f"linear(x, (-10 m, 0 m, 10 m), ({-10 * stiff:g} N, 0 N, 10 N))",
        }
        for form, law in laws.items():
            yield spring(
                f"spring of two slopes 1 : {stiff:g}, {form}", law, lambda t, s=stiff: bilinear(t, 1.0, s), 50.0
            )
    yield spring("spring of constant force, sign", "1 N*sign(x)", _constant_force, 40.0)
    yield signal("drained by sqrt(max(x, 0))", "-2*sqrt(max(x, 0))", 1, lambda t: np.clip(1 - t, 0, None) ** 2, 2.0)
    yield signal("leaves zero by a root", "3*(x^2)^(1/3) + 1e-3", 1e-9, _leaving, 0.5)
    yield signal(
        "down to a cube root", "-1.5*x/max(abs(x), 1e-20)^(2/3)", 1, lambda t: np.clip(1 - t, 0, None) ** 1.5, 0.99
    )


def _leaving(t: Any) -> Any:
    """x = y^3 with y - r atan(y/r) = t + constant, r^2 = 1e-3/3: y by halving."""
    r, first = np.sqrt(1e-3 / 3), 1e-3
    low, high = np.full_like(t, first), t + first + 2 * r
    for _ in range(100):
        y = (low + high) / 2
        early = y - first - r * (np.arctan(y / r) - np.arctan(first / r)) < t
        low, high = np.where(early, y, low), np.where(early, high, y)
    return y**3


def _constant_force(t: Any) -> Any:
    """Parabolas: from 1 m to 0 in sqrt(2) s."""
    quarter = np.sqrt(2)
    s = np.mod(t, 4 * quarter)
    half = np.where(s < 2 * quarter, s - 0.0, s - 2 * quarter)
    x = np.where(half < quarter, 1 - half**2 / 2, -(1 - (2 * quarter - half) ** 2 / 2))
    return np.where(s < 2 * quarter, x, -x)


# ---------------------------------------------------------------- parts of the library
HALF_WAVE = """import IdealDiode from electric
model HalfWave {
  "A diode passes the positive half of a sine into a resistor."
  Se mains : u = 10 V*sin(time/1 s)
  R load : u = 2 ohm*i
  IdealDiode diode
  1 loop : electric
  mains -> loop -> load
  loop -> diode.pins
  output q = integral(diode.current, 0 C)
}
"""
PEAK = """import IdealDiode from electric
model Peak {
  "A diode without any resistance in series: the capacitor holds the largest voltage so far."
  Se mains : u = 1 [V/s]*time*sin(time/1 s)
  C store : u = q/1 [mF]
  IdealDiode diode
  1 loop : electric
  mains -> loop -> store
  loop -> diode.pins
  output u = store.u
}
"""
BACKLASH = """import Backlash from mechanics
model Play {
  "A mass between two flanks: flights and half periods."
  parameter k = 1e4 [N/m], r = 0 [N*s/m]
  I mass : p = 1 kg*v { start v = 0.1 [m/s] }
  Backlash lash { play = 2 mm, k = k, r = r }
  Sf wall : v = 0 [m/s]
  0 far : translation
  1 body : translation
  body -> mass
  body -> lash.a
  lash.b -> far
  wall -> far
  output x = lash.way
}
"""
CHECK_VALVE = """import CheckValve from hydraulic
model Charging {
  "A pump that goes to and fro charges a volume through a check valve."
  Se pump : P = 20 bar*sin(time/1 s)
  CheckValve valve { area = 10 [mm^2], P_open = 0.5 bar }
  C room : P = V*1e8 [Pa/m^3]
  R leak : Q = 1e-11 [m^3/s/Pa]*P
  0 first : hydraulic
  0 node : hydraulic
  pump -> first -> valve.a
  valve.b -> node -> room, leak
  output P = room.P
}
"""


def half_wave(t: Any) -> Mapping[str, Any]:
    """The integral of 5 max(sin t, 0), abs(sin) being abs(cos) a quarter later."""
    return {"q": 2.5 * (folded(t - np.pi / 2) + 1 + 1 - np.cos(t))}


def peaks(t: Any) -> Mapping[str, Any]:
    """The largest t sin t so far: its crests lie where tan t = -t."""
    crests = [brentq(lambda s: np.sin(s) + s * np.cos(s), k * np.pi - np.pi / 2, k * np.pi) for k in range(1, 20, 2)]
    values = np.array([0.0, *(c * np.sin(c) for c in crests)])
    before = np.maximum.accumulate(values)[np.searchsorted(crests, t)]
    return {"u": np.maximum(before, t * np.sin(t))}


def between_flanks(t: Any, stiffness: float, damping: float) -> Mapping[str, Any]:
    """Flights of 2 mm, and contacts of half a damped period, each with less speed."""
    decay = damping / 2
    rate = np.sqrt(stiffness - decay**2)
    x, begin, speed, side, way = np.zeros(len(t)), 0.0, 0.1, 1.0, 1e-3
    while begin <= t[-1]:
        touch, leave = begin + way / speed, begin + way / speed + np.pi / rate
        flight, contact = (t >= begin) & (t < touch), (t >= touch) & (t < leave)
        x[flight] = side * (1e-3 - way + speed * (t[flight] - begin))
        s = t[contact] - touch
        x[contact] = side * (1e-3 + speed / rate * np.exp(-decay * s) * np.sin(rate * s))
        begin, speed, side, way = leave, speed * np.exp(-decay * np.pi / rate), -side, 2e-3
    return {"x": x}


def charged(t: Any) -> Mapping[str, Any]:
    """The same by an integration from event to event, at a tolerance of 1e-12."""
    factor = 0.62 * np.sqrt(2 / 850) * 10e-6

    def drop(s: float, y: Any) -> float:
        return float(2e6 * np.sin(s) - y[0])

    def rate(s: float, y: Any, passes: bool) -> list[float]:
        over = drop(s, y)
        flow = factor * np.sign(over) * over**2 / np.sqrt((np.hypot(over, 100) + 100) * over**2 + 1e-300)
        return [1e8 * (flow * passes - 1e-11 * y[0])]

    pressures, now, state, passes = np.zeros(len(t)), 0.0, [0.0], False
    while now < t[-1]:
        level = 0.0 if passes else 5e4

        def event(s: float, y: Any, passes: bool, level: float = level) -> float:
            return drop(s, y) - level

        event.terminal, event.direction = True, -1.0 if passes else 1.0  # type: ignore[attr-defined]
        part = solve_ivp(
            rate, (now, t[-1]), state, "DOP853", events=event, args=(passes,), rtol=1e-12, atol=1e-6, dense_output=True,
            max_step=0.1,
        )  # fmt: skip
        inside = (t >= now) & (t <= part.t[-1])
        pressures[inside] = part.sol(t[inside])[0]
        now, state, passes = part.t[-1], part.y[:, -1], not passes
    return {"P": pressures}


def parts() -> Iterator[Case]:
    """Ideal diode, check valve and backlash of the library, whose kinks are events."""
    yield Case("ideal diode, half a sine", "", 0, HALF_WAVE, {}, 20.0, half_wave)
    yield Case("ideal diode, largest so far", "", 0, PEAK, {}, 20.0, peaks)
    for stiffness, damping in ((1e4, 0.0), (1e4, 5.0), (1e7, 100.0)):
        settings = {"k": stiffness, "r": damping}
        formula = lambda t, k=stiffness, r=damping: between_flanks(t, k, r)  # noqa: E731
        yield Case(f"backlash with damping {damping:g},", "stiffness", stiffness, BACKLASH, settings, 0.5, formula)
    yield Case("check valve, to and fro", "", 0, CHECK_VALVE, {}, 15.0, charged)


# ---------------------------------------------------------------- mechanisms
FOUR_BAR = """model Parallelogram {
  "Equal cranks and a coupler: two change points in each turn; the motion through them goes on as a parallelogram."
  multibody bars : planar {
    body  left    { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (0, 0.5 m) }
    body  coupler { mass = 2 kg, inertia = 0.1 [kg*m^2], at = (1 m, 1 m) }
    body  right   { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (2 m, 0.5 m) }
    hinge a : ground to left    { at = (0, 0), start phi.omega = 3 [1/s] }
    hinge b : left to coupler   { at = (0, 1 m) }
    hinge c : ground to right   { at = (2 m, 0) }
    hinge d : right to coupler  { at = (2 m, 1 m) }
  }
  output x = bars.coupler.x, y = bars.coupler.y
}
"""
GIMBAL = """model Gimbal {
  "A body turns through gimbal lock: straight through the pole of every set of three angles, at a constant rate."
  multibody free : spatial {
    body plate { mass = 1 kg, inertia = 1 [kg*m^2]*(1, 2, 3), start ry.omega = 1 [1/s], start rx.omega = 0, start rz.omega = 0 }
    frame tip : plate { at = (1 m, 0, 0) }
  }
  output x = free.tip.x, z = free.tip.z, w = free.plate.attitude.w
}
"""
REDUNDANT = """model Beams {
  "A plate on three equal swinging bars: one of them holds nothing that the others do not hold."
  multibody plate : planar {
    gravity = (0, -10 [m/s^2])
    body top { mass = 3 kg, at = (1 m, -1 m) }
    for i in 1..3 {
      body bar[i] { mass = 1e-9 kg, at = ((i - 1)*1 m, -0.5 m) }
      hinge up[i]   : ground to bar[i] { at = ((i - 1)*1 m, 0) }
      hinge down[i] : bar[i] to top    { at = ((i - 1)*1 m, -1 m) }
    }
  }
  output x = plate.top.x
  experiment swing { start plate.up[1].phi = 60 deg; simulate 0 .. 5 s }
}
"""
MASSLESS = """model Chain {
  "A bob on a chain of massless links that springs hold straight but for the first."
  multibody chain : planar {
    gravity = (0, -1 [m/s^2])
    body a { at = (0, -0.25 m) }
    body b { at = (0, -0.5 m) }
    body bob { mass = 1 kg, at = (0, -1 m) }
    hinge first : ground to a { at = (0, 0), start phi = 1.5 }
    weld second : a to b { at = (0, -0.25 m) }
    weld third : b to bob { at = (0, -0.5 m) }
  }
  output phi = chain.first.phi
}
"""


def pendulum(t: Any, length: float, gravity: float, start: float) -> Any:
    """The angle of a point on a rod, from rest."""
    k = np.sin(start / 2)
    sn, _, _, _ = ellipj(ellipk(k * k) - np.sqrt(gravity / length) * t, k * k)
    return 2 * np.arcsin(k * sn)


def mechanisms() -> Iterator[Case]:
    """Singular poses, redundant constraints, links without mass."""

    def parallelogram(t: Any) -> Mapping[str, Any]:
        angle = (
            3 * t
        )  # the cranks turn at a constant rate: no gravity, and each point of the coupler goes on an equal circle
        return {"x": 1 - np.sin(angle), "y": np.cos(angle)}

    yield Case("parallelogram through change points", "", 0, FOUR_BAR, {}, 5.0, parallelogram)

    def gimbal(t: Any) -> Mapping[str, Any]:
        return {"x": np.cos(t), "z": -np.sin(t), "w": np.cos(t / 2)}

    yield Case("gimbal lock", "", 0, GIMBAL, {}, 9.0, gimbal)
    beams = Case(
        "redundant bars",
        "",
        0,
        REDUNDANT,
        {},
        5.0,
        lambda t: {"x": 1 + np.sin(pendulum(t, 1.0, 10.0, np.pi / 3))},
        experiment="swing",
    )
    yield beams
    yield Case("links without mass", "", 0, MASSLESS, {}, 10.0, lambda t: {"phi": pendulum(t, 1.0, 1.0, 1.5)})


LOOP = """plain model Loop {
  "A loop that is nearly singular: e = f*(1 - small) + … solved for f."
  parameter small = 1
  Se push : e = cos(time)
  R  one  : e = f
  R  two  : e = -(1 - small)*f
  C  store : e = q
  push -> 1(one, two) -> store
  output q = store.q
}
"""


def loops() -> Iterator[Case]:
    """A resistance that nearly cancels another: small*q' = cos t - q."""
    for small in (1.0, 1e-3, 1e-6, 1e-9):

        def expected(t: Any, s: float = small) -> Mapping[str, Any]:
            a = 1 / (1 + s * s)
            return {"q": a * (np.cos(t) + s * np.sin(t)) - a * np.exp(-t / s)}

        yield Case("resistances that nearly cancel", "what is left", small, LOOP, {"small": small}, 6.0, expected)


def section(short: bool) -> Section:
    """All of them in every way."""
    found = Section("4. Kinks, jumps, singular poses, thousands of events")
    found.say("Errors as in section 1.")
    cases = [*in_time(), *in_states(), *parts(), *mechanisms(), *loops()]
    if short:
        cases = [c for c in cases if not re.search(r"1 : (9|10000), |change points|redundant| 1$|0.001", c.name)]
    else:
        cases += [bouncing(0.97, least=1e-4), stick_slip(10_000), rectifier(False)]
    chosen = ways()
    run_all(found, cases, chosen[:1] if short else chosen)
    return found
