"""Mechanisms of the gallery in space and with closed loops, against equations that know one coordinate, or all of them written by hand."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import bondgraph
from tests.compiling import Running, compiled
from tests.gallery.reference import GALLERY, integrated, near, run
from tests.multibody.newton_euler import Oracle, turn

Vector = np.ndarray  # type: ignore[type-arg]
G = 9.81


def smooth(t: float, end: float) -> float:
    s = min(max(t / end, 0.0), 1.0)
    return 6 * s**5 - 15 * s**4 + 10 * s**3


def slope(f: Callable[[Any], Any], q: float) -> Any:
    """f'(q), exactly to round-off."""
    return np.imag(f(q + 1e-30j)) / 1e-30


def bend(f: Callable[[float], Any], q: float, h: float = 4e-3) -> Any:
    """Slope of a function without complex argument, to 1e-12."""
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    return sum(w * (f(q + n * h) - f(q - n * h)) for n, w in weights.items()) / h


# --- coin -------------------------------------------------------------------------------------------------------------------------


def test_coin_goes_round_in_a_circle() -> None:
    """Of radius r*spin/turn, at one lean and one load."""
    found, lean, turn, r = run("coin", "circle"), np.radians(30), 8.0, 0.012
    spin = (r * turn**2 * np.cos(lean) - 4 * G) * np.sin(lean) / (6 * r * turn * np.cos(lean))
    radius, angle = r * spin / turn, turn * found.time
    near(found["x"], radius * np.sin(angle))
    near(found["y"], radius * (1 - np.cos(angle)))
    near(found["tilt"], np.full(len(found.time), lean))
    near(found["load"], np.full(len(found.time), 0.0075 * G))


def test_coin_stays_up_when_it_is_fast() -> None:
    """A small lean swings: twice as large at the most as the lean of the steady motion that goes round with the momentum at the start."""
    speeds = [np.sqrt(G / (3 * 0.012)) * share for share in (1.5, 0.9)]
    stays, falls = (run("coin", "straight", settings={"spin": s, "lean": 1e-6}, to=1.0)["tilt"] for s in speeds)
    size = (1 - 0.25 * G / 0.012 / (0.75 * speeds[0] ** 2)) ** -1  # restoring terms by the lean, and all of them
    assert np.abs(stays).max() < 3 * size * 1e-6 and np.abs(falls).max() > 1e-3


# --- gyroscope --------------------------------------------------------------------------------------------------------------------


def lagrange_top(speed: float, around: float, times: Any) -> tuple[Vector, Vector]:
    """Of the top: way, elevation, its rate; and how fast it goes round. Two momenta stay: about the axle and about the post.

    I e'' = -I w^2 sin e cos e + p w cos e - m g l cos e, with I w cos^2 e + p sin e the momentum about the post, p that about the axle.
    """
    m, l, spin = 0.2, 0.05, 3e-4
    across = 1.8e-4 + m * l * l
    axle, post = spin * speed, across * around

    def omega(e: Any) -> Any:
        return (post - axle * np.sin(e)) / (across * np.cos(e) ** 2)

    def rates(t: float, y: Vector) -> tuple[float, ...]:
        _, e, v = y
        w = omega(e)
        return w, v, (-across * w * w * np.sin(e) + axle * w - m * G * l) * np.cos(e) / across

    exact = integrated(rates, (0, 0, 0), times)
    return exact, omega(exact[:, 1])


def test_gyroscope_nods_as_it_goes_round() -> None:
    found = run("gyroscope", "let_go", to=0.3)
    exact, omega = lagrange_top(300.0, 0.0, found.time)
    near(found["way"], exact[:, 0])
    near(found["nod"], exact[:, 1])
    near(found["omega"], omega)
    near(found["axle"], 300.0 - omega * np.sin(exact[:, 1]))


def test_depth_of_the_nod() -> None:
    """It turns back where the energy of going round is that of the fall: (p u)^2 = 2 m g l I u (1 - u^2), u = -sin e."""
    found = run("gyroscope", "let_go", to=0.2, points=4001)
    m, l, axle = 0.2, 0.05, 3e-4 * 300
    c = axle**2 / (2 * m * G * l * (1.8e-4 + m * l * l))
    deepest = -np.arcsin((np.sqrt(c * c + 4) - c) / 2)
    assert found["nod"].min() == pytest.approx(deepest, rel=1e-5)  # between instants
    assert found["nod"].max() < 1e-9


