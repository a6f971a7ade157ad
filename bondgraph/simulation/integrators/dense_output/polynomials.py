"""Polynomials within the last step: of each method, and for Radau also the one through the last step ends."""

from __future__ import annotations

from compiler.api import Floats

from .. import radau
from ..methods import CONSERVING, EXACT, THROUGH_ENDS
from ..steps.dop853_dense import polynomial
from ..steps.energy_step import within_step
from ..steps.exponential_step import exponential_within
from ..steps.trial_interpolant import along_stages
from ..workspace import IntegratorWorkspace

SURE = radau.SURE
COMPARED = (1 / 3, 2 / 3)  # fractions of a step
FOLLOWING = 1 / 2  # of the error estimate: largest difference of the two where the solution is smooth
ALIKE, APART, BROKEN = 0, 1, 2  # they agree; they differ as where the solution is smooth; by more


def interpolated(s: IntegratorWorkspace, time: float, out: Floats) -> None:
    """Compute the scaled state: by the quintic, but by the collocation polynomial for states in which `compare` trusts that one."""
    if s.ends < 3 or THROUGH_ENDS[s.method] == 0:
        collocation(s, time, out)
        return
    if s.node_count == 0:
        interpolate(s)
    quintic(s, time, out)
    if s.differs == BROKEN:
        collocation(s, time, s.w)
        for i in range(s.n):
            if s.apart[i] == BROKEN:
                out[i] = s.w[i]


def quintic(s: IntegratorWorkspace, time: float, out: Floats) -> None:
    """Put the polynomial through the last step ends, scaled states, into `out`; its coefficients are known."""
    n = s.n
    top = s.node_count - 1
    for i in range(n):
        out[i] = s.coefficients[top * n + i]
    for k in range(top - 1, -1, -1):
        past = time - s.nodes[k]
        for i in range(n):
            out[i] = out[i] * past + s.coefficients[k * n + i]


def collocation(s: IntegratorWorkspace, time: float, out: Floats) -> None:
    """Put the polynomial of the method in the last step, scaled states, into `out`."""
    if CONSERVING[s.method] != 0:
        within_step(s, time, out)
        return
    if EXACT[s.method] != 0:
        exponential_within(s, time, out)
        return
    if THROUGH_ENDS[s.method] == 0:
        polynomial(s, time, out)
        return
    n = s.n
    before = s.ends - 2
    at = (time - s.end_time[before]) / (s.end_time[before + 1] - s.end_time[before])
    along_stages(s, at, s.stages, out)
    for i in range(n):
        out[i] += s.end_state[before * n + i]


def interpolate(s: IntegratorWorkspace) -> None:
    """Compute the polynomial through values and rates at the last three step ends, from the last one back, by divided differences in Newton's form."""
    n = s.n
    m = 6 if s.first_sloped != 0 else 5
    for j in range(m):
        end = 2 - j // 2
        s.nodes[j] = s.end_time[end]
        for i in range(n):
            s.coefficients[j * n + i] = s.end_state[end * n + i]
    for order in range(1, m):
        for j in range(m - 1, order - 1, -1):
            gap = s.nodes[j] - s.nodes[j - order]
            if gap == 0.0:
                end = 2 - j // 2
                for i in range(n):
                    s.coefficients[j * n + i] = s.end_slope[end * n + i]
                continue
            by = 1.0 / gap
            for i in range(n):
                s.coefficients[j * n + i] = (s.coefficients[j * n + i] - s.coefficients[(j - 1) * n + i]) * by
    s.node_count = m
    compare(s)


def compare(s: IntegratorWorkspace) -> None:
    """Mark the states in which the two polynomials of the last step differ at one of two places; nearer to its ends they agree even where both are wrong.

    Where the solution is smooth they differ by the error of the collocation polynomial, about a fifth of the estimate. By more, the quintic is the wrong one:
    the steps before have another solution, as in front of a kink.
    """
    n = s.n
    s.differs = 0
    usual = 0.0
    for i in range(n):
        s.apart[i] = ALIKE
        usual = max(usual, FOLLOWING * s.allowed_estimate * abs(s.error[i]))
    start = s.end_time[s.ends - 2]
    for k in range(2):
        time = start + COMPARED[k] * (s.time - start)
        quintic(s, time, s.w)
        collocation(s, time, s.rest)
        for i in range(n):
            gap = abs(s.w[i] - s.rest[i]) / (s.absolute[i] + s.relative * abs(s.end_state[2 * n + i]))
            if not gap <= SURE:
                s.apart[i] = max(s.apart[i], APART if gap <= usual else BROKEN)
                s.differs = max(s.differs, s.apart[i])
