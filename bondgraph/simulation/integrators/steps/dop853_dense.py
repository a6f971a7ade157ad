"""Dense output of DOP853 (order 7), and the kinks of laws along it; see `dop853.py`.

A tried step and an accepted one are treated alike: both lead from a state and a time to others, with rates at all stages.
"""

from __future__ import annotations

from compiler.api import Floats

from .. import dop853
from ..workspace import IntegratorWorkspace
from .evaluation import rates
from .kinks import first_bend
from .trial_interpolant import value_at

C, STARTS, FROM, A, D = dop853.C, dop853.STARTS, dop853.FROM, dop853.A, dop853.D
STAGES, ALL_STAGES, NEAREST = dop853.STAGES, dop853.ALL_STAGES, dop853.NEAREST
PLACES = (0.0, 0.25, 0.5, 0.75, 1.0)  # fractions of a step at which kinks are searched


def densify(s: IntegratorWorkspace) -> None:
    """Compute the dense output of the last step."""
    n = s.n
    before = s.ends - 2
    densify_between(
        s, s.end_time[before], s.end_time[before + 1], s.end_state[before * n :], s.end_state[(before + 1) * n :]
    )
    s.dense_known = 1


def densify_between(s: IntegratorWorkspace, start: float, stop: float, first: Floats, last: Floats) -> None:
    """Compute the dense output between two states, from three more rates; the rates at the end are known."""
    n = s.n
    size = stop - start
    for stage in range(STAGES + 1, ALL_STAGES):
        evaluate_stage(s, stage, start, size, first)
    put_cubic(s, size, first, last)
    for i in range(n):
        for row in range(4):
            total = 0.0
            for stage in range(ALL_STAGES):
                total += D[row * ALL_STAGES + stage] * s.slope[stage * n + i]
            s.dense[(3 + row) * n + i] = size * total


def evaluate_stage(s: IntegratorWorkspace, stage: int, start: float, size: float, first: Floats) -> None:
    """Compute the rates of a stage of a step that begins with `first`; its state stays in `rest`."""
    combine(s, stage, size, first, s.rest)
    rates(s, start + C[stage] * size, s.rest, s.slope[stage * s.n :])


def combine(s: IntegratorWorkspace, stage: int, size: float, first: Floats, out: Floats) -> None:
    """Compute the state of a stage, from the rates of those before it."""
    n = s.n
    for i in range(n):
        out[i] = 0.0
    for k in range(STARTS[stage], STARTS[stage + 1]):
        weight = A[k]
        place = FROM[k] * n
        for i in range(n):
            out[i] += weight * s.slope[place + i]
    for i in range(n):
        out[i] = first[i] + size * out[i]


def put_cubic(s: IntegratorWorkspace, size: float, first: Floats, last: Floats) -> None:
    """Put the cubic polynomial through two states and the rates there in the place of the dense output, of which it is a part."""
    n = s.n
    for i in range(n):
        change = last[i] - first[i]
        s.dense[i] = change
        s.dense[n + i] = size * s.slope[i] - change
        s.dense[2 * n + i] = 2.0 * change - size * (s.slope[STAGES * n + i] + s.slope[i])
    for i in range(3 * n, 7 * n):
        s.dense[i] = 0.0


def polynomial(s: IntegratorWorkspace, time: float, out: Floats) -> None:
    """Put the scaled states within the last step into `out`."""
    if s.dense_known == 0:
        densify(s)
    before = s.ends - 2
    at = (time - s.end_time[before]) / (s.end_time[before + 1] - s.end_time[before])
    value_at(s, at, s.end_state[before * s.n :], out)


def first_bend_of_pair(s: IntegratorWorkspace, size: float, least: float) -> float:
    """Return the fraction of the tried step at which a law first has a kink; 1 if there is none, or if it is nearer than a step of the least size."""
    rates(s, s.time + size, s.new, s.slope[STAGES * s.n :])
    densify_between(s, s.time, s.time + size, s.state, s.new)
    return first_bend(s, size, PLACES, 5, max(NEAREST, 2.0 * least / size))
