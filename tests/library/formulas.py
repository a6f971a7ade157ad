"""Closed forms of the examples of the parts: from the instants of a run to what each output must be, in SI; a number is the value at the end."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from tests.library.bench import linear

Formula = Callable[[Any], Mapping[str, Any]]

EPS0, BOLTZMANN, CHARGE = 8.8541878128e-12, 1.380649e-23, 1.602176634e-19
SIGMA, G = 5.670374419e-8, 9.80665


def rise(t: Any, tau: float) -> Any:
    """Share of a first-order step that has passed."""
    return 1 - np.exp(-t / tau)


def ringing(t: Any, stiffness: float, decay: float) -> Any:
    """Free motion from 1 at rest of x'' + 2 decay x' + stiffness x = 0."""
    omega = math.sqrt(stiffness - decay**2)
    return np.exp(-decay * t) * (np.cos(omega * t) + decay / omega * np.sin(omega * t))


def fixed_point(step: Callable[[float], float], x: float) -> float:
    """Solution of x = step(x), found by repetition."""
    for _ in range(200):
        x = step(x)
    return x


def bisection(f: Callable[[float], float], low: float, high: float) -> float:
    """Zero of a function that changes its sign between two places."""
    for _ in range(200):
        middle = (low + high) / 2
        low, high = (middle, high) if (f(middle) > 0) == (f(low) > 0) else (low, middle)
    return (low + high) / 2


# ---------------------------------------------------------------------- electric


def diode(t: Any) -> Mapping[str, Any]:
    u_t = BOLTZMANN * 300.15 / CHARGE
    junction = bisection(lambda u: (5 - u) / 1001 - 1e-14 * math.expm1(u / u_t), 0, 1)
    i = (5 - junction) / 1001
    return {"u": junction + i, "i": i}


def mos(t: Any) -> Mapping[str, Any]:
    def step(i: float) -> float:
        return 1e-3 * (3 - 0.1 * i - 1) ** 2 * (1 + 0.01 * (5 - 0.2 * i))

    return {"i": fixed_point(step, 4e-3)}


def op_amp(t: Any) -> Mapping[str, Any]:
    """Node at the inverting input, with input and output resistance; gain 2e5."""
    matrix = [
        [1 / 9e3 + 1 / 1e3 + 1 / 2e6, -1 / 9e3],  # the inverting input: currents to out, ground and plus
        [2e5 / 75 - 1 / 9e3, 1 / 75 + 1 / 1e4 + 1 / 9e3],  # out: behind R_out of gain (plus - minus)
    ]
    return {"u": float(np.linalg.solve(matrix, [1 / 2e6, 2e5 / 75])[1])}


def coupled_coils(t: Any) -> Mapping[str, Any]:
    inductance = np.linalg.inv([[4e-3, -1e-3], [-1e-3, 1e-3]])  # M = 0.5 sqrt(4 mH 1 mH)
    i = linear(-inductance, inductance @ [1, 0], [0, 0], t)
    return {"i_a": i[:, 0], "i_b": i[:, 1]}


def zener(t: Any) -> Mapping[str, Any]:
    u_t = BOLTZMANN * 300.15 / CHARGE

    def current(u: float) -> float:
        return 1e-14 * math.expm1(u / u_t) - 5e-3 * math.exp(-(u + 5.1) / (3 * u_t))

    def excess(u: float) -> float:
        node = -u - 1 * current(u)
        return (12 - node) / 470 - node / 1000 + current(u)

    u = bisection(excess, -7, 0)
    return {"u": -u - current(u), "i": current(u)}


def battery(t: Any) -> Mapping[str, Any]:
    slope, r = 0.8 / 7200, 3.7 + 0.05
    rates = [[-slope / r, -1 / r], [-slope / r / 1000, -1 / r / 1000 - 1 / 30]]
    taken, slow = linear(rates, [4.1 / r, 4.1 / r / 1000], [0, 0], t).T
    return {"u": 3.7 * (4.1 - slope * taken - slow) / r, "soc": 1 - taken / 7200}


def solar_cell(t: Any) -> Mapping[str, Any]:
    u_t = 1.2 * BOLTZMANN * 298.15 / CHARGE
    u = bisection(lambda u: 6.4 - 1e-9 * math.expm1(u / u_t) - u / 10 - u / 0.055, 0, 1)
    return {"u": u * 50 / 55, "i": u / 0.055}


def transmission_line(t: Any) -> Mapping[str, Any]:
    """Echoes: 1/3 at the load, -1/3 at the source."""
    trips = np.floor((t - 11e-9) / 20e-9)
    return {"u": np.where(trips < 0, 0, 8 / 9 * (1 - (-1 / 9) ** (trips + 1)) / (1 + 1 / 9))}


def cable(t: Any) -> Mapping[str, Any]:
    """Four sections at rest, from the load back to the source."""
    u, i = 1.0, 1 / 50
    for _ in range(4):
        i += u * 250e-9
        u += 12.5 * i
    return {"u": 10 / u}