def test_gyroscope_goes_round_level() -> None:
    """m g l = spin speed w: the load is the weight, and the way grows evenly."""
    found = run("gyroscope", "steady")
    w = 0.2 * G * 0.05 / (3e-4 * 300)
    near(found["way"], w * found.time)
    near(found["load"], np.full(len(found.time), 0.2 * G))
    assert np.abs(found["nod"]).max() < 1e-12


# --- loops with one coordinate ----------------------------------------------------------------------------------------------------


def four_bar(q: Any) -> tuple[Any, Any]:
    """The pins of crank and rocker: where two circles meet, on the upper side."""
    ground, crank, coupler, rocker = 0.5, 0.15, 0.45, 0.35
    first = np.array([crank * np.cos(q), crank * np.sin(q)])
    x, y = ground - first[0], -first[1]
    square = x * x + y * y
    share = (square + coupler**2 - rocker**2) / (2 * square)
    height = np.sqrt(coupler**2 / square - share**2)
    return first, first + np.array([share * x - height * y, share * y + height * x])


def test_four_bar() -> None:
    """I(q) w' + I'(q) w^2/2 + V'(q) = torque of the shaft - loss of the rocker's bearing; bars by the speeds of their ends."""
    rho, ground = 3.0, 0.5
    masses = rho * 0.15, rho * 0.45, rho * 0.35

    def rocking(q: Any) -> Any:
        _, c = four_bar(q)
        return np.arctan2(np.real(c[1]), np.real(c[0]) - ground)

    def rate(q: float) -> tuple[Vector, Vector, float]:
        b, c = slope(lambda z: four_bar(z)[0], q), slope(lambda z: four_bar(z)[1], q)
        arm = four_bar(q)[1] - np.array([ground, 0.0])
        return b, c, float(arm[0] * c[1] - arm[1] * c[0]) / 0.35**2

    def inertia(q: float) -> float:
        b, c, _ = rate(q)
        return float(masses[0] * b @ b + masses[1] * (b @ b + b @ c + c @ c) + masses[2] * c @ c) / 3

    def rates(t: float, y: Vector) -> tuple[float, ...]:
        q, w, twist = y
        b, c, rocker = rate(q)
        relative = 20 * smooth(t, 0.5) - w
        weight = G * (masses[0] * b[1] + masses[1] * (b[1] + c[1]) + masses[2] * c[1]) / 2
        torque = 200 * twist + 2 * relative - 0.05 * rocker**2 * w - weight
        return w, (torque - bend(inertia, q) * w * w / 2) / inertia(q), relative

    found = run("four_bar", to=0.8, rtol=1e-8)
    exact = integrated(rates, (0, 0, 0), found.time, (0.5,))
    near(found["angle"], exact[:, 0], margin=1000)
    near(found["omega"], exact[:, 1], margin=1000)
    near(found["swing"], [rocking(q) - rocking(0.0) for q in exact[:, 0]], margin=1000)
    assert found["swing"].max() - found["swing"].min() > np.radians(50)


def spatial_linkage(q: Any) -> tuple[Any, Any]:
    """The crank's pin and the slider's."""
    pin = np.array([0 * q, 0.1 - 0.08 * np.sin(q), 0.12 + 0.08 * np.cos(q)])
    return pin, np.array([np.sqrt(0.09 - pin[1] ** 2 - pin[2] ** 2), 0 * q, 0 * q])


