"""Segments of time: up to the next instant at which an expression jumps or bends, or an event is sampled."""

from __future__ import annotations

from math import isfinite, ulp

from compiler.api import random_number

from .instance import INITIALIZING, EventData, FmuInstance

INFINITE = 1.7976931348623157e308
GOLDEN = 0.6180339887498949  # place within a segment at which no periods meet
ROUNDING = 16.0  # units in the last place of a time
COLUMNS = 5  # of `sampling`
MOST_SEEDS = 2147483648.0
MOST_TICKS = 8  # between the earliest one that may lie ahead and the one that does


def forget(s: FmuInstance) -> None:
    """Discard what was computed from values that have changed since."""
    s.full_known = 0
    s.rates_known = 0
    s.outputs_known = 0
    s.slopes_known = 0
    if s.has_events != 0:
        s.events.modes_known = 0


def enter_segment(s: FmuInstance) -> None:
    """Find the next instant at which something changes with time, and the truth of the conditions on time up to it."""
    w = s.solver
    if s.instant_count > 0:
        s.find_instants(0.0, s.state, w.inputs, w.constants, w.mode, s.instants)
    s.next_instant = INFINITE
    for k in range(s.instant_count):
        near = ROUNDING * max(ulp(s.time), ulp(s.instants[k]))
        if s.instants[k] > s.time + near:
            s.next_instant = min(s.next_instant, s.instants[k])
    if s.recurring_count > 0:
        s.find_recurring(0.0, s.state, w.inputs, w.constants, w.mode, s.recurring)
    for k in range(s.recurring_count // 2):
        s.next_instant = min(s.next_instant, next_integer(s.time, s.recurring[2 * k], s.recurring[2 * k + 1]))
    if s.has_events != 0:
        for k in range(s.events.sample_count):
            s.next_instant = min(s.next_instant, max(tick(s.events, k), s.time))
    margin = ROUNDING * ulp(s.time)
    w.earliest = s.time + margin
    w.latest = s.next_instant
    if s.next_instant < INFINITE:
        w.latest = s.next_instant - ROUNDING * max(ulp(s.time), ulp(s.next_instant))
    if s.mode_count > 0:
        within = s.time + max(1.0, abs(s.time))
        if s.next_instant < INFINITE:
            within = s.time + GOLDEN * (s.next_instant - s.time)
        s.find_switches(within, s.state, w.inputs, w.constants, w.mode, s.switches)
        for k in range(s.mode_count):
            w.mode[s.timed[k]] = s.switches[k]


def next_integer(time: float, at_zero: float, slope: float) -> float:
    """Return the next instant at which a function linear in time is an integer."""
    if slope == 0.0:
        return INFINITE
    forward = 1.0 if slope > 0.0 else -1.0
    first = float(int(at_zero + slope * time)) - 2.0 * forward
    for k in range(MOST_TICKS):
        instant = (first + forward * float(k) - at_zero) / slope
        if instant > time + ROUNDING * max(ulp(time), ulp(instant)):
            return instant
    return INFINITE


def inside(s: FmuInstance) -> float:
    """Return the time; just inside of the segment where it is an end of it, because ends are rounded."""
    w = s.solver
    if s.time < w.earliest:
        return w.earliest
    if s.time > w.latest and s.time - s.next_instant <= s.next_instant - w.latest:
        return w.latest
    return s.time


def tick(e: EventData, k: int) -> float:
    """Return the next instant at which an event is sampled: each from its number, so that no rounding adds up."""
    row = COLUMNS * k
    late = e.sampling[row + 1] + e.sampling[row + 2]
    if e.sampling[row + 3] > 0.0:
        late += e.sampling[row + 3] * (0.5 + 0.5 * random_number(int(e.number[k]), int(e.sampling[row + 4])))
    return e.sampling[row] * e.number[k] + late


def near_ticks(s: FmuInstance, k: int) -> float:
    """Return up to which distance two instants of a sampled event are one."""
    return ROUNDING * ulp(max(abs(s.time), s.events.sampling[COLUMNS * k]))


def place_ticks(s: FmuInstance) -> None:
    """Find the first instants of sampled events after those that have acted; where the run begins, those that are now are among them."""
    e = s.events
    w = s.solver
    e.wrong = 0
    if e.sample_count > 0:
        e.find_sampling(0.0, s.state, w.inputs, w.constants, w.mode, e.sampling)
    for k in range(e.sample_count):
        row = COLUMNS * k
        period = e.sampling[row]
        offset = e.sampling[row + 1]
        delay = e.sampling[row + 2]
        jitter = e.sampling[row + 3]
        seed = e.sampling[row + 4]
        if not (period > 0.0 and isfinite(period) and min(offset, delay, jitter) >= 0.0):
            e.wrong = 1
        if not (offset < period and delay + jitter < period):
            e.wrong = 1
        if not (seed >= 0.0 and seed < MOST_SEEDS and float(int(seed)) == seed):
            e.wrong = 1
        if e.wrong == 0:
            past = e.done if s.phase > INITIALIZING else s.time
            near = near_ticks(s, k) if s.phase > INITIALIZING else -near_ticks(s, k)
            e.number[k] = float(int((past - offset - delay - jitter) / period) - 2)
            for _ in range(MOST_TICKS):
                if tick(e, k) < past + near:
                    e.number[k] += 1.0
        e.at_once[e.sampled[k]] = 1 if e.late[e.sampled[k]] != 0 and not delay > 0.0 else 0


def collect_ticks(s: FmuInstance) -> None:
    """Find the sampled events that act now."""
    e = s.events
    e.done = s.time
    for k in range(e.sample_count):
        if tick(e, k) <= s.time + near_ticks(s, k):
            e.due[e.sampled[k]] = 1
            e.number[k] += 1.0
