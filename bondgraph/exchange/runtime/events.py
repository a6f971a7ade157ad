"""Events at an instant: what is due, conditions that have crossed zero, resets, until nothing changes any more; see `simulation/events/events.py`."""

from __future__ import annotations

from math import isfinite

from ...simulation.events import events
from ...simulation.integrators.acceptance.event_indicators import NOISE, keep, reread
from ...simulation.integrators.acceptance.event_passing import MOST_ROUNDS, OFTEN, SHORT, is_sure
from ...simulation.integrators.acceptance.first_crossing import FOUND, LEFT, first_crossing
from ...simulation.integrators.acceptance.zero_crossings import free_roots, full_at, is_wrong, roots_at, truth
from ...simulation.integrators.methods import PARTS
from .conditions import count_in, guess_mode, look, put, said, settle_mode
from .constraints import refresh
from .instance import (
    CROWDED,
    KEPT,
    NOT_FINITE,
    OK,
    PILED_UP,
    SET_TWICE,
    WITHOUT_END,
    WRONG_SAMPLING,
    EventData,
    FmuInstance,
    refused,
)
from .segment import collect_ticks, enter_segment, forget

BEYOND, ALIKE, SHRUNK = float(events.BEYOND), float(events.ALIKE), events.SHRUNK
MOST_AT_ONCE = events.MOST_AT_ONCE
SOON = 1e-6  # of a step
NOTHING, CUT, UNSURE, FAILED = 0, 1, 2, 3  # answers of the search for an event in a step


def start_modes(s: FmuInstance) -> None:
    """Put the start of discrete variables and the truth of all conditions into the mode."""
    e = s.events
    w = s.solver
    if e.discrete_count > 0:
        e.find_modes(0.0, s.state, w.inputs, w.constants, w.mode, e.starts)
    for k in range(e.discrete_count):
        if e.is_set[k] == 0:
            w.mode[k] = e.starts[k]
    guess_mode(s)


def instant(s: FmuInstance) -> int:
    """Let act what acts at the time of the instance."""
    e = s.events
    k = e.conditions
    w = s.solver
    if e.wrong != 0:
        return refused(s, WRONG_SAMPLING)
    collect_ticks(s)
    enter_segment(s)
    s.segment_known = 1
    refresh(s)
    w.roots(s.time, s.full, w.inputs, w.constants, w.mode, k.root)
    crossed = 0
    for j in range(w.root_count):
        w.root_said[j] = said(s, j)
        e.floor[j] = w.root_floor[j]
        e.crossed[j] = 1 if is_wrong(w, j, k.root[j]) else 0
        crossed += e.crossed[j]
    for j in range(w.root_count):
        if e.crossed[j] != 0:
            put(s, j, 1 - w.root_said[j])
    count_in(s)
    for i in range(e.event_count):
        e.acted[i] = 0
    failed = happen(s)
    forget(s)
    if failed != OK:
        return failed
    acted = 0
    for i in range(e.event_count):
        acted += e.acted[i]
    if acted + crossed == 0:
        return OK
    for j in range(w.root_count):  # those that no look ahead shows stay until they are beyond the tolerance
        if e.crossed[j] != 0 and said(s, j) != w.root_said[j] and k.sought[j] > 0:
            w.root_floor[j] = max(w.root_floor[j], k.relative / NOISE * k.noise[j])
    again = is_simultaneous(s)
    if acted == 0:
        keep_doubtful(s, again)
    if e.simultaneous > MOST_AT_ONCE or is_piled_up(s):
        return refused(s, PILED_UP)
    return OK


def happen(s: FmuInstance) -> int:
    """Let events act, and those that follow from them, until none does."""
    e = s.events
    w = s.solver
    failed = settle_mode(s)
    for _ in range(MOST_ROUNDS):
        if failed != OK:
            return failed
        acting = 0
        if e.event_count > 0:
            refresh(s)
            e.find_triggers(s.time, s.full, w.inputs, w.constants, w.mode, e.triggers)
        for k in range(e.event_count):
            true = 1 if e.triggers[k] == 1.0 else 0
            e.acts[k] = 1 if e.due[k] != 0 or (true != 0 and e.was_true[k] == 0) else 0
            e.was_true[k] = true
            e.due[k] = 0
            e.acted[k] = max(e.acted[k], e.acts[k])
            acting += e.acts[k]
            if e.acts[k] != 0 and e.stops[k] != 0:
                e.ended = 1
        if acting == 0:
            return OK
        keep(e.conditions)
        failed = act(s, 0)
        if failed == OK:
            failed = act(s, 1)
        if failed == OK:
            look(s)
            reread(e.conditions)
            count_in(s)
            failed = settle_mode(s)
    return refused(s, WITHOUT_END)


