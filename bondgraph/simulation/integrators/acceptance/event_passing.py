"""Events that a run passes without Python: the first zero crossing of a step, what acts there, and the mode just after it.

The usual case alone, by the rules of `simulation/events`: whatever else comes up is `LEFT` to Python, which begins with the same step again.
"""

from __future__ import annotations

from math import isfinite, ulp

from compiler.api import Floats, Ints, Record, sized

from ...monitors import step_size_diagnosis
from ..cuts import ALLOWED, BACK, HALVES, NEAR, PARTED, SHORTEST, SLOPE
from ..methods import EXACT, PARTS
from ..workspace import Function, IntegratorWorkspace
from .crossing_search import CHANGES
from .event_indicators import IndicatorWorkspace, decide, doubt, evaluate, keep, look_ahead, reread
from .first_crossing import FOUND, LEFT, NONE, first_crossing
from .zero_crossings import free_roots, full_at, roots_at

THROUGH = 2  # what the search for a crossing answers, and this for one that only events read
SHORT = 1e-12  # relative to the time: events closer than this count as simultaneous
MOST_ROUNDS = 100  # most rounds of events that cause each other at one instant
OFTEN = 3  # times in a row that an event makes its condition false before it is expected to
HARMLESS = 0.01  # in units of the tolerance: largest difference of two laws that one step may use both of
ROOM = 256  # instants in the record of what has happened
KNOWN = 16  # modes whose method is known
BEYOND = step_size_diagnosis.BEYOND


class EventWorkspace(Record):
    """Events of a program in a run, and what they do on the way. Modes have `mode_size` items."""

    triggers: Function
    values: Function
    actives: Function
    solver: IntegratorWorkspace
    conditions: IndicatorWorkspace
    mode_size: int
    event_count: int
    setting_count: int
    junction_count: int
    stops: Ints  # event_count: 1 where the event ends the run
    owner: Ints  # setting_count: the event
    position: Ints  # setting_count: place in the mode or among the states
    is_mode: Ints  # setting_count
    reset_value: Floats = sized("setting_count")
    active: Floats = sized("junction_count")
    is_active: Ints = sized("junction_count")  # 1 where it is on in this program
    holds: Floats = sized("event_count")  # truth of the conditions of the events
    on: Ints = sized("event_count")  # the same before this instant
    acts: Ints = sized("event_count")
    acted: Ints = sized("event_count")
    left: Ints = sized("event_count")  # times in a row that an event made its condition false
    crossed: Ints = sized("root_count")  # conditions that have crossed zero
    recent: float  # instant of the last event
    many: int  # steps of a segment whose cause is reported
    most_events: int  # that may still act
    # of the step, to begin it again
    mode_before: Floats = sized("mode_size")
    on_before: Ints = sized("event_count")
    logged_before: int
    spacing_before: float
    derivatives_before: int
    # methods with which segments in some modes have begun
    automatic: int  # 1 if another method may take over
    known_count: int
    known_mode: Floats = sized(KNOWN, "mode_size")
    known_method: Ints = sized(KNOWN)
    otherwise: int  # method in all other modes; -1: not known
    # what has happened since Python has looked: instants, and the modes from there on
    logged: int
    log_time: Floats = sized(ROOM)
    log_kind: Ints = sized(ROOM)  # FOUND or THROUGH
    log_mode: Floats = sized(ROOM, "mode_size")
    log_crossed: Ints = sized(ROOM, "root_count")
    log_acted: Ints = sized(ROOM, "event_count")
    # segments that have ended, and the one that has begun last
    passed: int
    begun: float
    begun_state: Floats = sized("n")
    begun_position: int
    peak: Floats = sized("n")  # largest values in SI
    steps: int
    derivatives: int
    jacobians: int
    factorisations: int


