"""Loop over steps in the subset of Python that becomes machine code, around a step of one method.

Where there is no machine code, the same source runs over numpy (`in_numpy.py`, `plain.py`).
"""

from __future__ import annotations

from importlib import import_module
from math import isfinite, sqrt, ulp

from ..acceptance.singular_poses import GOES_ON, begin_watch, watch
from ..acceptance.step_acceptance import add_work, grow, steep
from ..acceptance.zero_crossings import may_flip
from ..dense_output.dense_output import sample
from ..dop853 import OFTEN
from ..methods import CONSERVING, ESTIMATES, EXACT, METHODS
from ..outcomes import FINISHED, FLIP, HANDOVER, LOOK, MORE, STIFF
from ..radau import FIRST_ULPS
from ..steps.energy_step import take_energy
from ..steps.evaluation import rates
from ..tolerances import first_length
from ..workspace import IntegratorWorkspace

# The step of each method, by its number: a new one is a row of the table of solvers and a module of `steps/`.
STEPS = tuple(getattr(import_module(f"..steps.{row.word}_step", __package__), f"{row.word}_step") for row in METHODS)


def advance(s: IntegratorWorkspace, most: int) -> int:
    """Make up to `most` steps; return earlier if the caller has to act."""
    for _ in range(most):
        if s.pending == 0:
            if s.time >= s.stop:
                return FINISHED
            failed = one_step(s)
            if failed != 0:
                return failed
            s.steps += 1
            s.pending = 2
            if s.root_count > 0 and may_flip(s):
                return FLIP
        if s.pending == 2:
            s.pending = 1
            if sample(s):
                return LOOK
        if s.power_count > 0:
            add_work(s)
        s.pending = 0
        if s.until <= s.time and s.until < s.stop:
            return FINISHED
        grow(s)
        if s.slope_count > 0 and s.time < s.stop and steep(s):
            return HANDOVER
        if s.automatic != 0 and s.held_by_stability >= OFTEN and s.time < s.stop:
            return STIFF
        if s.closed.positions.rows > 0 and s.time < s.stop:
            near = watch(s)
            if near != GOES_ON:
                return near
    return FINISHED if s.time >= s.stop else MORE


def one_step(s: IntegratorWorkspace) -> int:
    """Make one accepted step of the method; return 0, or the reason why there is none."""
    failed: int = STEPS[s.method](s)
    return failed


def begin(s: IntegratorWorkspace) -> None:
    """Compute the first rates, and the first step size if the method has an error estimate."""
    rates(s, s.time, s.state, s.rate)
    begin_watch(s)
    if CONSERVING[s.method] != 0:
        take_energy(s)
    if EXACT[s.method] == 0:
        put_first_size(s)
    s.ends = 1
    s.end_time[0] = s.time
    for i in range(s.n):
        s.end_state[i] = s.state[i]


def put_first_size(s: IntegratorWorkspace) -> None:
    """Compute the first step size (Hairer, Nørsett and Wanner, Solving ODEs I, section II.4)."""
    span = s.stop - s.time
    d0 = 0.0
    d1 = 0.0
    for i in range(s.differential):
        s.scale[i] = s.absolute[i] + abs(s.state[i]) * s.relative
        if isfinite(s.scale[i]):
            d0 += s.state[i] / s.scale[i] * (s.state[i] / s.scale[i])
            d1 += s.rate[i] / s.scale[i] * (s.rate[i] / s.scale[i])
    d0 = sqrt(d0) / sqrt(float(s.n))
    d1 = sqrt(d1) / sqrt(float(s.n))
    h0 = 1e-6 * span if d0 < 1e-5 or d1 * span < 1e-5 else 0.01 * max(d0, 1.0) / d1
    h0 = min(h0, span) if isfinite(h0) and h0 > 0.0 else 1e-6 * span
    d2 = curvature(s, h0)
    if not isfinite(d2) and d1 > 0.0:  # a law has no value that far ahead
        h0 = min(h0, 0.01 * max(d0, 1.0) / d1)
        d2 = curvature(s, h0)
    h1 = first_length(d1, d2, 1.0 / float(ESTIMATES[s.method]))
    if not (isfinite(h1) and isfinite(d2)):
        h1 = h0
    s.size = min(max(min(100.0 * h0, h1), FIRST_ULPS * ulp(s.time)), span)


def curvature(s: IntegratorWorkspace, length: float) -> float:
    """Return the norm of the second derivative, by the rates at the end of an explicit step; not finite where they have no value there."""
    for i in range(s.n):
        s.new[i] = s.state[i] + length * s.rate[i] if i < s.differential else s.state[i]
    rates(s, s.time + length, s.new, s.f)
    total = 0.0
    for i in range(s.differential):
        if isfinite(s.scale[i]):
            total += (s.f[i] - s.rate[i]) / s.scale[i] * ((s.f[i] - s.rate[i]) / s.scale[i])
    return sqrt(total) / sqrt(float(s.n)) / length
