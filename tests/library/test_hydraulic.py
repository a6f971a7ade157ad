"""Hydraulic parts against volume balances, the orifice law, polytropes and linear responses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq, fsolve

from tests.library.bench import exact, near, run


def test_pump_gives_its_displacement_less_the_leakage() -> None:
    found = run(
        "hydraulic", "Pump",
        """
        Sf motor : omega = 1500 rpm*sin(2*pi*1 Hz*time)
        Se low   : P = 2 bar
        Se high  : P = 102 bar
        Pump pump { D = 16 [cm^3/rev], leakage = 2e-12 [m^3/s/Pa] }
        motor -> pump.shaft
        low -> pump.a
        pump.b -> high
        output Q = pump.flow, Q_in = low.Q, Q_out = high.Q, M = motor.M
        """,
        1,
    )  # fmt: skip
    omega, displacement, pressure = (
        1500 / 60 * 2 * math.pi * np.sin(2 * math.pi * found.time),
        16e-6 / (2 * math.pi),
        100e5,
    )
    flow = displacement * omega - 2e-12 * pressure
    near(found["Q"], flow, rtol=1e-12, margin=1)
    near(found["Q_in"], flow, rtol=1e-12, margin=1)
    near(found["Q_out"], flow, rtol=1e-12, margin=1)
    exact(found["M"], np.full(101, displacement * pressure))


def test_pump_drives_a_motor() -> None:
    """A hydrostatic transmission: a second pump is the motor. The leakage of both takes a little of the speed."""
    found = run(
        "hydraulic", "Pump, Reservoir",
        """
        Sf engine : omega = 100 [rad/s]
        I inertia : p = 1e-4 [kg*m^2]*omega
        R drag    : M = 0.02 [N*m*s]*omega
        C hose    : P = 1e12 [Pa/m^3]*V
        Pump pump  { D = 20 [cm^3/rev], leakage = 1e-12 [m^3/s/Pa] }
        Pump drive { D = 40 [cm^3/rev], leakage = 1e-12 [m^3/s/Pa] }
        Reservoir tank, sump
        1 wheel
        0 line, back
        engine -> pump.shaft
        tank.line -> pump.a
        pump.b -> line -> hose, drive.a
        drive.b -> back
        sump.line -> back
        wheel -> drive.shaft, inertia, drag
        output omega = wheel.omega, P = hose.P
        """,
        0.3,
    )  # fmt: skip
    d1, d2, g, drag = 20e-6 / (2 * math.pi), 40e-6 / (2 * math.pi), 1e-12, 0.02
    # d1 w1 - g P = d2 w2 + g P and P d2 = drag w2
    speed = d1 * 100 / (d2 + 2 * g * drag / d2)
    near(found.final("omega"), speed)
    near(found.final("P"), drag * speed / d2)


@pytest.mark.parametrize("opening", [1.0, 0.3])
def test_valve_is_a_turbulent_orifice_both_ways(opening: float) -> None:
    found = run(
        "hydraulic", "Valve",
        f"""
        Se left  : P = 50 bar*sin(2*pi*1 Hz*time)
        Se right : P = 0
        Valve valve {{ area = 8 [mm^2], C_d = 0.7, rho = 870 [kg/m^3], P_soft = 100 Pa, opening = {opening} }}
        left -> valve.a
        valve.b -> right
        output Q = valve.flow, P = valve.drop
        """,
        1, points=1001,
    )  # fmt: skip
    p = found["P"]
    turbulent = opening * 0.7 * 8e-6 * np.sign(p) * np.sqrt(2 * np.abs(p) / 870)
    far = np.abs(p) > 1e5  # 100 Pa/(2*1 bar) = 5e-4 is what the laminar part takes
    assert np.all(np.abs(found["Q"][far] / turbulent[far] - 1) < 5.1e-4)
    near(found["Q"] + found["Q"][::-1], 0, scale=1e-4, rtol=1e-11, margin=1)
    r = found["Q"] / (opening * 0.7 * 8e-6 * math.sqrt(2 / 870))
    near(r * np.sqrt(r**2 + 200), p, rtol=1e-12, margin=1)


def test_valve_behind_a_pipe() -> None:
    """The pipe gives the flow, and the valve its pressure: turned round, and at rest both drops make up the supply."""
    found = run(
        "hydraulic", "Reservoir, Pipe, Valve",
        """
        Reservoir high { pressure = 10 bar }
        Se air : P = 0
        Pipe pipe { length = 2 m, diameter = 6 mm }
        Valve valve { area = 2 [mm^2], opening = 0.5 }
        high.line -> pipe.a
        pipe.b -> valve.a
        valve.b -> air
        output Q = pipe.flow, P = valve.drop
        """,
        1,
    )  # fmt: skip
    resistance, conductance = 128 * 0.03 * 2 / (math.pi * 0.006**4), 0.5 * 0.62 * 2e-6 * math.sqrt(2 / 850)

    def missing(q: float) -> float:
        r = q / conductance
        return resistance * q + r * math.sqrt(r**2 + 200) - 10e5

    flow = brentq(missing, 0, 1e-3, xtol=1e-20, rtol=1e-14)
    near(found.final("Q"), flow)
    near(found.final("P"), 10e5 - resistance * flow)


def test_tank_empties_through_a_valve() -> None:
    """Torricelli: the root of the level falls linearly."""
    found = run(
        "hydraulic", "Tank, Valve",
        """
        Se air : P = 0
        Tank tank { area = 0.5 [m^2], rho = 1000 [kg/m^3], level_0 = 2 m }
        Valve hole { area = 400 [mm^2], C_d = 0.6, rho = 1000 [kg/m^3], P_soft = 1e-5 Pa }
        0 bottom
        bottom -> tank.bottom
        bottom -> hole.a
        hole.b -> air
        output h = tank.level, P = tank.pressure
        """,
        600,
    )  # fmt: skip
    slope = 0.6 * 400e-6 * math.sqrt(2 * 9.80665) / 0.5
    near(found["h"], (math.sqrt(2) - slope / 2 * found.time) ** 2)
    exact(found["P"], 1000 * 9.80665 * found["h"])


def test_volume_between_two_valves() -> None:
    """Two equal orifices halve the pressure, two of areas 1:2 leave a fifth; the volume fills with Q bulk/V_0."""
    found = run(
        "hydraulic", "Reservoir, Valve, Volume",
        """
        Reservoir high { pressure = 100 bar }
        Se air : P = 0
        Valve first  { area = 1 [mm^2], rho = 850 [kg/m^3], P_soft = 1e-4 Pa }
        Valve second { area = 2 [mm^2], rho = 850 [kg/m^3], P_soft = 1e-4 Pa }
        Volume line { V_0 = 0.5 L, P_0 = 5 bar }
        0 between
        high.line -> first.a
        first.b -> between -> line.line, second.a
        second.b -> air
        output P = line.pressure, Q = line.oil.Q
        """,
        1,
    )  # fmt: skip
    near(found.final("P"), 20e5)
    flow = 0.62 * math.sqrt(2 / 850) * (1e-6 * math.sqrt(95e5) - 2e-6 * math.sqrt(5e5))
    near(found["Q"][0], flow)
    near(found["P"][0], 5e5)
    small = run(
        "hydraulic", "Volume",
        "Sf pump : Q = 1 [cm^3/s]\n Volume line { V_0 = 2 L, bulk = 1.6 GPa }\n pump -> line.line\n output P = line.pressure", 1,
    )  # fmt: skip
    near(small["P"], 1.6e9 / 2e-3 * 1e-6 * small.time)


def test_pipe_starts_and_settles() -> None:
    found = run(
        "hydraulic", "Pipe, Reservoir",
        """
        Reservoir high { pressure = 3 bar }
        Se air : P = 0
        Pipe pipe { length = 5 m, diameter = 8 mm, mu = 0.04 [Pa*s], rho = 870 [kg/m^3] }
        high.line -> pipe.a
        pipe.b -> air
        output Q = pipe.flow, Re = pipe.reynolds
        """,
        0.5,
    )  # fmt: skip
    resistance = 128 * 0.04 * 5 / (math.pi * 0.008**4)
    inertia = 870 * 5 / (math.pi * 0.008**2 / 4)
    near(found["Q"], 3e5 / resistance * (1 - np.exp(-resistance / inertia * found.time)))
    velocity = found["Q"] / (math.pi * 0.008**2 / 4)
    near(found["Re"], 870 * velocity * 0.008 / 0.04, rtol=1e-13)


@pytest.mark.parametrize("n", [1.0, 1.4])
def test_accumulator_follows_a_polytrope(n: float) -> None:
    found = run(
        "hydraulic", "Accumulator",
        f"""
        Sf pump : Q = 0.1 [L/s]
        Accumulator bladder {{ V_0 = 2 L, P_0 = 80 bar, n = {n}, V_oil = 0.2 L }}
        pump -> bladder.line
        output V = bladder.oil, P = bladder.pressure
        """,
        10, energy=True,
    )  # fmt: skip
    oil = 0.2e-3 + 1e-4 * found.time
    near(found["V"], oil)
    near(found["P"], 80e5 * (2e-3 / (2e-3 - oil)) ** n - 101325)
    gas = 2e-3 - oil[[0, -1]]
    work = (
        80e5 * 2e-3 * math.log(gas[0] / gas[1])
        if n == 1
        else 80e5 * 2e-3**n / (n - 1) * (gas[1] ** (1 - n) - gas[0] ** (1 - n))
    )
    assert found.energy is not None
    near(found.energy.stored, work - 101325 * 1e-3)


def test_two_accumulators_share_a_line() -> None:
    """One of them follows the other; the flow divides as their stiffnesses want it."""
    found = run(
        "hydraulic", "Accumulator",
        """
        Sf pump : Q = 0.1 [L/s]
        Accumulator a { V_0 = 1 L, n = 1 }
        Accumulator b { V_0 = 3 L, n = 1 }
        0 line
        pump -> line -> a.line, b.line
        output P = a.pressure, V = b.oil
        """,
        10,
    )  # fmt: skip
    near(found["P"], 100e5 * 4e-3 / (4e-3 - 1e-4 * found.time) - 101325)
    near(found["V"], 0.75e-4 * found.time)


# ---------------------------------------------------------------------- cylinder

CYLINDER = """
    Se supply : P = 80 bar
    Se back   : P = 5 bar
    R  throttle_a : P = 1e10 [Pa*s/m^3]*Q
    R  throttle_b : P = 1e10 [Pa*s/m^3]*Q
    I  load   : p = 50 kg*v
    C  spring : F = 4e4 [N/m]*x
    1  table
    Cylinder cylinder { A_a = 12 [cm^2], A_b = 7 [cm^2], V_a = 80 [cm^3], V_b = 300 [cm^3], leakage = 1e-16 [m^3/s/Pa], r = 500 [N*s/m] }
    supply -> 1(throttle_a) -> cylinder.a
    back   -> 1(throttle_b) -> cylinder.b
    cylinder.rod -> table -> load, spring
    output x = cylinder.way, a = cylinder.pressure_a, b = cylinder.pressure_b, force = cylinder.force