def relay(t: Any) -> Mapping[str, Any]:
    tau, top = 0.5 / 240, 50 * (1 - math.exp(-19e-3 / (0.5 / 240)))
    on, off = 1e-3 - tau * math.log(1 - 35 / 50), 20e-3 + tau * math.log(top / 10)
    return {"i": np.where((t >= on) & (t < off), 0.5, 0.0)}


ELECTRIC: dict[str, Formula] = {
    "Transformer": lambda t: {"i": 23 * np.sin(100 * np.pi * t) / 4},
    "CoupledCoils": coupled_coils,
    "Zener": zener,
    "Varistor": lambda t: {"u": 400 * 1e4 ** (1 / 25)},
    "Thermistor": lambda t: {"u": 1e-4 * 1e4 * math.exp(3435 * (1 / 333.15 - 1 / 298.15)) + 0 * t},
    "Battery": battery,
    "SolarCell": solar_cell,
    "TransmissionLine": transmission_line,
    "CableSections": cable,
    "Relay": relay,
    "Resistor": lambda t: {"i": 5 / 2e3 + 0 * t},
    "Capacitor": lambda t: {"u": 5 * rise(t, 2e-3)},
    "Inductor": lambda t: {"i": 0.5 * rise(t, 2e-3)},
    "Diode": diode,
    "IdealDiode": lambda t: {"i": np.maximum(0.1 * np.sin(100 * np.pi * t), 0)},
    "IdealThyristor": lambda t: {"i": np.where((t > 0.0245) & (t < 0.03), 0.1 * np.sin(100 * np.pi * t), 0)},
    "Switch": lambda t: {"i": np.where((t >= 1e-3) & (t < 3e-3), 2.0, 0.0)},
    "Bjt": lambda t: {"i": 1e-3},
    "Mos": mos,
    "OpAmp": op_amp,
    "DcMotor": lambda t: {"speed": 12 * 0.05 / (1e-5 + 0.05**2), "i": 12 * 1e-5 / (1e-5 + 0.05**2)},
}

# ---------------------------------------------------------------------- power


def power_mosfet(t: Any) -> Mapping[str, Any]:
    r = 20e-3 * (1 + 0.006 * 35)
    i = np.where((t >= 1e-3) & (t < 3e-3), 24 / (2 + r), 24 / (2 + 1e6))
    return {"i": i, "heat": (24 - 2 * i) * i}


def igbt(t: Any) -> Mapping[str, Any]:
    u = 160 / (100.1 + 1e-6)
    return {"i": (600 - u) / 10 + 0 * t, "heat": u * (600 - u) / 10 + 0 * t}


def thyristor(t: Any) -> Mapping[str, Any]:
    """It fires at 5 ms and blocks where its current falls to 50 mA."""
    g, u = 100 + 1e-6, 100 * np.sin(100 * np.pi * t)
    last = 0.01 - math.asin((0.05 * (1 + 10 * g) + 100) / g / 100) / (100 * math.pi)
    return {"i": np.where((t >= 5e-3) & (t < last), (g * u - 100) / (1 + 10 * g), u * 1e-6 / (1 + 10e-6))}


def pulse_width(t: Any) -> Mapping[str, Any]:
    periods = np.floor(t / 1e-3 + 1e-9)
    return {"mean": (0.3 * periods + np.minimum(t / 1e-3 - periods, 0.3)) / 10}


POWER: dict[str, Formula] = {
    "PowerMosfet": power_mosfet,
    "Igbt": igbt,
    "Thyristor": thyristor,
    "BuckConverter": lambda t: {"i": 2.4 * rise(t, 1e-3 / 5), "i_a": 1.2 * rise(t, 1e-3 / 5)},
    "BoostConverter": lambda t: {"i": 2.4 * rise(t, 1e-3 / 5), "u": 19.6 * 1.2 * rise(t, 1e-3 / 5)},
    "BuckBoostConverter": lambda t: {"i": 1.2 * rise(t, 1e-3 / 5), "u": -19.6 * 0.6 * rise(t, 1e-3 / 5)},
    "HBridge": lambda t: {"i": 6 * np.sin(100 * np.pi * t), "i_a": 6 * np.sin(100 * np.pi * t) ** 2},
    "DiodeBridge": lambda t: {"i": np.maximum(np.abs(10 * np.sin(100 * np.pi * t)) - 1.4, 0) / 10},
    "PulseWidthModulator": pulse_width,
}

# ---------------------------------------------------------------------- magnetic

MU0 = 1.25663706127e-6


def winding(t: Any) -> Mapping[str, Any]:
    s = 0.2 / (MU0 * 1000 * 4e-4)
    i = 2 * rise(t, 200**2 / s / 5)
    return {"i": i, "flux": 200 * i / s}


def saturating(t: Any) -> Mapping[str, Any]:
    h = 5000 * np.sin(100 * np.pi * t)
    return {"flux": 1e-4 * (1.6 * h / np.hypot(h, 1.6 / (MU0 * 5000)) + MU0 * h)}


