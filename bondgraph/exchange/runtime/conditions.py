"""Conditions on states: their truth just after an instant, and the mode in which all of them are so, as in `simulation/events` of a run.

See `indicators.py` and `mode_iteration.py` there for the reasons; units have no loops, constraints and switched junctions.
"""

from __future__ import annotations

from math import isfinite, ulp
from typing import TYPE_CHECKING

from ...simulation.events import mode_iteration
from ...simulation.integrators.acceptance import event_indicators
from .instance import ERROR, OK, SLIDES, EventData, FmuInstance
from .segment import INFINITE

if TYPE_CHECKING:
    from compiler.api import Floats

NOISE, REACHES, SHARE, LATE = (
    event_indicators.NOISE,
    event_indicators.REACHES,
    event_indicators.SHARE,
    event_indicators.LATE,
)
CLOSE = mode_iteration.CLOSE
FAR, COUNT = REACHES[-1], len(REACHES)
HIDDEN, TOLD = 2, 1  # values of `doubtful`


def holds(root: float, strict: int) -> int:
    """Return 1 if a condition with this root holds."""
    return 1 if root < 0.0 or (root == 0.0 and strict == 0) else 0


def said(s: FmuInstance, j: int) -> int:
    """Return 1 if a condition holds in the mode."""
    return 1 if s.solver.mode[s.events.places[j]] == 1.0 else 0


def put(s: FmuInstance, j: int, truth: int) -> int:
    """Put the truth of a condition into the mode; return 1 if it changes."""
    if said(s, j) == truth:
        return 0
    s.solver.mode[s.events.places[j]] = float(truth)
    return 1


def count_in(s: FmuInstance) -> int:
    """Put the whole numbers that belong to the conditions into the mode; return how many change."""
    e = s.events
    w = s.solver
    changed = 0
    if e.counted_count > 0:
        e.find_counts(s.time, s.state, w.inputs, w.constants, w.mode, e.counts)
    for k in range(e.counted_count):
        if w.mode[e.counted[k]] != e.counts[k]:
            w.mode[e.counted[k]] = e.counts[k]
            changed += 1
    return changed


def evaluate(s: FmuInstance) -> None:
    """Compute the roots, their rounding, and the flow with the time in which it moves a state by its magnitude."""
    e = s.events
    w = s.solver
    w.roots(s.time, s.state, w.inputs, w.constants, w.mode, e.roots)
    for j in range(w.root_count):
        e.noise[j] = 0.0
    e.flowing = 0
    speed = 0.0
    if w.n > 0:
        w.derivative(s.time, s.state, w.inputs, w.constants, w.mode, e.flow)
        e.flowing = 1
    for i in range(w.n):
        if not isfinite(e.flow[i]):
            e.flowing = 0
        speed = max(speed, abs(e.flow[i]) / w.magnitude[i])
        e.moved[i] = s.state[i]
    e.whole = s.stop - s.time if s.stop < INFINITE and s.stop > s.time else max(1.0, abs(s.time))
    if e.flowing != 0 and speed > 0.0:
        e.whole = min(e.whole, 1.0 / speed)
    if w.root_count == 0:
        return
    for i in range(w.n):
        e.moved[i] = s.state[i] + SHARE * max(w.magnitude[i], abs(s.state[i]))
        add_noise(s, s.time, NOISE / SHARE)
        e.moved[i] = s.state[i]
    size = max(abs(s.time), 1e-300)
    add_noise(s, s.time + SHARE * size, NOISE / SHARE)
    if e.flowing != 0:
        late = LATE * ulp(size)
        span = max(SHARE * e.whole, late)
        for i in range(w.n):
            e.moved[i] = s.state[i] + span * e.flow[i]
        add_noise(s, s.time + span, late / span)


def add_noise(s: FmuInstance, time: float, share: float) -> None:
    """Add a share of the change of all roots between here and a place that is moved."""
    e = s.events
    w = s.solver
    w.roots(time, e.moved, w.inputs, w.constants, w.mode, e.again)
    for j in range(w.root_count):
        change = abs(e.again[j] - e.roots[j])
        if isfinite(change):
            e.noise[j] += share * change


def just_after(s: FmuInstance) -> None:
    """Find the truth of the conditions just after; where rounding hides it the flow decides, and where nothing moves it stays."""
    e = s.events
    w = s.solver
    evaluate(s)
    hidden = 0
    for j in range(w.root_count):
        e.truth[j] = holds(e.roots[j], w.root_strict[j])
        e.doubtful[j] = 0
        w.root_floor[j] = 0.0
        if abs(e.roots[j]) <= e.noise[j]:
            e.truth[j] = said(s, j)
            e.doubtful[j] = HIDDEN
            w.root_floor[j] = max(0.25 * e.noise[j], 2.0 * abs(e.roots[j]))
            hidden += 1
    for r in range(COUNT):
        if hidden == 0 or e.flowing == 0:
            return
        hidden -= look_ahead(s, REACHES[r] * e.whole)