"""


def test_cylinder_comes_to_rest_against_a_spring() -> None:
    """P_a A_a (1 + P_a/2E) - P_b A_b (1 + P_b/2E) = k x: the energy stored in the oil pushes the piston, too."""
    found = run("hydraulic", "Cylinder", CYLINDER, 30)
    leak = 1e-16 * 75e5 / (1 + 2 * 1.001e10 * 1e-16)  # past the piston, and so through throttles and connections
    a, b, bulk = 80e5 - 1.001e10 * leak, 5e5 + 1.001e10 * leak, 1.4e9
    force = 12e-4 * a * (1 + a / (2 * bulk)) - 7e-4 * b * (1 + b / (2 * bulk))
    near(found.final("a"), a)
    near(found.final("b"), b, scale=a)
    near(found.final("force"), force)
    near(found.final("x"), force / 4e4)


def test_cylinder_may_stand_between_two_reservoirs() -> None:
    """Its connections have a resistance, so any pressure can be put on it. At last it moves steadily, with steady pressures."""
    found = run(
        "hydraulic", "Cylinder, Reservoir",
        """
        Reservoir high { pressure = 20 bar }
        Reservoir tank
        Cylinder cylinder { r = 1e5 [N*s/m] }
        I load : p = 10 kg*v
        high.line -> cylinder.a
        tank.line -> cylinder.b
        cylinder.rod -> load
        output v = load.v, a = cylinder.pressure_a, b = cylinder.pressure_b
        """,
        0.05,
    )  # fmt: skip
    bulk, area_a, area_b = 1.4e9, 10e-4, 6e-4

    def missing(x: np.ndarray) -> list[float]:
        v, a, b = x[0] * 1e-2, x[1] * 1e6, x[2] * 1e6
        leak = 1e-13 * (a - b)
        # At a pressure P the moving piston takes A v of oil and P/E of that to fill the room that it leaves.
        return [
            1e7 * (area_a * v * (1 + a / bulk) + leak) - (20e5 - a),
            1e7 * (area_b * v * (1 + b / bulk) + leak) - b,
            area_a * a * (1 + a / (2 * bulk)) - area_b * b * (1 + b / (2 * bulk)) - 1e5 * v,
        ]

    v, a, b = fsolve(missing, [2.0, 2.0, 0.0], xtol=1e-13) * [1e-2, 1e6, 1e6]
    near(found.final("v"), v)
    near(found.final("a"), a)
    near(found.final("b"), b, scale=a)


def test_cylinder_conserves_energy() -> None:
    found = run("hydraulic", "Cylinder", CYLINDER, 1, energy=True)
    assert found.energy is not None and found.energy.stored > 10
    near(found.energy.residual, 0, scale=found.energy.supplied)


def test_cylinder_with_a_blocked_rod_presses_its_oil_together() -> None:
    found = run(
        "hydraulic", "Cylinder",
        """
        Sf pump : Q = 1 [cm^3/s]
        Sf blind : Q = 0
        Sf wall : v = 0
        Cylinder cylinder { V_a = 50 [cm^3], P_a0 = 10 bar, P_b0 = 10 bar, leakage = 1e-25 [m^3/s/Pa] }
        pump -> cylinder.a
        blind -> cylinder.b
        cylinder.rod -> wall
        output a = cylinder.pressure_a, b = cylinder.pressure_b
        """,
        1,
    )  # fmt: skip
    near(found["a"], 10e5 + 1.4e9 * 1e-6 / 50e-6 * found.time)
    near(found["b"], 10e5, scale=3e7)


def test_cylinder_moves_with_the_flow() -> None:
    """Against no pressure the rod goes with the flow over the area: the volume that stays in the oil is known."""
    found = run(
        "hydraulic", "Cylinder",
        """
        Sf pump : Q = 10 [cm^3/s]
        Se back : P = 0
        R  pipe : P = 1e9 [Pa*s/m^3]*Q
        Cylinder cylinder { V_b = 200 [cm^3], r = 3000 [N*s/m], leakage = 1e-25 [m^3/s/Pa] }
        I load : p = 10 kg*v
        1 table
        pump -> cylinder.a
        back -> 1(pipe) -> cylinder.b
        cylinder.rod -> table -> load
        output v = table.v, x = cylinder.way, P = cylinder.pressure_a, P_b = cylinder.pressure_b
        """,
        0.5,
    )  # fmt: skip
    # P_a = E (V_in - A x)/(V_a + A x): what came in is what the piston gave and what the pressure holds.
    given = 10e-4 * found["x"]
    near(found["P"], 1.4e9 * (1e-5 * found.time - given) / (100e-6 + given), scale=1.4e9)
    # The load moves on steadily with what the pump gives.
    near(found.final("v"), 1e-5 / 10e-4, rtol=1e-3, margin=1)
