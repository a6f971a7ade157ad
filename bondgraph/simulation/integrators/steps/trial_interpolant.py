"""Interpolant of a trial step: scaled states at a fraction of it, by the polynomial of its method."""

from __future__ import annotations

from compiler.api import Floats

from .. import radau
from ..methods import THROUGH_ENDS
from ..workspace import IntegratorWorkspace

P = tuple(radau.P.ravel().tolist())


def tried_at(s: IntegratorWorkspace, at: float, out: Floats) -> None:
    """Compute the state of Radau from its stages, that of DOP853 from the results of `dop853_dense.densify_between`."""
    if THROUGH_ENDS[s.method] != 0:
        from_stages(s, at, out)
    else:
        value_at(s, at, s.state, out)


def from_stages(s: IntegratorWorkspace, at: float, out: Floats) -> None:
    """Compute the state by the collocation polynomial."""
    n = s.n
    a = at * P[0] + at * at * P[1] + at * at * at * P[2]
    b = at * P[3] + at * at * P[4] + at * at * at * P[5]
    c = at * P[6] + at * at * P[7] + at * at * at * P[8]
    for i in range(n):
        out[i] = s.state[i] + (a * s.z[i] + b * s.z[n + i] + c * s.z[2 * n + i])


def value_at(s: IntegratorWorkspace, at: float, first: Floats, out: Floats) -> None:
    """Compute the state by the polynomial of order 7 within a step of DOP853 that begins with `first`."""
    n = s.n
    back = 1.0 - at
    for i in range(n):
        value = at * s.dense[6 * n + i] + s.dense[5 * n + i]
        value = back * value + s.dense[4 * n + i]
        value = at * value + s.dense[3 * n + i]
        value = back * value + s.dense[2 * n + i]
        value = at * value + s.dense[n + i]
        value = back * value + s.dense[i]
        out[i] = first[i] + at * value
