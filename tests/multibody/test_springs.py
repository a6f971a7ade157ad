"""Springs between bodies in space: an energy in the relative pose, read from the poses; smooth where nothing is turned."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

import bondgraph
from tests.compiling import Running, compiled

TEXT = """model Hung {{
  multibody stage : spatial {{
    body one {{ mass = 2 kg, inertia = (0.2 [kg*m^2], 0.3 [kg*m^2], 0.4 [kg*m^2]), at = (0, 0, 0) }}
    body two {{ mass = 1 kg, inertia = (0.1 [kg*m^2], 0.2 [kg*m^2], 0.15 [kg*m^2]), at = (1 m, 0, 0){start} }}
    free flex : one to two {{ at = (0.5 m, 0.1 m, 0), axes = {axes} }}
  }}
  C spring(x, y, z, rx, ry, rz) : energy = 50 [N/m]*(x^2 + 2*y^2 + 3*z^2) + 4 [N*m]*(rx^2 + 2*ry^2 + 0.5*rz^2) + 10 [N]*(y*rz - 2*z*ry + x*rx)
  stage.flex => spring
  output x = stage.flex.x, rx = stage.flex.rx, angle = stage.two.rz
}}
"""
START = ", start y = 0.1 m, start rx.omega = 2 [1/s], start ry.omega = -1 [1/s], start rz = 0.3"


@pytest.mark.parametrize("axes", ["from", "to", "middle", "world"])
def test_slopes_where_nothing_is_turned(axes: str) -> None:
    """Exactly at zero turn the rates have slopes, those of differences."""
    running = Running(compiled(TEXT.format(axes=axes, start=""), everything=True))
    time, x, u, c, mode = running.arguments(0.0, None, None)
    random = np.random.default_rng(0)
    for size in (0.0, 1e-9, 1e-3, 0.3):
        y = x + size * random.standard_normal(len(x))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = running.program.jacobian(time, y, u, c, mode)

        def rates(z: Any) -> Any:
            return running.program.derivative(time, z, u, c, mode)

        h = 1e-4
        slopes = np.array([(8 * (rates(y + h * e) - rates(y - h * e)) - rates(y + 2 * h * e) + rates(y - 2 * h * e)) / (12 * h) for e in np.eye(len(y))]).T  # fmt: skip
        np.testing.assert_allclose(np.asarray(found), slopes, rtol=1e-7, atol=1e-6)


@pytest.mark.parametrize("axes", ["from", "to", "middle"])
def test_energy_stays(axes: str) -> None:
    """The sum of the energies of the spring and the bodies is constant."""
    found = bondgraph.load(TEXT.format(axes=axes, start=START)).simulate(to=2.0, rtol=1e-9, energy=True)
    assert found.energy is not None
    assert abs(found.energy.residual) < 1e-7
    assert np.ptp(found["rx"]) > 0.1