def look_ahead(s: FmuInstance, span: float) -> int:
    """Follow the flow by Heun's method, and iterated once more; return how many hidden signs it tells."""
    e = s.events
    w = s.solver
    for i in range(w.n):
        e.middle[i] = e.flow[i]
    move_on(s, span)
    mean_rates(s, span)
    move_on(s, span)
    w.roots(s.time + span, e.moved, w.inputs, w.constants, w.mode, e.change)
    mean_rates(s, span)
    move_on(s, span)
    w.roots(s.time + span, e.moved, w.inputs, w.constants, w.mode, e.again)
    signs = 0
    for j in range(w.root_count):
        first = e.change[j] - e.roots[j]
        then = e.again[j] - e.roots[j]
        if e.doubtful[j] == HIDDEN and (abs(first) > 4.0 * e.noise[j] or abs(then) > 4.0 * e.noise[j]):
            signs += 1
            e.doubtful[j] = TOLD
            if first * then > 0.0:
                e.truth[j] = 1 if first < 0.0 else 0
                if e.steers[j] == 0 or e.truth[j] == holds(e.roots[j], w.root_strict[j]):
                    w.root_floor[j] = 0.25 * e.noise[j]
    return signs


def move_on(s: FmuInstance, span: float) -> None:
    """Move the state by the mean rates."""
    e = s.events
    for i in range(s.solver.n):
        e.moved[i] = s.state[i] + span * e.middle[i]


def mean_rates(s: FmuInstance, span: float) -> None:
    """Compute the mean of the rates here and at the moved state."""
    e = s.events
    w = s.solver
    w.derivative(s.time + span, e.moved, w.inputs, w.constants, w.mode, e.middle)
    for i in range(w.n):
        e.middle[i] = 0.5 * (e.flow[i] + e.middle[i])


def guess_mode(s: FmuInstance) -> None:
    """Put the conditions into the mode as evaluated; a root below rounding counts as zero."""
    e = s.events
    w = s.solver
    for _ in range(w.root_count + 1):
        evaluate(s)
        changed = 0
        for j in range(w.root_count):
            root = 0.0 if abs(e.roots[j]) <= e.noise[j] else e.roots[j]
            changed += put(s, j, holds(root, w.root_strict[j]))
        changed += count_in(s)
        if changed == 0:
            return


def settle_mode(s: FmuInstance) -> int:
    """Change the mode until all conditions are as just after it."""
    e = s.events
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
            s.rates[i] = e.flow[i]
        changed = 0
        for j in range(w.root_count):
            flip = put(s, j, e.truth[j])
            changed += flip
            if number >= most:
                e.flips[j] = max(e.flips[j], flip)
        changed += count_in(s)
        if changed == 0:
            return OK
    return rest_between(s)


def compare_rates(s: FmuInstance, e: EventData) -> None:
    """See if the rates of two modes of a cycle are equal, as for a law that is continuous at its condition."""
    w = s.solver
    for i in range(w.n):
        if not e.whole * abs(e.flow[i] - s.rates[i]) <= CLOSE * max(w.magnitude[i], abs(s.state[i])):
            e.alike = 0


def rest_between(s: FmuInstance) -> int:
    """Find the mode at conditions that lead back from both their sides: as where the sides are equal, if the motion stays there."""
    e = s.events
    w = s.solver
    for j in range(w.root_count):
        if e.flips[j] != 0:
            put(s, j, holds(0.0, w.root_strict[j]))
    count_in(s)
    just_after(s)
    fits = 1
    for j in range(w.root_count):
        if e.truth[j] != said(s, j):
            fits = 0
    if fits != 0 or is_at_rest(s):
        return OK
    if e.alike == 0 or e.flowing == 0:
        s.message = SLIDES
        return ERROR
    for j in range(w.root_count):
        if e.flips[j] != 0:
            w.root_floor[j] = 4.0 * e.noise[j]
    return OK


def is_at_rest(s: FmuInstance) -> bool:
    """Return True if the rates leave the roots of these conditions zero but for rounding."""
    e = s.events
    w = s.solver
    if e.flowing == 0:
        return False
    for i in range(w.n):
        e.moved[i] = s.state[i] + FAR * e.whole * e.flow[i]
    w.roots(s.time, e.moved, w.inputs, w.constants, w.mode, e.again)
    for j in range(w.root_count):
        if e.flips[j] != 0 and not max(abs(e.roots[j]), abs(e.again[j])) <= e.noise[j]:
            return False
    for j in range(w.root_count):
        if e.flips[j] != 0:
            w.root_floor[j] = max(0.25 * e.noise[j], 2.0 * abs(e.roots[j]))
    return True


def reread(s: FmuInstance) -> None:
    """Put the truth of conditions whose two sides are equal into the mode: nothing else may move them after a reset."""
    e = s.events
    w = s.solver
    evaluate(s)
    for j in range(w.root_count):
        if abs(e.roots[j]) <= e.noise[j]:
            put(s, j, holds(0.0, w.root_strict[j]))


def indicate(s: FmuInstance, indicators: Floats) -> None:
    """Compute event indicators: roots, shifted such that one leaves zero at its event and crosses it again only when the condition changes back.

    Where a root has left zero, the shift is rounding again: else each event would be found a little farther behind its zero.
    """
    e = s.events
    w = s.solver
    w.roots(s.time, s.state, w.inputs, w.constants, w.mode, e.roots)
    for j in range(w.root_count):
        truth = said(s, j)
        if abs(e.roots[j]) > e.floor[j] and holds(e.roots[j], w.root_strict[j]) == truth:
            w.root_floor[j] = min(w.root_floor[j], e.floor[j])
        shift = max(w.root_floor[j], 1e-300)
        if truth != 0:
            shift = -shift
        indicators[j] = e.roots[j] + shift if isfinite(e.roots[j]) else shift
