"""Mechanical parts against ratios, linear responses, conserved quantities."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

import bondgraph
from tests.library.bench import exact, linear, near, run, text

# ---------------------------------------------------------------------- ideal transducers


@pytest.mark.parametrize("ratio", [4.0, -0.5])
def test_gear_accelerates_what_is_behind_it(ratio: float) -> None:
    found = run(
        "mechanics", "Gear",
        f"""
        Se motor : M = 3 [N*m]
        1 shaft, load
        I rotor  : p = 0.1 [kg*m^2]*omega
        I wheel  : p = 0.8 [kg*m^2]*omega
        Gear gear {{ ratio = {ratio} }}
        motor -> shaft -> rotor, gear.a
        gear.b -> load -> wheel
        output fast = shaft.omega, slow = load.omega
        output power_in = gear.mesh.M1*gear.mesh.omega1, power_out = gear.mesh.M2*gear.mesh.omega2
        """,
        2,
    )  # fmt: skip
    near(found["fast"], 3 / (0.1 + 0.8 / ratio**2) * found.time)
    exact(found["slow"] * ratio, found["fast"])
    exact(found["power_in"], found["power_out"])


def test_lever_turns_forces_round() -> None:
    found = run(
        "mechanics", "Lever",
        """
        Se hand : F = 10 N
        1 near, far
        I stone : p = 5 kg*v
        R drag  : F = 2 [N*s/m]*v
        Lever lever { l_a = 0.5 m, l_b = 0.1 m }
        hand -> near -> lever.a
        lever.b -> far -> stone, drag
        output v_near = near.v, v_far = far.v
        """,
        3,
    )  # fmt: skip
    # The far end goes the other way, at a fifth of the velocity, with five times the force.
    near(found["v_far"], -50 / 2 * (1 - np.exp(-2 / 5 * found.time)))
    exact(found["v_near"], -5 * found["v_far"])


def test_screw_moves_a_nut() -> None:
    found = run(
        "mechanics", "Screw",
        """
        Se motor : M = 0.2 [N*m]
        1 shaft, table
        I rotor : p = 1e-4 [kg*m^2]*omega
        I mass  : p = 20 kg*v
        Screw screw { lead = 10 [mm/rev] }
        motor -> shaft -> rotor, screw.a
        screw.b -> table -> mass
        output v = table.v
        """,
        1,
    )  # fmt: skip
    lead = 0.010 / (2 * math.pi)
    near(found["v"], lead * 0.2 / (1e-4 + 20 * lead**2) * found.time)


def test_wheel_drives_a_car() -> None:
    found = run(
        "mechanics", "Wheel",
        """
        Se motor : M = 100 [N*m]
        1 axle, car
        I rims : p = 2 [kg*m^2]*omega
        I mass : p = 1000 kg*v
        Wheel wheel { radius = 0.25 m }
        motor -> axle -> rims, wheel.a
        wheel.b -> car -> mass
        output v = car.v, omega = axle.omega
        """,
        10,
    )  # fmt: skip
    near(found["v"], (100 / 0.25) / (1000 + 2 / 0.25**2) * found.time)
    exact(found["omega"] * 0.25, found["v"])


# ---------------------------------------------------------------------- elastic parts


def test_belt_between_two_pulleys() -> None:
    found = run(
        "mechanics", "Belt",
        """
        Se motor : M = 1 [N*m]
        1 fast, slow
        I rotor : p = 1e-3 [kg*m^2]*omega
        I drum  : p = 5e-2 [kg*m^2]*omega
        R drag  : M = 0.1 [N*m*s]*omega
        Belt belt { r_a = 20 mm, r_b = 80 mm, k = 2e4 [N/m], r = 30 [N*s/m] }
        motor -> fast -> rotor, belt.a
        belt.b -> slow -> drum, drag
        output fast_omega = fast.omega, slow_omega = slow.omega, stretch = belt.stretch, pull = belt.pull
        """,
        0.5, energy=True,
    )  # fmt: skip
    ra, rb, k, r, ja, jb = 0.02, 0.08, 2e4, 30.0, 1e-3, 5e-2
    a = [
        [-ra * ra * r / ja, ra * rb * r / ja, -ra * k / ja],
        [ra * rb * r / jb, (-rb * rb * r - 0.1) / jb, rb * k / jb],
        [ra, -rb, 0],
    ]
    expected = linear(a, [1 / ja, 0, 0], [0, 0, 0], found.time)
    for column, name in enumerate(("fast_omega", "slow_omega", "stretch")):
        near(found[name], expected[:, column])
    near(found["pull"], k * expected[:, 2] + r * (ra * expected[:, 0] - rb * expected[:, 1]))
    assert found.energy is not None
    near(found.energy.residual, 0, scale=found.energy.supplied)


def test_spring_damper_between_two_masses() -> None:
    found = run(
        "mechanics", "SpringDamper",
        """
        1 left, right
        I m1 : p = 2 kg*v
        I m2 : p = 3 kg*v
        SpringDamper link { k = 50 [N/m], r = 4 [N*s/m], x_0 = 10 mm }
        left -> m1
        left -> link.a
        link.b -> right -> m2
        output v1 = left.v, v2 = right.v, x = link.compression, force = link.force
        """,
        3,
    )  # fmt: skip
    a = [[-4 / 2, 4 / 2, -50 / 2], [4 / 3, -4 / 3, 50 / 3], [1, -1, 0]]
    expected = linear(a, [0, 0, 0], [0, 0, 0.01], found.time)
    near(found["v1"], expected[:, 0])
    near(found["v2"], expected[:, 1])
    near(found["x"], expected[:, 2])
    near(2 * found["v1"] + 3 * found["v2"], 0, scale=0.1)  # momentum
    near(found["force"], 50 * expected[:, 2] + 4 * (expected[:, 0] - expected[:, 1]))


def test_torsion_spring_swings() -> None:
    found = run(
        "mechanics", "TorsionSpring",
        """
        Sf wall : omega = 0
        1 body
        I disc : p = 0.2 [kg*m^2]*omega
        TorsionSpring wire { k = 5 [N*m], r = 0.1 [N*m*s], phi_0 = 30 deg }
        body -> disc
        body -> wire.a
        wire.b -> wall
        output phi = wire.twist, omega = body.omega, torque = wire.torque
        """,
        5,
    )  # fmt: skip
    w0, delta, start = math.sqrt(5 / 0.2), 0.1 / 0.2 / 2, math.pi / 6
    w = math.sqrt(w0**2 - delta**2)
    expected = start * np.exp(-delta * found.time) * (np.cos(w * found.time) + delta / w * np.sin(w * found.time))
    near(found["phi"], expected)
    near(found["torque"], 5 * found["phi"] + 0.1 * found["omega"], rtol=1e-14)


# ---------------------------------------------------------------------- friction


def test_friction_has_stribecks_curve() -> None:
    found = run(
        "mechanics", "Friction, RotaryFriction",
        """
        Sf drive : v = 0.05 [m/s]*sin(2*pi*1 Hz*time)
        Sf spin  : omega = 3 [rad/s]*sin(2*pi*1 Hz*time)
        Friction rail { F_c = 10 N, F_s = 14 N, v_s = 0.01 [m/s], v_0 = 0.001 [m/s], r = 20 [N*s/m] }
        RotaryFriction bearing { M_c = 0.2 [N*m], M_s = 0.3 [N*m], omega_s = 0.4 [rad/s], omega_0 = 0.02 [rad/s], r = 0.01 [N*m*s] }
        drive -> rail.ends
        spin -> bearing.ends
        output F = rail.force, M = bearing.torque
        """,
        1, points=1001,
    )  # fmt: skip
    v, omega = 0.05 * np.sin(2 * np.pi * found.time), 3 * np.sin(2 * np.pi * found.time)
    near(found["F"], (10 + 4 * np.exp(-((v / 0.01) ** 2))) * np.tanh(v / 0.001) + 20 * v, rtol=1e-11, margin=1)
    near(
        found["M"],
        (0.2 + 0.1 * np.exp(-((omega / 0.4) ** 2))) * np.tanh(omega / 0.02) + 0.01 * omega,
        rtol=1e-11,
        margin=1,
    )
    assert found["F"].max() > 12  # it breaks away before it slides


SLED = """
    Se push : F = %g N
    1 body
    I mass : p = 2 kg*v                                { start v = %g [m/s] }
    Friction rail { F_c = 10 N, F_s = %g N, v_s = 0.02 [m/s], v_0 = 0.01 [m/s], r = %g [N*s/m] }
    push -> body -> mass, rail.ends
    output v = body.v
