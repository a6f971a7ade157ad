"""1. Stiffness, masses, times and units over many decades, against closed forms in 40 digits."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import mpmath
import numpy as np

from tests.stress.report import Section
from tests.stress.trial import Case, Outcome, attempt, tell
from tests.stress.ways import ways

STIFFNESS = (1e0, 1e3, 1e6, 1e9, 1e12)
MASSES = (1e-12, 1e-8, 1e-4, 1e0, 1e4, 1e8, 1e12)
TIMES = (1e-9, 1e-6, 1e-3, 1e0, 1e3, 1e6, 1e9)
NONE_REFUSED_BELOW = {"stiffness": 1e9, "mass ratio": 1e8}
MOST_REFUSED = 0.05
SHORT = (1e-12, 1e9, 1e12, 4, 5)  # sizes, and numbers of units


def exactly(function: Callable[[Any], Any], times: Any) -> Any:
    """A function of mpmath over times."""
    with mpmath.workdps(40):
        return np.array([float(function(mpmath.mpf(float(t)))) for t in times])


# ---------------------------------------------------------------- stiffness
KAPS = """plain model Kaps {
  "Kaps: exact whatever the stiffness mu, y1 = exp(-2t), y2 = exp(-t)."
  parameter mu = 1
  signal y1 = integral(-(mu + 2)*y1 + mu*y2^2, 1)
  signal y2 = integral(y1 - y2 - y2^2, 1)
  output a = y1, b = y2
}
"""
FOLLOWER = """plain model Follower {
  "Prothero and Robinson, with a cube: follows cos t as stiffly as L says."
  parameter L = 1
  signal y = integral(-L*(y^3 + y - cos(time)^3 - cos(time)) - sin(time), 1)
  output a = y
}
"""
DIODE = """model Discharge {
  "A capacitor empties through a diode: the conductance falls from g*exp(u0/U) to g."
  parameter C = 1 F, I_s = 1 A, U = 1 V, u0 = 1 V
  C store : u = q/C        { start u = u0 }
  R diode : i = I_s*(exp(u/U) - 1)
  diode_node -> diode
  0 diode_node
  source -> diode_node
  Sf source : i = 0
  diode_node -> store
  output u = store.u
}
"""
PAIR = """model Pair {
  "Two capacitors behind resistors, both linear."
  parameter C1 = 1 F, C2 = 1 F, R1 = 1 ohm, R2 = 1 ohm
  C first  : u = q/C1      { start u = 1 V }
  C second : u = q/C2      { start u = 2 V }
  R leak   : u = R1*i
  R wire   : u = R2*i
  0 here, there : electric
  here -> first, leak
  here -> 1(wire) -> there
  there -> second
  output u1 = first.u, u2 = second.u
}
"""
DRAGGED = """model Dragged {
  "A mass that quadratic drag slows down, and beside it a capacitor that a cubic leak empties quickly."
  parameter m = 1 kg, c: kg/m = 1, C = 1 F, g: A/V^3 = 1
  I mass : p = m*v         { start v = 1 [m/s] }
  R drag : F = c*v*abs(v)
  1(mass) -> drag
  C store : u = q/C        { start u = 1 V }
  R leak  : i = g*u^3
  0(store) -> leak
  output v = mass.v, u = store.u
}
"""


def stiff() -> Iterator[Case]:
    """Stiffness ratios."""
    for ratio in STIFFNESS:
        yield Case(
            "Kaps", "stiffness", ratio, KAPS, {"mu": ratio}, 2.0, lambda t: {"a": np.exp(-2 * t), "b": np.exp(-t)}
        )
        yield Case("cubic follower", "stiffness", ratio, FOLLOWER, {"L": ratio}, 6.0, lambda t: {"a": np.cos(t)})
        yield _diode(ratio)
        yield _pair(ratio)
        yield _dragged(ratio)


def _diode(ratio: float, volt: float = 0.025, ampere: float = 1e-9, farad: float = 1e-9) -> Case:
    """w = exp(-u/U): w' = (1 - w) I_s/(C U)."""
    u0 = volt * np.log(ratio) if ratio > 1 else volt

    def expected(times: Any) -> Mapping[str, Any]:
        tau = mpmath.mpf(farad) * volt / ampere
        w0 = mpmath.exp(-mpmath.mpf(u0) / volt)
        return {"u": exactly(lambda t: -volt * mpmath.log1p(-(1 - w0) * mpmath.exp(-t / tau)), times)}

    settings = {"C": farad, "I_s": ampere, "U": volt, "u0": u0}
    return Case("diode discharge", "stiffness", ratio, DIODE, settings, 3 * farad * volt / ampere, expected)


