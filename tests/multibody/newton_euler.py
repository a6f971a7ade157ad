"""An independent dynamics of trees, by numbers: one big linear system of Newton's and Euler's equations.

Every body has its six accelerations as unknowns, in world axes about its centre of mass; every joint lets its freedoms go and ties the
rest: found here from the geometry of the poses alone. M a = f + projected: with J the velocities that each coordinate's rate
gives to the bodies, found by differences of exact poses (complex steps), J^T M J q'' = J^T (f - M J' q').
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

STEP = 1e-30


def skew(v: Any) -> Any:
    """The matrix of `v x`."""
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def turn(axis: Any, angle: Any) -> Any:
    """About a unit vector by an angle, which may be complex."""
    k = skew(np.asarray(axis, dtype=float) / np.linalg.norm(axis))
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * (k @ k)


def of_quaternion(p: Any) -> Any:
    """The matrix of a unit quaternion."""
    w, v = p[0], np.asarray(p[1:])
    return np.eye(3) + 2 * (w * skew(v) + skew(v) @ skew(v)) / np.sum(np.asarray(p) ** 2)


Pose = tuple[Any, Any]  # where the centre of mass is, how the body is turned from the drawing


class Oracle:
    """`poses(q)`: of every body, from the coordinates; masses and tensors (in body axes, as drawn)."""

    def __init__(self, poses: Callable[[Any], list[Pose]], masses: Any, tensors: Any, gravity: Any) -> None:
        self.poses, self.masses, self.tensors, self.gravity = poses, masses, tensors, np.asarray(gravity)

    def jacobian(self, q: Any) -> list[tuple[Any, Any]]:
        """Of every body the velocities of its centre and its spins that rates of the coordinates give; (3, n) each."""
        found = [(np.zeros((3, len(q))), np.zeros((3, len(q)))) for _ in self.masses]
        now = self.poses(np.asarray(q, dtype=float))
        for k in range(len(q)):
            moved = np.asarray(q, dtype=complex)
            moved[k] += 1j * STEP
            for (place, spin), (_, r0), (x, r) in zip(found, now, self.poses(moved), strict=True):
                place[:, k] = x.imag / STEP
                w = (r.imag / STEP) @ r0.T
                spin[:, k] = w[2, 1], w[0, 2], w[1, 0]
        return found

    def accelerations(self, q: Any, rates: Any, forces: Any) -> Any:
        """Second rates of the coordinates. `forces`: on the coordinates."""
        q, rates = np.asarray(q, dtype=float), np.asarray(rates, dtype=float)
        h = 1e-4
        mass = np.zeros((len(q), len(q)))
        right = np.array(forces, dtype=float)
        here = self.jacobian(q)
        # J' q' by a difference of high order along the motion
        weights = {-3: -1 / 60, -2: 3 / 20, -1: -3 / 4, 1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
        there = {n: self.jacobian(q + n * h * rates) for n in weights}
        for i, (_, r) in enumerate(self.poses(q)):
            place, spin = here[i]
            bias = [sum(w * there[n][i][part] for n, w in weights.items()) / h @ rates for part in (0, 1)]
            tensor = r @ self.tensors[i] @ r.T
            omega = spin @ rates
            mass += self.masses[i] * place.T @ place + spin.T @ tensor @ spin
            right -= place.T @ (self.masses[i] * (bias[0] - self.gravity))
            right -= spin.T @ (tensor @ bias[1] + np.cross(omega, tensor @ omega))
        return np.linalg.solve(mass, right)
