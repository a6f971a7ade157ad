"""Electrical parts against nodal analysis, textbook characteristics and linear responses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq, fsolve

from tests.library.bench import exact, linear, near, run

BOLTZMANN, CHARGE = 1.380649e-23, 1.602176634e-19
U_T = BOLTZMANN * 300.15 / CHARGE


def test_capacitor_empties_into_a_resistor() -> None:
    found = run(
        "electric", "Resistor, Capacitor",
        """
        Resistor r { R = 2 [kohm] }
        Capacitor c { C = 3 uF, U_0 = 5 V }
        0 node
        node -> r.pins, c.pins
        output u = c.voltage, i = r.current
        """,
        20e-3,
    )  # fmt: skip
    expected = 5 * np.exp(-found.time / 6e-3)
    near(found["u"], expected)
    near(found["i"], expected / 2e3)


def test_inductor_empties_into_a_resistor() -> None:
    found = run(
        "electric", "Resistor, Inductor",
        """
        Resistor r { R = 4 ohm }
        Inductor l { L = 2 mH, I_0 = 3 A }
        1 loop
        loop -> r.pins, l.pins
        output i = l.current, u = l.voltage
        """,
        2e-3,
    )  # fmt: skip
    expected = 3 * np.exp(-found.time / 0.5e-3)
    near(found["i"], expected)
    near(found["u"], -4 * expected)


# ---------------------------------------------------------------------- diode


def diode_current(u: float, r: float, n: float = 1.0) -> float:
    """The current of a Shockley diode behind a resistance: i = Is (exp((u - r i)/(n Ut)) - 1)."""
    if u < 0:
        return -1e-14 * (1 - math.exp((u + 1e-14 * r) / (n * U_T)))
    # Solved for the voltage of the junction, where the equation is well scaled.
    v = brentq(lambda v: v + r * 1e-14 * math.expm1(v / (n * U_T)) - u, 0.0, u, xtol=1e-16, rtol=1e-15)
    return 1e-14 * math.expm1(v / (n * U_T))


DIODE = """
    Se supply : u = %g V
    Diode d { R_s = 2 ohm, n = %g }
    supply -> d.pins
    output i = d.current, u = d.voltage
"""


@pytest.mark.parametrize(("u", "n"), [(0.3, 1), (0.6, 1), (0.8, 1), (5.0, 1), (0.8, 1.7)])
def test_diode_in_steady_state_follows_shockley(u: float, n: float) -> None:
    found = run("electric", "Diode", DIODE % (u, n), 1e-6)
    near(found.final("i"), diode_current(u, 2.0, n))
    exact(found.final("u"), u)


def test_diode_blocks_backwards() -> None:
    """A germanium diode at -5 V: its saturation current. The error of the voltages is measured by R_s."""
    found = run("electric", "Diode", DIODE % (-5, 1), 1e-6, settings={"d.I_s": "10 uA"})
    near(found.final("i"), -1e-5, scale=5 / 2)
    assert found.final("i") == pytest.approx(-1e-5, rel=1e-3)


@pytest.mark.parametrize("m", [0.5, 1 / 3])
def test_depletion_charge(m: float) -> None:
    """q(u) integrated from C = Cj/(1 - u/Uj)^m up to half of Uj, constant capacitance above."""
    found = run(
        "electric", "Diode",
        f"""
        Se supply : u = 0.75 V*sin(2*pi*1 MHz*time) - 0.2 V
        Diode d {{ I_s = 1e-16 A, grading = {m!r} }}
        supply -> d.pins
        output q = d.depletion.q, u = d.depletion.u
        """,
        2e-6, points=201,
    )  # fmt: skip
    u, capacitance, built_in = found["u"], 4e-12, 0.75
    below = np.minimum(u, built_in / 2)
    charge = capacitance * built_in / (1 - m) * (1 - (1 - below / built_in) ** (1 - m)) + capacitance / 0.5**m * (
        u - below
    )
    assert u.min() < -0.9 and u.max() > 0.45
    near(found["q"], charge, rtol=1e-11, margin=1)


# ---------------------------------------------------------------------- transistors

BJT = """
    Se base_supply : u = %g V
    Se collector_supply : u = %g V
    Se ground_supply : u = 0
    Bjt t { polarity = %d }
    base_supply -> t.base
    collector_supply -> t.collector
    t.emitter -> ground_supply
    output ib = t.base_current, ic = t.collector_current, ie = t.emitter_current
