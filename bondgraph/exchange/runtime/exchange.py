"""Model exchange: the importer integrates, the unit tells rates and the instants at which something changes with time."""

from __future__ import annotations

from compiler.api import Bytes, Floats, Ints, ShortInts

from ...simulation.integrators.tolerances import (
    FIRST,
    allowed_estimate,
    creeping_tolerance,
    newton_tolerance,
    stagnation_tolerance,
)  # fmt: skip
from .conditions import indicate
from .constraints import hold
from .events import instant, steady
from .instance import (
    EVENT_MODE,
    EVENTS,
    INITIALIZING,
    INSTANTIATED,
    NOT_NOW,
    OK,
    RUNNING,
    TERMINATED,
    FmuInstance,
    refused,
)
from .segment import INFINITE, forget
from .values import check_limits, check_start, find_outputs, find_rates, may_start, settle

LEAST, LARGEST = 1e-13, 0.1  # relative tolerances
LAST_TIME, TERMINATED_STATUS = 2, 3  # kinds of status that an importer asks for


def set_up(s: FmuInstance, has_tolerance: int, tolerance: float, start: float, has_stop: int, stop: float) -> int:
    """Take the experiment of the importer."""
    if s.phase != INSTANTIATED:
        return refused(s, NOT_NOW)
    s.time = start
    s.segment_known = 0
    s.stop = stop if has_stop != 0 else INFINITE
    if has_tolerance != 0 and tolerance > 0.0:
        integrate_to(s, min(max(tolerance, LEAST), LARGEST))
    return OK


def set_up_and_start(s: FmuInstance, has_tolerance: int, tolerance: float, start: float, has_stop: int, stop: float) -> int:  # fmt: skip
    """Take the experiment of the importer, and begin the initialization."""
    failed = set_up(s, has_tolerance, tolerance, start, has_stop, stop)
    return failed if failed != OK else may_start(s)


def integrate_to(s: FmuInstance, relative: float) -> None:
    """Integrate to a relative tolerance; absolute ones that no author gave are proportional to it."""
    w = s.solver
    for i in range(w.n):
        if w.held[i] == 0:
            w.resting[i] *= relative / w.relative
    s.relative = relative
    w.relative = relative
    w.tolerance = relative
    w.allowed_estimate = allowed_estimate(relative)
    w.newton_tolerance = newton_tolerance(relative, 1.0)
    w.first_newton_tolerance = newton_tolerance(relative, FIRST)
    w.creeping_tolerance = creeping_tolerance(relative)
    w.stagnation_tolerance = stagnation_tolerance(relative)


def end_initialization(s: FmuInstance) -> int:
    """End the initialization."""
    if s.phase != INITIALIZING:
        return refused(s, NOT_NOW)
    settle(s)
    failed = check_start(s)
    if failed == OK:
        failed = hold(s)
    if failed != OK:
        return failed
    s.phase = RUNNING if s.makes_steps != 0 and (s.makes_steps & EVENT_MODE) == 0 else EVENTS
    failed = pass_instant(s)
    if s.has_events != 0:
        s.events.begins = 1
    if failed == OK:
        failed = find_rates(s)
    if failed == OK:
        failed = find_outputs(s)
    if failed != OK:
        return failed
    return check_limits(s)


def enter_events(s: FmuInstance) -> int:
    """Let the importer change values at an instant."""
    s.phase = EVENTS
    return OK


def enter_continuous(s: FmuInstance) -> int:
    """Let the importer integrate."""
    if s.has_events != 0:
        s.events.begins = 0
    s.phase = RUNNING
    return OK


def pass_instant(s: FmuInstance) -> int:
    """Pass into the next segment of time, let events act."""
    s.segment_known = 0
    s.waiting = 0
    s.broken = 1
    settle(s)
    if s.has_events == 0:
        return OK
    s.events.resets = 0
    s.events.begins = 0
    failed = instant(s)
    if failed == OK:
        steady(s)
    return failed


