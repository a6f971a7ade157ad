"""Mechanisms of the gallery against Lagrange's equations, written by hand; and control around them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

import bondgraph
from tests.gallery.reference import GALLERY, driven, integrated, near, run

Vector = np.ndarray  # type: ignore[type-arg]


def test_double_pendulum() -> None:
    """Two equal rods, half of each length to its centre, angles p, q of the rods from the horizontal; d = p - q:

    4/3 p'' + 1/2 cos(d) q'' = -1/2 sin(d) q'^2 - 3/2 g cos(p)
    1/2 cos(d) p'' + 1/3 q'' =  1/2 sin(d) p'^2 - 1/2 g cos(q)      (m = l = 1)
    """
    g = 9.81

    def rates(t: float, y: Vector) -> tuple[float, ...]:
        p, q, p1, q1 = y
        d = p - q
        mass = np.array([[4 / 3, np.cos(d) / 2], [np.cos(d) / 2, 1 / 3]])
        force = [-np.sin(d) * q1**2 / 2 - 1.5 * g * np.cos(p), np.sin(d) * p1**2 / 2 - g * np.cos(q) / 2]
        return (p1, q1, *np.linalg.solve(mass, force))

    found = run("pendulum", to=2.0)  # it is chaotic: later, all errors grow
    exact = integrated(rates, (0, 0, 0, 0), found.time)
    near(found["upper"], exact[:, 0])
    near(found["lower"], exact[:, 1])
    near(found["x"], np.cos(exact[:, 0]) + np.cos(exact[:, 1]) / 2)
    near(found["y"], np.sin(exact[:, 0]) + np.sin(exact[:, 1]) / 2)


def test_crane() -> None:
    """(M + m) x'' + m l (q'' cos q - q'^2 sin q) = F - r x', l q'' + x'' cos q + g sin q = 0."""
    big, m, l, g, r = 400.0, 150.0, 6.0, 9.81, 120.0

    def rates(t: float, y: Vector) -> tuple[float, ...]:
        _, q, v, w = y
        force = 300.0 if 1 <= t < 5 else 0.0
        mass = np.array([[big + m, m * l * np.cos(q)], [np.cos(q), l]])
        return (v, w, *np.linalg.solve(mass, [force - r * v + m * l * w * w * np.sin(q), -g * np.sin(q)]))

    found = run("crane", energy=True)
    exact = integrated(rates, (0, 0, 0, 0), found.time, (1, 5))
    near(found["x"], exact[:, 0])
    near(found["swing"], exact[:, 1])
    near(found["x_load"], exact[:, 0] + l * np.sin(exact[:, 1]))
    assert found.energy is not None
    assert abs(found.energy.residual) < 1e-7 * found.energy.supplied


def test_slider_crank_keeps_its_energy() -> None:
    """1/2 (J + m (dx/dphi)^2) omega^2 stays: omega is known at every angle, and the time to get there is an integral."""
    r, l, inertia, m, omega_0, phi_0 = 0.04, 0.13, 5e-3, 0.8, 60.0, 0.3

    def slope(phi: float | Vector) -> float | Vector:
        return -r * np.sin(phi) - r * r * np.sin(phi) * np.cos(phi) / np.sqrt(l * l - (r * np.sin(phi)) ** 2)

    def speed(phi: float | Vector) -> float | Vector:
        return omega_0 * np.sqrt((inertia + m * slope(phi_0) ** 2) / (inertia + m * slope(phi) ** 2))

    found = run("slider_crank", points=101)
    near(found["omega"], speed(found["angle"]))
    near(found["v"], slope(found["angle"]) * found["omega"])
    near(found["x"], r * np.cos(found["angle"]) + np.sqrt(l * l - (r * np.sin(found["angle"])) ** 2))
    took, _ = quad(lambda phi: 1 / speed(phi), phi_0, found.final("angle"), epsabs=0, epsrel=1e-12, limit=500)
    assert took == pytest.approx(0.5, rel=1e-7)


def test_crank_linkage_moves_as_its_closed_form() -> None:
    """1/2 M(phi) omega^2 stays, with the rod's mass in it; the wrist holds what the piston's acceleration asks for."""
    r, l, inertia, m, rod, omega_0, phi_0 = 0.04, 0.13, 5e-3, 0.8, 0.2, 60.0, 0.3

    def slopes(phi: float | Vector) -> tuple[float | Vector, ...]:
        beta = np.arcsin(r * np.sin(phi) / l)
        turn = r * np.cos(phi) / (l * np.cos(beta))
        return -r * np.sin(phi) - r * np.cos(phi) * np.tan(beta), turn, -r * np.sin(phi) - 0.5 * l * np.sin(beta) * turn

    def whole(phi: float | Vector) -> float | Vector:
        piston, turn, middle = slopes(phi)
        return inertia + m * piston**2 + rod * (l**2 / 12 * turn**2 + middle**2 + (0.5 * r * np.cos(phi)) ** 2)

    found = run("crank_linkage", points=101)
    near(found["omega"], omega_0 * np.sqrt(whole(phi_0) / whole(found["angle"])))
    near(found["x"], r * np.cos(found["angle"]) + np.sqrt(l * l - (r * np.sin(found["angle"])) ** 2))


def test_robot_reaches_what_its_inverse_kinematics_say() -> None:
    """Forces along the legs on a platform: m (x, y)'' = sum f u, J phi'' = sum f (b x u), f = k (wanted - length) - r length'."""
    m, inertia, k, r = 2.0, 0.01, 4e4, 400.0
    around = np.radians([0, 120, 240])
    feet = 0.5 * np.stack([np.cos(around), np.sin(around)], axis=1)
    tips = 0.1 * np.stack([np.cos(around + np.pi / 6), np.sin(around + np.pi / 6)], axis=1)

    def placed(pose: Vector) -> Vector:  # the tips, seen from the platform's middle, in world axes
        c, s = np.cos(pose[2]), np.sin(pose[2])
        return np.stack([c * tips[:, 0] - s * tips[:, 1], s * tips[:, 0] + c * tips[:, 1]], axis=1)

    def lengths(pose: Vector) -> Vector:
        return np.hypot(*(placed(pose) + pose[:2] - feet).T)

    def goal(t: float) -> Vector:
        s = min(t / 0.2, 1.0)
        return np.array([0.06, -0.04, np.radians(10)]) * (6 * s**5 - 15 * s**4 + 10 * s**3)

    def rates(t: float, y: Vector) -> tuple[float, ...]:
        pose, rate = y[:3], y[3:]
        arm = placed(pose)
        leg = arm + pose[:2] - feet
        along = leg / np.hypot(*leg.T)[:, None]
        velocity = rate[:2] + rate[2] * np.stack([-arm[:, 1], arm[:, 0]], axis=1)
        force = k * (lengths(goal(t)) - np.hypot(*leg.T)) - r * (velocity * along).sum(axis=1)
        push = force[:, None] * along
        torque = (arm[:, 0] * push[:, 1] - arm[:, 1] * push[:, 0]).sum()
        return (*rate, *(push.sum(axis=0) / m), torque / inertia)

    found = run("inverse_kinematics")
    exact = integrated(rates, np.zeros(6), found.time, (0.2,))
    for name, column in (("x", 0), ("y", 1), ("phi", 2)):
        near(found[name], exact[:, column])
    for i in range(3):
        wanted = np.array([lengths(goal(t))[i] for t in found.time])
        near(found[f"stretch[{i + 1}]"], np.array([lengths(y[:3])[i] for y in exact]) - wanted, scale=0.5)
    assert found.final("x") == pytest.approx(0.06, rel=1e-6)
    assert found.final("y") == pytest.approx(-0.04, rel=1e-6)
    assert found.final("phi") == pytest.approx(np.radians(10), rel=1e-6)


# (current, speed of the load, its angle, lag of the derivative's filter, integral) of the servo
R, L, K, RATIO = 1.0, 0.5e-3, 0.05, 20
INERTIA, FRICTION = 2e-3 + RATIO**2 * 1e-5, 1e-3 + RATIO**2 * 1e-5  # of motor and load together, at the load
KP, KI, KD, LAG = 30.0, 60.0, 1.5, 2e-3


def command(y: Vector, goal: float) -> float:
    """The voltage that the controller wants; its derivative part does not see the setpoint."""
    return float(KP * (goal - y[2]) + KD * (-y[2] - y[3]) / LAG + y[4])


def servo(y: Vector, goal: float, torque: float, low: float = -np.inf, high: float = np.inf) -> Vector:
    """L i' = u - R i - K n w, (J_load + n^2 J) w' = n K i - (b_load + n^2 b) w + torque; the controller beside it."""
    wanted = command(y, goal)
    volt = min(max(wanted, low), high)
    windup = (volt - wanted) / 0.1
    turn = (RATIO * K * y[0] - FRICTION * y[1] + torque) / INERTIA
    return np.array(
        [(volt - R * y[0] - K * RATIO * y[1]) / L, turn, y[1], (-y[2] - y[3]) / LAG, KI * (goal - y[2]) + windup]
    )


def test_servo_small_step() -> None:
    """Linear, and constant between the steps at 0.05 s and 1 s: a matrix exponential on each stretch."""
    found = run("pid_dc_motor", "small_step", points=81)
    zero = np.zeros(5)
    a = np.stack([servo(e, 0, 0) for e in np.eye(5)], axis=1)
    step, push = servo(zero, 0.2, 0), servo(zero, 0.2, 2.0)
    t = found.time
    corner = driven(a, step, zero, (0.95,))[0]
    exact = np.concatenate(
        [
            np.zeros((int((t < 0.05).sum()), 5)),
            driven(a, step, zero, t[(t >= 0.05) & (t < 1)] - 0.05),
            driven(a, push, corner, t[t >= 1] - 1),
        ]
    )
    near(found["phi"], exact[:, 2])
    near(found["current"], exact[:, 0])
    goals = np.where(t >= 0.05, 0.2, 0.0)
    near(found["volt"], [command(y, goal) for y, goal in zip(exact, goals, strict=True)])
    near(found["error"], goals - exact[:, 2])


def test_servo_holds_its_place_against_a_torque() -> None:
    """The integral part leaves no error: at rest K n i = -torque, u = R i."""
    found = run("pid_dc_motor", "small_step", to=20.0)
    assert abs(found.final("error")) < 1e-8
    assert found.final("current") == pytest.approx(-2 / (K * RATIO), rel=1e-6)
    assert found.final("volt") == pytest.approx(-2 * R / (K * RATIO), rel=1e-6)


def test_servo_large_step_is_limited_and_does_not_wind_up() -> None:
    found = run("pid_dc_motor", "large_step", to=0.6, points=121)
    t = found.time

    def rates(time: float, y: Vector) -> Vector:
        return servo(y, 5.0 if time >= 0.05 else 0.0, 0.0, -24.0, 24.0)

    exact = integrated(rates, np.zeros(5), t, (0.05,), "LSODA")
    assert np.abs(found["phi"] - exact[:, 2]).max() < 1e-6 * 5  # the corners of the limiter are not located
    assert found["volt"].max() == 24.0
    assert found["volt"].min() >= -24.0
    assert found["phi"].max() < 5 * 1.2


@pytest.mark.parametrize(("experiment", "i_d"), [("start", 0.0), ("weaken", -3.0)])
def test_field_oriented_currents_answer_as_a_first_order(experiment: str, i_d: float) -> None:
    """What couples the axes is fed forward and the poles are cancelled: i = i_wanted (1 - exp(-t/T)); the torque is their product."""
    found = run("field_oriented", experiment)
    rise = 1 - np.exp(-found.time / 2e-3)
    near(found["current_d"], i_d * rise, scale=1)
    near(found["current_q"], 5 * rise)
    a, b = 4 * 5 * 0.02, 4 * 5 * i_d * (1e-3 - 1.5e-3)  # M = a rise + b rise^2
    near(found["torque"], a * rise + b * rise**2)
    terms = {0.0: a + b, 500.0: -a - 2 * b, 1000.0: b}  # of exp(-rate t)
    slow = 1e-3 / 2e-4
    speed = sum(c * (np.exp(-k * found.time) - np.exp(-slow * found.time)) / (slow - k) for k, c in terms.items())
    near(found["speed"], speed / 2e-4)


def test_sampled_servo() -> None:
    """Its states from sample to sample, exactly; both blocks act at one instant and read the values from before."""
    m, r, T = 0.5, 2.0, 2e-3
    a = np.exp(-r * T / m)
    A, B = np.array([[1, m / r * (1 - a)], [0, a]]), np.array([T / r - m / r**2 * (1 - a), (1 - a) / r])
    state, estimate, target, exact = np.zeros(2), np.zeros(2), 0.0, []
    for sample in range(601):
        exact.append(state)
        force = np.clip(200 * (target - estimate[0]) - 15 * estimate[1], -1, 1)
        estimate = A @ estimate + B * force + np.array([0.4, 30]) * (state[0] - estimate[0])
        state = A @ state + B * force
        target = 0.01 - target if sample % 200 == 0 else target
    result = run("sampled_servo", points=601)
    np.testing.assert_allclose(np.stack([result["x"], result["v"]], 1), exact, atol=1e-13)
    assert not result.notes


def test_predators_and_prey() -> None:
    """x' = 1.1 x - 0.4 x y, y' = 0.1 x y - 0.4 y; delta x - gamma ln x + beta y - alpha ln y stays."""

    def rates(t: float, y: Vector) -> tuple[float, float]:
        return 1.1 * y[0] - 0.4 * y[0] * y[1], 0.1 * y[0] * y[1] - 0.4 * y[1]

    found = run("lotka_volterra")
    exact = integrated(rates, (10, 10), found.time)
    near(found["x"], exact[:, 0])
    near(found["y"], exact[:, 1])
    first = 0.1 * 10 - 0.4 * np.log(10) + 0.4 * 10 - 1.1 * np.log(10)
    near(found["conserved"], np.full(len(found.time), first))


def test_stiffness_frames() -> None:
    """Closed forms of appendices A and B, and J q'' = -K_e q - tau K_e q' + F by the exponential of a hand-written matrix."""
    young, l, b, h, m, turning, tau, pull = 210e9, 0.1, 0.5e-3, 20e-3, 0.5, 2e-4, 0.5e-3, 1.0
    bending, along = young * h * b**3 / 12, young * b * h / l
    stiffness = np.array(
        [[4 * bending / l, 6 * bending / l**2], [6 * bending / l**2, 12 * bending / l**3]]
    )  # (B.11), phi and x
    inverted = np.diag([1 / turning, 1 / m])
    rates = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverted @ stiffness, -tau * inverted @ stiffness]])
    found = run("stiffness_frames")
    exact = driven(rates, [0, 0, 0, pull / m], [0, 0, 0, 0], found.time)
    phi, x, omega, speed = exact.T
    near(found["angle"], phi)
    near(found["x_e"], x)
    near(found["omega"], omega)
    near(found["u"], speed * np.cos(phi))  # (A.4) with y at rest, in the axes of the body
    near(found["v"], speed * np.sin(phi))
    for name in ("u_0", "u_tilde"):
        near(found[name], speed - omega * l)  # (A.8): y is the length of the spring
    for name in ("v_0", "v_tilde"):
        near(found[name], omega * x)
    near(found["power"], np.einsum("ti,ij,tj->t", exact[:, :2], stiffness, exact[:, 2:]))
    closed = {
        "k_phi": bending / l,
        "k_x": 12 * bending / l**3,
        "k_y": along,
        "same": 12 * bending / l**3,
        "other": -6 * bending / l**2,
    }
    assert {name: found.final(name) for name in closed} == pytest.approx(closed, rel=1e-12)  # (B.18), (B.28)
    assert abs(found.final("coupled")) < 1e-12 * bending / l**2
    held = bondgraph.load(GALLERY / "stiffness_frames.bg").equilibrium("held").outputs
    assert held["x_e"] == pytest.approx(pull * l**3 / (3 * bending), rel=1e-9)  # (B.8)
    assert held["angle"] == pytest.approx(-pull * l**2 / (2 * bending), rel=1e-9)