"""


def ebers_moll(ub: float, uc: float) -> tuple[float, float]:
    """Base and collector current of the npn with its lead resistances, by a solver for the currents."""

    def currents(x: np.ndarray) -> tuple[float, float]:
        forward, reverse = (1e-15 * math.expm1(v / U_T) for v in x)
        return forward / 100 + reverse / 1, forward - reverse - reverse / 1

    def residual(x: np.ndarray) -> list[float]:
        ib, ic = currents(x)
        be, bc = x
        return [ub - 10 * ib - 0.1 * (ib + ic) - be, (ub - 10 * ib) - (uc - 1 * ic) - bc]

    solution = fsolve(residual, [0.6, min(ub - uc, 0.6)], xtol=1e-12)
    assert np.abs(residual(solution)).max() < 1e-11
    return currents(solution)


@pytest.mark.parametrize("polarity", [1, -1])
@pytest.mark.parametrize(("ub", "uc"), [(0.65, 5.0), (0.8, 5.0), (0.75, 0.1), (0.6, -0.1)])
def test_bjt_is_ebers_and_moll(ub: float, uc: float, polarity: int) -> None:
    """Active, with leads that matter, saturated, backwards; the pnp is the mirror image."""
    found = run("electric", "Bjt", BJT % (polarity * ub, polarity * uc, polarity), 2e-6)
    ib, ic = ebers_moll(ub, uc)
    near(found.final("ib"), polarity * ib, scale=abs(ic))
    near(found.final("ic"), polarity * ic)
    near(found.final("ie"), polarity * (ib + ic), scale=abs(ic))


MOS = """
    Se gate_supply : u = %g V
    Se drain_supply : u = %g V
    Se ground_supply : u = 0
    Mos t { polarity = %d, k = 3e-3 [A/V^2], U_th = 0.8 V, modulation = 0.02 [1/V], R_d = 5 ohm, R_s = 3 ohm }
    gate_supply -> t.gate
    drain_supply -> t.drain
    t.source -> ground_supply
    output gs = t.store_gs.u, gd = t.store_gd.u, i = t.drain_current, ig = t.gate_current, out = t.source_current
"""


def level_1(gs: float, ds: float) -> float:
    """The drain current of SPICE's level 1 as textbooks give it, region by region."""
    if ds < 0:
        return -level_1(gs - ds, -ds)
    over = gs - 0.8
    if over <= 0:
        return 0.0
    if ds < over:
        return 3e-3 * (over * ds - ds**2 / 2) * (1 + 0.02 * ds)
    return 3e-3 / 2 * over**2 * (1 + 0.02 * ds)


@pytest.mark.parametrize("polarity", [1, -1])
@pytest.mark.parametrize(("ug", "ud"), [(0.5, 3.0), (2.0, 0.3), (2.0, 5.0), (1.5, -1.0)])
def test_mos_is_level_1(ug: float, ud: float, polarity: int) -> None:
    """Cut off, as a resistance, saturated, backwards: at the voltages that the leads leave."""
    found = run("electric", "Mos", MOS % (polarity * ug, polarity * ud, polarity), 1e-6)
    gs, gd = polarity * found.final("gs"), polarity * found.final("gd")
    expected = level_1(gs, gs - gd)
    near(polarity * found.final("i"), expected, scale=1e-3)
    near(gs - gd, ud - 8 * expected, scale=1)  # the rest drops in the leads
    near(found.final("ig"), 0, scale=1e-3)
    near(found.final("out"), found.final("i"), scale=1e-3)


@pytest.mark.parametrize(
    ("part", "pins", "field", "ports"),
    [
        ("Bjt", ("base", "collector", "emitter"), "junctions", ("be", "bc")),
        ("Mos", ("gate", "drain", "source"), "channel", ("gs", "gd")),
    ],
)
def test_transistors_give_no_energy(part: str, pins: tuple[str, ...], field: str, ports: tuple[str, ...]) -> None:
    """Two voltages that sweep all regions at unrelated frequencies: the power into the field is never negative."""
    power = " + ".join(f"t.{field}.{p}.u*t.{field}.{p}.i" for p in ports)
    found = run(
        "electric", part,
        f"""
        Se one : u = 0.9 V*sin(2*pi*1 kHz*time)
        Se two : u = 3 V*sin(2*pi*1.618 kHz*time)
        Se earth : u = 0
        {part} t
        one -> t.{pins[0]}
        two -> t.{pins[1]}
        t.{pins[2]} -> earth
        output power = {power}
        """,
        20e-3, points=2001, rtol=1e-6, settings={"t.U_th": "0.2 V"} if part == "Mos" else {},
    )  # fmt: skip
    assert found["power"].max() > 1e-3
    near(np.minimum(found["power"], 0), 0, scale=found["power"].max(), rtol=1e-6, margin=1)


# ---------------------------------------------------------------------- op-amp

AMPLIFIER = """
    import Resistor from electric
    input signal_in = 0 V
    MSe source : u = signal_in
    Se zero : u = 0
    OpAmp amplifier
    Resistor r1 { R = 1 [kohm] }
    Resistor r2 { R = 10 [kohm] }
    0 minus, out
    source -> 1(r1.pins) -> minus
    out -> 1(r2.pins) -> minus
    minus -> amplifier.minus
    zero -> amplifier.plus
    amplifier.out -> out
    output u = amplifier.open - 75 ohm*amplifier.current, open = amplifier.open
"""