def update_events(s: FmuInstance, flags: ShortInts, numbers: Floats) -> int:
    """Act on an instant. `flags` and `numbers` are the same structure of the importer."""
    failed = pass_instant(s)
    for k in range(5):
        flags[k] = 0
    if s.has_events != 0:
        flags[1] = s.events.ended
        flags[3] = s.events.resets
    if s.next_instant < INFINITE:
        flags[4] = 1
        numbers[3] = s.next_instant
    return failed


def update_discrete_states(
    s: FmuInstance, again: Bytes, ends: Bytes, nominals: Bytes, values: Bytes, timed: Bytes, time: Floats
) -> int:
    """Act on an instant, and tell what it has changed."""
    failed = pass_instant(s)
    again[0] = 0
    ends[0] = s.events.ended if s.has_events != 0 else 0
    nominals[0] = 0
    values[0] = s.events.resets if s.has_events != 0 else 0
    timed[0] = 1 if s.next_instant < INFINITE else 0
    time[0] = s.next_instant
    return failed


def set_time(s: FmuInstance, time: float) -> int:
    """Set the time."""
    if time != s.time:
        s.time = time
        forget(s)
    return OK


def set_states(s: FmuInstance, states: Floats, count: int) -> int:
    """Set all states."""
    if count != s.solver.differential:
        return refused(s, NOT_NOW)
    settle(s)
    for i in range(count):
        s.state[i] = states[i]
    forget(s)
    return OK


def get_states(s: FmuInstance, states: Floats, count: int) -> int:
    """Put all states into an array."""
    settle(s)
    for i in range(min(count, s.solver.differential)):
        states[i] = s.state[i]
    return OK


def get_rates(s: FmuInstance, rates: Floats, count: int) -> int:
    """Put the rates of all states into an array."""
    failed = find_rates(s)
    if failed != OK:
        return failed
    for i in range(min(count, s.solver.differential)):
        rates[i] = s.rates[i]
    return OK


def get_nominals(s: FmuInstance, nominals: Floats, count: int) -> int:
    """Put the magnitudes of all states into an array."""
    for i in range(min(count, s.solver.differential)):
        nominals[i] = s.solver.magnitude[i]
    return OK


def get_indicators(s: FmuInstance, indicators: Floats, count: int) -> int:
    """Put the event indicators into an array."""
    if count != s.solver.root_count:
        return refused(s, NOT_NOW)
    settle(s)
    if count > 0:
        indicate(s, indicators)
    return OK


def end_step(s: FmuInstance, no_return: int, events: ShortInts, ends: ShortInts) -> int:
    """Look at a step that the importer has made."""
    events[0] = 0
    ends[0] = 0
    return check_limits(s)


def complete_step(s: FmuInstance, events: Bytes, ends: Bytes) -> int:
    """Look at a step that the importer has made."""
    events[0] = 0
    ends[0] = 0
    return check_limits(s)


def count_states(s: FmuInstance, number: Ints) -> int:
    """Tell the number of states."""
    number[0] = s.solver.differential
    return OK


def count_indicators(s: FmuInstance, number: Ints) -> int:
    """Tell the number of event indicators."""
    number[0] = s.solver.root_count
    return OK


def get_truth(s: FmuInstance, kind: int, value: ShortInts) -> int:
    """Tell if an event has ended the run."""
    if kind != TERMINATED_STATUS:
        return refused(s, NOT_NOW)
    value[0] = s.events.ended if s.has_events != 0 else 0
    return OK


def get_number(s: FmuInstance, kind: int, value: Floats) -> int:
    """Tell the time that a communication step has reached."""
    if kind != LAST_TIME:
        return refused(s, NOT_NOW)
    value[0] = s.time
    return OK


def terminate(s: FmuInstance) -> int:
    """End the run."""
    s.phase = TERMINATED
    return OK