def passing(e: EventWorkspace) -> int:
    """Find out what happens in the last step: `NONE`, `FOUND` with the hybrid state after all events, or `LEFT`, and then nothing has changed."""
    s = e.solver
    keep_before(e)
    answer = crossing(e)
    if answer == FOUND:
        answer = happening(e)
    if answer == LEFT:
        for i in range(e.mode_size):
            s.mode[i] = e.mode_before[i]
        put_said(e)
        for i in range(e.event_count):
            e.on[i] = e.on_before[i]
        e.logged = e.logged_before
        e.conditions.spacing = e.spacing_before
        s.derivatives = e.derivatives_before
    return answer


def keep_before(e: EventWorkspace) -> None:
    """Keep what a crossing that is passed through changes."""
    for i in range(e.mode_size):
        e.mode_before[i] = e.solver.mode[i]
        e.conditions.mode[i] = e.solver.mode[i]
    for i in range(e.event_count):
        e.on_before[i] = e.on[i]
    e.logged_before = e.logged
    e.spacing_before = e.conditions.spacing
    e.derivatives_before = e.solver.derivatives


def put_said(e: EventWorkspace) -> None:
    """Read the truth of the conditions from the mode."""
    s = e.solver
    for j in range(s.root_count):
        s.root_said[j] = 1 if s.mode[e.conditions.places[j]] == 1.0 else 0


def crossing(e: EventWorkspace) -> int:
    """Find the crossing that ends the last step; pass through those that only events read, none of which acts."""
    s = e.solver
    k = e.conditions
    start = s.end_time[s.ends - 2]
    stop = s.end_time[s.ends - 1]
    parts = PARTS[s.method]
    for part in range(parts):
        begin = start + (stop - start) * float(part) / float(parts)
        end = stop if part + 1 == parts else start + (stop - start) * float(part + 1) / float(parts)
        while begin < end:
            answer = first_crossing(s, k, begin, end)
            if answer == FOUND:
                answer = LEFT if jumps(k) else judged(e, start, stop)
            if answer == NONE:
                break
            if answer != THROUGH:
                return answer
            begin = k.found
    roots_at(s, stop, s.root_seen)
    free_roots(s)
    for j in range(s.root_count):
        if s.root_seen[j] != s.root_seen[j]:
            return LEFT
    return NONE


def jumps(k: IndicatorWorkspace) -> bool:
    """Return True if one of the conditions that change may be nothing but the rounding of terms that cancel."""
    for j in range(k.root_count):
        if k.touching[j] == CHANGES and k.converged[j] == 0:
            return True
    return False


def judged(e: EventWorkspace, start: float, stop: float) -> int:
    """Put the hybrid state at a crossing into the conditions, as they are behind it; return `FOUND` if it ends the step, or `THROUGH`."""
    s = e.solver
    k = e.conditions
    k.time = k.found
    full_at(s, k.found, k.state)
    for i in range(e.mode_size):
        k.mode[i] = s.mode[i]
    steers = 0
    for j in range(s.root_count):
        e.crossed[j] = 1 if k.touching[j] == CHANGES else 0
        if e.crossed[j] != 0:
            k.mode[k.places[j]] = 1.0 - k.mode[k.places[j]]
            steers += k.steers[j]
    if switches(e):
        return LEFT
    if find_rising(e) > 0 or moves_others(e):
        return FOUND
    if steers > 0:
        return FOUND if laws_differ(e, start, stop) else LEFT
    if e.logged >= ROOM:
        return LEFT
    for i in range(e.event_count):
        e.on[i] = 1 if e.holds[i] == 1.0 else 0
    log(e, THROUGH)
    for i in range(e.mode_size):
        s.mode[i] = k.mode[i]
    put_said(e)
    return THROUGH


def moves_others(e: EventWorkspace) -> bool:
    """Return True if a condition that crosses is read by the root of another: that one's truth is not what it has crossed under the branch before."""
    s = e.solver
    k = e.conditions
    s.roots(k.time, k.state, s.inputs, s.constants, s.mode, k.root)
    s.roots(k.time, k.state, s.inputs, s.constants, k.mode, k.change)
    for j in range(s.root_count):
        if k.root[j] != k.change[j] and (isfinite(k.root[j]) or isfinite(k.change[j])):
            return True
    return False


