"""Polynomials within the last step: of each method, and for Radau also the one through the last step ends."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .. import radau
from ..methods import CONSERVING, THROUGH_ENDS
from ..steps.dop853_dense import polynomial
from ..steps.energy_step import within_step
from ..workspace import IntegratorWorkspace

if TYPE_CHECKING:
    from compiler.api import Floats

P = tuple(radau.P.ravel().tolist())


def quintic(s: IntegratorWorkspace, time: float, out: Floats) -> None:
    """Put the polynomial through the last step ends, scaled states, into `out`."""
    if s.node_count == 0:
        interpolate(s)
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
    if THROUGH_ENDS[s.method] == 0:
        polynomial(s, time, out)
        return
    n = s.n
    before = s.ends - 2
    at = (time - s.end_time[before]) / (s.end_time[before + 1] - s.end_time[before])
    a = at * (P[0] + at * (P[1] + at * P[2]))
    b = at * (P[3] + at * (P[4] + at * P[5]))
    c = at * (P[6] + at * (P[7] + at * P[8]))
    for i in range(n):
        out[i] = s.end_state[before * n + i] + (a * s.stages[i] + b * s.stages[n + i] + c * s.stages[2 * n + i])


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
