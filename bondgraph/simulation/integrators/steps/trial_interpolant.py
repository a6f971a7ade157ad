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
        along_stages(s, at, s.z, out)
        for i in range(s.n):
            out[i] += s.state[i]
    else:
        value_at(s, at, s.state, out)


def along_stages(s: IntegratorWorkspace, at: float, stages: Floats, out: Floats) -> None:
    """Compute how far the collocation polynomial of three stages leads from the start."""
    n = s.n
    a = at * (P[0] + at * (P[1] + at * P[2]))
    b = at * (P[3] + at * (P[4] + at * P[5]))
    c = at * (P[6] + at * (P[7] + at * P[8]))
    for i in range(n):
        out[i] = a * stages[i] + b * stages[n + i] + c * stages[2 * n + i]


def value_at(s: IntegratorWorkspace, at: float, first: Floats, out: Floats) -> None:
    """Compute the state by the polynomial of order 7 within a step of DOP853 that begins with `first`."""
    along_rows(s, at, s.dense, out)
    for i in range(s.n):
        out[i] += first[i]


def along_rows(s: IntegratorWorkspace, at: float, rows: Floats, out: Floats) -> None:
    """Compute how far the polynomial of order 7 of these rows leads from the start."""
    n = s.n
    back = 1.0 - at
    for i in range(n):
        value = at * rows[6 * n + i] + rows[5 * n + i]
        value = back * value + rows[4 * n + i]
        value = at * value + rows[3 * n + i]
        value = back * value + rows[2 * n + i]
        value = at * value + rows[n + i]
        out[i] = at * (back * value + rows[i])