def find_rising(e: EventWorkspace) -> int:
    """Find the events whose conditions become true at the hybrid state; return how many."""
    k = e.conditions
    e.triggers(k.time, k.state, k.inputs, k.constants, k.mode, e.holds)
    rising = 0
    for i in range(e.event_count):
        e.acts[i] = 1 if e.holds[i] == 1.0 and e.on[i] == 0 else 0
        rising += e.acts[i]
    return rising


def switches(e: EventWorkspace) -> bool:
    """Return True if other junctions are off at the hybrid state."""
    k = e.conditions
    if e.junction_count > 0:
        e.actives(k.time, k.state, k.inputs, k.constants, k.mode, e.active)
    for i in range(e.junction_count):
        if (1 if e.active[i] == 1.0 else 0) != e.is_active[i]:
            return True
    return False


def laws_differ(e: EventWorkspace, start: float, stop: float) -> bool:
    """Return True if the rates under the modes of both sides differ beyond what one step may use both of."""
    s = e.solver
    k = e.conditions
    time = 0.5 * (k.found + stop)
    full_at(s, time, k.later)
    s.derivative(time, k.later, s.inputs, s.constants, s.mode, k.slope)
    s.derivative(time, k.later, s.inputs, s.constants, k.mode, k.rate)
    s.derivatives += 2
    for i in range(s.n):
        allowed = HARMLESS * (s.resting[i] * s.magnitude[i] + s.relative * abs(k.later[i]))
        if not abs((stop - start) * (k.rate[i] - k.slope[i])) <= allowed:
            return True
    return False


def log(e: EventWorkspace, kind: int) -> None:
    """Record an instant, with the mode from there on."""
    k = e.conditions
    here = e.logged
    e.log_time[here] = k.time
    e.log_kind[here] = kind
    for i in range(e.mode_size):
        e.log_mode[here * e.mode_size + i] = k.mode[i]
    for j in range(k.root_count):
        e.log_crossed[here * k.root_count + j] = e.crossed[j]
    for i in range(e.event_count):
        e.log_acted[here * e.event_count + i] = e.acted[i] if kind == FOUND else 0
    e.logged += 1


def happening(e: EventWorkspace) -> int:
    """Let all events at a crossing act, as `Events.happen` does; return `FOUND`, or `LEFT`."""
    s = e.solver
    k = e.conditions
    time = k.found
    if (
        time - e.recent <= SHORT * abs(time)
        or s.stop - time <= SHORT * abs(s.stop)
        or e.logged >= ROOM
        or e.most_events <= 0
    ):
        return LEFT
    if s.steps >= e.many:
        return LEFT
    if EXACT[s.method] == 0 and not is_sure(s, k, s.end_time[s.ends - 2], time):
        return LEFT
    for i in range(s.n):
        if abs(k.state[i]) > BEYOND * s.magnitude[i]:  # which is reported
            return LEFT
        e.peak[i] = max(e.peak[i], max(s.greatest[i] * s.magnitude[i], abs(k.state[i])))
    if acting(e) == LEFT or switches(e) or k.flows == 0 or method_in(e) < 0:
        return LEFT
    acted = 0
    for i in range(e.event_count):
        if e.acted[i] != 0:
            acted += 1
            if e.stops[i] != 0 or (e.on[i] != 0 and e.left[i] >= OFTEN):
                return LEFT
    for j in range(s.root_count):
        if e.crossed[j] != 0 and (k.sought[j] > 0 or (acted == 0 and k.mode[k.places[j]] == s.mode[k.places[j]])):
            return LEFT  # no look ahead shows the crossing, or the flow contradicts it
    for i in range(e.event_count):
        if e.acted[i] != 0:
            e.left[i] = e.left[i] + 1 if e.on[i] == 0 else 0
    log(e, FOUND)
    e.recent = time
    e.most_events -= 1
    return FOUND


