"""Oil, water, air, heat, amounts of substance: closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bondgraph
from tests.gallery.reference import GALLERY, driven, integrated, near, run


def test_hydraulic_press() -> None:
    """V' = (F/A_s - P)/r - A_l v, P = bulk/V_0 V; m v' = A_l P - k x - b v; from 10 ms on."""
    small, large, stiff, r, m, k, b = 2e-4, 1e-2, 1.4e9 / 5e-4, 2e9, 50.0, 2e7, 2e4
    a = np.array([[-stiff / r, -large, 0], [large * stiff / m, -b / m, -k / m], [0, 1, 0]])
    found = run("hydraulic_press", energy=True)
    exact = driven(a, np.array([300 / small / r, 0, 0]), (0, 0, 0), np.maximum(found.time - 0.01, 0))
    near(found["pressure"], stiff * exact[:, 0])
    near(found["pressing"], k * exact[:, 2])
    assert found.final("pressing") == pytest.approx(300 * large / small, rel=1e-5)  # Pascal
    assert found.energy is not None
    assert abs(found.energy.residual) < 1e-7 * found.energy.supplied


def test_coupled_tanks_fall() -> None:
    """A r/(rho g) h_1' = h_2 - h_1, A r/(rho g) h_2' = h_1 - h_2 - r/r_out h_2: two exponentials."""
    rate = 1000 * 9.81 / (0.5 * 1e6)
    a = rate * np.array([[-1, 1], [1, -1.25]])
    found = run("coupled_tanks", "fall")
    values, shapes = np.linalg.eigh(a)
    exact = (shapes * (shapes.T @ [1.0, 0.2])) @ np.exp(np.outer(values, found.time))
    near(found["level_1"], exact[0])
    near(found["level_2"], exact[1])
    near(found["flow"], (exact[0] - exact[1]) * 1000 * 9.81 / 1e6, scale=8e-3)


def test_coupled_tanks_fill_until_all_runs_out() -> None:
    """Steady: P_2 = r_out Q, P_1 = P_2 + r Q."""
    found = run("coupled_tanks", "fill", to="10 h")
    assert found.final("level_2") == pytest.approx(4e6 * 2e-3 / 9810, rel=1e-7)
    assert found.final("level_1") == pytest.approx(5e6 * 2e-3 / 9810, rel=1e-7)


def test_surge_tank_without_friction() -> None:
    """V'' = -w^2 V, w^2 = g A/(length S), V'(0) = Q: the level rises to Q/(S w)."""
    w = np.sqrt(9.81 * 12 / (800 * 60))
    found = run("surge_tank", settings={"r": 0.0})
    near(found["level"], 30 / (60 * w) * np.sin(w * found.time))
    near(found["Q"], 30 * np.cos(w * found.time))


def test_surge_tank_with_friction() -> None:
    """V'' + 2 a V' + w^2 V = 0, 2 a = r A/(rho length); V(0) = -r Q S/(rho g), V'(0) = Q."""
    a, w_0 = 500 * 12 / (2 * 1000 * 800), np.sqrt(9.81 * 12 / (800 * 60))
    w, v_0 = np.sqrt(w_0**2 - a**2), -500 * 30 * 60 / 9810
    found = run("surge_tank", energy=True)
    t = found.time
    near(found["level"], np.exp(-a * t) * (v_0 * np.cos(w * t) + (30 + a * v_0) / w * np.sin(w * t)) / 60)
    assert found.energy is not None
    assert abs(found.energy.residual) < 1e-7 * found.energy.dissipated


def test_surge_tank_is_steady_until_the_gate_shuts() -> None:
    found = run("surge_tank", settings={"shut": 100.0}, to=100.0)
    near(found["Q"], 30 + 0 * found.time)
    near(found["level"], -500 * 30 / 9810 + 0 * found.time)


def test_batch_tank() -> None:
    """Filled in V/flow, kept for a minute, drained by exp(-k t/r) to an eighth in r/k ln 8: 0.35 m^3 are left to fill from the second batch on."""
    found, drain = run("batch_tank"), 50 * np.log(8)
    ends = np.cumsum([200, 60, drain, 175, 60, drain, 175, 60])
    assert [e.time for e in found.events] == pytest.approx(ends, rel=1e-9)
    assert found.final("done") == 2
    assert found.final("V") == pytest.approx(0.4 * np.exp(-(1000 - ends[-1]) / 50), rel=1e-8)
    assert found["heating"] == pytest.approx(
        sum((a < found.time) & (found.time < b) for a, b in zip(ends[::3], ends[1::3], strict=True))
    )


def test_rough_pipe() -> None:
    """Q' = area/(rho length) (P - loss(Q)), with Colebrook's equation solved by Lambert's function (Keady, J. Hydraul. Eng. 124, 1998)."""
    area, rough, half = np.pi * 0.05**2 / 4, 0.1e-3 / (3.7 * 0.05), np.log(10) / 2

    def factor(q: float) -> float:
        reynolds = 1000 * q * 0.05 / (area * 1e-3)
        b = reynolds / 2.51  # s = -2 log10(rough + s/b): half s + half b rough = W(half b exp(half b rough))
        w = half * b * rough + np.log(half * b)  # W(exp(w)) = y, y + ln y = w
        y = w - np.log(w)
        for _ in range(20):
            y -= (y + np.log(y) - w) / (1 + 1 / y)
        return float(((y - half * b * rough) / half) ** -2)

    def rates(_: float, q: Any) -> Any:
        loss = 50 / 0.05 * 1000 / 2 * factor(q[0]) * (q[0] / area) ** 2
        return [area / (1000 * 50) * (1e5 - loss)]

    found = run("rough_pipe")
    flow = integrated(rates, [0.5e-3], found.time)[:, 0]
    near(found["Q"], flow)
    near(found["factor"], np.array([factor(q) for q in flow]))