MAGNETIC: dict[str, Formula] = {
    "Winding": winding,
    "MagneticPath": lambda t: {"flux": 100 * np.sin(100 * np.pi * t) / (0.1 / (MU0 * 2000 * 1e-4))},
    "AirGap": lambda t: {"F": (1e-3 * t) ** 2 / (4e-4 * MU0), "mmf": t * 1e-3 * (1e-3 + 1e-3 * t) / (2e-4 * MU0)},
    "SaturatingCore": saturating,
    "PermanentMagnet": lambda t: {
        "B": 1.2 * (5 / 1.05) / (5 / 1.05 + 1) * rise(t, 1e3 / ((5e-3 / 1.05 + 1e-3) / (MU0 * 1e-4)))
    },
    "EddyCurrents": lambda t: {"flux": 100 * MU0 * rise(t, 1000 * MU0)},
}

# ---------------------------------------------------------------------- machines


def pmsm(t: Any) -> Mapping[str, Any]:
    inverse = np.diag([1 / 1e-3, 1 / 1.5e-3])
    rates = inverse @ [[-0.5, 400 * 1.5e-3], [-400 * 1e-3, -0.5]]
    i = linear(rates, inverse @ [-3, 12 - 400 * 0.02], [0, 0], t)
    return {"i_d": i[:, 0], "i_q": i[:, 1], "M": 4 * (-0.5e-3 * i[:, 0] + 0.02) * i[:, 1]}


def induction(t: Any) -> Mapping[str, Any]:
    """Torque of the phasors at rest in rotating axes."""
    w, slip = 100 * np.pi, 100 * np.pi - 300
    matrix = [[1.2 + 1j * w * 0.16, 1j * w * 0.15], [1j * slip * 0.15, 1 + 1j * slip * 0.16]]
    stator, rotor = np.linalg.solve(matrix, [200, 0])
    return {"M": 2 * 0.15 * (stator * np.conj(rotor)).imag}


MACHINES: dict[str, Formula] = {
    "VoiceCoil": lambda t: {"i": 6 / 8.5 * rise(t, 1e-6 / 8.5), "v": 3 / 8.5 * rise(t, 1e-6 / 8.5)},
    "SeriesMotor": lambda t: {"i": 8 * rise(t, 5e-3 / 3), "M": 0.02 * 64 * rise(t, 5e-3 / 3) ** 2 - 0.01},
    "Pmsm": pmsm,
    "InductionMotor": induction,
    "StepperMotor": lambda t: {"phi": -math.asin(0.1 / 0.6) / 50},
    "ServoDrive": lambda t: {"M": 2 * rise(t, 2e-3), "omega": 200 * (t - 2e-3 * rise(t, 2e-3))},
}

# ---------------------------------------------------------------------- mechanics


def stribeck(v: Any, dry: float, away: float, v_s: float, v_0: float, r: float) -> Any:
    return (dry + (away - dry) * np.exp(-((v / v_s) ** 2))) * np.tanh(v / v_0) + r * v


MECHANICS: dict[str, Formula] = {
    "Gear": lambda t: {"speed": 10 / 2 * t},
    "Lever": lambda t: {"v": -0.5 * 10 / 5 + 0 * t},
    "Screw": lambda t: {"v": 0.1 / (5e-3 / (2 * np.pi)) / 20 * t},
    "Wheel": lambda t: {"v": 30 / 0.3 / 50 * t},
    "Belt": lambda t: {"stretch": 50 / 1e5 * rise(t, 10 / 1e5), "speed": 50 * 0.06 / 0.1 + 0 * t},
    "SpringDamper": lambda t: {"x": 0.01 * rise(t, 1e-3)},
    "TorsionSpring": lambda t: {"phi": 0.01 * rise(t, 1e-4)},
    "Friction": lambda t: {"F": stribeck(0.01 * np.sin(t), 10, 12, 0.01, 1e-4, 5)},
    "RotaryFriction": lambda t: {"M": stribeck(0.5 * np.sin(t), 0.1, 0.12, 0.5, 0.005, 0.01)},
    "EndStop": lambda t: {"F": 1e6 * (1e-3 - 0.5e-6) * (1 + 0.5 * 1e-3)},
    "DryFriction": lambda t: {"v": 10 * (1 - 0.75**2) - 10 * 0.25 + 10 * 1},
    "Stops": lambda t: {"F": 1e6 * 2e-3 + 100 * 10e-3},
    "RotaryStops": lambda t: {"M": -1000 * (2 - np.pi / 2) - 1},
    "StoppedMass": lambda t: {"x": -1e-3 + 0.64 * 1.5e-3, "v": 0.64},
    "Backlash": lambda t: {"F": 1e6 * 0.5e-3 + 10 * 10e-3},
    "Clutch": lambda t: {"omega": np.where(t < 0.01, 0.0, 25.0)},
}

# ---------------------------------------------------------------------- drivetrain


def magic(x: float, c: float, e: float) -> float:
    return math.sin(c * math.atan(x - e * (x - math.atan(x))))


