"""A problem of the literature with events: the simplest walking model, whose limit cycle is known to fifteen digits.

M. Garcia, A. Chatterjee, A. Ruina and M. Coleman, The simplest walking model: stability, complexity, and scaling, J. Biomech. Eng. 120 (1998):
two stiff legs, a mass at the hip and one at each foot, walk down a slope of 0.009; where the swinging foot strikes, the legs change their parts. The
start of the stable gait for feet of a thousandth of the hip's mass is that of the programs published for the course by P. Bhounsule and A. Ruina,
who compared accuracies on it (Dyn. Contin. Discrete Impuls. Syst. B 21, 2014). It is confirmed here by a method of order 8 at 1e-13 before it is used.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from tests.stress.trial import Case

SLOPE, FEET = 0.009, 1e-3
PUBLISHED = (0.200161072169750, -0.199906060087682, 0.400322144339512, -0.015805473227965)
AGREE = 1e-12
STRIKES = (
    -0.05
)  # angle of the leg on the ground from which on the other one may strike: before, it scuffs, which is left out
TEXT = f"""plain model Walker {{
  "Angles of the leg that stands and of the one that swings, measured from it; lengths by the leg, times by sqrt(l/g)."
  parameter slope = {SLOPE!r}, feet = {FEET!r}
  signal theta = integral(w, {PUBLISHED[0]!r})
  signal phi = integral(u, {PUBLISHED[2]!r})
  signal w = integral(w_dot, {PUBLISHED[1]!r})
  signal u = integral((1 - cos(phi))*w_dot + w^2*sin(phi) + falls, {PUBLISHED[3]!r})
  signal falls = sin(theta - phi - slope), leans = sin(theta - slope)
  signal pulls = (1 - cos(phi))*(w^2*sin(phi) + falls) + sin(phi)*(u^2 - 2*w*u) - falls + leans
  signal w_dot = (feet*pulls + leans)/(1 + feet*sin(phi)^2)
  signal kept = cos(2*theta)/(1 + feet*sin(2*theta)^2)
  when phi - 2*theta > 0 and theta < {STRIKES!r} {{
    w = kept*w
    u = (1 - cos(2*theta))*kept*w
    phi = -2*theta
    theta = -theta
  }}
  output stands = theta, swings = phi
}}
"""


def _rates(_: float, y: Any) -> list[float]:
    """Both equations of motion, the angular momenta about the foot and about the hip, solved for the accelerations."""
    theta, w, phi, u = y
    sine, rest = np.sin(phi), 1 - np.cos(phi)
    hip = -np.sin(theta - phi - SLOPE)
    # [1 + 2 m rest, -m rest; rest, -1] [w', u'] = …
    matrix = np.array([[1 + 2 * FEET * rest, -FEET * rest], [rest, -1.0]])
    first = FEET * sine * (u**2 - 2 * u * w) + FEET * hip + (1 + FEET) * np.sin(theta - SLOPE)
    found = np.linalg.solve(matrix, [first, hip - w**2 * sine])
    return [w, float(found[0]), u, float(found[1])]


@lru_cache
def stride() -> tuple[float, Any]:
    """Duration of a step, and the motion in it. The published start must come back."""

    def strikes(_: float, y: Any) -> float:
        return float(y[2] - 2 * y[0]) if y[0] < STRIKES else -1.0

    strikes.terminal, strikes.direction = True, 1.0  # type: ignore[attr-defined]
    found = solve_ivp(
        _rates, (0, 6), PUBLISHED, method="DOP853", rtol=1e-13, atol=1e-15, events=strikes, dense_output=True
    )
    theta, w, _, _ = found.y_events[0][0]
    w *= np.cos(2 * theta) / (1 + FEET * np.sin(2 * theta) ** 2)
    back = np.array([-theta, w, -2 * theta, (1 - np.cos(2 * theta)) * w])
    assert np.abs(back - PUBLISHED).max() < AGREE, "the published digits are not confirmed"
    return float(found.t_events[0][0]), found.sol


def walker(steps: int = 10) -> Case:
    """Some steps; the last ends in the middle of a swing."""
    period, motion = stride()

    def expected(times: Any) -> Mapping[str, Any]:
        phase = np.mod(times, period)
        inside = np.minimum(phase, period - phase) > 1e-3  # of the instants of a strike nothing is asked
        y = motion(phase)
        return {"stands": np.where(inside, y[0], np.nan), "swings": np.where(inside, y[2], np.nan)}

    return Case(
        "the simplest walking model (Garcia et al. 1998)",
        "steps",
        steps,
        TEXT,
        {},
        (steps + 0.5) * period,
        expected,
        points=401,
    )
