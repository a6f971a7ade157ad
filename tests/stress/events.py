"""5. Event problems with known answers: a ball that bounces to rest, a rectifier, stick and slip, and problems of the literature."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import airy

import bondgraph
from tests.stress.report import Section
from tests.stress.trial import Case, run_all
from tests.stress.walking import walker
from tests.stress.ways import ways

BALL = """model Ball {
  parameter m = 0.1 kg, bounce = 0.8, h = 1 m, g = 10 [m/s^2], least = 1 [mm/s]
  1  ball    { active = not resting }
  I  mass    : p = m*v
  Se weight  : F = -m*g
  weight -> ball -> mass
  output height = integral(ball.v, h), v = mass.v
  mode resting = false
  when height < 0 m {
    mass.v  = -bounce*mass.v
    resting = abs(mass.v) < least
  }
}
"""


def bouncing(bounce: float = 0.8, height: float = 1.0, least: float = 1e-3) -> Case:
    """Bounce k at t1 + 2 t1 (e + … + e^k), t1 = sqrt(2h/g), with the speed e^k g t1; at rest where that is too little."""
    g = 10.0
    first = np.sqrt(2 * height / g)

    def expected(times: Any) -> Mapping[str, Any]:
        y, v = np.zeros(len(times)), np.zeros(len(times))
        falls = times < first
        y[falls], v[falls] = height - g / 2 * times[falls] ** 2, -g * times[falls]
        begin, speed = first, bounce * g * first
        while speed >= least:
            end = begin + 2 * speed / g
            inside = (times >= begin) & (times < end)
            s = times[inside] - begin
            y[inside], v[inside] = speed * s - g / 2 * s**2, speed - g * s
            begin, speed = end, bounce * speed
        near = np.abs(v) > 0.999 * bounce * g * first  # of an instant beside the first bounce nothing is asked
        return {"height": y, "v": np.where(near & (times > first * 0.999), np.nan, v)}

    def check(result: bondgraph.Result) -> str:
        count = int(np.ceil(np.log(g * first / least) / -np.log(bounce)))
        found = len(result.events)
        return "" if abs(found - count) <= 1 else f"{found} bounces in place of {count}"

    settings = {"bounce": bounce, "h": height, "least": least}
    stop = first * (1 + bounce) / (1 - bounce) * 1.1
    return Case("ball that bounces to rest", "restitution", bounce, BALL, settings, stop, expected, check=check)


RECTIFIER = """model Rectifier {
  parameter R = 1 ohm, C = 20 mF, R_load = 10 ohm
  Se mains : u = 10 V*sin(2*pi*50*time/1 s)
  R source : u = R*i
  R diode  : i = u/1 [mohm] if u > 0 V else 0 A
  C store  : u = q/C
  R load   : u = R_load*i
  mains -> 1(source, diode) -> 0(store, load)
  output u = store.u, i = diode.i
}
"""
IDEAL = RECTIFIER.replace("R diode  : i = u/1 [mohm] if u > 0 V else 0 A", "IdealDiode diode").replace(
    "1(source, diode)", "way"
)
IDEAL = "import IdealDiode from electric\n" + IDEAL.replace(
    "  mains ->", "  1 way : electric\n  way -> source, diode.pins\n  mains ->"
).replace("diode.i", "diode.current")


def rectifier(ideal: bool) -> Case:
    """C u' = (U sin wt - u)/Rs - u/RL while it conducts, C u' = -u/RL while it blocks; the instants by bisection."""
    rs, c, rl, amplitude, w = 1.0 if ideal else 1.001, 20e-3, 10.0, 10.0, 100 * np.pi
    stop = 0.2

    def conducting(t0: float, u0: float) -> Any:
        a, b = (1 / rs + 1 / rl) / c, amplitude / rs / c
        p, q = b * a / (a * a + w * w), -b * w / (a * a + w * w)  # particular: p sin + q cos
        k = u0 - p * np.sin(w * t0) - q * np.cos(w * t0)
        return lambda t: k * np.exp(-a * (t - t0)) + p * np.sin(w * t) + q * np.cos(w * t)

    def expected(times: Any) -> Mapping[str, Any]:
        u = np.empty(len(times))
        t, value, on = 0.0, 0.0, True
        while t < stop:
            part = conducting(t, value) if on else (lambda s, t=t, value=value: value * np.exp(-(s - t) / (rl * c)))
            drive = lambda s, part=part: amplitude * np.sin(w * s) - part(s)  # noqa: E731
            grid = np.linspace(t, min(t + 0.02, stop), 4001)[1:]
            away = np.flatnonzero((drive(grid) < 0) if on else (drive(grid) > 0))
            away = away[away > 0]
            end = brentq(drive, grid[away[0] - 1], grid[away[0]], xtol=1e-16) if len(away) else stop
            inside = (times >= t) & (times <= end)
            u[inside] = part(times[inside])
            t, value, on = float(end), float(part(end)), not on
        return {"u": u}

    name = "ideal diode" if ideal else "diode of two slopes"
    return Case(f"rectifier, {name}", "", 0, IDEAL if ideal else RECTIFIER, {}, stop, expected, points=401)


STICK_SLIP = """import DryFriction from mechanics
model StickSlip {
  "A block on a belt, held by a spring: it sticks until the spring pulls with F_s, and slips back."
  parameter m = 1 kg, k: N/m = 100, belt: m/s = 0.1, fall = 0 [m/s]
  Sf drive  : v = belt
  I  block  : p = m*v                    { start v = 0.1 [m/s] }
  C  spring : F = k*x
  DryFriction rub { F_c = 5 N; F_s = 10 N; v_s = fall }
  drive -> gap
  0  gap : translation
  1  slide, body : translation
  gap -> slide -> rub.ends
  gap -> body -> block, spring
  output x = spring.x, sticks = rub.sticks
}
"""


def escape(pull: float, drop: float, fall: float) -> float:
    """Sticking time of a block from its break-away on: u' = pull t + drop (u/fall)^2 from rest, until u is infinite.

    Friction falls as exp(-(u/fall)^2). u is -w'/w/b with w'' = -a b t w, w'(0) = 0: w = sqrt(3) Ai(-s) + Bi(-s), s = (a b)^(1/3) t, which
    vanishes first at s = 1.9864.
    """
    if fall == 0:
        return 0.0
    w = lambda s: np.sqrt(3) * airy(-s)[0] + airy(-s)[2]  # noqa: E731
    return float(brentq(w, 1.0, 3.0) / (pull * drop / fall**2) ** (1 / 3))


MANY = 1000  # cycles that are tried in the first way only


def stick_slip(cycles: int = 5, fall: float = 0.0) -> Case:
    """Stick-slip motion, exactly.

    It sticks until x = Fs/k (the fall of friction to Fc takes no time, or that of `escape`), then m x'' + k x = Fc from there with the speed
    of the belt, until it has that speed again. x = Fc/k + (d/k) cos wt + (v/w) sin wt, d = Fs - Fc; it is back at v after
    t = 2 (pi - atan(d w/(k v)))/w, at x = Fc/k - d/k.
    """
    m, k, v, fc, fs = 1.0, 100.0, 0.1, 5.0, 10.0
    fs += k * v * escape(k * v / m, (fs - fc) / m, fall)
    w, d = np.sqrt(k / m), fs - fc
    slip = 2 * (np.pi - np.arctan(d * w / (k * v))) / w
    stick = 2 * d / k / v
    first = fs / k / v

    def expected(times: Any) -> Mapping[str, Any]:
        phase = np.mod(times - first, slip + stick)
        slipping = fc / k + d / k * np.cos(w * phase) + v / w * np.sin(w * phase)
        x = np.where(phase < slip, slipping, (fc - d) / k + v * (phase - slip))
        return {"x": np.where(times < first, v * times, x)}

    stop = first + cycles * (slip + stick)
    allowed = max(10.0, cycles / 20)  # each cycle begins where the one before ended: their errors in time add up
    case = Case(
        "stick and slip", f"friction falls within {fall:g} m/s, cycles", cycles, STICK_SLIP, {"fall": fall}, stop, expected,
        points=501, allowed=allowed,
    )  # fmt: skip
    if cycles <= MANY:
        return case
    return replace(case, points=5001, only=lambda way: way == ways()[0], longest=1000.0)  # some 5 ms for each cycle


MANNSHARDT = """plain model Trapped {
  "y'' + 0.2 y' + 4 sign(y') + y = 2 cos(pi t): it sticks while 4 can hold it."
  mode way = 1
  signal y = integral(v, 3)
  signal pull = 2*cos(pi*time) - y
  signal v = integral(0 if way == 0 else pull - 0.2*v - 4*way, 4)
  when way*v < 0 { way = 0; v = 0 }
  when way == 0 and abs(pull) > 4 { way = 1 if pull > 0 else -1 }
  output place = y, speed = v
}
"""


def mannshardt() -> Case:
    """Piece by piece in closed form; the sticking begins where the speed is zero and ends where the pull is 4."""
    damping, dry, drive, w = 0.1, 4.0, 2.0, np.pi
    root = np.sqrt(1 - damping**2)
    p = drive * (1 - w * w) / ((1 - w * w) ** 2 + (2 * damping * w) ** 2)
    q = drive * 2 * damping * w / ((1 - w * w) ** 2 + (2 * damping * w) ** 2)

    def moving(t0: float, y0: float, v0: float, way: int) -> Any:
        a = y0 + dry * way - p * np.cos(w * t0) - q * np.sin(w * t0)
        b = (v0 + p * w * np.sin(w * t0) - q * w * np.cos(w * t0) + damping * a) / root

        def at(t: Any) -> Any:
            s = t - t0
            c, e = np.cos(root * s), np.exp(-damping * s)
            y = -dry * way + p * np.cos(w * t) + q * np.sin(w * t) + e * (a * c + b * np.sin(root * s))
            free = e * ((b * root - damping * a) * c - (a * root + damping * b) * np.sin(root * s))
            return y, free - p * w * np.sin(w * t) + q * w * np.cos(w * t)

        return at

    def expected(times: Any) -> Mapping[str, Any]:
        stop, y = float(times[-1]), np.empty(len(times))
        t, here, speed, way = 0.0, 3.0, 4.0, 1
        while t < stop:
            if way:
                at = moving(t, here, speed, way)
                turns = lambda s, at=at, way=way: way * at(s)[1]  # noqa: E731
            else:
                at = lambda s, here=here: (here + 0 * s, 0 * s)  # noqa: E731
                turns = lambda s, here=here: dry - abs(drive * np.cos(w * s) - here)  # noqa: E731
            grid = t + 1e-3 + np.linspace(0, 4, 40001)  # a motion begins so slowly that rounding hides its sign
            after = np.flatnonzero(turns(grid) < 0)
            end = brentq(turns, grid[after[0] - 1], grid[after[0]], xtol=1e-15) if len(after) and after[0] else stop + 1
            inside = (times >= t) & (times <= end)
            y[inside] = at(times[inside])[0]
            t, here, speed = end, float(at(end)[0]), 0.0
            pull = drive * np.cos(w * t) - here
            way = 0 if way and abs(pull) <= dry else int(np.sign(pull))
        return {"place": y}

    return Case("dry friction that traps (Mannshardt 1978)", "", 0, MANNSHARDT, {}, 8.0, expected, points=401)


def section(short: bool) -> Section:
    """The problems in every way."""
    found = Section("5. Events with known answers")
    found.say("Errors as in section 1; instants of a jump itself are left out of the comparison.")
    cases = [bouncing(), rectifier(False), rectifier(True), stick_slip(), stick_slip(fall=1e-9), mannshardt(), walker()]
    if not short:
        cases += [bouncing(0.5), bouncing(0.9, least=1e-5), bouncing(0.97, least=1e-3), stick_slip(100), walker(100)]
    chosen = ways()
    run_all(found, cases, chosen[:1] if short else chosen)
    return found
