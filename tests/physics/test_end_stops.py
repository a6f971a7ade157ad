"""The manipulator at its end-stops and with shuttles that go aside, against scipy on hand-written equations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph
from tests.physics import manipulator_reference as m

P = m.NOMINAL
STOP, LOSS = 11e-6, 1e-3  # way of a shuttle, m; of a flexure along itself, N s/m


def wall(x: Any, v: Any, reach: Any, k: float, r: float) -> Any:
    """Force of two stops on a body at x: spring and damper that push and never pull, N."""
    push = np.maximum(k * (x - reach) + r * v, 0) * (x > reach)
    return -push - np.minimum(k * (x + reach) + r * v, 0) * (x < -reach)


def gradient(phi: float) -> Any:
    """Rates of the lengths of the flexures by the rates of q; shape (3, 6)."""
    turn = P.corner * np.cos(phi) + P.spring_arm * np.sin(phi)
    return np.column_stack([-np.eye(3), -m.SINE, m.COSINE, np.full(3, turn)])


def losses(q: Any, rate: Any) -> Any:
    """Forces over q of dampers along the flexures, by virtual work."""
    slopes = gradient(q[5])
    return -LOSS * slopes.T @ (slopes @ rate)


def smooth(t: float, begin: float, end: float) -> float:
    return m.smoothstep5(t, begin, end)


@pytest.mark.machine_code
def test_two_shuttles_bounce_off_their_stops() -> None:
    def rates(t: float, z: Any) -> Any:
        q, rate = z[:6], z[6:]
        volt = 60 * (smooth(t, 0, 1.5e-3) - smooth(t, 2.5e-3, 3e-3))
        force = m.applied(P, push=(0, 0, volt), pull=(0, volt, 0)) - P.resistance * rate - m.restoring(q)
        force[:3] += wall(q[:3], rate[:3], STOP, 2e3, 2e-3)
        return np.concatenate([rate, (force + losses(q, rate)) / P.mass])

    def jacobian(t: float, z: Any) -> Any:
        matrix = m.jacobian(z)
        slopes = gradient(z[5])
        matrix[6:, 6:] -= LOSS * slopes.T @ slopes / P.mass[:, None]
        for i in np.flatnonzero(np.abs(z[:3]) > STOP):
            matrix[6 + i, [i, 6 + i]] -= np.array([2e3, 2e-3]) / P.mass[i]
        return matrix

    stop = 1.6e-3
    times = np.linspace(0, stop, 33)
    magnitude = np.array([1e-5] * 5 + [1e-3] + [1e-2] * 5 + [10])
    exact = solve_ivp(rates, (0, stop), np.zeros(12), "Radau", times, jac=jacobian, rtol=1e-5, atol=1e-6 * magnitude).y
    found = bondgraph.load("models/end_stops.bg").simulate(to=stop, points=33)
    assert found["c2"].min() < -0.95 * STOP and np.diff(found["c2"]).max() > 1e-7  # it came there, and bounced
    for row, name in enumerate(("", "c2", "c3", "x", "", "phi")):
        if name:
            scale = 1e-3 if name == "phi" else 1e-5
            np.testing.assert_allclose(found[name], exact[row], rtol=0, atol=3e-4 * scale, err_msg=name)


def aside_rates(t: float, z: Any, askew: float, comb: Any) -> Any:
    """18 states: q and then the ways l of the shuttles across, then their rates."""
    q, l, rate, slip = z[:6], z[6:9], z[9:15], z[15:18]
    d, gap = np.array(P.thickness), P.gap
    moved = np.array(q)
    xa, ya, phi = m.flexure_coordinates(moved)
    xa = xa - l
    fx, fy, torque = m.flexure_effort(xa, ya, phi, m.Stiffness(P.k_phi, P.k_x, P.k_y))
    cosine, sine, a, s = np.cos(q[5]), np.sin(q[5]), P.corner, P.spring_arm
    k_l = 4 * np.array(P.young) * P.area / P.folded_length
    bend = 1 + 12 * q[:3] ** 2 / (700 * d**2)
    restoring = np.empty(6)
    restoring[:3] = P.k_g * q[:3] - fy - k_l * l**2 / 2 * (24 * q[:3] / (700 * d**2)) / bend**2
    restoring[3] = np.sum(fx * m.COSINE - fy * m.SINE)
    restoring[4] = np.sum(fx * m.SINE + fy * m.COSINE)
    restoring[5] = np.sum(torque + fx * (s * cosine - a * sine) + fy * (a * cosine + s * sine))
    aside = k_l * l / bend - fx
    push, pull, fy_hand = comb(t)
    out = l + askew
    half = P.fingers * P.permittivity * P.height / 2
    co_energy = half * (1 / (gap - out) + 1 / (gap + out))  # of one comb at 1 V, per length of overlap
    slope = half * (1 / (gap - out) ** 2 - 1 / (gap + out) ** 2)
    force = -restoring - P.resistance * rate
    force[:3] += co_energy * (push**2 - pull**2) + wall(q[:3], rate[:3], STOP, 2e5, 5e-2)
    force[4] += fy_hand
    force += losses(q, rate)
    side = slope * ((20e-6 + q[:3]) * push**2 + (20e-6 - q[:3]) * pull**2) - aside - P.damping * slip
    side += wall(out, slip, 0.75 * gap, 1e7, 0.4)
    return np.concatenate([rate, slip, force / P.mass, side / P.shuttle_mass])


@pytest.mark.machine_code
@pytest.mark.parametrize("volts", [1400.0])
def test_a_shuttle_far_out_goes_aside(volts: float) -> None:
    """The same against scipy; and where it happens the lateral stiffness of (4.3) is what the combs ask for."""

    def comb(t: float) -> tuple[Any, Any, float]:
        volt = np.array([volts * smooth(t, 0, 0.5e-3), 0, 0])
        return volt, volt, 30e-6 * smooth(t, 0.5e-3, 2e-3)

    stop = 1.3e-3
    times = np.linspace(0, stop, 27)
    magnitude = np.array([1e-5] * 5 + [1e-3] + [1e-8] * 3 + [1e-2] * 5 + [10] + [1e-3] * 3)
    exact = solve_ivp(
        lambda t, z: aside_rates(t, z, 10e-9, comb), (0, stop), np.zeros(18), "Radau", times, rtol=1e-5, atol=1e-6 * magnitude
    ).y  # fmt: skip
    found = bondgraph.load("models/side_instability.bg").simulate(to=stop, points=27)
    before = times < 1.21e-3
    assert found["l1"][before].max() < 0.2e-6 and found["l1"][-1] > 3e-6
    np.testing.assert_allclose(found["l1"][before], exact[6][before] + 10e-9, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found["c1"][before], exact[0][before], rtol=0, atol=1e-9)
    assert found["l1"][-1] == pytest.approx(exact[6][-1] + 10e-9, rel=1e-2)
