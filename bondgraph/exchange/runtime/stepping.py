"""Co-simulation: the unit makes its own steps, with the methods and the error control of a run."""

from __future__ import annotations

from math import isfinite, ulp

from compiler.api import Bytes, Floats

from ...simulation.integrators.compiled.advance import advance, begin, begin_segment
from ...simulation.integrators.dense_output.dense_output import INNER, C, state_at
from ...simulation.integrators.methods import EXPLICIT, RADAU, THROUGH_ENDS
from ...simulation.integrators.outcomes import CROSS, FINISHED, FLIP, LOOK, MORE, REDUNDANT, STIFF
from .conditions import said
from .constraints import hold
from .events import CUT, FAILED, UNSURE, cut_at_event, instant
from .instance import (
    DISCARD,
    EARLY_RETURN,
    ENDED,
    ERROR,
    EVENT_MODE,
    NO_STEP,
    NOT_NOW,
    OK,
    RUNNING,
    SINGULAR,
    TOO_MANY_STEPS,
    WARNING,
    WRONG_TIME,
    FmuInstance,
    refused,
)
from .segment import INFINITE, forget
from .values import check_limits, judge_limits, settle

BATCH = 1000
AGAIN = 0.25  # first step, as a share of one that an event has cut badly
MOST = 10_000_000  # steps within one communication step
ROUNDING = 64.0  # units in the last place by which an importer's time may be off
NOTHING = 4.0  # within which nothing changes: an importer's point is an instant of the unit but for rounding
NEAR = 1e-3  # smallest singular value, by the size of the mechanism, up to which no pose counts as singular
TINY = 1e5  # up to which a step is one that the end of a communication step has cut


def do_step(s: FmuInstance, time: float, size: float) -> int:
    """Integrate up to the next communication point."""
    if s.phase != RUNNING:
        return refused(s, NOT_NOW)
    if abs(time - s.time) > ROUNDING * max(ulp(time), ulp(time + size)) or not size >= 0.0 or not isfinite(time + size):
        return refused(s, WRONG_TIME)
    s.waiting = 0
    settle(s)
    answer = OK
    if s.has_events != 0 and s.broken != 0:  # an input or a parameter may have moved a condition
        answer = happens(s)
    if answer == OK:
        answer = go_to(s, time + size)
    if answer > WARNING:
        return answer
    return max(answer, check_limits(s))


def step_or_return(
    s: FmuInstance, time: float, size: float, events: Bytes, ends: Bytes, early: Bytes, reached: Floats
) -> int:
    """Integrate up to the next communication point, or to an event that the importer handles; tell what has happened."""
    answer = do_step(s, time, size)
    ends[0] = 0
    if answer == DISCARD and s.has_events != 0 and s.events.ended != 0:
        ends[0] = 1
        answer = OK
    events[0] = s.waiting
    early[0] = 1 if s.time < time + size and (s.makes_steps & EARLY_RETURN) != 0 else 0
    reached[0] = s.time
    return answer


def hands_over(s: FmuInstance, target: float) -> bool:
    """Return True if the importer is to handle an event."""
    return (
        s.has_events != 0
        and (s.makes_steps & EVENT_MODE) != 0
        and ((s.makes_steps & EARLY_RETURN) != 0 or s.time >= target)
    )


def go_to(s: FmuInstance, target: float) -> int:
    """Integrate to a time, from event to event and from segment to segment."""
    result = OK
    while s.time < target:
        if target - s.time <= NOTHING * ulp(target):
            s.time = target
            s.broken = 1
            forget(s)
            return result
        until = min(target, s.next_instant)
        answer = go_along(s, until)
        if answer > WARNING:
            return answer
        result = max(result, answer)
        if s.has_events != 0 and s.events.located != 0:
            s.events.located = 0
        else:
            s.time = until
            if s.next_instant == INFINITE or until < s.next_instant - ROUNDING * ulp(s.next_instant):
                forget(s)
                continue
        if hands_over(s, target):
            s.waiting = 1
            s.broken = 1
            forget(s)
            return result
        answer = happens(s)
        if answer != OK:
            return answer
    return result