def cam(t: Any) -> Mapping[str, Any]:
    def lifted(x: Any) -> Any:
        x = np.clip(x, 0, 1)
        return x - np.sin(2 * np.pi * x) / (2 * np.pi)

    return {"x": 0.01 * (lifted(t * 4) - lifted((t - 150 / 360) * 4))}


def crank_slider(t: Any) -> Mapping[str, Any]:
    root_ = np.sqrt(0.15**2 - (0.04 * np.sin(10 * t)) ** 2)
    v = -0.4 * np.sin(10 * t) * (1 + 0.04 * np.cos(10 * t) / root_)
    return {"v": v, "x": 0.04 * np.cos(10 * t) + root_ - 0.19}


def universal_joint(t: Any) -> Mapping[str, Any]:
    c = math.cos(math.pi / 6)
    return {"omega": 10 * c / (1 - np.cos(10 * t) ** 2 / 4), "turned": np.arctan2(np.sin(10 * t), c * np.cos(10 * t))}


def lugre(t: Any) -> Mapping[str, Any]:
    g = 1 + 0.5 * math.exp(-25)
    return {"F": g * rise(t, g / 500) + 300 * 5e-3 * np.exp(-t * 500 / g) + 0.4 * 5e-3}


WORM = math.tan(math.radians(10) + math.atan(0.06 / math.cos(math.radians(20)))) / math.tan(math.radians(10))

DRIVETRAIN: dict[str, Formula] = {
    "PlanetaryGear": lambda t: {"omega": 2 * t, "M_ring": 3 + 0 * t},
    "Differential": lambda t: {"w_left": 10 + 0 * t, "w_right": 2.5 + 0 * t, "shaft": 25 + 0 * t},
    "WormGear": lambda t: {"M": 20 / 30 * WORM + 0 * t},
    "VariableGear": lambda t: {"omega": 100 / (2 + np.sin(t)), "M": 100 / (2 + np.sin(t)) ** 2},
    "Freewheel": lambda t: {"w_a": 2.5 * t - 12.5 * np.maximum(t - 1, 0), "w_b": 2.5 * np.minimum(t, 1)},
    "FrictionClutch": lambda t: {"M": 100 + 0 * t, "heat": 2000 + 0 * t},
    "DiscBrake": lambda t: {"M": 192 + 0 * t, "heat": 9600 + 0 * t},
    "TorqueConverter": lambda t: {"M_p": 137.3 + 44.42 - 46.041 + 0 * t, "M_t": 230.624 + 6.214 - 54.323 + 0 * t},
    "UniversalJoint": universal_joint,
    "CrankSlider": crank_slider,
    "Cam": cam,
    "Tyre": lambda t: {"F": 4000 * magic(0.5, 1.65, 0.97) + 0 * t, "slip": 0.05 + 0 * t},
    "TyreSide": lambda t: {"F": 4000 * magic(9 * math.atan(0.05), 1.3, -1) + 0 * t},
    "Lugre": lugre,
    "HertzContact": lambda t: {
        "F": 4 / 3 * 115e9 * math.sqrt(5e-3) * np.maximum(1e-3 * t - 1e-6, 0) ** 1.5
    },
    "Rope": lambda t: {"v": 9.81 / 3 * t, "T": 13.08 + 0 * t},
    "Cantilever": lambda t: {"x": cantilever(t)},
    "BeamChain": lambda t: beam_chain(4),
    "Bushing": lambda t: {"x": 1e-3 * np.cos(np.sqrt(1e5) * t), "turn": np.pi / 180 * np.cos(100 * t)},
    "PlanarBushing": lambda t: {
        "x": 1e-3 * ringing(t, 1e5, 50), "y": 2e-3 * ringing(t, 5e4, 25), "turn": np.pi / 180 * ringing(t, 1e4, 5)
    },
    "GroundPoint": lambda t: {"v": 3 - 0.2 * 9.81 * t, "N": 9.81 + 0 * t},
    "GroundBall": lambda t: {"v": 2 - 0.981 * t, "omega": 0.1 / 0.004 * 0.981 * t},
    "AirDrag": lambda t: {"F": 0.6 * 0.3 * 2.2 * 900 * np.sin(t) * np.abs(np.sin(t))},
}  # fmt: skip

# ---------------------------------------------------------------------- hydraulic

ORIFICE = 0.62 * 10e-6 * math.sqrt(2 / 850)


def root(p: Any, soft: float = 100.0) -> Any:
    """r of p = r sqrt(r^2 + 2 soft)."""
    return np.sign(p) * np.sqrt(np.sqrt(soft**2 + np.asarray(p) ** 2) - soft)


def cylinder(t: Any) -> Mapping[str, Any]:
    leak = 5e6 / (2e7 + 1e13)
    a, b = 5e6 - 1e7 * leak, 1e7 * leak
    return {"P": a, "F": 1e-3 * a * (1 + a / 2.8e9) - 6e-4 * b * (1 + b / 2.8e9)}


