"""Masses on springs: closed forms of their vibrations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipj

from tests.gallery.reference import driven, integrated, near, run


def test_duffing_swings_as_an_elliptic_function() -> None:
    """m x'' + k x + k3 x^3 = 0 from rest at a: x = a cn(w t, M), w^2 = (k + k3 a^2)/m, M = k3 a^2/(2 (k + k3 a^2)).

    Put x = a cn in: (cn)'' = -(1 - 2M) cn - 2M cn^3, so w^2 (1 - 2M) = k/m and 2 M w^2 = k3 a^2/m.
    """
    m, k, k3, a = 0.5, 20.0, 5e4, 0.03
    found = run("duffing", to=5.0, energy=True)
    w, parameter = np.sqrt((k + k3 * a * a) / m), k3 * a * a / (2 * (k + k3 * a * a))
    sn, cn, dn, _ = ellipj(w * found.time, parameter)
    near(found["x"], a * cn)
    near(found["v"], -a * w * sn * dn)
    assert found.energy is not None
    assert abs(found.energy.stored) < 1e-7 * (k * a**2 / 2 + k3 * a**4 / 4)


def test_duffing_is_isochronous_only_without_the_cube() -> None:
    """Setting k3 = 0 leaves a cosine."""
    found = run("duffing", settings={"k3": 0.0}, to=5.0)
    near(found["x"], 0.03 * np.cos(np.sqrt(40) * found.time))


@pytest.mark.parametrize(("n", "mode"), [(8, 3), (5, 1), (20, 20)])
def test_a_mode_of_a_chain_swings_alone(n: int, mode: int) -> None:
    """m u_i'' = k (u_(i-1) - 2 u_i + u_(i+1)), u_i = a sin(kappa i) cos(w t): w = 2 sqrt(k/m) sin(kappa/2)."""
    kappa = np.pi * mode / (n + 1)
    w = 2 * np.sqrt(100 / 0.1) * np.sin(kappa / 2)
    found = run("chain", settings={"n": n, "mode_number": mode}, to=1.0)
    near(found["x"], 1e-3 * np.sin(kappa) * np.cos(w * found.time))
    near(found["x_2"], 1e-3 * np.sin(2 * kappa) * np.cos(w * found.time))
    near(found["v"], -1e-3 * w * np.sin(kappa) * np.sin(w * found.time))


def absorber(r: float) -> tuple[np.ndarray, np.ndarray, float]:  # type: ignore[type-arg]
    """(x, v, x_s, v_a)' with x_s = x - x_a: the absorber's spring pulls at both masses."""
    m, k, m_a, w = 100.0, 4e5, 5.0, 2 * np.pi * 9
    k_a = m_a * w**2
    a = np.array([[0, 1, 0, 0], [-k / m, -r / m, -k_a / m, 0], [0, 1, 0, -1], [0, 0, k_a / m_a, 0]])
    return a, np.array([0, 100 / m, 0, 0]), w


def test_absorber_from_rest() -> None:
    a, b, w = absorber(400)
    found = run("vibration_absorber", to=2.0)
    exact = driven(a, b, (0, 0, 0, 0), found.time, w)
    near(found["x"], exact[:, 0])
    near(found["v"], exact[:, 1])
    near(found["x_a"], exact[:, 0] - exact[:, 2])


def test_the_machine_comes_to_rest_and_the_absorber_does_not() -> None:
    """Steady: the absorber's spring carries the whole force, k_a x_a = -F; X = F/(k - m w^2 - k_a m_a w^2/(k_a - m_a w^2)) = 0."""
    _, _, w = absorber(4000)
    found = run("vibration_absorber", settings={"r": 4000.0}, to=7.0, points=3501, rtol=1e-7)
    last = found.time > 6.8
    amplitude = 100 / (5 * w**2)
    assert np.abs(found["x"][last]).max() < 1e-4 * amplitude
    assert np.abs(found["x_a"][last]).max() == pytest.approx(amplitude, rel=1e-3)