def act(s: FmuInstance, at_once: int) -> int:
    """Set what the acting events set, all from the values before. `at_once`: 1 for those that act after the others."""
    e = s.events
    w = s.solver
    if e.setting_count > 0:
        refresh(s)
        e.find_values(s.time, s.full, w.inputs, w.constants, w.mode, e.values)
    for k in range(e.setting_count):
        if acts_now(e, k, at_once):
            for i in range(k):
                if acts_now(e, i, at_once) and e.is_mode[i] == e.is_mode[k] and e.position[i] == e.position[k]:
                    return refused(s, SET_TWICE)
            if not isfinite(e.values[k]):
                return refused(s, NOT_FINITE)
            if e.is_mode[k] != 0:
                w.mode[e.position[k]] = e.values[k]
            else:
                s.state[e.position[k]] = e.values[k]
                e.resets = 1
                s.full_known = 0
    return OK


def acts_now(e: EventData, k: int, at_once: int) -> bool:
    """Return True if the event of a setting acts."""
    return e.acts[e.owner[k]] != 0 and e.at_once[e.owner[k]] == at_once


def is_simultaneous(s: FmuInstance) -> bool:
    """Count the instants that are one but for rounding; return True if this is not the first of them."""
    e = s.events
    if e.simultaneous > 0 and s.time - e.recent <= SHORT * abs(s.time):
        e.simultaneous += 1
        return True
    e.recent = s.time
    e.simultaneous = 1
    return False


def keep_doubtful(s: FmuInstance, again: bool) -> None:
    """Keep conditions as they are that the flow leads back within rounding of their zero crossing, until they are beyond doubt."""
    e = s.events
    k = e.conditions
    w = s.solver
    look(s)
    for j in range(w.root_count):
        most = BEYOND * k.noise[j]
        least = min(e.floor[j], most) if again else 0.0
        if e.crossed[j] != 0 and said(s, j) == w.root_said[j]:
            least = most
        w.root_floor[j] = max(w.root_floor[j], least)


def is_piled_up(s: FmuInstance) -> bool:
    """Return True if an event accumulates: its reset has become too small to make its condition false again."""
    e = s.events
    piled = False
    for k in range(e.event_count):
        if e.acted[k] != 0:
            first = KEPT * k
            for i in range(OFTEN - 1, 0, -1):
                e.intervals[first + i] = e.intervals[first + i - 1]
            e.intervals[first] = s.time - e.when[k]
            e.when[k] = s.time
            if e.was_true[k] == 0:
                e.left[k] += 1
                if e.left[k] > 1:
                    e.intervals[first + OFTEN] = max(e.intervals[first + OFTEN], e.intervals[first])
            else:
                if e.left[k] >= OFTEN and shrinks(e, first, s.makes_steps):
                    piled = True
                e.left[k] = 0
    return piled


def shrinks(e: EventData, first: int, exact: int) -> bool:
    """Return True if the last intervals get shorter, and are much shorter than the longest one. `exact`: also by nearly one factor, which the
    instants of an importer need not show."""
    if e.intervals[first] >= SHRUNK * e.intervals[first + OFTEN]:
        return False
    least = 1.0
    most = 0.0
    for i in range(OFTEN - 1):
        factor = e.intervals[first + i] / e.intervals[first + i + 1]
        least = min(least, factor)
        most = max(most, factor)
    return most < 1.0 and (most < ALIKE * least or exact == 0)


def steady(s: FmuInstance) -> None:
    """Raise what counts as zero to the rounding of the roots, so that an importer sees no indicator rest at zero."""
    e = s.events
    k = e.conditions
    w = s.solver
    look(s)
    for j in range(w.root_count):
        w.root_floor[j] = max(w.root_floor[j], 0.25 * k.noise[j])
        if truth(k.root[j], w.root_strict[j]) != said(s, j) and isfinite(k.root[j]):
            w.root_floor[j] = max(w.root_floor[j], 2.0 * abs(k.root[j]))


def cut_at_event(s: FmuInstance) -> int:
    """Find the first zero crossing in the last step; put the instant and the state there into the instance, or those of the start of a step that
    is to be made again with shorter ones."""
    w = s.solver
    k = s.events.conditions
    start = w.end_time[w.ends - 2]
    parts = PARTS[w.method]
    look(s)
    s.full_known = 0  # the search writes there
    begin = start
    for part in range(parts):
        end = w.time if part + 1 == parts else start + (w.time - start) * float(part + 1) / float(parts)
        answer = first_crossing(w, k, begin, end)
        if answer == FOUND:  # where terms cancel, roots are rounding: they cross as often as one looks
            s.events.crowded = s.events.crowded + 1 if k.found - start <= SOON * (w.time - start) else 0
        if answer == LEFT or s.events.crowded > MOST_AT_ONCE:
            s.message = CROWDED
            return FAILED
        if answer == FOUND and is_sure(w, k, start, k.found):
            s.time = k.found
            full_at(w, k.found, s.state)
            s.events.located = 1
            return CUT
        if answer == FOUND:
            take_back(s)
            return UNSURE
        begin = end
    roots_at(w, w.time, w.root_seen)
    free_roots(w)
    return NOTHING


def take_back(s: FmuInstance) -> None:
    """Put the start of the last step into the instance."""
    w = s.solver
    s.time = w.end_time[w.ends - 2]
    for i in range(w.n):
        s.state[i] = w.end_state[(w.ends - 2) * w.n + i] * w.magnitude[i]