def reducing_valve(t: Any) -> Mapping[str, Any]:
    def excess(p: float) -> float:
        return (50e5 - p) / 5e5 * ORIFICE * float(root(200e5 - p)) - p / 2e10

    return {"P": bisection(excess, 45e5, 50e5)}


def directional_valve(t: Any) -> Mapping[str, Any]:
    """By symmetry the drops of both open edges are equal."""

    def excess(d: float) -> float:
        return 0.5 * ORIFICE * float(root(d)) + 1e-16 * d - (1e7 - 2 * d) / 1e10 - 1e-16 * (1e7 - d)

    return {"Q": (1e7 - 2 * bisection(excess, 0, 5e6)) / 1e10 + 0 * t}


def wave_line(t: Any) -> Mapping[str, Any]:
    """Joukowsky's wave, turned at the reservoir every second way."""
    c = math.sqrt(1.4e9 / 850)
    z, open_, shut = 850 * c / (math.pi * 25e-6), 3e10, 3e10 * (1 + 1e6)
    wave, values = 3e6 * (1 + z / open_), np.full_like(t, 3e6)
    for n in range(4):
        values = np.where(t >= 5e-3 + 20 / c * n, wave * shut / (shut + z), values)
        wave = 6e6 - wave * (shut - z) / (shut + z)
    return {"P": values}


def turbulent_pipe(t: Any) -> Mapping[str, Any]:
    area = math.pi * 1e-4
    k = 0.3164 * 10 / 0.02 * 500 / area**2 * (1000 * 0.02 / (1e-3 * area)) ** -0.25
    return {"Q": (1e5 / k) ** (1 / 1.75)}


def plunger(t: Any) -> Mapping[str, Any]:
    return {"P": 1.4e7 * t, "F": 1.4e4 * t * (1 + 1.4e7 * t / 2.8e9)}


def variable_pump(t: Any) -> Mapping[str, Any]:
    half = 0.5 * 28e-6 / (2 * math.pi)
    return {"Q": half * 100 / 1.01 + 0 * t, "M": half * 1e10 * half * 100 / 1.01 + 0 * t}


HYDRAULIC: dict[str, Formula] = {
    "Pump": lambda t: {"Q": 10e-6 / (2 * np.pi) * 100 / (1 + 1e-12 * 1e10) + 0 * t},
    "Valve": lambda t: {"Q": t * ORIFICE * root(1e6)},
    "CheckValve": lambda t: {"Q": ORIFICE * np.maximum(root(1e6 * np.sin(2 * np.pi * t)), 0)},
    "Cylinder": cylinder,
    "Accumulator": lambda t: {"P": 1e7 * (1 / (1 - 0.1 * t)) ** 1.4 - 101325},
    "Pipe": lambda t: {
        "Q": np.pi * 1e-8 * 1e4 / (128 * 0.03)
        * rise(t, 850 / (np.pi * 1e-4 / 4) / (128 * 0.03 / (np.pi * 1e-8)))
    },
    "Volume": lambda t: {"P": 1.4e9 / 1e-3 * 1e-5 * t},
    "Tank": lambda t: {"level": 0.1 + 2e-3 / 0.5 * t, "P": 850 * G * (0.1 + 2e-3 / 0.5 * t)},
    "Reservoir": lambda t: {"Q": 3e5 / 1e9 + 0 * t},
    "ReliefValve": lambda t: {"P": np.where(
        t * 5e-4 * (1e12 / 1.01) < 1e7, t * 5e-4 / (1e-12 + 1e-14), (t * 5e-4 + 1e-2) / (1e-9 + 1e-12 + 1e-14)
    )},
    "ReducingValve": reducing_valve,
    "DirectionalValve": directional_valve,
    "ServoValve": lambda t: {"Q": 0.5 * second_order(t, 300, 0.8) * ORIFICE * root(1e7) + 1e-9},
    "VariablePump": variable_pump,
    "WaveLine": wave_line,
    "TurbulentPipe": turbulent_pipe,
    "Plunger": plunger,
}  # fmt: skip

# ---------------------------------------------------------------------- pneumatic


def gas_orifice(t: Any) -> Mapping[str, Any]:
    r = (1 + 5.5 * t) / 7
    return {"m_dot": 2e-8 * 1.185 * 7e5 * np.sqrt(1 - (np.maximum(r - 0.3, 0) / 0.7) ** 2)}


def gas_cylinder(t: Any) -> Mapping[str, Any]:
    p = 4e5 * 50 / (50 + 100 * t)
    return {"P": p, "F": 1e-3 * (p - 101325)}


PNEUMATIC: dict[str, Formula] = {
    "GasSource": lambda t: {"m_dot": 7e-4 + 0 * t},
    "GasVolume": lambda t: {"P": 101325 + 287.06 * 293.15 * t},
    "GasOrifice": gas_orifice,
    "GasCylinder": gas_cylinder,
    "GasLine": lambda t: {"m_dot": 1e4 * math.pi * 1e-12 * 1.2 / (128 * 1.82e-5) + 0 * t},
}

# ---------------------------------------------------------------------- thermal


