"""Conditions on states: their truth just after an instant, and the mode in which all of them are so, as in `simulation/events` of a run.

See `indicators.py` and `mode_iteration.py` there for the reasons; units have no events beside loops, and no switched junctions.
"""

from __future__ import annotations

from math import isfinite

from compiler.api import Floats, Ints

from ...simulation.events import mode_iteration
from ...simulation.integrators.acceptance.crossing_search import LEAST
from ...simulation.integrators.acceptance.event_indicators import (
    NOISE,
    REACHES,
    TRIES,
    decide,
    doubt,
    evaluate,
    look_ahead,
    put_later,
)
from ...simulation.integrators.acceptance.zero_crossings import FREE, truth
from .constraints import refresh
from .instance import OK, SLIDES, EventData, FmuInstance, refused
from .segment import INFINITE

CLOSE, VANISHES = mode_iteration.CLOSE, mode_iteration.VANISHES
FAR = REACHES[-1]


def said(s: FmuInstance, j: int) -> int:
    """Return 1 if a condition holds in the mode."""
    return 1 if s.solver.mode[s.events.conditions.places[j]] == 1.0 else 0


def put(s: FmuInstance, j: int, value: int) -> int:
    """Put the truth of a condition into the mode; return 1 if it changes."""
    if said(s, j) == value:
        return 0
    s.solver.mode[s.events.conditions.places[j]] = float(value)
    return 1


def count_in(s: FmuInstance) -> int:
    """Put the whole numbers that belong to the conditions into the mode; return how many change."""
    e = s.events
    w = s.solver
    changed = 0
    if e.counted_count > 0:
        refresh(s)
        e.find_counts(s.time, s.full, w.inputs, w.constants, w.mode, e.counts)
    for k in range(e.counted_count):
        if w.mode[e.counted[k]] != e.counts[k]:
            w.mode[e.counted[k]] = e.counts[k]
            changed += 1
    return changed


def look(s: FmuInstance) -> None:
    """Evaluate the conditions at the current values: their roots, the rounding of these, and the flow."""
    k = s.events.conditions
    w = s.solver
    refresh(s)
    k.inputs = w.inputs
    k.constants = w.constants
    k.mode = w.mode
    k.state = s.full
    k.magnitude = w.magnitude
    k.strict = w.root_strict
    k.floor = w.root_floor
    k.time = s.time
    k.until = s.next_instant
    k.relative = s.relative
    k.horizon = s.stop - s.time if s.stop < INFINITE and s.stop > s.time else max(1.0, abs(s.time))
    evaluate(k)


def just_after(s: FmuInstance) -> None:
    """Find the truth of the conditions just after; where rounding hides it the flow decides, and where nothing moves it stays."""
    k = s.events.conditions
    look(s)
    if doubt(k) > 0:
        look_ahead(k)
        decide(k)


def guess_mode(s: FmuInstance) -> None:
    """Put the conditions into the mode as evaluated; a root below rounding counts as zero."""
    k = s.events.conditions
    w = s.solver
    for _ in range(w.root_count + 1):
        look(s)
        changed = 0
        for j in range(w.root_count):
            root = 0.0 if abs(k.root[j]) <= k.noise[j] else k.root[j]
            changed += put(s, j, truth(root, w.root_strict[j]))
        changed += count_in(s)
        if changed == 0:
            return


def settle_mode(s: FmuInstance) -> int:
    """Change the mode until all conditions are as just after it."""
    e = s.events
    k = e.conditions
    w = s.solver
    most = 2 * (w.root_count + 1)
    for j in range(w.root_count):
        e.flips[j] = 0
    e.alike = 1
    for number in range(2 * most):
        just_after(s)
        if number > most:
            compare_rates(s, e)
        for i in range(w.n):
            s.rates[i] = k.rate[i]
        changed = 0
        for j in range(w.root_count):
            flip = put(s, j, k.truth[j])
            changed += flip
            if number >= most:
                e.flips[j] = max(e.flips[j], flip)
        changed += count_in(s)
        if changed == 0:
            return OK
    return rest_between(s)