def test_spatial_slider_crank() -> None:
    """One coordinate: the rod's inertia from the speeds of its ends, and its turn about itself from the universal joint, whose axes stay square."""
    inertia, m_rod, m, j_rod = 2e-3, 0.3, 0.6, 2e-5
    beside = np.array([0, 0.1, 0.2]) / np.hypot(0.1, 0.2)  # the joint's axis on the slider, which never turns
    square = np.cross(np.eye(3), beside)

    def axis(q: Any) -> Any:
        pin, end = spatial_linkage(q)
        n = (end - pin) @ square
        return n / np.sqrt(n @ n)

    def moving(q: float) -> tuple[Vector, Vector, float]:
        pin, end = spatial_linkage(q)
        along = (end - pin) / 0.3
        return (
            slope(lambda z: spatial_linkage(z)[0], q),
            slope(lambda z: spatial_linkage(z)[1], q),
            float(np.linalg.det([slope(axis, q), along, axis(q)])),
        )

    def mass(q: float) -> float:
        p, e, spin = moving(q)
        return float(inertia + m_rod / 3 * (p @ p + p @ e + e @ e) + j_rod * spin**2 + m * e @ e)

    def rates(t: float, y: Vector) -> tuple[float, ...]:
        q, w = y
        torque = 0.5 if t < 0.5 else 0.0
        weight = m_rod * G * moving(q)[0][2] / 2
        return w, (torque - weight - bend(mass, q) * w * w / 2) / mass(q)

    found = run("spatial_slider_crank", to=0.7, rtol=1e-8)
    exact = integrated(rates, (0, 0), found.time, (0.5,))
    near(found["angle"], exact[:, 0], margin=1000)
    near(found["omega"], exact[:, 1], margin=1000)
    start = spatial_linkage(0.0)[1][0]
    near(found["x"], [spatial_linkage(q)[1][0] - start for q in exact[:, 0]], margin=1000)


# --- robot arm --------------------------------------------------------------------------------------------------------------------

AXES = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1)]
PINS = [(0, 0, 0), (0, 0, 0), (0, 0, 0.43), (0, 0, 0.86), (0, 0, 0.86), (0, 0, 0.86)]
LINKS = [  # mass, centre, principal inertias
    (13, (0, 0, 0), (0.3, 0.3, 0.35)),
    (17.4, (0.006, 0.016, 0.068), (0.524, 0.539, 0.13)),
    (4.8, (0, -0.014, 0.5), (0.066, 0.078, 0.0125)),
    (0.82, (0, 0, 0.841), (1.8e-3, 1.8e-3, 1.3e-3)),
    (0.34, (0, 0, 0.86), (0.3e-3, 0.3e-3, 0.4e-3)),
    (2.09, (0, 0, 0.92), (2e-3, 2e-3, 1e-3)),
]


def arm_poses(q: Any) -> list[tuple[Any, Any]]:
    """Products of turns about the axes that were drawn."""
    place, around, found = np.zeros(3), np.eye(3), []
    for angle, axis, pin, (_, centre, _) in zip(q, AXES, PINS, LINKS, strict=True):
        place = place + around @ np.asarray(pin)
        around = around @ turn(axis, angle)
        place = place - around @ np.asarray(pin)
        found.append((place + around @ np.asarray(centre), around))
    return found


def test_robot_arm_accelerates_as_newton_and_euler_say() -> None:
    """Rotors count with the square of their gear; motors give what the controller wants, up to their limit."""
    oracle = Oracle(arm_poses, [m for m, _, _ in LINKS], [np.diag(j) for _, _, j in LINKS], (0, 0, -G))
    running = Running(compiled(GALLERY / "robot_arm.bg", free=("pace",)))
    goal = np.radians([60, 50, -70, 40, 30, 90])
    rotors = 60**2 * np.array([2e-4] * 3 + [3e-5] * 3)
    k_p, k_d = np.array([2000, 5000, 2000, 100, 100, 100]), np.array([200, 400, 150, 5, 5, 5])
    most, friction = np.array([200, 300, 150, 30, 30, 30]), np.array([2, 2, 2, 0.2, 0.2, 0.2])
    random = np.random.default_rng(5)
    for _ in range(4):
        q, v = random.uniform(-1, 1, 6), random.uniform(-2, 2, 6)
        state = {f"arm.j[{i + 1}].phi": q[i] for i in range(6)} | {f"arm.j[{i + 1}].phi.omega": v[i] for i in range(6)}
        rates = running.rates(state, inputs={"pace": 0.7})
        found = np.array([rates[f"arm.j[{i + 1}].phi.omega"] for i in range(6)])
        torque = most * np.tanh((k_p * (0.7 * goal - q) - k_d * v) / most) - friction * v
        np.testing.assert_allclose(oracle.accelerations(q, v, torque - rotors * found), found, rtol=1e-8, atol=1e-7)