def _pair(ratio: float) -> Case:
    """The second capacitor follows the first through a small resistance."""

    def expected(times: Any) -> Mapping[str, Any]:
        r = 1 / mpmath.mpf(ratio)
        with mpmath.workdps(60):
            a = mpmath.matrix([[-1 - 1 / r, 1 / r], [1 / r, -1 / r]])
            values, vectors = mpmath.eigsy(a)
            start = vectors.T * mpmath.matrix([1, 2])
            found = [
                vectors * mpmath.matrix([start[i] * mpmath.exp(values[i] * float(t)) for i in range(2)]) for t in times
            ]
        return {"u1": np.array([float(x[0]) for x in found]), "u2": np.array([float(x[1]) for x in found])}

    return Case("two capacitors", "stiffness", ratio, PAIR, {"R2": 1 / ratio}, 3.0, expected)


def _dragged(ratio: float) -> Case:
    """v = 1/(1 + t), u = 1/sqrt(1 + 2 ratio t)."""

    def expected(t: Any) -> Mapping[str, Any]:
        return {"v": 1 / (1 + t), "u": 1 / np.sqrt(1 + 2 * ratio * t)}

    return Case("drag and cubic leak", "stiffness", ratio, DRAGGED, {"g": ratio}, 3.0, expected)


# ---------------------------------------------------------------- masses
COLLIDING = """model Two {
  "Two masses on a hardening spring."
  parameter m1 = 1 kg, m2 = 1 kg, k: N/m = 1, k3: N/m^3 = 1, a = 1 m
  I one : p = m1*v
  I two : p = m2*v
  C spring : F = k*x + k3*x^3  { start x = a }
  1 first, second : translation
  one_side -> spring
  0 one_side
  first -> one_side -> second
  first -> one
  second -> two
  output x = spring.x, v1 = one.v, v2 = two.v
}
"""
LEVER = """model Lever {
  "A mass behind a lever: one of the two follows; drag on the first."
  parameter m1 = 1 kg, m2 = 1 kg, n = 1, c: kg/m = 1
  I one  : p = m1*v            { start v = 1 [m/s] }
  I two  : p = m2*v
  R drag : F = c*v*abs(v)
  TF lever : v2 = n*v1
  1 first, second : translation
  first -> one, drag
  first -> lever -> second -> two
  output v1 = one.v, v2 = two.v
}
"""
PENDULUM = """model Hanging {
  "Two pendulums, one below the other."
  parameter m1 = 1 kg, m2 = 1 kg
  multibody arm : planar {
    gravity = (0, -1 [m/s^2])
    body  upper { mass = m1, at = (0, -1 m) }
    body  lower { mass = m2, at = (0, -2 m) }
    hinge top   : ground to upper { at = (0, 0), start phi = 0.5 }
    hinge elbow : upper to lower  { at = (0, -1 m), start phi = -0.3 }
  }
  output a = arm.top.phi, b = arm.elbow.phi
}
"""


def heavy() -> Iterator[Case]:
    """Mass ratios."""
    for ratio in MASSES:
        yield _two_masses(ratio)
        yield _lever(ratio)
        yield _hanging(ratio)


def duffing(t: Any, m: Any, k: Any, k3: Any, a: Any) -> tuple[Any, Any]:
    """x and v of m x'' + k x + k3 x^3 = 0 from rest at a."""
    w, parameter = mpmath.sqrt((k + k3 * a**2) / m), k3 * a**2 / (2 * (k + k3 * a**2))
    sn, cn, dn = (mpmath.ellipfun(name, w * t, m=parameter) for name in ("sn", "cn", "dn"))
    return a * cn, -a * w * sn * dn


def _two_masses(ratio: float) -> Case:
    """The spring acts on the reduced mass; the centre of mass is at rest."""

    def expected(times: Any) -> Mapping[str, Any]:
        m1, m2 = mpmath.mpf(1), mpmath.mpf(ratio)
        reduced = m1 * m2 / (m1 + m2)
        both = [duffing(mpmath.mpf(float(t)), reduced, 1, 1, 1) for t in times]
        x, v = (np.array([float(b[i]) for b in both]) for i in (0, 1))
        return {"x": x, "v1": v * float(reduced / m1), "v2": -v * float(reduced / m2)}

    stop = 12.0 * (ratio / (1 + ratio)) ** 0.5
    return Case("two masses on a hardening spring", "mass ratio", ratio, COLLIDING, {"m2": ratio}, stop, expected)