def happens(s: FmuInstance) -> int:
    """Act on an instant."""
    s.segment_known = 0
    s.broken = 1
    settle(s)
    if s.has_events != 0:
        failed = instant(s)
        if failed == OK and s.events.ended != 0:
            s.message = ENDED
            return DISCARD
        return failed
    return OK


def go_along(s: FmuInstance, until: float) -> int:
    """Integrate within a segment, up to a time or to the first event."""
    w = s.solver
    if s.broken != 0 or w.time != s.time or w.size < TINY * ulp(s.time):
        failed = start_steps(s, until)
        if failed != OK:
            return failed
    w.stop = until
    w.until = until
    if w.n == 0:
        w.time = until
        w.ends = 2
        if w.root_count > 0 and cut_at_event(s) == FAILED:
            return ERROR
        return OK
    answer = make_steps(s)
    if answer <= WARNING and (s.has_events == 0 or s.events.located == 0):
        for i in range(w.n):
            s.state[i] = w.state[i] * w.magnitude[i]
    return answer


def make_steps(s: FmuInstance) -> int:
    """Make the steps up to the end that is set."""
    w = s.solver
    result = OK
    steps = 0
    while steps < MOST:
        answer = advance(w, BATCH)
        steps += BATCH
        if answer == FINISHED:
            return result
        if answer == STIFF:
            s.own_method = RADAU
            w.method = RADAU
            w.automatic = 0
            begin(w)
        elif answer == FLIP:
            event = cut_at_event(s)
            if event == CUT:
                return result
            if event == FAILED:
                return ERROR
            if event == UNSURE:
                size = w.time - s.time
                forget(s)
                failed = start_steps(s, w.stop)
                if failed != OK:
                    return failed
                w.size = min(w.size, AGAIN * size)
        elif answer == CROSS:
            if w.pose_least[w.poses - 1] <= NEAR:
                return refused(s, SINGULAR)
            w.tried = w.ahead
        elif answer == LOOK:
            judged = look_along(s)
            if judged > WARNING:
                return judged
            result = max(result, judged)
        elif answer == REDUNDANT:
            return refused(s, SINGULAR)
        elif answer != MORE:
            s.message = NO_STEP
            s.broken = 1
            return DISCARD
    s.message = TOO_MANY_STEPS
    s.broken = 1
    return DISCARD


def look_along(s: FmuInstance) -> int:
    """Look at the limits where a step has left one; with unknowns, which the step does not have, at its end and within it."""
    w = s.solver
    for i in range(w.n):
        s.state[i] = w.state[i] * w.magnitude[i]
    if w.always == 0:
        return judge_limits(s, w.time, w.si)
    start = w.end_time[w.ends - 2]
    inner = 2 if THROUGH_ENDS[w.method] != 0 else 4
    judged = OK
    for k in range(inner + 1):
        part = 1.0 if k == inner else (C[k] if inner == 2 else INNER[k])
        s.time = w.time if k == inner else start + part * (w.time - start)
        state_at(w, s.time, s.state)
        forget(s)
        judged = max(judged, check_limits(s))
    return judged


def start_steps(s: FmuInstance, until: float) -> int:
    """Begin to integrate from the current values, as a new solver would."""
    w = s.solver
    failed = hold(s)
    if failed != OK:
        return failed
    w.longest = INFINITE
    if s.period_count > 0:
        s.find_periods(0.0, s.state, w.inputs, w.constants, w.mode, s.periods)
        for k in range(s.period_count):
            w.longest = min(w.longest, abs(s.periods[k]))
    w.usual = w.longest
    for i in range(w.n):
        w.si[i] = s.full[i]
    w.time = s.time
    w.stop = until
    w.until = until
    w.method = s.own_method
    w.automatic = 1 if s.own_method == EXPLICIT else 0
    for j in range(w.root_count):
        w.root_said[j] = said(s, j)
    w.end_time[0] = s.time
    if w.n > 0:
        begin_segment(w)
    s.broken = 0
    return OK