def test_robot_arm_rests_where_its_motors_hold_it() -> None:
    """At the end the motors' torques are those of the weights, about each axis."""
    model = bondgraph.load(GALLERY / "robot_arm.bg")
    found = model.simulate(to=6.0, points=3, rtol=1e-8, outputs=model.outputs)
    q = np.array([found.final(f"phi{i}") for i in range(1, 7)])
    weights = [
        sum(m * G * slope(lambda z, i=i, k=k: arm_poses([z if n == i else x for n, x in enumerate(q)])[k][0][2], q[i])
            for k, (m, _, _) in enumerate(LINKS))
        for i in range(3)
    ]  # fmt: skip
    for i in range(3):
        assert found.final(f"torque{i + 1}") == pytest.approx(weights[i], rel=1e-5, abs=1e-4)


# --- car --------------------------------------------------------------------------------------------------------------------------


def test_car() -> None:
    """The body's pose, two strokes along the body's axes, two turning wheels: Newton's law through the slopes of the hubs' places."""
    m, j, m_w, j_w, radius, height = 1200.0, 1800.0, 80.0, 1.6, 0.3, 0.55
    place = np.array([1.1, -1.5])
    weight = m * G * np.array([1.5, 1.1]) / 2.6
    k, r, most = np.array([4e4, 3.5e4]), np.array([3500.0, 3000.0]), np.array([2500.0, 1800.0])

    def hubs(y: Vector) -> list[tuple[Vector, Vector, Vector]]:
        """Position, its derivatives by (x, y, phi, s1, s2), and its acceleration at zero second derivatives of the coordinates."""
        c, s = np.cos(y[2]), np.sin(y[2])
        found = []
        for i in (0, 1):
            drop = radius - height + y[3 + i]
            arm = np.array([c * place[i] - s * drop, s * place[i] + c * drop])
            along, across = np.array([-s, c]), np.array([-arm[1], arm[0]])
            slopes = np.zeros((2, 5))
            slopes[:, :2], slopes[:, 2], slopes[:, 3 + i] = np.eye(2), across, along
            w, v = y[9], y[10 + i]
            found.append((y[:2] + arm, slopes, -w * w * arm + 2 * w * v * np.array([-c, -s])))
        return found

    def rates(t: float, y: Vector) -> Vector:  # y: 5 coordinates, 2 angles of wheels, and their rates
        v, spins = y[7:12], y[12:14]
        mass = np.diag([m, m, j, 0.0, 0.0])
        force = np.array([0, -m * G, 0, 0, 0.0])
        turning = np.zeros(2)
        for i, (at, slopes, bias) in enumerate(hubs(y)):
            speed = slopes @ v
            pressed = weight[i] + m_w * G - 4e5 * (at[1] - radius)
            spring = max(pressed, 0.0)
            slip = speed[0] + radius * spins[i]
            grip = 0.9 * spring * np.sin(1.6 * np.arctan(10 * slip / max(abs(speed[0]), 1.0)))
            brake = most[i] * smooth(t, 0.3) * np.tanh((spins[i] - v[2]) / 0.5)
            mass += m_w * slopes.T @ slopes
            force += slopes.T @ (np.array([-grip, spring - 500 * speed[1] - m_w * G]) - m_w * bias)
            force[3 + i] -= weight[i] + k[i] * y[3 + i] + r[i] * v[3 + i]
            force[2] += brake
            turning[i] = (-brake - radius * grip) / j_w
        return np.concatenate([v, spins, np.linalg.solve(mass, force), turning])

    found = run("car", to=1.0)
    start = np.zeros(14)
    start[1], start[7], start[12:] = height, 25.0, -25 / radius
    exact = integrated(rates, start, found.time, (0.3,), "Radau")
    assert found["press_front"].min() > 0 and found["press_rear"].min() > 0
    for name, column in (("x", 0), ("y", 1), ("dip", 2), ("v", 7)):
        near(found[name], exact[:, column], margin=1000)
    near(found["omega_front"], -exact[:, 12], margin=1000)
    near(found["omega_rear"], -exact[:, 13], margin=3000)
    assert found.final("omega_rear") < 1.0 < found.final("omega_front"), "the rear locks, the front goes on rolling"


# --- six axes ---------------------------------------------------------------------------------------------------------------------