"""


def test_friction_stops_a_sled() -> None:
    """m dv/dt = -F tanh(v/v0): sinh(v/v0) falls exponentially."""
    found = run("mechanics", "Friction", SLED % (0, 0.05, 10, 0), 0.03)
    near(found["v"], 0.01 * np.arcsinh(math.sinh(5) * np.exp(-10 / (2 * 0.01) * found.time)))


def test_friction_creeps_below_the_break_away_force() -> None:
    found = run("mechanics", "Friction", SLED % (8, 0, 14, 5), 1)

    def missing(v: float) -> float:
        return (10 + 4 * math.exp(-((v / 0.02) ** 2))) * math.tanh(v / 0.01) + 5 * v - 8

    near(found.final("v"), brentq(missing, 0, 0.01, xtol=1e-16, rtol=1e-14))


# ---------------------------------------------------------------------- end stop

IMPACT = """
    1 body
    I mass : p = 0.5 kg*v                              { start v = %g [m/s] }
    EndStop stop { side = %d, gap = 5 mm, k = 2e5 [N/m], soft = 0.2 mm, loss = %g [s/m] }
    body -> mass, stop.ends
    output v = body.v, x = stop.way, force = stop.force
"""


@pytest.mark.parametrize("side", [1, -1])
def test_end_stop_without_loss_returns_the_energy(side: int) -> None:
    """1 m/s into it and 1 m/s out of it; at the turn all energy is in the contact."""
    found = run("mechanics", "EndStop", IMPACT % (side, side, 0), 15e-3, points=20001, energy=True)
    x, v = side * found["x"], side * found["v"]
    near(found.final("v"), -side)
    free = x < 5e-3
    assert np.all(found["force"][free] == 0) and np.all(side * found["force"] >= 0)
    near(v[: int(np.argmax(~free))], 1)

    def missing(depth: float) -> float:
        s = 0.2e-3  # a parabola over the first s: s^2/6, then straight
        return 2e5 * (s**2 / 6 + (depth**2 - s**2) / 2 - s / 2 * (depth - s)) - 0.5 * 0.5 * 1**2

    deepest = brentq(missing, 0.2e-3, 1e-2, xtol=1e-16, rtol=1e-14)
    # Between two instants the turn is missed by at most half an acceleration times half a step squared.
    assert x.max() - 5e-3 == pytest.approx(deepest, rel=1e-6)
    assert found.energy is not None
    near(found.energy.residual, 0, scale=0.25)


@pytest.mark.parametrize("side", [1, -1])
def test_end_stop_with_loss_after_hunt_and_crossley(side: int) -> None:
    """v/c - ln(1 + c v)/c^2 + (k/m) (integral of the depth) stays: it has the same value before and after."""
    found = run("mechanics", "EndStop", IMPACT % (side, side, 0.8), 20e-3, points=2001)
    v = -side * found.final("v")
    c = 0.8

    def invariant(speed: float) -> float:
        return speed / c - math.log1p(c * speed) / c**2

    near(v, -brentq(lambda s: invariant(s) - invariant(1.0), -1.0, -0.1, xtol=1e-16, rtol=1e-14))
    assert np.all(side * found["force"] >= 0)  # it never pulls


# ---------------------------------------------------------------------- on mechanisms


def test_a_bowling_ball_slides_and_then_rolls() -> None:
    """Closed form: friction takes 2/7 of its speed, in any direction; then it rolls, without loss."""
    found = run(
        "mechanics", "GroundBall",
        """
        multibody m : spatial {
          gravity = (0, 0, -9.81 [m/s^2])
          body marble { mass = 2 kg, inertia = 0.008 [kg*m^2]*(1, 1, 1), at = (1 m, 0, 0.1 m), start x.v = 0.3 [m/s], start y.v = -0.4 [m/s], start z = 0.1 m - 20.12 um }
        }
        GroundBall floor { mu = 0.3, v_0 = 1e-5 [m/s], loss = 0 }
        m.marble => floor.ends
        output vx = m.marble.x.v, vy = m.marble.y.v, wx = m.marble.rx.omega, wy = m.marble.ry.omega, N = floor.load
        """,
        0.4, rtol=1e-7, energy=True,
    )  # fmt: skip
    slides = found.time < 2 * 0.5 / (7 * 0.3 * 9.81) - 1e-3
    fast = np.where(slides, 0.5 - 0.3 * 9.81 * found.time, 0.5 * 5 / 7)
    late = slides | (found.time > 0.1)
    for name, share in (("vx", 0.6), ("vy", -0.8)):
        near(found[name][late], share * fast[late], scale=1, rtol=1e-6)
    near(found["wy"][-1], found["vx"][-1] / 0.1, scale=1, rtol=1e-6)
    near(found["wx"][-1], -found["vy"][-1] / 0.1, scale=1, rtol=1e-6)
    near(found["N"], np.full(len(found.time), 2 * 9.81), rtol=1e-6)
    assert found.energy is not None
    lost = {e.name: e.dissipated for e in found.energy.elements}["floor.friction"]
    near(lost, 2 / 7 * 0.5 * 2 * 0.25, rtol=1e-6)
    assert abs(found.energy.residual) < 1e-6


def test_a_box_on_two_feet_slides_upright() -> None:
    """Closed form: friction at the feet shifts the load to the front one by m mu g h over their distance; thrown up it leaves the ground."""
    bench = """
        multibody m : planar {{
          gravity = (0, -9.81 [m/s^2])
          body box {{ mass = 3 kg, inertia = 0.05 [kg*m^2], at = (0, 0.2 m), start x.v = 2 [m/s], start y.v = {up} [m/s] }}
          frame back : box {{ at = (-0.25 m, 0) }}
          frame front : box {{ at = (0.25 m, 0) }}
        }}
        GroundPoint one {{ mu = 0.25, k = 1e5 [N/m], loss = 20 [s/m] }}
        GroundPoint two {{ mu = 0.25, k = 1e5 [N/m], loss = 20 [s/m] }}
        m.back.x -> one.x
        m.back.y -> one.y
        m.front.x -> two.x
        m.front.y -> two.y
        output v = m.box.x.v, back = one.load, front = two.load, y = m.box.y
        """
    found = run("mechanics", "GroundPoint", bench.format(up=0), 0.6, rtol=1e-6)
    mean, shift = 3 * 9.81 / 2, 3 * 0.25 * 9.81 * 0.2 / 0.5
    assert found["front"][-1] == pytest.approx(mean + shift, rel=2e-3)
    assert found["back"][-1] == pytest.approx(mean - shift, rel=2e-3)
    assert found["v"][-1] == pytest.approx(2 - 0.25 * 9.81 * 0.6, abs=2e-3)
    flies = run("mechanics", "GroundPoint", bench.format(up=1.5), 0.2, rtol=1e-8)
    near(flies["y"], 0.2 + 1.5 * flies.time - 9.81 / 2 * flies.time**2, rtol=1e-8)
    exact(flies["front"] + flies["back"], np.zeros(len(flies.time)))


@pytest.mark.parametrize("share", [0.2, 1.0, 5.0])
def test_a_beam_with_a_mass_at_its_tip_has_its_frequencies(share: float) -> None:
    """Against 1 + cos b cosh b + M/m b (cos b sinh b - sin b cosh b) = 0: the first two, which its four modes and the rest make."""
    model = bondgraph.load(
        text("mechanics", "Cantilever", f"Cantilever beam {{ zeta = 0 }}\nI tip : p = {0.2 * share} kg*v\n1(tip) -> beam.tip\noutput x = beam.deflection"),
        "Bench",
    )  # fmt: skip

    def missed(b: float) -> float:
        return float(1 / math.cosh(b) + math.cos(b) + share * b * (math.cos(b) * math.tanh(b) - math.sin(b)))

    for low, high, rtol in ((0.3, 1.8751, 1e-6), (3.2, 4.7, 1e-3)):
        exact_b = brentq(missed, low, high, xtol=1e-14)
        wanted = exact_b**2 * math.sqrt(20 / 0.5**3 / 0.2) / (2 * math.pi)
        assert np.abs(model.modes().frequencies / wanted - 1).min() < rtol


def test_a_rope_goes_slack_and_catches() -> None:
    """A weight that is thrown up flies freely until the rope is tight again; the other stands on a soft spring."""
    found = run(
        "mechanics", "Rope",
        """
        Se weight : F = 9.81 N
        I mass : p = 1 kg*v { start v = -2 [m/s] }
        Sf post : v = 0
        Rope rope { length = 0, r = 0, k = 1e4 [N/m] }
        weight -> 1(mass) -> rope.a
        post -> rope.b
        output v = mass.v, T = rope.pull
        """,
        0.4,
    )  # fmt: skip
    near(found["v"], -2 + 9.81 * found.time)
    exact(found["T"], np.zeros(len(found.time)))


def test_a_rope_over_a_pulley_of_a_mechanism_counts_from_its_length() -> None:
    """Its strands are distances, which are 2 m together where it is drawn: without a length it would pull by 100 kN."""
    found = run(
        "mechanics", "Rope",
        """
        multibody hoist : planar {
          gravity = (0, -9.81 [m/s^2])
          frame top  : ground { at = (0, 0) }
          body left  { mass = 2 kg, at = (0, -1 m) }
          body right { mass = 1 kg, at = (0, -1 m) }
          slide one  : ground to left { along = (0, 1) }
          slide two  : ground to right { along = (0, 1) }
          distance d : top to left
          distance e : top to right
        }
        Rope rope { length = 2 m - 13.08e-5 m }
        hoist.d -> rope.a
        hoist.e -> rope.b
        output v = hoist.one.x.v, T = rope.pull
        """,
        0.3,
    )  # fmt: skip
    near(found["v"], -9.81 / 3 * found.time)
    near(found["T"], 13.08 + 0 * found.time)


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("load", "along", "aside", "turn"), [(1.0, 0.94357, 0.30172, 0.46135), (5.0, 0.61237, 0.71379, 1.21537)]
)
def test_a_beam_chain_bends_as_the_elastica(load: float, along: float, aside: float, turn: float) -> None:
    """K. Mattiasson 1981, a force F across the tip: digits for F l^2/EI. Of 5 and 10 short beams the error falls by 4, and is extrapolated."""
    text_of = """
        Se across : F = {load} N
        Se none : F = 0 N
        Se no : M = 0 [N*m]
        BeamChain beam {{ l = 1 m, EI = 1 [N*m^2], EA = 1 [MN], m = 1 kg, n = {n}, tau = 1 s }}
        none -> beam.tip.x; across -> beam.tip.y; no -> beam.tip.phi
        output x = beam.along, y = beam.aside, turn = beam.turn
        """
    found = []
    for n in (5, 10):
        still = bondgraph.load(text("mechanics", "BeamChain", text_of.format(load=load, n=n)), "Bench").equilibrium()
        found.append(np.array([still["x"], still["y"], still["turn"]]))
    exact = np.array([along, aside, turn])
    assert np.abs(found[1] - exact).max() < 3e-3
    np.testing.assert_allclose((4 * found[1] - found[0]) / 3, exact, atol=1e-4)


def test_a_torque_converter_passes_its_coupling_point() -> None:
    """The published fits do not meet there: between jumping torques the turbine cannot go on."""
    found = run(
        "drivetrain", "TorqueConverter",
        """
        TorqueConverter part
        Se engine : M = 150 [N*m]
        I pump    : L = 0.2 [kg*m^2]*omega { start omega = 80 [1/s] }
        I turbine : L = 2 [kg*m^2]*omega
        engine -> 1(pump) -> part.pump
        part.turbine -> turbine
        output ratio = turbine.omega/pump.omega, M_p = part.pump.M, M_t = part.turbine.M
        """,
        to=5,
    )  # fmt: skip
    assert 0.91 < found.final("ratio") < 1 and found.final("M_p") > 0 < found.final("M_t")
