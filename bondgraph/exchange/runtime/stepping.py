"""Co-simulation: the unit makes its own steps, with the methods and the error control of a run."""

from __future__ import annotations

from math import isfinite, ulp

from compiler.api import Bytes, Floats

from ...simulation.integrators.acceptance.zero_crossings import full_at
from ...simulation.integrators.compiled.advance import advance, begin, begin_segment
from ...simulation.integrators.dense_output.dense_output import INNER, C, corrected, state_at
from ...simulation.integrators.dense_output.stiff_interpolation import misses_stiff_states
from ...simulation.integrators.methods import EXPLICIT, RADAU, THROUGH_ENDS
from ...simulation.integrators.outcomes import CROSS, FINISHED, FLIP, LOOK, MORE, REDUNDANT, STIFF
from .conditions import said
from .constraints import hold
from .events import CUT, FAILED, UNSURE, cut_at_event, instant, take_back
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

BEYOND = 1000.0  # communication steps, by which a step may go beyond a communication point
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
    s.goes_on = 1 if s.broken == 0 and s.solver.always == 0 else 0
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
    """Integrate within a segment, up to a time or to the first event; the last step may have been there already."""
    w = s.solver
    if s.broken == 0 and s.time < s.ahead and (until < s.ahead or (until == s.ahead and s.cut == 0)):
        read_within(s, until)
        return OK
    if s.broken == 0 and s.cut != 0:
        s.time = s.ahead
        full_at(w, s.time, s.state)
        s.events.located = 1
        return OK
    w.stop = until
    if s.goes_on != 0:
        w.stop = max(until, min(s.next_instant, min(s.stop, until + BEYOND * (until - s.time))))
    if s.broken != 0 or w.size < TINY * ulp(s.time):
        failed = start_steps(s, until)
        if failed != OK:
            return failed
    w.until = w.stop
    if w.n == 0:
        w.time = until
        w.ends = 2
        if w.root_count > 0 and cut_at_event(s) == FAILED:
            return ERROR
        return OK
    answer = make_steps(s, until)
    if answer <= WARNING and (s.has_events == 0 or s.events.located == 0):
        read_within(s, until)
    return answer


def read_within(s: FmuInstance, time: float) -> None:
    """Put the state at an instant of the last step into the instance."""
    w = s.solver
    if time == w.time:
        for i in range(w.n):
            s.state[i] = w.state[i] * w.magnitude[i]
    else:
        state_at(w, time, s.state)
        corrected(w, time, s.state, misses_stiff_states(w))


def make_steps(s: FmuInstance, until: float) -> int:
    """Make the steps up to a time, which the last one may pass: then nothing but its own error control is to come of what lies beyond."""
    w = s.solver
    result = OK
    for _ in range(MOST):
        answer = advance(w, 1)
        s.ahead = w.time
        if answer == CROSS and w.pose_least[w.poses - 1] > NEAR:
            w.tried = w.ahead
            answer = MORE
        if answer == FINISHED:
            answer = MORE
        if answer == FLIP:
            event = cut_at_event(s)
            if event == CUT and s.time > until:
                s.ahead = s.time
                s.cut = 1
                s.events.located = 0
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
        elif answer == STIFF:
            s.own_method = RADAU
            if w.time >= until:
                s.broken = 1
                return result
            w.method = RADAU
            w.automatic = 0
            begin(w)
        elif answer == MORE or (answer == CROSS and w.stop > until):
            if w.time >= until:
                return result
            if answer == CROSS:
                w.stop = until
                w.until = until
        elif answer == LOOK and w.time <= until:
            judged = look_along(s)
            if judged > WARNING:
                return judged
            result = max(result, judged)
        elif w.stop > until:
            failed = begin_again(s, until)
            if failed != OK:
                return failed
        elif CROSS <= answer <= REDUNDANT:
            return refused(s, SINGULAR)
        else:
            s.message = NO_STEP
            s.broken = 1
            return DISCARD
    s.message = TOO_MANY_STEPS
    s.broken = 1
    return DISCARD


def begin_again(s: FmuInstance, until: float) -> int:
    """Begin again before a step that has met something beyond the communication point, at which the steps then end."""
    w = s.solver
    if w.time > until:
        take_back(s)
    else:
        s.time = w.time
        for i in range(w.n):
            s.state[i] = w.state[i] * w.magnitude[i]
    forget(s)
    return start_steps(s, until)


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
    s.ahead = s.time
    s.cut = 0
    if w.n > 0:
        begin_segment(w)
    s.broken = 0
    return OK