def forced_convection(t: Any) -> Mapping[str, Any]:
    re, pr = 998 * 2 * 0.02 / 1e-3, 1e-3 * 4180 / 0.6
    return {"heat": 0.023 * re**0.8 * pr**0.4 * 0.6 * math.pi * 40 + 0 * t}


def fin(t: Any) -> Mapping[str, Any]:
    m = math.sqrt(25 * 0.102 / (200 * 50e-6))
    return {"heat": math.sqrt(25 * 0.102 * 200 * 50e-6) * math.tanh(m * 0.04) * 50 + 0 * t}


def heat_rod(t: Any) -> Mapping[str, Any]:
    g, c = 200 * 1e-4 * 40, 900 * 2700 * 1e-4 * 0.025
    rates = g / c * np.array([[-3, 1, 0, 0], [1, -2, 1, 0], [0, 1, -2, 1], [0, 0, 1, -3]])
    found = linear(rates, 2 * g / c * np.array([353.15, 0, 0, 293.15]), [293.15] * 4, t)
    return {"middle": (found[:, 1] + found[:, 2]) / 2}


def heat_exchanger(t: Any) -> Mapping[str, Any]:
    """Counterflow by the logarithmic mean difference: UA and the two balances."""

    def excess(q: float) -> float:
        first, last = 75 - q / 400, 75 - q / 200  # where stream a enters, and where it leaves
        return 300 * (first - last) / math.log(first / last) - q

    q = bisection(excess, 1e3, 14.9e3)
    return {"heat": q + 0 * t, "T_out": 363.15 - q / 200 + 0 * t}


THERMAL: dict[str, Formula] = {
    "HeatSource": lambda t: {"T": 293.15 + 0.4 * t},
    "NaturalConvection": lambda t: {"heat": 0.142 * 0.2**-0.25 * (1600 + 1e-6) ** 0.125 * 40 + 0 * t},
    "ForcedConvection": forced_convection,
    "Fin": fin,
    "HeatRod": heat_rod,
    "Peltier": lambda t: {
        "u": 6 + 0 * t,
        "Q_cold": 0.1 * 273.15 - 4 - 20 + 0 * t,
        "Q_hot": 0.1 * 313.15 + 4 - 20 + 0 * t,
    },
    "HeatExchanger": heat_exchanger,
    "HeatCapacity": lambda t: {"T": 353.15 - 60 * np.exp(-2 / 100 * t)},
    "Conductor": lambda t: {"heat": 120 + 0 * t},
    "Radiator": lambda t: {"heat": 0.8 * SIGMA * (773.15**4 - 293.15**4) + 0 * t},
    "HeatedResistor": lambda t: {"heat": 144 / (100 * (1 + 0.0039 * 50)) + 0 * t},
    "Ambient": lambda t: {"heat": 500 * np.sin(2 * np.pi * t / 86400)},
}

# ---------------------------------------------------------------------- mems

BEAM = 160e9 * 38e-6 * (2e-6) ** 3 / 12  # E I of the leaf springs
GUIDE = 8 * 6 * BEAM / (400e-6) ** 3
COMB = 100 * EPS0 * 38e-6 / 4e-6  # N/V^2


def squeezed(ratio: float) -> float:
    odd = range(1, 20001, 2)
    return 1 - 192 / math.pi**5 * ratio * sum(math.tanh(n * math.pi / 2 / ratio) / n**5 for n in odd)


def shuttle(t: Any) -> Mapping[str, Any]:
    return {"x": COMB * 800 / GUIDE * rise(t, (1e-4 + 1.82e-5 * 0.1e-6 / 2e-6) / GUIDE)}


def reinforced(t: Any) -> Mapping[str, Any]:
    k = 12 * BEAM / 1e-9 / (1 - 0.72**3)
    return {"x": 1e-5 / k * rise(t, 1e-3 / k)}


def chevron(t: Any) -> Mapping[str, Any]:
    sin, ea, ei = math.sin(math.radians(3)), 160e9 * 38e-6 * 4e-6, 160e9 * 38e-6 * (4e-6) ** 3 / 12
    k = 8 * (ea / 400e-6 * sin**2 + 12 * ei / (400e-6) ** 3 * (1 - sin**2))
    return {"x": 8 * ea * sin * 2.6e-6 * 200 / k * rise(t, 1e-3 / k)}


def crab_leg(t: Any) -> Mapping[str, Any]:
    """Slope-deflection of one leg, its knee only turns; four legs. Thigh of 300 um, shin of 100 um."""
    thigh, shin = BEAM, BEAM * 1.5**3

    def stiffness(bent: float, length: float, other: float, other_length: float) -> float:
        turn = 6 * bent / length**2 / (4 * bent / length + 4 * other / other_length)
        return 4 * (12 * bent / length**3 - 6 * bent / length**2 * turn)

    k_x, k_y = stiffness(thigh, 300e-6, shin, 100e-6), stiffness(shin, 100e-6, thigh, 300e-6)
    return {"x": 1e-5 / k_x * rise(t, 1e-3 / k_x), "y": 1e-5 / k_y * rise(t, 1e-3 / k_y)}