def six_axes() -> tuple[Vector, Vector]:
    """Masses and stiffness for small motions: shuttles c 1..3, platform x y phi, legs 1..3, top x y z rx ry rz."""
    p, l_s, l_f, h, a, s, b, over = 0.72, 1e-3, 400e-6, 38e-6, 170e-6, 0.5e-3, 120e-6, 15e-6
    m_s, m_p, i_z, m_l, m_t, i_t = 40.373233e-9, 2.108492e-9, 2.94e-17, 0.2e-9, 0.8e-9, 4e-18
    d, young = np.array([1.95, 1.75, 1.75]) * 1e-6, np.array([130, 158, 158]) * 1e9
    mass, stiffness = np.zeros((15, 15)), np.zeros((15, 15))
    np.fill_diagonal(mass, [m_s] * 3 + [m_p, m_p, i_z] + [0] * 3 + [m_t] * 3 + [i_t, i_t, 2 * i_t])

    def spring(k: float, **terms: tuple[tuple[int, float], ...]) -> None:
        row = np.zeros(15)
        for place, factor in terms["of"]:
            row[place] += factor
        stiffness[:] += k * np.outer(row, row)

    for i in range(3):
        angle = np.radians(120 * i)
        second, area = h * d[i] ** 3 / 12, h * d[i]
        out, side = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        spring(48 * young[i] * second / l_f**3, of=((i, 1.0),))
        spring(young[i] * second / l_s / (1 - p), of=((5, 1.0),))
        # the end of the flexure, a out and s against the shuttle's way: turning by phi moves it by s out and a aside
        spring(12 * young[i] * second / l_s**3 / (1 - p**3), of=((3, out[0]), (4, out[1]), (5, s)))
        spring(young[i] * area / l_s / (1 - p), of=((3, side[0]), (4, side[1]), (5, a), (i, -1.0)))
        # a leg goes with the platform and rises from it
        rise, leg = 6 + i, np.zeros((3, 15))
        leg[0, 3], leg[1, 4], leg[0, 5], leg[1, 5], leg[2, rise] = 1, 1, -b * out[1], b * out[0], 1
        mass += m_l * leg.T @ leg
        spring(1.5, of=((rise, 1.0),))
        # the leaf's end on the top lies b out and `over` below its centre: moved by turn x arm
        arm = np.array([b * out[0], b * out[1], -over])
        top = np.zeros((3, 15))
        top[:, 9:12] = np.eye(3)
        for n in range(3):
            top[:, 12 + n] = np.cross(np.eye(3)[n], arm)
        gap, turned = top - leg, np.zeros((3, 15))
        turned[:, 12:] = np.eye(3)
        turned[2, 5] -= 1
        axes = np.array([[*out, 0], [*side, 0], [0, 0, 1]])
        for k, row in zip((0.5, 1500, 1500, 4e-9, 1e-9, 2e-8), np.vstack([axes @ gap, axes @ turned]), strict=True):
            stiffness += k * np.outer(row, row)
    return mass, stiffness


def test_six_axes_ring_as_masses_on_springs() -> None:
    """Fifteen freedoms without losses: w^2 M = K."""
    mass, stiffness = six_axes()
    exact = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real))
    running = Running(compiled(GALLERY / "six_axes.bg", {"r": "0 [N*s/m]", "r_t": "0 [N*s/m]"}))
    slopes = running.program.jacobian(*running.arguments(0.0, None, None))
    found = np.sort(np.abs(np.linalg.eigvals(slopes).imag))[-30::2]
    np.testing.assert_allclose(found, exact, rtol=1e-6)


def test_six_axes_give_way_to_a_small_force() -> None:
    """A nanonewton held on the top moves it by K^-1 F, as soon as all is at rest."""
    _, stiffness = six_axes()
    load = np.zeros(15)
    load[9], load[11], load[12] = 4e-10, 8e-10, 4e-15
    still = np.linalg.solve(stiffness, load)
    model = bondgraph.load(GALLERY / "six_axes.bg")
    ramp = "*smoothstep5(time, 0 s, 20 ms)"
    settings = {"fx": f"0.4 nN{ramp}", "fz": f"0.8 nN{ramp}", "mx": f"4e-15 [N*m]{ramp}", "r": "3e-4 [N*s/m]"}
    found = model.simulate(None, settings, to=0.15, points=2, rtol=1e-8, outputs=model.outputs)
    for name, place in (
        ("x", 9),
        ("y", 10),
        ("z", 11),
        ("rx", 12),
        ("ry", 13),
        ("rz", 14),
        ("under", 3),
        ("leg1", 6),
        ("c2", 1),
    ):
        kind = still[12:] if name[0] == "r" else still[:12]
        assert found.final(name) == pytest.approx(still[place], abs=1e-5 * np.abs(kind).max())