def acting(e: EventWorkspace) -> int:
    """Change the hybrid state by all events, until none acts; return `LEFT` where they do not end soon."""
    k = e.conditions
    for i in range(e.event_count):
        e.acted[i] = 0
    if settling(e) == LEFT:
        return LEFT
    for _ in range(MOST_ROUNDS):
        rising = find_rising(e)
        for i in range(e.event_count):
            e.on[i] = 1 if e.holds[i] == 1.0 else 0
            e.acted[i] = max(e.acted[i], e.acts[i])
        if rising == 0:
            return FOUND
        keep(k)
        if resetting(e) == LEFT:
            return LEFT
        evaluate(k)
        reread(k)
        if switches(e) or settling(e) == LEFT:
            return LEFT
    return LEFT


def settling(e: EventWorkspace) -> int:
    """Change the mode until all conditions are as just after the instant; return `LEFT` where they do not settle."""
    k = e.conditions
    for _ in range(2 * (k.root_count + 1)):
        if evaluate(k) > 0:
            return LEFT
        if doubt(k) > 0:
            look_ahead(k)
            if decide(k) > 0:
                return LEFT
        changed = 0
        for j in range(k.root_count):
            if float(k.truth[j]) != k.mode[k.places[j]]:
                k.mode[k.places[j]] = float(k.truth[j])
                changed += 1
        if changed == 0:
            return FOUND
    return LEFT


def resetting(e: EventWorkspace) -> int:
    """Set what the acting events set, each from the values before; return `LEFT` where that is refused."""
    k = e.conditions
    if e.setting_count > 0:
        e.values(k.time, k.state, k.inputs, k.constants, k.mode, e.reset_value)
    for i in range(e.setting_count):
        if e.acts[e.owner[i]] != 0:
            if not isfinite(e.reset_value[i]):
                return LEFT
            for j in range(i):
                same = e.is_mode[i] == e.is_mode[j] and e.position[i] == e.position[j]
                if same and e.acts[e.owner[j]] != 0 and e.owner[i] != e.owner[j]:
                    return LEFT
            if e.is_mode[i] != 0:
                k.mode[e.position[i]] = e.reset_value[i]
            else:
                k.state[e.position[i]] = e.reset_value[i]
    return FOUND


def method_in(e: EventWorkspace) -> int:
    """Return the method with which a segment in the mode of the hybrid state begins; -1 if it is not known."""
    for number in range(e.known_count):
        same = 1
        for i in range(e.mode_size):
            if e.known_mode[number * e.mode_size + i] != e.conditions.mode[i]:
                same = 0
        if same != 0:
            return e.known_method[number]
    return e.otherwise


def is_sure(s: IntegratorWorkspace, k: IndicatorWorkspace, start: float, stop: float) -> bool:
    """Return True if the dense output of a step satisfies the equations from its start up to the event that cuts it: see `integration/cut.py`."""
    size = stop - start
    if size < SHORTEST * ulp(max(abs(start), abs(stop))):
        return True
    s.derivatives += 2
    for p in range(2):
        time = start + size * HALVES[p]
        full_at(s, time, k.later)
        s.derivative(time, k.later, s.inputs, s.constants, s.mode, k.rate)
        for i in range(s.n):
            k.slope[i] = 0.0
        for b in range(PARTED):
            full_at(s, time + NEAR * size * BACK[b], s.si)
            for i in range(s.n):
                k.slope[i] += SLOPE[b] / NEAR * s.si[i]
        for i in range(s.differential):
            allowed = s.resting[i] * s.magnitude[i] + s.relative * abs(k.later[i])
            if abs(size * k.rate[i] - k.slope[i]) > ALLOWED * allowed:
                return False
    return True