def inverting() -> tuple[float, float, float]:
    """Of the linear amplifier: rate of its pole, and open output and output per volt in, at rest; from its nodes."""
    r1, r2, r_in, r_out, gain, w = 1e3, 1e4, 2e6, 75.0, 2e5, 2 * math.pi * 1e6
    # Nodes n (minus) and o (out): (s - n)/r1 + (o - n)/r2 - n/r_in = 0; (v - o)/r_out + (n - o)/r2 = 0.
    g = np.array([[-1 / r1 - 1 / r2 - 1 / r_in, 1 / r2], [1 / r2, -1 / r_out - 1 / r2]])
    (n_s, o_s), (n_v, o_v) = np.linalg.solve(g, [-1 / r1, 0]), np.linalg.solve(g, [0, -1 / r_out])
    # v' = w (0 - n) - w/gain v, n = n_s s + n_v v
    pole = w * (n_v + 1 / gain)
    open_output = -w * n_s / pole
    return pole, open_output, o_s + o_v * open_output


def test_op_amp_inverts_with_one_pole() -> None:
    """1 uV is small enough that the slew rate is not felt: (1 uV/80 mV)^2."""
    found = run("electric", "OpAmp", AMPLIFIER, 3e-6, settings={"signal_in": "1 uV"})
    pole, open_output, output = inverting()
    near(found["open"], 1e-6 * open_output * (1 - np.exp(-pole * found.time)))
    near(run("electric", "OpAmp", AMPLIFIER, 30e-6, settings={"signal_in": "1 uV"}).final("u"), 1e-6 * output)
    assert output == pytest.approx(-10, rel=1e-3)


def test_op_amp_slews_and_stops_at_its_rail() -> None:
    found = run("electric", "OpAmp", AMPLIFIER, 60e-6, settings={"signal_in": "-5 V"}, points=601)
    w, before = 2 * math.pi * 1e6, found.time < 23e-6
    # More than a volt between the inputs: tanh is 1, and v' = slew - w v/gain until the rail is there.
    near(found["open"][before], 0.5e6 * 2e5 / w * -np.expm1(-w / 2e5 * found.time[before]))
    # At rest slew - w v/gain = w (v - rail).
    near(found.final("open"), (0.5e6 + w * 12) / (w + w / 2e5))


# ---------------------------------------------------------------------- motor

MOTOR = """
    import Resistor from electric
    Se supply : u = 12 V
    DcMotor motor { R = 2 ohm, L = 1 mH, K = 0.04 [N*m/A], J = 2e-5 [kg*m^2], b = 3e-5 [N*m*s] }
    Se load : M = 0.02 [N*m]
    supply -> motor.pins
    motor.shaft -> load
    output i = motor.current, omega = motor.speed
"""


def test_dc_motor_starts_and_settles() -> None:
    found = run("electric", "DcMotor", MOTOR, 0.2, energy=True)
    r, l, k, j, b, u, m = 2.0, 1e-3, 0.04, 2e-5, 3e-5, 12.0, 0.02
    expected = linear([[-r / l, -k / l], [k / j, -b / j]], [u / l, -m / j], [0, 0], found.time)
    near(found["i"], expected[:, 0])
    near(found["omega"], expected[:, 1])
    final = run("electric", "DcMotor", MOTOR, 3.0)
    near(final.final("omega"), (k * u - r * m) / (r * b + k**2))
    near(final.final("i"), (b * u + k * m) / (r * b + k**2))
    assert found.energy is not None
    near(found.energy.residual, 0, scale=found.energy.supplied)


def test_two_capacitors_may_share_a_node() -> None:
    """Storages side by side add up: one of them follows the other."""
    found = run(
        "electric", "Resistor, Capacitor",
        """
        Se supply : u = 1 V
        Resistor r { R = 1 [kohm] }
        Capacitor a { C = 1 uF }
        Capacitor b { C = 2 uF }
        supply -> 1(r.pins, 0(a.pins, b.pins))
        output u = a.voltage, ia = a.current, ib = b.current
        """,
        10e-3,
    )  # fmt: skip
    near(found["u"], 1 - np.exp(-found.time / 3e-3))
    near(found["ib"], 2 * found["ia"], scale=1e-3)


def test_a_transistor_holds_its_gain_at_the_default_tolerance() -> None:
    """While its junctions charge they see volts, not what a coarse pilot run through their exponentials sees."""
    body = """
    Sf bias : i = 10 uA
    Se supply : u = 5 V
    Se earth : u = 0 V
    Bjt part
    bias -> part.base
    supply -> part.collector
    part.emitter -> earth
    output i = part.collector_current
    """
    found = run("electric", "Bjt", body, 1e-4, rtol=1e-6)
    assert found.final("i") == pytest.approx(1e-3, rel=1e-3)