def _lever(ratio: float) -> Case:
    """(m1 + n^2 m2) v' = -c v^2."""

    def expected(t: Any) -> Mapping[str, Any]:
        v = 1 / (1 + t / (1 + ratio))
        return {"v1": v, "v2": v}

    return Case("lever with drag", "mass ratio", ratio, LEVER, {"m2": ratio}, 2 * (1 + ratio), expected)


def _hanging(ratio: float) -> Case:
    """The equations of motion of two points, integrated by Taylor series in 30 digits."""

    def expected(times: Any) -> Mapping[str, Any]:
        with mpmath.workdps(25):
            mu = mpmath.mpf(ratio)

            def rates(t: Any, y: Any) -> Any:
                a, b, u, v = y
                s, c = mpmath.sin(a - b), mpmath.cos(a - b)
                # (1 + mu) u' + mu c v' = -mu s v^2 - (1 + mu) sin a;  c u' + v' = s u^2 - sin b
                f, g = -mu * s * v * v - (1 + mu) * mpmath.sin(a), s * u * u - mpmath.sin(b)
                determinant = 1 + mu - mu * c * c
                return [u, v, (f - mu * c * g) / determinant, ((1 + mu) * g - c * f) / determinant]

            solution = mpmath.odefun(rates, 0, [mpmath.mpf("0.5"), mpmath.mpf("0.2"), 0, 0])
            found = [solution(mpmath.mpf(float(t))) for t in times]
        return {"a": np.array([float(y[0]) for y in found]), "b": np.array([float(y[1] - y[0]) for y in found])}

    stop = min(2.0, 12.0 / (1 + ratio) ** 0.5)  # some two swings of the fast mode that a light upper body has
    return Case("double pendulum", "mass ratio", ratio, PENDULUM, {"m2": ratio}, stop, expected)


# ---------------------------------------------------------------- times and units
SPRING = """model Swing {
  "A mass on a hardening spring."
  parameter m = 1 kg, k: N/m = 1, k3: N/m^3 = 1, a = 1 m
  I mass : p = m*v
  C spring : F = k*x + k3*x^3  { start x = a }
  1(mass) -> spring
  output x = spring.x, v = mass.v
}
"""
BRAKED = """model Braked {
  "A mass that quadratic drag slows down."
  parameter m = 1 kg, c: kg/m = 1, v0 = 1 [m/s]
  I mass : p = m*v         { start v = v0 }
  R drag : F = c*v*abs(v)
  1(mass) -> drag
  output v = mass.v, force = drag.F
}
"""
SWINGING = """model Swinging {
  "A pendulum as a mechanism."
  parameter m = 1 kg, l = 1 m, g = 1 [m/s^2]
  multibody arm : planar {
    gravity = (0, -g)
    body  bob { mass = m, at = (0, -l) }
    hinge pin : ground to bob { at = (0, 0), start phi = 2 }
  }
  output phi = arm.pin.phi, x = arm.bob.x
}
"""
HEATED = """model Heated {
  "A body that cools by radiation alone, T' = -s T^4/C."
  parameter C: J/K = 1, s: W/K^4 = 1, T0 = 1 K
  signal T = integral(-s*T^4/C, T0)
  output T_body = T
}
"""
# mass, length, time: what one unit of each is in SI.
UNITS = (
    (1e-20, 1.0, 1.0), (1e12, 1.0, 1.0), (1.0, 1e-12, 1.0), (1.0, 1e9, 1.0), (1e-20, 1e-9, 1e-6), (1e-18, 1e-10, 1e-12),
    (1e12, 1e6, 1e3), (1e12, 1e-3, 1e-3), (1e-15, 1e3, 1e-9), (2e-9, 1e-6, 1e-3),
)  # fmt: skip


def timed() -> Iterator[Case]:
    """Time scales."""
    for unit in TIMES:
        yield from mechanical(1.0, 1.0, unit, "time scale", unit)
        yield _diode_in(1.0, 1.0, unit, "time scale", unit)
        yield _radiating(1.0, unit, "time scale", unit)


