"""Loop over steps in the subset of Python that becomes machine code, around a step of one method.

Where there is no machine code, the same source runs over numpy (`in_numpy.py`, `plain.py`).
"""

from __future__ import annotations

from importlib import import_module
from math import isfinite, sqrt, ulp

from ...segments import timeline
from ..acceptance.event_passing import EventWorkspace, method_in, passing, put_said
from ..acceptance.first_crossing import FOUND, LEFT
from ..acceptance.singular_poses import GOES_ON, begin_watch, watch
from ..acceptance.step_acceptance import add_work, grow
from ..acceptance.zero_crossings import may_flip
from ..dense_output.dense_output import sample
from ..dop853 import LOOK_AGAIN, OFTEN
from ..methods import CONSERVING, ESTIMATES, EXACT, EXPLICIT, EXPONENTIAL, STEP_NAMES
from ..outcomes import FINISHED, FLIP, HANDOVER, LOOK, MORE, STIFF
from ..radau import FIRST_ULPS
from ..selection import is_steep
from ..steps.energy_step import take_energy
from ..steps.evaluation import rates
from ..tolerances import first_length
from ..workspace import IntegratorWorkspace

# The step of each method, by its number: a new one is a row of the table of solvers and a module of `steps/`.
STEPS = tuple(getattr(import_module(f"..steps.{name}", __package__), name) for name in STEP_NAMES)
MARGIN = float(timeline.ROUNDING)


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
        if s.selection.slope_count > 0 and s.time < s.stop:
            for i in range(s.n):
                s.si[i] = s.state[i] * s.magnitude[i]
            if is_steep(s.selection, s.time, s.si, s.inputs, s.constants, s.mode):
                return HANDOVER
        if s.automatic != 0 and s.held_by_stability >= OFTEN and s.time < s.stop:
            return STIFF
        if s.closed.positions.rows > 0 and s.time < s.stop:
            near = watch(s)
            if near != GOES_ON:
                return near
    return FINISHED if s.time >= s.stop else MORE


def advance_through(e: EventWorkspace, most: int) -> int:
    """Make up to `most` steps as `advance`, through events that need no Python, each of which begins another segment."""
    s = e.solver
    count = 0
    while count < most:
        before = s.steps
        answer = advance(s, most - count)
        count += s.steps - before
        if answer == FLIP:
            happened = passing(e)
            if happened == LEFT:
                return FLIP
            if happened == FOUND:
                begin_behind(e)
            elif e.logged > e.logged_before and EXACT[s.method] != 0:
                s.last_size = 0.0  # the matrix is another
        elif answer != MORE:
            return answer
    return MORE


def begin_behind(e: EventWorkspace) -> None:
    """Finish a step up to its event, and begin the segment behind it."""
    s = e.solver
    k = e.conditions
    s.until = k.time
    advance(s, 1)
    e.steps += s.steps
    e.derivatives += s.derivatives
    e.jacobians += s.jacobians
    e.factorisations += s.factorisations
    s.method = method_in(e)
    s.automatic = e.automatic if s.method == EXPLICIT or s.method == EXPONENTIAL else 0
    while s.position < s.instant_count and s.instants[s.position] <= k.time:
        for i in range(s.n):
            s.reported[s.position * s.n + i] = k.state[i]
        s.position += 1
    for i in range(s.n):
        s.si[i] = k.state[i]
        e.begun_state[i] = k.state[i]
    for i in range(e.mode_size):
        s.mode[i] = k.mode[i]
    put_said(e)
    for j in range(s.root_count):
        s.root_floor[j] = k.floor[j]
    e.passed += 1
    e.begun = k.time
    e.begun_position = s.position
    put_start(s, k.time)
    begin_segment(s)


def put_start(s: IntegratorWorkspace, start: float) -> None:
    """Put the start of a new segment, up to the same end: see `compiled/fields.py`."""
    s.time = start
    s.until = s.stop
    margin = MARGIN * ulp(max(abs(start), abs(s.stop)))
    s.earliest = start + margin
    s.latest = s.stop - margin
    while s.node_next > 0 and s.node_time[s.node_next - 1] >= start:
        s.node_next -= 1
    while s.node_next < s.signal_nodes and s.node_time[s.node_next] < start:
        s.node_next += 1


def one_step(s: IntegratorWorkspace) -> int:
    """Make one accepted step of the method; return 0, or the reason why there is none."""
    failed: int = STEPS[s.method](s)
    return failed


def begin_segment(s: IntegratorWorkspace) -> None:
    """Begin a segment with the state that is in `si`, as a new solver would."""
    for i in range(s.n):
        s.state[i] = s.si[i] / s.magnitude[i]
        s.absolute[i] = s.resting[i]
        s.peak[i] = max(abs(s.state[i]), 1.0)
        s.greatest[i] = 0.0
        s.error[i] = 0.0
    s.fastest = 0.0
    s.since_looked = LOOK_AGAIN
    s.held_by_stability = 0
    s.free_steps = 0
    s.steps = 0
    s.derivatives = 0
    s.jacobians = 0
    s.factorisations = 0
    s.negative = 0
    begin(s)


def begin(s: IntegratorWorkspace) -> None:
    """Discard what steps share with each other; compute the first rates, and the first step size if the method has an error estimate."""
    s.known = 0
    s.current = 0
    s.factorised = 0
    s.first_sloped = 0
    s.node_count = 0
    s.pending = 0
    s.last_size = 0.0
    s.last_error = 0.0
    s.contraction = 0.0
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