def stiffening(t: Any) -> Mapping[str, Any]:
    """Rest under both forces; the shortening by the integral over the bent shape."""
    p, l, d, f_x, f_y = 0.4, 1e-3, 2e-6, 1e-6, 50e-6
    s = np.linspace(0, 0.5, 200_001)
    slope = np.minimum(s, 0.3) / 2 - np.minimum(s, 0.3) ** 2 / 2
    c = float(np.trapezoid(slope**2, s) / (2 * np.trapezoid(slope, s)) ** 2)
    q = p / (1 - p)
    b = 700 * (1 + q) * (1 + 3 * q + 3 * q**2) ** 3 / (1 + 10 * q + 45 * q**2 + 105 * q**3 + 105 * q**4)
    k_x, k_y, soft = 12 * BEAM / l**3 / (1 - p**3), 160e9 * 38e-6 * d / l / (1 - p), 12 / ((1 - p) * b * d**2)
    x = f_x / (k_x + 2 * c * f_y / l - f_y**2 / k_y * soft)
    return {"x": x, "y": f_y / k_y * (1 + soft * x**2) - c * x**2 / l}


def side_comb(t: Any) -> Mapping[str, Any]:
    return {
        "F_x": 200 * 100 * EPS0 * 38e-6 * (1 / 3e-6 + 1 / 5e-6),
        "F_y": 200 * 100 * EPS0 * 38e-6 * 20e-6 * (1 / 9e-12 - 1 / 25e-12),
    }


MEMS: dict[str, Formula] = {
    "GapClosingComb": lambda t: {"F": 50 * 50 * EPS0 * 38e-6 * 100e-6 * (1 / 4e-12 - 1 / 36e-12)},
    "SideComb": side_comb,
    "ChevronActuator": chevron,
    "PiezoStack": lambda t: {"x": 50e6 * 200 * 500e-12 * 100 / 70e6},
    "CrabLegFlexure": crab_leg,
    "SerpentineSpring": lambda t: {"x": 1e-6 / (2 * BEAM / 1e-12) * rise(t, 1e-4 / (2 * BEAM / 1e-12))},
    "ClampedBeam": lambda t: {
        "F": 192 * BEAM / (400e-6) ** 3 * t + np.pi**4 / 8 * 160e9 * 38e-6 * 2e-6 / (400e-6) ** 3 * t**3
    },
    "StiffeningFlexure": stiffening,
    "CapacitiveReadout": lambda t: {"u": EPS0 * 2e-8 / 1e-12 * (1 / 1.5e-6 - 1 / 2.5e-6) * rise(t, 1e-5)},
    "CombDrive": lambda t: {"x": COMB * 900 / GUIDE * rise(t, 1e-4 / GUIDE)},
    "CombCapacitor": lambda t: {"F": COMB * 400},
    "ParallelPlate": lambda t: {"F": EPS0 * 1e-8 * 25 / (2 * 4e-12)},
    "Flexure": lambda t: {"x": 5e-6 * rise(t, 1e-3 / 2)},
    "LeafFlexure": lambda t: {"phi": 1e-10 / (BEAM / 1e-3) * rise(t, 1e-12 / (BEAM / 1e-3))},
    "ReinforcedFlexure": reinforced,
    "FoldedFlexure": lambda t: {"x": 1e-5 / GUIDE * rise(t, 1e-4 / GUIDE)},
    "SlideFilm": lambda t: {"F": 1.82e-5 * 0.1e-6 / 2e-6 * 0.01 + 0 * t},
    "SqueezeFilm": lambda t: {
        "F": squeezed(0.5) * 1.82e-5 * 100e-6 * (50e-6) ** 3 / (2e-6 - 1e-3 * t) ** 3 * 1e-3
    },
    "Shuttle": shuttle,
}  # fmt: skip

# ---------------------------------------------------------------------- control


def second_order(t: Any, w: float, zeta: float) -> Any:
    """Response of w^2/(s^2 + 2 zeta w s + w^2) to a step, zeta below 1."""
    damped = w * math.sqrt(1 - zeta**2)
    return 1 - np.exp(-zeta * w * t) * (np.cos(damped * t) + zeta * w / damped * np.sin(damped * t))


def ticks(t: Any, period: float) -> Any:
    """Number of the last sample."""
    return np.floor(t / period + 1e-9)


def converted(t: Any, late: float = 0.0) -> Any:
    """Codes of a sine of amplitude 1, 10 rad/s, in 8 bits from -1 to 1, every 10 ms; 0 before the first."""
    k = ticks(t - late, 0.01)
    return np.where(k < 0, 0, np.minimum(np.floor((np.sin(0.1 * k) + 1) * 128 + 0.5), 255))


def discrete_pid(t: Any) -> Mapping[str, Any]:
    """2 + I, I growing by 0.5 a sample; above 4 it follows the limit by a fifth of the excess."""
    found, integral = [], 0.0
    for _ in range(10):
        found.append(min(2 + integral, 4.0))
        integral += 0.5 + 0.2 * (found[-1] - 2 - integral)
    return {"command": np.array(found)[ticks(t, 0.1).astype(int)]}