def scaled() -> Iterator[Case]:
    """Parameters in SI."""
    for number, (mass, length, time) in enumerate(UNITS):
        yield from mechanical(mass, length, time, f"units {mass:g} kg, {length:g} m, {time:g} s; number", number)
    for charge, volt in ((1.6e-19, 1e-3), (1e-20, 1e-6), (1e6, 1e9), (1e-12, 1e6), (1e3, 1e-9)):
        yield _diode_in(charge, volt, 1.0, f"units {charge:g} C, {volt:g} V; number", 1)
    for temperature in (1e-9, 1e-3, 1e3, 1e9):
        yield _radiating(temperature, 1.0, "temperature in K", temperature)


def mechanical(mass: float, length: float, time: float, swept: str, size: float) -> Iterator[Case]:
    """Three systems with these numbers as units."""
    m, a, t = (mpmath.mpf(x) for x in (mass, length, time))

    def swinging(times: Any) -> Mapping[str, Any]:
        both = [duffing(mpmath.mpf(float(s)) / t, 1, 1, 1, 1) for s in times]
        return {"x": np.array([float(a * b[0]) for b in both]), "v": np.array([float(a / t * b[1]) for b in both])}

    k = float(m / t**2)
    settings = {"m": mass, "k": k, "k3": float(k / a**2), "a": length}
    yield Case("mass on a hardening spring", swept, size, SPRING, settings, 10 * time, swinging)

    def braked(times: Any) -> Mapping[str, Any]:
        v = length / time / (1 + times / time)
        return {"v": v, "force": mass / length * v**2}

    settings = {"m": mass, "c": float(m / a), "v0": float(a / t)}
    yield Case("quadratic drag", swept, size, BRAKED, settings, 4 * time, braked)

    def pendulum(times: Any) -> Mapping[str, Any]:
        """sin(phi/2) = k sn(K - w t), k = sin(phi0/2)."""
        k = mpmath.sin(1)
        quarter = mpmath.ellipk(k**2)
        phi = [2 * mpmath.asin(k * mpmath.ellipfun("sn", quarter - mpmath.mpf(float(s)) / t, k=k)) for s in times]
        return {"phi": np.array([float(p) for p in phi]), "x": np.array([float(a * mpmath.sin(p)) for p in phi])}

    settings = {"m": mass, "l": length, "g": float(a / t**2)}
    yield Case("pendulum", swept, size, SWINGING, settings, 10 * time, pendulum)


def _diode_in(charge: float, volt: float, time: float, swept: str, size: float) -> Case:
    farad, ampere = charge / volt, charge / time
    case = _diode(1e3, volt, ampere, farad)
    return Case(case.system, swept, size, case.text, case.settings, case.stop, case.expected)


def _radiating(temperature: float, time: float, swept: str, size: float) -> Case:
    """T = T0 (1 + 3 t/tau)^(-1/3), tau = C/(s T0^3)."""

    def expected(t: Any) -> Mapping[str, Any]:
        return {"T_body": temperature * (1 + 3 * t / time) ** (-1 / 3)}

    settings = {"s": 1 / time / temperature**3, "T0": temperature}
    return Case("radiation", swept, size, HEATED, settings, 10 * time, expected)


# ---------------------------------------------------------------- the section
def section(short: bool) -> Section:
    """The sweeps, in every way."""
    found = Section("1. Stiffness, masses, times and units")
    found.say(
        "Each row is a model with a closed form, or a solution by Taylor series in 25 digits; the error is the largest of all outputs at all "
        "instants, as a share of the output's largest value, in units of the tolerance (rtol = 1e-6). At most 10 are allowed."
    )
    cases = [*stiff(), *heavy(), *timed(), *scaled()]
    chosen = ways()
    outcomes: dict[str, dict[str, Outcome]] = {}
    for way in chosen[:1] if short else chosen:
        for case in cases:
            if short and case.size not in SHORT:
                continue
            outcomes.setdefault(case.name, {})[way.name] = attempt(case, way)
    tell(found, outcomes, [w.name for w in chosen])
    _check_refusals(found, cases, outcomes)
    return found


def _check_refusals(found: Section, cases: list[Case], outcomes: Mapping[str, Mapping[str, Outcome]]) -> None:
    """Nothing may be refused where others manage, and little at all."""
    refused = {name for name, by_way in outcomes.items() if any(o.refused for o in by_way.values())}
    for case in cases:
        least = NONE_REFUSED_BELOW.get(case.swept)
        if case.name in refused and least is not None and max(case.size, 1 / case.size) <= least:
            found.fail(case.name, f"refused below a {case.swept} of {least:g}")
    if len(refused) > MOST_REFUSED * len(outcomes):
        found.fail("the whole table", f"{len(refused)} of {len(outcomes)} rows were refused")