def test_bottle() -> None:
    """P = P_0 exp(-a t) (cos w t + a/w sin w t), w_0^2 = c^2 area/(belly length), a = w_0/(2 Q)."""
    w_0 = 343 * np.sqrt(np.pi * 0.018**2 / 4 / (0.75e-3 * 0.06))
    a = w_0 / 80
    w = np.sqrt(w_0**2 - a**2)
    found = run("helmholtz", to=0.05)
    t = found.time
    near(found["pressure"], 10 * np.exp(-a * t) * (np.cos(w * t) + a / w * np.sin(w * t)))
    assert found.final("f_0") == pytest.approx(w_0 / (2 * np.pi), rel=1e-12)


def test_loudspeaker() -> None:
    """L i' = u - R i - Bl v, m v' = Bl i - k x - r v - S P, x' = v, V' = S v - P/leak, P = rho c^2/V_0 V."""
    res, ind, bl, m, k, r, s, leak = 6.0, 0.5e-3, 6.0, 0.015, 1500.0, 1.2, 0.013, 4e5
    air = 1.2 * 343**2 / 0.012
    a = np.array(
        [
            [-res / ind, -bl / ind, 0, 0],
            [bl / m, -r / m, -k / m, -s * air / m],
            [0, 1, 0, 0],
            [0, s, 0, -air / leak],
        ]
    )
    found = run("loudspeaker", to=0.1, energy=True)
    exact = driven(a, np.array([8 / ind, 0, 0, 0]), (0, 0, 0, 0), found.time, 2 * np.pi * 60)
    near(found["i"], exact[:, 0])
    near(found["v"], exact[:, 1])
    near(found["x"], exact[:, 2])
    near(found["pressure"], air * exact[:, 3])
    assert found.energy is not None
    assert abs(found.energy.residual) < 1e-7 * found.energy.supplied


def test_brake_heats_its_disc() -> None:
    """J omega' = -b omega; c T' = b omega^2 - G (T - T_air): exponentials of 2 b/J and G/c; entropy of disc and air together."""
    inertia, b, c, g, air, omega_0 = 0.8, 0.4, 450.0, 6.0, 293.15, 1500 * np.pi / 30
    found = run("brake", energy=True)
    t, fast, slow = found.time, 2 * b / inertia, g / c
    near(found["speed"], omega_0 * np.exp(-b / inertia * t))
    size = b * omega_0**2 / c / (slow - fast)
    excess = size * (np.exp(-fast * t) - np.exp(-slow * t))
    near(found["T"], air + excess)
    near(found["loss"], b * omega_0**2 * np.exp(-fast * t))
    to_air = g * size * ((1 - np.exp(-fast * t)) / fast - (1 - np.exp(-slow * t)) / slow)
    near(found["entropy"], c * np.log(1 + excess / air) + to_air / air)
    assert np.all(np.diff(found["entropy"]) > 0)  # the second law
    near(c * excess + to_air, inertia * omega_0**2 / 2 * (1 - np.exp(-fast * t)))  # the first


def test_reaction_of_second_order() -> None:
    """n' = -2 k_f n^2 + k_r (N - n), N = n + 2 d: with the roots n+ > n- of the right side,
    (n - n+)/(n - n-) falls with exp(-2 k_f (n+ - n-) t)."""
    k_f, k_r, n_0, d_0 = 0.3, 0.05, 2.0, 0.002
    total = n_0 + 2 * d_0
    root = np.sqrt(k_r**2 + 8 * k_f * k_r * total)
    high, low = (-k_r + root) / (4 * k_f), (-k_r - root) / (4 * k_f)
    found = run("reaction")
    ratio = (n_0 - high) / (n_0 - low) * np.exp(-2 * k_f * (high - low) * found.time)
    exact = (high - low * ratio) / (1 - ratio)
    near(found["n_monomer"], exact)
    near(found["n_dimer"], (total - exact) / 2)
    assert np.all(found["affinity"] > 0)
    near(found["affinity"] / (8.314462618 * 298.15), np.log(k_f * exact**2 / (k_r * (total - exact) / 2)))


def cooler(current: float) -> tuple[np.ndarray, np.ndarray]:
    """Rates a x + b of the temperatures of box and sink at a constant current: linear."""
    alpha, r, k, g, air, load = 0.05, 2.0, 0.5, 2.0, 298.15, 5.0
    a = np.array([[-(alpha * current + k) / 300, k / 300], [k / 500, (alpha * current - k - g) / 500]])
    return a, np.array([(load + r * current**2 / 2) / 300, (r * current**2 / 2 + g * air) / 500])


def test_thermoelectric_cooler() -> None:
    """C T_c' = load - alpha T_c i + R i^2/2 + K (T_h - T_c), C T_h' = alpha T_h i + R i^2/2 - K (T_h - T_c) - G (T_h - T_air)."""
    found = run("thermoelectric_cooler")
    exact = driven(*cooler(1.5), (298.15, 298.15), found.time)
    near(found["T_box"], exact[:, 0])
    near(found["T_sink"], exact[:, 1])
    near(found["power"], 1.5 * (0.05 * (exact[:, 1] - exact[:, 0]) + 2 * 1.5))


def test_the_best_current_of_a_thermoelectric_cooler() -> None:
    """Rest of the two balances at each current; the box is coldest near 4 A."""
    points = bondgraph.load(GALLERY / "thermoelectric_cooler.bg").run("best_current")
    boxes = [point.numbers()["T_box"] for point in points]
    assert boxes == pytest.approx([-np.linalg.solve(*cooler(i))[0] for i in range(1, 6)], rel=1e-9)
    assert int(np.argmin(boxes)) == 3
