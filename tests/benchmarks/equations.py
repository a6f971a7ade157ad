"""Equations of the benchmarks over any kind of numbers, for peers that take them in Python (sympy, casadi, DiffSL)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol


class Functions(Protocol):
    """Source of the functions: sympy or casadi."""

    def sin(self, x: Any) -> Any: ...
    def cos(self, x: Any) -> Any: ...
    def exp(self, x: Any) -> Any: ...


def robertson(m: Functions, t: Any, y: Sequence[Any]) -> list[Any]:
    a, b, c = 0.04 * y[0], 1e4 * y[1] * y[2], 3e7 * y[1] * y[1]
    return [-a + b, a - b - c, c]


def vdpol(m: Functions, t: Any, y: Sequence[Any]) -> list[Any]:
    return [y[1], 1000.0 * (1 - y[0] * y[0]) * y[1] - y[0]]


def duffing(m: Functions, t: Any, y: Sequence[Any]) -> list[Any]:
    return [y[1], -(y[0] + y[0] * y[0] * y[0])]


R0, R, UB, UF, ALPHA, BETA = 1000.0, 9000.0, 6.0, 0.026, 0.99, 1e-6


def amplifier(m: Functions, t: Any, y: Sequence[Any]) -> list[Any]:
    """Right side of M y' = f; M in `scenes.py`."""
    source = 0.1 * m.sin(200 * 3.141592653589793 * t)
    g1, g2 = BETA * (m.exp((y[1] - y[2]) / UF) - 1), BETA * (m.exp((y[4] - y[5]) / UF) - 1)
    return [
        (y[0] - source) / R0, y[1] / R + (y[1] - UB) / R + (1 - ALPHA) * g1, y[2] / R - g1, (y[3] - UB) / R + ALPHA * g1,
        y[4] / R + (y[4] - UB) / R + (1 - ALPHA) * g2, y[5] / R - g2, (y[6] - UB) / R + ALPHA * g2, y[7] / R,
    ]  # fmt: skip


H, LS, LF, P, A, S, DENSITY = 38e-6, 1e-3, 400e-6, 0.72, 170e-6, 0.5e-3, 2330.0
D, E = (1.95e-6, 1.75e-6, 1.75e-6), (130e9, 158e9, 158e9)
COS, SIN = (1.0, -0.5, -0.5), (0.0, 0.75**0.5, -(0.75**0.5))
SHUTTLE = 39.8e-9 + DENSITY * H * (14e-6 * 720e-6 * (14**2 - 9**2) / 14**2 + 2e-6 * 280e-6)
PLATFORM, INERTIA = 378 * DENSITY * 12e-6 * 12e-6 * H * 0.4375, 2.94e-17


def manipulator(m: Functions, t: Any, z: Sequence[Any], push: Any = None) -> list[Any]:
    """`push`: the force in x. Without it, that of after 5 ms."""
    phi = z[5]
    cosine, sine, ch, sh = m.cos(phi), m.sin(phi), m.cos(phi / 2), m.sin(phi / 2)
    versine = 2 * sh * sh
    over_x, over_y, at_x, at_y = (
        S * cosine - A * sine,
        A * cosine + S * sine,
        S * sine - A * versine,
        A * sine + S * versine,
    )
    fx, fy, torque = 30e-6 if push is None else push, 0.0, 0.0
    shuttles = []
    for i in range(3):
        moment, area = H * D[i] ** 3 / 12, H * D[i]
        k_phi, k_x = E[i] * moment / LS / (1 - P), 12 * E[i] * moment / LS**3 / (1 - P**3)
        k_y, k_g = E[i] * area / LS / (1 - P), 48 * E[i] * moment / LF**3
        xa, ya = z[3] * COS[i] + z[4] * SIN[i] + at_x, z[4] * COS[i] - z[3] * SIN[i] + at_y - z[i]
        xc, yc = xa * ch + ya * sh, ya * ch - xa * sh
        px, py = k_x * xc, k_y * yc
        force_x, force_y = px * ch - py * sh, px * sh + py * ch
        shuttles.append((force_y - k_g * z[i] - 2.5e-5 * z[6 + i]) / SHUTTLE)
        fx = fx - (force_x * COS[i] - force_y * SIN[i])
        fy = fy - (force_x * SIN[i] + force_y * COS[i])
        torque = torque - (k_phi * phi + (k_x - k_y) * xc * yc / 2 + force_x * over_x + force_y * over_y)
    return [*z[6:], *shuttles, fx / PLATFORM, fy / PLATFORM, torque / INERTIA]


def rising(t: Any) -> Any:
    """The force of the manipulator's first 5 ms."""
    s = t / 5e-3
    return 30e-6 * s * s * s * (10 - 15 * s + 6 * s * s)