def encoder(t: Any) -> Mapping[str, Any]:
    k, step = ticks(t, 0.01), 2 * np.pi / 400
    count, before = (np.floor(3 * (0.01 * np.maximum(n, -0.1) + 0.001) / step) for n in (k, k - 1))
    return {"angle": step * count, "speed": step * (count - np.where(k > 0, before, 0)) / 0.01}


CONTROL: dict[str, Formula] = {
    "Adc": lambda t: {"value": converted(t) / 128 - 1, "code": converted(t)},
    "Dac": lambda t: {"value": converted(t, 0.004) / 128 - 1},
    "DiscretePid": discrete_pid,
    "DiscreteRateLimit": lambda t: {"y": np.minimum(0.2 * (ticks(t, 0.1) + 1), 1)},
    "Encoder": encoder,
    "Pid": lambda t: {"command": 2 + 5 * t},
    "FirstOrder": lambda t: {"y": 2 * rise(t, 0.5)},
    "SecondOrder": lambda t: {"y": second_order(t, 5, 0.4)},
    "LeadLag": lambda t: {"y": 1 + 3 * np.exp(-4 * t)},
    "StateSpace": lambda t: {"y": (1 - np.exp(-t)) ** 3},
    "TransferFunction2": lambda t: {"y": (1 - np.exp(-2 * t)) / 2},
    "RateLimit": lambda t: {"y": 1 - 0.1 * np.arcsinh(np.sinh(10) * np.exp(-10 * t))},
    "Lowpass": lambda t: {"y": second_order(t, 4 * np.pi, math.sqrt(0.5))},
}

# ---------------------------------------------------------------------- signals


def trapezoid(t: Any) -> Mapping[str, Any]:
    up, down = np.minimum(t, 0.5), np.clip(t, 2.5, 3) - 2.5
    v = 0.4 * up - 0.4 * down
    return {"v": v, "x": 0.2 * up**2 + 0.2 * (np.clip(t, 0.5, 2.5) - 0.5) + 0.2 * down - 0.2 * down**2}


def three_point(t: Any) -> Mapping[str, Any]:
    on, off = math.asin(0.6) / (2 * math.pi), 0.5 - math.asin(0.3) / (2 * math.pi)
    return {"y": sum(s * ((t - h >= on) & (t - h < off)) for s, h in ((1.0, 0), (-1.0, 0.5), (1.0, 1), (-1.0, 1.5)))}


def observer(t: Any) -> Mapping[str, Any]:
    s, fade = 20 * t, 1e-3 * np.exp(-20 * t)
    return {
        "x": 1e-3 - fade * (1 - 2 * s + s**2 / 2),
        "v": 20 * fade * (3 - 3 * s + s**2 / 2) - 60 * fade * (1 - 2 * s + s**2 / 2),
        "d": -2 * 400 * fade * (s - s**2 / 2),
    }


SIGNALS: dict[str, Formula] = {
    "TrapezoidProfile": trapezoid,
    "SmoothProfile": lambda t: {
        "x": 0.5 * (6 * (t / 2) ** 5 - 15 * (t / 2) ** 4 + 10 * (t / 2) ** 3),
        "v": 0.25 * (30 * (t / 2) ** 4 - 60 * (t / 2) ** 3 + 30 * (t / 2) ** 2),
    },
    "TwoPoint": lambda t: {"y": np.where(((t >= 7 / 12) & (t < 13 / 12)) | (t >= 19 / 12), 1.0, 0.0)},
    "ThreePoint": three_point,
    "Observer": observer,
    "Notch": lambda t: {"y": 10 * t * np.exp(-10 * t)},
    "Delay": lambda t: {"y": np.maximum(t - 0.2, 0)},
}


def cantilever(t: Any) -> Any:
    """Deflection of the tip under 10 N: the static one, less what four modes swing about it."""
    beta, k = np.array([1.8751040687119611, 4.694091132974175, 7.854757438237613, 10.995540734875467]), 20 / 0.5**3
    swings = sum(4 / b**4 * np.cos(b**2 * np.sqrt(k / 0.2) * t) for b in beta)
    return 10 / k * (1 / 3 - swings)


def beam_chain(n: int) -> Mapping[str, Any]:
    """Tip of a beam of 1 m bent to a quarter circle, of n chords in pairs of halves."""
    slope = np.linspace(0, math.pi / 2, n + 1)
    return {
        "x": np.trapezoid(np.cos(slope), dx=1 / n),
        "y": np.trapezoid(np.sin(slope), dx=1 / n),
        "turn": math.pi / 2,
    }


FORMULAS: dict[str, Formula] = {
    **ELECTRIC,
    **POWER,
    **MAGNETIC,
    **MACHINES,
    **MECHANICS,
    **DRIVETRAIN,
    **HYDRAULIC,
    **PNEUMATIC,
    **THERMAL,
    **MEMS,
    **CONTROL,
    **SIGNALS,
}
