"""Electric and magnetic circuits of the gallery: closed forms, and matrix exponentials of hand-written matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from tests.gallery.reference import driven, integrated, near, run


def test_a_gyrator_makes_a_coil_of_a_capacitor() -> None:
    """C1 u' = -u/R - u_2/g, C2 u_2' = u/g: u'' + 2 a u' + u/(g^2 C1 C2) = 0, 2 a = 1/(R C1); u(0) = U, u'(0) = -2 a U."""
    g, r, c_1, c_2 = 1e3, 5e4, 1e-6, 1e-8
    found = run("gyrator")
    a = 1 / (2 * r * c_1)
    w = np.sqrt(1 / (g * g * c_1 * c_2) - a * a)
    t = found.time
    near(found["u"], np.exp(-a * t) * (np.cos(w * t) - a / w * np.sin(w * t)))
    assert found.final("L") == pytest.approx(g * g * c_2, rel=1e-14)


def test_coupled_coils_beat() -> None:
    """In the sum of both circuits the coils count L + M, in the difference L - M: u = U/2 (cos w+ t +- cos w- t)."""
    slow, fast = (1 / np.sqrt((1e-3 + m) * 1e-7) for m in (5e-5, -5e-5))
    found = run("coupled_coils", to=5e-4, energy=True)
    t = found.time
    near(found["u_1"], 5 * (np.cos(slow * t) + np.cos(fast * t)))
    near(found["u_2"], 5 * (np.cos(slow * t) - np.cos(fast * t)))
    near(found["i_1"], -5e-7 * (slow * np.sin(slow * t) + fast * np.sin(fast * t)))
    assert found.energy is not None
    assert abs(found.energy.stored) < 1e-7 * 1e-7 * 100 / 2


@pytest.mark.parametrize("n", [1, 10, 25])
def test_ladder_by_its_modes(n: int) -> None:
    """u_i' = n^2/(R C) (u_(i-1) - 2 u_i + u_(i+1)), u_0 = 1, u_(n+1) = u_n.

    1 - u_i is a sum over sin(kappa i), kappa = (2 j - 1) pi/(2 n + 1), each falling with 4 n^2/(R C) sin^2(kappa/2); as the sum of
    the squares of a mode is (2 n + 1)/4, unity holds 4/(2 n + 1) sum_i sin(kappa i) of it.
    """
    found = run("rc_ladder", settings={"n": n})
    kappa = (2 * np.arange(1, n + 1) - 1) * np.pi / (2 * n + 1)
    places = np.arange(1, n + 1)
    share = 4 / (2 * n + 1) * np.sin(np.outer(kappa, places)).sum(axis=1)
    decay = np.exp(-np.outer(found.time, 4 * n * n / 1e-2 * np.sin(kappa / 2) ** 2))
    near(found["u_end"], 1 - decay @ (share * np.sin(kappa * n)))
    near(found["u_1"], 1 - decay @ (share * np.sin(kappa)))


def test_transformer_with_its_core() -> None:
    """n1 i1 = S Phi + S_a Phi_a, i2 = S_a Phi_a/n2; Phi' = (u - R1 i1)/n1, Phi_a' = Phi' - (R2 + R_L) i2/n2."""
    n_1, n_2, s, s_a, r_1, r_2, load = 200, 50, 4e5, 4e7, 2.0, 0.2, 8.0
    row = np.array([-r_1 * s / n_1**2, -r_1 * s_a / n_1**2])
    a = np.array([row, row - [0, (r_2 + load) * s_a / n_2**2]])
    found = run("transformer")
    w = 2 * np.pi * 50
    exact = driven(a, np.array([325 / n_1, 325 / n_1]), (0, 0), found.time, w)
    near(found["flux"], exact[:, 0])
    near(found["u_2"], load * s_a * exact[:, 1] / n_2)
    near(found["i_1"], (s * exact[:, 0] + s_a * exact[:, 1]) / n_1)


def test_an_ideal_transformer_is_what_remains_of_it() -> None:
    """Without reluctance (no magnetising current), leakage and winding resistance: u_2 = u n2/n1, i_1 = i_2 n2/n1."""
    ideal = {"reluctance": 1e-3, "leakage": 1e12, "R_1": 1e-9, "R_2": 1e-9, "volt": 200.0}
    found = run("transformer", None, settings=ideal, to=1e-3)
    assert found.final("u_2") == pytest.approx(50, rel=1e-6)
    assert found.final("i_1") == pytest.approx(50 / 8 / 4, rel=1e-6)


