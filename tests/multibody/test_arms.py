"""Manipulators with 2 to 12 arms at random angles against a Lagrangian that knows nothing of trees and recursions.

Its coordinates are the shuttles' slides and the platform's pose; their mass matrix is constant, and the forces are the slope of the
energy of all springs, differentiated by a complex step (exact to round-off).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.compiling import Running, compiled

ARM = """
    body shuttle{i} {{ mass = {shuttle!r} kg }}
    slide guide{i} : ground to shuttle{i} {{ along = {angle!r} + pi/2 }}
    free flex{i} : shuttle{i} to platform {{ at = polar(a, {angle!r}) - polar(s, {angle!r} + pi/2), angle = {angle!r}, axes = {axes} }}
"""
SPRINGS = """
  C folded{i} : F = {guiding!r} [N/m]*x
  stage.guide{i} -> folded{i}
  C flexure{i}(x, y, phi) : energy = 1/2*{bending!r} [N*m]*phi^2 + 1/2*{lateral!r} [N/m]*({turned_x})^2 + 1/2*{along!r} [N/m]*({turned_y})^2
  stage.flex{i} => flexure{i}
"""
# The one energy of a flexure in the coordinates of each choice of axes: those of the middle see no turn.
HALF = {"from": "phi/2", "to": "-phi/2", "middle": "0"}


class Manipulator:
    """Random dimensions of the size of the thesis' ones."""

    def __init__(self, arms: int, seed: int) -> None:
        random = np.random.default_rng(seed)
        self.arms = arms
        self.angle = np.sort(random.uniform(0, 2 * np.pi, arms))
        self.corner, self.reach = 170e-6, 0.5e-3
        self.shuttle = 40e-9 * random.uniform(0.5, 2, arms)
        self.mass, self.inertia = 2.1e-9, 2.9e-17
        self.guiding, self.bending = random.uniform(0.5, 3, arms), 4e-9 * random.uniform(0.5, 2, arms)
        self.lateral, self.along = random.uniform(0.1, 1, arms), 1e4 * random.uniform(0.5, 2, arms)

    def text(self, axes: str) -> str:
        half = HALF[axes]
        rows = []
        springs = []
        for i in range(self.arms):
            fixed = {
                "i": i + 1, "angle": float(self.angle[i]), "shuttle": float(self.shuttle[i]), "axes": axes,
                "guiding": float(self.guiding[i]), "bending": float(self.bending[i]),
                "lateral": float(self.lateral[i]), "along": float(self.along[i]),
                "turned_x": f"x*cos({half}) + y*sin({half})", "turned_y": f"y*cos({half}) - x*sin({half})",
            }  # fmt: skip
            rows.append(ARM.format(**fixed))
            springs.append(SPRINGS.format(**fixed))
        body = f"body platform {{ mass = {self.mass!r} kg, inertia = {self.inertia!r} [kg*m^2] }}"
        return (
            f"model Arms {{\n  parameter a = {self.corner!r} m, s = {self.reach!r} m\n  multibody stage : planar {{\n    {body}"
            + "".join(rows)
            + "  }\n"
            + "".join(springs)
            + "  output x = stage.platform.x\n}\n"
        )

    def energy(self, q: Any) -> Any:
        """Of all springs, J; q holds the slides, then x, y, phi of the platform, and may be complex."""
        slide, x, y, phi = q[: self.arms], q[-3], q[-2], q[-1]
        c, s = np.cos(self.angle), np.sin(self.angle)
        at_x, at_y = self.corner * c + self.reach * s, self.corner * s - self.reach * c
        versine, sine = 2 * np.sin(phi / 2) ** 2, np.sin(phi)
        over_x = x - versine * at_x - sine * at_y + slide * s  # the platform's end of a flexure less the shuttle's
        over_y = y + sine * at_x - versine * at_y - slide * c
        local_x, local_y = c * over_x + s * over_y, c * over_y - s * over_x
        middle_x = local_x * np.cos(phi / 2) + local_y * np.sin(phi / 2)
        middle_y = local_y * np.cos(phi / 2) - local_x * np.sin(phi / 2)
        flexures = self.bending * phi**2 + self.lateral * middle_x**2 + self.along * middle_y**2
        return ((self.guiding * slide**2).sum() + flexures.sum()) / 2

    def accelerations(self, q: Any) -> Any:
        masses = np.array([*self.shuttle, self.mass, self.mass, self.inertia])
        slopes = [self.energy(q + 1e-30j * unit).imag / 1e-30 for unit in np.eye(len(q))]
        return -np.array(slopes) / masses


@pytest.mark.few(9)
@pytest.mark.parametrize("arms", [2, 3, 4, 5, 8, 12])
@pytest.mark.parametrize("axes", ["from", "to", "middle"])
def test_accelerations_of_any_number_of_arms(arms: int, axes: str) -> None:
    """Order 2(n + 3), no constraint; to 1e-12 of the largest force's acceleration, for all axes of the flexures."""
    made = Manipulator(arms, seed=arms)
    compilation = compiled(made.text(axes))
    running = Running(compilation)
    names = running.program.states.names
    assert len(names) == 2 * (arms + 3) and not running.program.unknowns.names
    coordinates = [*(f"stage.guide{i + 1}.x" for i in range(arms)), *(f"stage.platform.{c}" for c in ("x", "y", "phi"))]
    speeds = [*(f"{c}.v" for c in coordinates[:-1]), f"{coordinates[-1]}.omega"]
    assert set(names) == {*coordinates, *speeds}
    random = np.random.default_rng(100 + arms)
    for size in (1e-8, 1e-6, 1e-5):
        q = size * random.standard_normal(arms + 3)
        q[-1] *= 1e3
        rates = running.rates(dict(zip(coordinates, q.tolist(), strict=True)))
        found, expected = np.array([rates[s] for s in speeds]), made.accelerations(q)
        kinds = [slice(0, arms + 2), slice(arms + 2, None)]
        for kind in kinds:
            np.testing.assert_allclose(found[kind], expected[kind], rtol=0, atol=1e-11 * np.abs(expected[kind]).max())
