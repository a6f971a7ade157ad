"""Within the last step: states at reported instants, and the limits of the model; see `radau.Radau.sample` and `validity.py`."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

from .. import pair, radau
from ..methods import ENERGY, EXPLICIT, RADAU
from .along import polynomial
from .conserving import sample_step, within_step
from .holding import hold
from .stepper import Stepper

if TYPE_CHECKING:
    from ....door import Floats

INNER = pair.INNER
C, P = tuple(radau.C.tolist()), tuple(radau.P.ravel().tolist())


def sample(s: Stepper) -> bool:
    """States at the instants that the last step passed; whether the caller should look at the limits of the model."""
    first = s.position
    while s.position < s.instant_count:
        at = s.instants[s.position]
        if at > s.time or at >= s.stop:
            break
        state_at(s, at, s.reported[s.position * s.n :])
        s.position += 1
    if s.always != 0:
        return True
    if s.limit_count == 0:
        return False
    start = s.end_time[s.ends - 2]
    size = s.time - start
    if leaves(s, start) or leaves(s, s.time):
        return True
    if s.method != RADAU:
        for k in range(4):
            if leaves(s, start + INNER[k] * size):
                return True
    elif leaves(s, start + C[0] * size) or leaves(s, start + C[1] * size):
        return True
    for k in range(first, s.position):
        if leaves(s, s.instants[k]):
            return True
    return False


def leaves(s: Stepper, time: float) -> bool:
    """Whether a limit that is not known to be left does not hold at an instant of the last step."""
    state_at(s, time, s.si)
    s.holds(time, s.si, s.inputs, s.constants, s.mode, s.truth)
    for k in range(s.limit_count):
        if s.left[k] == 0 and s.truth[k] != 1.0:
            return True
    return False


def state_at(s: Stepper, time: float, out: Floats) -> None:
    """States in SI within the last step: the quintic, unless it differs from the collocation polynomial by more than that can err."""
    n = s.n
    if s.method == ENERGY:
        sample_step(s, time, out)
    else:
        collocation(s, time, out)
    if s.ends == 3 and s.method == RADAU:
        if s.node_count == 0:
            interpolate(s)
        m = s.node_count
        for i in range(n):
            value = s.coefficients[(m - 1) * n + i]
            for k in range(m - 2, -1, -1):
                value = value * (time - s.nodes[k]) + s.coefficients[k * n + i]
            limit = 10.0 * (s.absolute[i] + s.relative * abs(s.end_state[2 * n + i]))
            if abs(value - out[i]) <= limit and isfinite(limit):
                out[i] = value
    for i in range(n):
        out[i] *= s.magnitude[i]
    if s.closed.gaps > 0:
        hold(s.closed, time, out)


def collocation(s: Stepper, time: float, out: Floats) -> None:
    """The polynomial of the method in the last step, scaled states."""
    if s.method == EXPLICIT:
        polynomial(s, time, out)
        return
    if s.method == ENERGY:
        within_step(s, time, out)
        return
    n = s.n
    before = s.ends - 2
    at = (time - s.end_time[before]) / (s.end_time[before + 1] - s.end_time[before])
    a = at * (P[0] + at * (P[1] + at * P[2]))
    b = at * (P[3] + at * (P[4] + at * P[5]))
    c = at * (P[6] + at * (P[7] + at * P[8]))
    for i in range(n):
        out[i] = s.end_state[before * n + i] + (a * s.stages[i] + b * s.stages[n + i] + c * s.stages[2 * n + i])


def interpolate(s: Stepper) -> None:
    """The polynomial through values and slopes of the last three ends, by divided differences, in Newton's form."""
    n = s.n
    m = 0
    for k in range(3):
        for twice in range(2):
            if k == 0 and twice == 1 and s.first_sloped == 0:
                continue
            s.nodes[m] = s.end_time[k]
            for i in range(n):
                s.coefficients[m * n + i] = s.end_state[k * n + i]
            m += 1
    shift = 6 - m  # a first end without slope is one node
    for order in range(1, m):
        for j in range(m - 1, order - 1, -1):
            gap = s.nodes[j] - s.nodes[j - order]
            for i in range(n):
                if gap == 0.0:
                    s.coefficients[j * n + i] = s.end_slope[(j + shift) // 2 * n + i]
                else:
                    rise = s.coefficients[j * n + i] - s.coefficients[(j - 1) * n + i]
                    s.coefficients[j * n + i] = rise / gap
    s.node_count = m