def test_active_filter_with_an_amplifier_of_finite_gain() -> None:
    """Kirchhoff at the summing node (w), at the output, and the amplifier's one pole (its slew rate is set out of reach).

    (u - w)/R1 - w/R_in = i, i = (w - u_c - v)/R_o (feedback through R_o), u_c' = (i - u_c/R2)/C, v' = -2 pi gbw (w + v/gain).
    """
    r_1, r_2, c, r_in, r_o, gbw, gain = 1e4, 2e4, 1e-8, 2e6, 75.0, 1e6, 2e5
    sum_ = 1 / r_1 + 1 / r_in + 1 / r_o
    w_of = np.array([1 / r_o, 1 / r_o, 1 / r_1]) / sum_  # of (u_c, v, u)
    i_of = (w_of - [1, 1, 0]) / r_o
    rows = np.array([(i_of - [1 / r_2, 0, 0]) / c, -2 * np.pi * gbw * (w_of + np.array([0, 1 / gain, 0]))])
    found = run("active_filter")
    frequency = 2 * np.pi * 500
    exact = driven(rows[:, :2], rows[:, 2], (0, 0), found.time, frequency)
    w = exact @ w_of[:2] + w_of[2] * np.sin(frequency * found.time)
    near(found["u_minus"], w, scale=2.0)
    near(found["u_out"], w - exact[:, 0])


def test_active_filter_is_nearly_ideal() -> None:
    """-R2/R1/(1 + s R2 C) to a thousandth, after the start has died away."""
    found = run("active_filter", points=801)
    late, w, tau = found.time > 5e-3, 2 * np.pi * 500, 2e-4
    ideal = np.imag(-2 / (1 + 1j * w * tau) * np.exp(1j * w * found.time))
    assert np.abs(found["u_out"] - ideal)[late].max() < 3e-3


def test_solenoid() -> None:
    """E = lambda^2 (1 + x/a)/(2 L0): lambda' = u - R i, i = lambda (1 + x/a)/L0; m v' = -lambda^2/(2 L0 a) - k (x - gap) - r v."""
    l_0, a, res, m, k, r, gap = 0.2, 2e-3, 12.0, 0.05, 400.0, 2.0, 4e-3

    def rates(t: float, y: np.ndarray) -> tuple[float, ...]:  # type: ignore[type-arg]
        u = 2.4 if 0.01 <= t < 0.15 else 0.0
        return (
            u - res * y[0] * (1 + y[1] / a) / l_0,
            y[2],
            (-(y[0] ** 2) / (2 * l_0 * a) - k * (y[1] - gap) - r * y[2]) / m,
        )

    found = run("solenoid", points=61, energy=True)
    exact = integrated(rates, (0, gap, 0), found.time, (0.01, 0.15))
    near(found["x"], exact[:, 1])
    near(found["i"], exact[:, 0] * (1 + exact[:, 1] / a) / l_0)
    near(found["pull"], exact[:, 0] ** 2 / (2 * l_0 * a))
    assert found.energy is not None
    assert abs(found.energy.residual) < 1e-7 * found.energy.supplied


def test_plate_goes_further_with_a_charge_than_with_a_voltage() -> None:
    """m x'' + r x' + k x = q^2/(2 eps A): quadratic in time while the current flows, then constant. Rest at 0.6 of the gap."""
    area, gap, eps, m, k, r = 1e-6, 3e-6, 8.8541878128e-12, 20e-9, 8.0, 2e-4
    charge, end = np.sqrt(2 * eps * area * k * 0.6 * gap), 1e-4
    a = np.array([[0, 1], [-k / m, -r / m]])
    found = run("plates", points=61, energy=True)
    t = found.time
    pull = charge**2 / (2 * eps * area)
    corner = driven(a, np.array([0, pull / end**2 / m]), (0, 0), (end,), powers=3)[0]
    first = driven(a, np.array([0, pull / end**2 / m]), (0, 0), t[t <= end], powers=3)
    second = driven(a, np.array([0, pull / m]), corner, t[t > end] - end)
    x = np.concatenate([first, second])[:, 0]
    near(found["x"], x)
    near(found["charge"], charge * np.minimum(t / end, 1))
    near(found["volt"], found["charge"] * (gap - x) / (eps * area))
    assert run("plates", to=0.02, points=2).final("share") == pytest.approx(0.6, rel=1e-7)
    assert found.energy is not None
    assert abs(found.energy.residual) < 1e-7 * found.energy.supplied