def compare_rates(s: FmuInstance, e: EventData) -> None:
    """See if the rates of two modes of a cycle are equal, as for a law that is continuous at its condition."""
    k = e.conditions
    w = s.solver
    for i in range(w.differential):
        if not k.whole * abs(k.rate[i] - s.rates[i]) <= CLOSE * max(w.magnitude[i], abs(s.full[i])):
            e.alike = 0


def rest_between(s: FmuInstance) -> int:
    """Find the mode at conditions that lead back from both their sides: as where the sides are equal, if the motion stays there."""
    e = s.events
    k = e.conditions
    w = s.solver
    for j in range(w.root_count):
        e.rest[j] = truth(0.0, w.root_strict[j])
    put_flips(s, e.rest)
    just_after(s)
    fits = 1
    for j in range(w.root_count):
        if k.truth[j] != said(s, j):
            fits = 0
    if fits != 0 or is_at_rest(s):
        return OK
    reach = 4.0
    if k.flows == 0 or (e.alike == 0 and not vanishes(s)):
        return refused(s, SLIDES)
    if e.alike == 0:
        reach = max(reach, k.relative / NOISE)
        put_flips(s, k.truth)
    for j in range(w.root_count):
        if e.flips[j] != 0:
            w.root_floor[j] = reach * k.noise[j]
    return OK


def put_flips(s: FmuInstance, truths: Ints) -> None:
    """Put the truth of the conditions that change again and again into the mode."""
    for j in range(s.solver.root_count):
        if s.events.flips[j] != 0:
            put(s, j, truths[j])
    count_in(s)


def vanishes(s: FmuInstance) -> bool:
    """Return True if laws go through zero where the sides of conditions are equal: see `_onwards` of `mode_iteration.py`."""
    e = s.events
    k = e.conditions
    w = s.solver
    for r in range(1, TRIES):
        put_later(k, REACHES[r] * k.whole, k.rate)
        w.derivative(s.time, k.later, w.inputs, w.constants, w.mode, k.slope)
        put_flips(s, k.truth)
        put_later(k, REACHES[r] * k.whole, k.rate)
        w.derivative(s.time, k.later, w.inputs, w.constants, w.mode, w.si)
        put_flips(s, e.rest)
        largest = 0.0
        for i in range(w.differential):
            difference = abs(w.si[i] - k.slope[i])
            if not isfinite(difference) or (r > 1 and not s.rates[i] <= VANISHES * difference):
                return False
            s.rates[i] = difference
            largest = max(largest, difference)
        if largest == 0.0:  # something else jumps there, as a count of steps
            return False
    return True


def is_at_rest(s: FmuInstance) -> bool:
    """Return True if the rates leave the roots of these conditions zero but for rounding."""
    e = s.events
    k = e.conditions
    w = s.solver
    if k.flows == 0:
        return False
    put_later(k, FAR * k.whole, k.rate)
    w.roots(s.time, k.later, w.inputs, w.constants, w.mode, k.again)
    for j in range(w.root_count):
        if e.flips[j] != 0 and not max(abs(k.root[j]), abs(k.again[j])) <= k.noise[j]:
            return False
    for j in range(w.root_count):
        if e.flips[j] != 0:
            w.root_floor[j] = max(0.25 * k.noise[j], 2.0 * abs(k.root[j]))
    return True


def indicate(s: FmuInstance, indicators: Floats) -> None:
    """Compute event indicators: roots, shifted such that one leaves zero at its event and crosses it again only when the condition changes back.

    Where a root is clear of zero, its rounding level ends: else each event would be found a little farther behind its zero, and a plateau at zero, as of
    `max(x, 0)`, not at all. The sign at zero is then that of the condition there.
    """
    e = s.events
    k = e.conditions
    w = s.solver
    refresh(s)
    w.roots(s.time, s.full, w.inputs, w.constants, w.mode, k.root)
    for j in range(w.root_count):
        now = said(s, j)
        if FREE * w.root_floor[j] < abs(k.root[j]) < INFINITE and truth(k.root[j], w.root_strict[j]) == now:
            w.root_floor[j] = 0.0
        holds = now if w.root_floor[j] > 0.0 else truth(0.0, w.root_strict[j])
        shift = max(w.root_floor[j], LEAST)
        if holds != 0:
            shift = -shift
        indicators[j] = k.root[j] + shift if isfinite(k.root[j]) else shift