@pytest.mark.parametrize("duration", [4.0, 7.0])
def test_sweep_through_a_resonance(duration: float) -> None:
    """m x'' + r x' + k x = sin(2 pi (f0 t + (f1 - f0) t^2/(2 T)))."""
    w, zeta = 2 * np.pi * 6, 0.01

    def rates(t: float, y: np.ndarray) -> tuple[float, float]:  # type: ignore[type-arg]
        force = np.sin(2 * np.pi * (2 * t + 10 * t * t / (2 * duration)))
        return y[1], force - 2 * zeta * w * y[1] - w * w * y[0]

    found = run("sweep", "fast", settings={"duration": duration}, to=duration, points=201)
    near(found["x"], integrated(rates, (0, 0), found.time)[:, 0])
    assert found.final("frequency") == pytest.approx(12, rel=1e-12)


def test_a_faster_sweep_peaks_later_and_lower() -> None:
    slow, fast = (run("sweep", e, rtol=1e-6, points=4001) for e in ("up", "fast"))
    peak = [float(r["frequency"][np.abs(r["x"]).argmax()]) for r in (slow, fast)]
    assert 6 < peak[0] < peak[1] < 9
    assert np.abs(fast["x"]).max() < np.abs(slow["x"]).max()


def test_drag_in_a_slot() -> None:
    """m v' = m g (1 - v/v_t): v = v_t (1 - exp(-g t/v_t)); with the square, v = v_t tanh(g t/v_t), way = v_t^2/g ln cosh(g t/v_t)."""
    found = run("drag")
    x = 9.81 * found.time / 5
    near(found["v_stokes"], 5 * (1 - np.exp(-x)))
    near(found["v_newton"], 5 * np.tanh(x))
    near(found["way"], 25 / 9.81 * np.log(np.cosh(x)))


def test_the_other_drag_for_the_slow_ball() -> None:
    found = run("drag", settings={"slow.Drag": "Newton"})
    near(found["v_stokes"], 5 * np.tanh(9.81 * found.time / 5))


def test_van_der_pol_returns_after_one_period() -> None:
    """u'' - (1 - u^2) u' + u = 0: period 6.6632868593231302, amplitude 2.0086198608748433 (known to many digits)."""
    found = run("van_der_pol", to=6.66328685932313, points=2001)
    assert found.final("u") == pytest.approx(2.0086198608748433, rel=1e-7)
    assert found["u"].max() == pytest.approx(2.0086198608748433, rel=1e-7)
    assert found["u"].min() == pytest.approx(-2.0086198608748433, rel=1e-5)  # seen every 3 ms only


def test_van_der_pol_over_three_rounds() -> None:
    def rates(t: float, y: np.ndarray) -> tuple[float, float]:  # type: ignore[type-arg]
        return -y[1] - (y[0] ** 3 / 3 - y[0]), y[0]

    found = run("van_der_pol")
    u = 2.0086198608748433
    exact = integrated(rates, (u, u - u**3 / 3), found.time)
    near(found["u"], exact[:, 0])
    near(found["i"], exact[:, 1])


@pytest.mark.parametrize("n", [2, 3])
def test_resonators_of_two_materials(n: int) -> None:
    """Four guided beams of stiffness E h w^3/l^3; folded, two such rows in series. The second one is of nickel, folded and damped."""
    found = run("resonators", settings={"n": n}, outputs=(*(f"v[{i}]" for i in range(1, n + 1)), "loss"))
    stiff = 4 * 20e-6 * (2e-6 / 200e-6) ** 3
    for i in range(1, n + 1):
        e, rho, r = (200e9, 8908.0, 1e-6) if i == 2 else (160e9, 2330.0, 0.0)
        m = rho * i * 1e-8 * 20e-6
        k, a = e * stiff / (2 if i == 2 else 1), r / (2 * m)
        w = np.sqrt(k / m - a * a)
        near(
            found[f"v[{i}]"], 0.01 * np.exp(-a * found.time) * (np.cos(w * found.time) - a / w * np.sin(w * found.time))
        )
    near(found["loss"], 1e-6 * np.asarray(found["v[2]"]) ** 2)