def test_bridge_rectifier() -> None:
    """Kirchhoff at both ends of the winding (a, b; `minus` is zero), each diode a depletion charge behind a resistance:

    (b - a + v)/R = i_1 - i_3 = i_4 - i_2, i_k = (u across k - u_k)/R_s, q_k' = i_k - I_s (exp(u_k/U_T) - 1),
    u_k = U_j (1 - (1 - q_k/(2 C_j U_j))^2) up to q_f, where the capacitance is sqrt(2) C_j, and straight on from there.
    """
    c, load, r, r_s, c_j, u_j, i_s = 470e-6, 200.0, 2.0, 0.1, 100e-9, 0.75, 1e-14
    u_t = 1.380649e-23 * 300.15 / 1.602176634e-19
    q_f, c_f = 2 * c_j * u_j * (1 - np.sqrt(0.5)), c_j * np.sqrt(2)
    matrix = np.array([[1 / r + 2 / r_s, -1 / r], [-1 / r, 1 / r + 2 / r_s]])  # of (a, b)

    def winding(t: float, y: np.ndarray) -> tuple[float, ...]:  # type: ignore[type-arg]
        """(current of the winding, its ends a and b, the diodes' voltages)."""
        q, plus, v = y[:4], y[4] / c, 17 * np.sin(2 * np.pi * 50 * t)
        u = u_j * (1 - (1 - np.minimum(q, q_f) / (2 * c_j * u_j)) ** 2) + np.maximum(q - q_f, 0) / c_f
        a, b = np.linalg.solve(matrix, [v / r + (plus + u[0] - u[2]) / r_s, -v / r + (plus + u[1] - u[3]) / r_s])
        return ((b - a + v) / r, a, b, *u)

    def rates(t: float, y: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
        _, a, b, *u = winding(t, y)
        plus = y[4] / c
        i = (np.array([a - plus, b - plus, -a, -b]) - u) / r_s
        return np.append(i - i_s * np.expm1(np.array(u) / u_t), i[0] + i[1] - plus / load)

    found = run("rectifier", points=201, rtol=1e-8, to=0.03)
    exact = integrated(rates, np.zeros(5), found.time, (), "LSODA")
    near(found["u_out"], exact[:, 4] / c, margin=1000)
    # The pulses are narrow against a step, and between steps the solver's polynomial is of third order.
    near(found["i"], [winding(t, y)[0] for t, y in zip(found.time, exact, strict=True)], margin=10_000)
    assert found["u_out"].max() < 17 - 2 * 0.5  # two diodes in the way


def test_a_step_down_converter_period_by_period() -> None:
    """x' = A x + b u with u = 24 V during half of each period: matrix exponentials of both halves; the mean is that of the duty."""
    a = np.array([[-0.05 / 47e-6, -1 / 47e-6], [1e4, -1e4 / 2]])  # of i and u_out
    still = np.linalg.solve(a, [-24 / 47e-6, 0.0])  # where on leads to
    half = expm(a * 5e-6)
    x, expected = np.zeros(2), [np.zeros(2)]
    for _ in range(200):
        x = half @ (x - still) + still
        x = half @ x
        expected.append(x)
    found = run("step_down", points=201)
    np.testing.assert_allclose(np.stack([found["i"], found["u_out"]], axis=1), expected, rtol=1e-9, atol=1e-9)
    rest = np.linalg.solve(
        np.eye(2) - half @ half, half @ (still - half @ still)
    )  # x of the periodic motion where a period begins
    ripple = np.trapezoid([(expm(a * t) @ (rest - still) + still)[1] for t in np.linspace(0, 5e-6, 201)], dx=2.5e-8)
    top = half @ (rest - still) + still
    ripple += np.trapezoid([(expm(a * t) @ top)[1] for t in np.linspace(0, 5e-6, 201)], dx=2.5e-8)
    assert found.final("mean") == pytest.approx(ripple / 1e-5, rel=1e-6)
