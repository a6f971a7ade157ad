"""Event indicators at an instant: rounding of their roots, and their signs where the flow leads; see `events/indicators.py`."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite, ulp

from compiler.api import Floats, Ints, Record, sized

from ....numerics.indicators import GRID, PLACES
from ....numerics.roots import Bracket
from ..workspace import Function
from .zero_crossings import truth

NOISE = 1e-13  # relative to the magnitudes: rounding in a root that is zero
REACHES = (1e-10, 1e-8, 1e-6, 1e-4, 1e-2)  # relative to the magnitudes: how far the flow is followed to find a sign
TRIES, FARTHEST = len(REACHES), REACHES[-1]
# Reaches, their number, and iterations at them: a motion from rest as t^n shows itself in the n-th.
FAR, FARTHER, FURTHER = (1e-2, 1e-1), 2, 8
SLOWLY = -2  # what `sought` says of a sign that these iterations have found
PART = 1e-6  # of the way to where a root is looked at ahead: a plateau, on which it is as here, ends beyond
AGREE = 0.5  # of a change: as well do two iterations agree that show it
SHARE = 1e-7  # of a magnitude, and of the time in which the flow moves a state by one: steps by which rounding of roots is found
ROUNDED = NOISE / SHARE
LATE = 32.0  # units in the last place of a time: the change of a root within it counts as zero
# in units of the rounding of a root: less is or moves what is no rounding of terms that cancel
CANCELLED, JUMPED = 1e8, 1e4
CERTAIN = 4.0  # in units of the rounding of a root: a larger change shows where it goes
INFINITE = float("inf")
DEEPEST = 26  # most halvings of a part of a step
MOST_SUSPECTS = PLACES + GRID + 1


# Arguments: an instant of a step, array for the roots there.
RootsAt = Callable[[float, "Floats"], None]


class IndicatorWorkspace(Record):
    """Conditions of a program at an instant. n states and unknowns, of which `count` are states."""

    derivative: Function
    roots: Function
    solve: Function  # puts the unknowns of loops into a state; only of Python
    exactly: RootsAt  # roots at an instant of a step, with loops solved; only of Python
    inputs: Floats
    constants: Floats
    n: int
    count: int
    root_count: int
    places: Ints  # root_count: index of the condition in the mode
    strict: Ints  # root_count: 1 where the condition does not hold at zero
    steers: Ints  # root_count: 1 where a law reads it, not only events
    horizon: float  # length of the run, s
    until: float  # end of the segment, s: beyond it other conditions on time hold
    relative: float  # tolerance of the run; 0 where it is not known
    magnitude: Floats = sized("n")  # 0 where it is not known
    # the hybrid state
    time: float
    state: Floats = sized("n")
    mode: Floats
    # roots, their rounding, and the flow there
    root: Floats = sized("root_count")
    noise: Floats = sized("root_count")
    flows: int  # 1 if there are rates, all finite
    rate: Floats = sized("n")
    whole: float  # time in which the flow moves a state by its magnitude, at most the run's length
    # roots a little later
    truth: Ints = sized("root_count")  # 1 where the condition holds just after
    # 1 where the sign is sought, -1 where it was found, `SLOWLY` in a motion from rest, 0 where it was clear
    sought: Ints = sized("root_count")
    moved: Floats = sized("root_count")  # change that shows it, or 0
    later: Floats = sized("n")
    slope: Floats = sized("n")
    change: Floats = sized("root_count")
    again: Floats = sized("root_count")
    floor: Floats = sized("root_count")  # level below which a root is rounding
    # a part of a step, and the roots there
    low: float
    high: float
    said: Ints = sized("root_count")  # 1 where the condition holds in the mode
    values: Floats = sized(PLACES, "root_count")
    form: Floats = sized(PLACES, "root_count")  # coefficients of the polynomials
    grid: Floats = sized(GRID + 1, "root_count")  # their values on the grid
    error: Floats = sized("root_count")  # of the polynomial
    variation: Floats = sized("root_count")
    converged: Ints = sized("root_count")  # 1 where the polynomial is valid between the places
    near: Ints = sized("root_count")  # 1 where there may be a crossing
    near_count: int
    unsure: Ints = sized("root_count")  # 1 where the polynomial does not show all of it
    unsure_count: int
    shown: Ints = sized("root_count")  # 1 where a place shows a crossing
    crosses: Ints = sized("root_count")  # 1 where the grid does
    clear_count: int  # number of near ones without such a place, or with a dip before it
    dips: Ints = sized(GRID + 1, "root_count")  # 1, or `SEARCHED`, where the polynomial may touch zero
    dipping: Ints = sized("root_count")  # 1 where it may somewhere
    suspects: Floats = sized(MOST_SUSPECTS)  # instants at which conditions may have changed
    suspect_count: int
    roots_there: Floats = sized(MOST_SUSPECTS, "root_count")
    most_parts: int  # of a step that are searched before the caller has to act
    ends: Floats = sized(2 * DEEPEST + 2)  # of a part, and of the parts that it begins: halved, or cut at a dip
    spacing: float  # length of the part of a step in which the last zero crossing was found
    measured: int  # 1 if `noise` is that of a step
    at_place: Ints = sized(PLACES)  # 1 where a condition differs from the mode
    at_grid: Ints = sized(GRID + 1)  # 1 where the polynomial of one begins to, or is deepest behind its crossing
    # narrowing
    seen: Floats = sized("root_count")  # roots at the last instant
    scale: Floats = sized("root_count")  # size of the roots behind the crossing
    flipping: Ints = sized("root_count")  # 1 for the conditions that are followed
    behind: Ints = sized("root_count")  # 1 where a condition differs from the mode at the last instant
    touching: Ints = sized("root_count")  # 2 where it is zero at the found instant alone, `CHANGES` where it changes
    bracket: Bracket
    found: float  # first instant behind the crossing


def evaluate(k: IndicatorWorkspace) -> int:
    """Compute the roots, the flow, and the rounding of the roots: from the states, in units of their magnitudes, and from the instant, its change
    along the flow during the uncertainty of a located one, with unknowns of loops fixed.

    Return the number of roots that may be rounding of terms that cancel: the states' moves show next to nothing of that.
    """
    put_flow(k)
    if k.root_count == 0:
        return 0
    k.roots(k.time, k.state, k.inputs, k.constants, k.mode, k.root)
    for j in range(k.root_count):
        k.noise[j] = 0.0
    for i in range(k.n):
        k.later[i] = k.state[i]
    for i in range(k.n):
        size = k.magnitude[i]
        if k.flows != 0 and i < k.count and not size > 0.0:  # a unit of its own would be a size of no meaning
            size = k.whole * abs(k.rate[i])
        k.later[i] = k.state[i] + SHARE * max(size, abs(k.state[i]))
        add_change(k, k.time, 1.0)
        k.later[i] = k.state[i]
    least = max(abs(k.time), 1e-300)
    add_change(k, k.time + SHARE * least, 1.0)
    for j in range(k.root_count):
        k.noise[j] *= ROUNDED
        k.again[j] = k.noise[j]  # of the moves alone: the flow's has no least size
    if k.flows != 0:
        late = LATE * ulp(least)
        span = max(SHARE * k.whole, late)
        for i in range(k.count):
            k.later[i] = k.state[i] + span * k.rate[i]
        add_change(k, k.time + span, late / span)
    count = 0
    for j in range(k.root_count):
        if k.noise[j] < abs(k.root[j]) and (k.again[j] == 0.0 or abs(k.root[j]) <= CANCELLED * k.again[j]):
            count += 1
        if k.root[j] != k.root[j]:  # of no value: the caller refuses it
            count += 1
    return count


def put_flow(k: IndicatorWorkspace) -> None:
    """Compute the rates of the states, and the time in which they move a state by its magnitude."""
    k.flows = 0
    if k.count == 0:
        return
    k.derivative(k.time, k.state, k.inputs, k.constants, k.mode, k.rate)
    speed = 0.0
    for i in range(k.count):
        if not isfinite(k.rate[i]):
            return
        if k.magnitude[i] > 0.0:
            speed = max(speed, abs(k.rate[i]) / k.magnitude[i])
    k.flows = 1
    k.whole = min(k.horizon, 1.0 / speed if speed > 0.0 else INFINITE)


def add_change(k: IndicatorWorkspace, time: float, share: float) -> None:
    """Add a share of the change of the roots from the hybrid state to `later`, where it is finite."""
    k.roots(time, k.later, k.inputs, k.constants, k.mode, k.change)
    for j in range(k.root_count):
        change = abs(k.change[j] - k.root[j])
        if isfinite(change):
            k.noise[j] += share * change


def doubt(k: IndicatorWorkspace) -> int:
    """Decide the truth of conditions just after the hybrid state that is evaluated, as far as rounding lets it; return the number of those in doubt,
    which keep the truth that they have in the mode."""
    count = 0
    for j in range(k.root_count):
        k.sought[j] = 1 if abs(k.root[j]) <= k.noise[j] else 0
        k.moved[j] = 0.0
        k.truth[j] = truth(k.root[j], k.strict[j])
        if k.sought[j] != 0:
            k.truth[j] = 1 if k.mode[k.places[j]] == 1.0 else 0
            count += 1
        k.floor[j] = 0.0
    return count


def look_ahead(k: IndicatorWorkspace) -> int:
    """Put the changes of the sought roots along the flow into `moved`, at the least reach at which they are beyond doubt; 0 where they are not.

    By Heun's method, and iterated once more: where iterations disagree on the sign, time constants are shorter than the reach.
    """
    if k.flows == 0:
        return 0
    for r in range(TRIES):
        span = REACHES[r] * k.whole
        put_later(k, span, k.rate)
        put_slope(k, span)
        put_later(k, span, k.slope)
        k.roots(k.time + span, k.later, k.inputs, k.constants, k.mode, k.change)
        put_slope(k, span)
        put_later(k, span, k.slope)
        k.roots(k.time + span, k.later, k.inputs, k.constants, k.mode, k.again)
        put_near(k, span)
        left = 0
        for j in range(k.root_count):
            if k.sought[j] > 0:
                change = k.change[j] - k.root[j]
                again = k.again[j] - k.root[j]
                if change != 0.0 and max(abs(change), abs(again)) > CERTAIN * k.noise[j] and not stays(k, j, again):
                    k.moved[j] = change if change * again > 0.0 else 0.0
                    k.sought[j] = -1
                else:
                    left += 1
        if left == 0:
            return 0
    return look_further(k)


def look_further(k: IndicatorWorkspace) -> int:
    """Iterate on where `look_ahead` shows nothing: of a chain of states at rest one moves after the other."""
    for r in range(FARTHER):
        left = k.until - k.time
        span = min(FAR[r] * k.whole, 0.5 * left) if left > 0.0 else FAR[r] * k.whole
        put_later(k, span, k.rate)
        for j in range(k.root_count):
            k.again[j] = k.root[j]
        for _ in range(FURTHER):
            put_slope(k, span)
            put_later(k, span, k.slope)
            for j in range(k.root_count):
                k.change[j] = k.again[j]
            k.roots(k.time + span, k.later, k.inputs, k.constants, k.mode, k.again)
            put_near(k, span)
            if find_slow(k) == 0:
                return 0
            put_later(k, span, k.slope)
    return 0


def put_near(k: IndicatorWorkspace, span: float) -> None:
    """Put the roots at a small part of the way along `slope` into `seen`."""
    put_later(k, PART * span, k.slope)
    k.roots(k.time + PART * span, k.later, k.inputs, k.constants, k.mode, k.seen)


def stays(k: IndicatorWorkspace, j: int, change: float) -> bool:
    """Return True if a root does not leave zero now: it is on a plateau, which ends before its change ahead shows."""
    return k.seen[j] == k.root[j] and k.noise[j] < PART * abs(change)


def find_slow(k: IndicatorWorkspace) -> int:
    """Put the changes of the sought roots on which two iterations agree into `moved`; return the number of those still sought."""
    left = 0
    for j in range(k.root_count):
        if k.sought[j] > 0:
            change = k.change[j] - k.root[j]
            again = k.again[j] - k.root[j]
            agree = abs(again) > CERTAIN * k.noise[j] and abs(again - change) <= AGREE * abs(again)
            if agree and not stays(k, j, again):
                k.moved[j] = again
                k.sought[j] = SLOWLY
            else:
                left += 1
    return left


def decide(k: IndicatorWorkspace) -> int:
    """Decide the truth of the conditions in doubt by the changes in `moved`, and put the rounding level of each into `floor`.

    A root that stays at zero must not cross; one that leaves zero must be located when it returns, and be doubtful then. Nor must that of a law which
    is still on the other side: the law would change again and again. What leaves zero so slowly that it stays within the tolerance for some steps is
    not contradicted there: the dense output of these has any sign. Return the number of changes that may be rounding of terms that cancel.
    """
    count = 0
    for j in range(k.root_count):
        if k.sought[j] != 0 and abs(k.moved[j]) > JUMPED * k.noise[j]:
            count += 1
        if k.sought[j] != 0:
            k.floor[j] = max(0.25 * k.noise[j], 2.0 * abs(k.root[j]))
            if k.moved[j] != 0.0:
                k.truth[j] = 1 if k.moved[j] < 0.0 else 0
                if k.steers[j] == 0 or k.truth[j] == truth(k.root[j], k.strict[j]):
                    k.floor[j] = 0.25 * k.noise[j]
            elif k.root[j] == 0.0 and k.noise[j] == 0.0:  # a plateau: no rounding moves it
                k.truth[j] = truth(0.0, k.strict[j])
            if k.sought[j] == SLOWLY:
                k.floor[j] = max(k.floor[j], k.relative / NOISE * k.noise[j])
    return count


def keep(k: IndicatorWorkspace) -> int:
    """Keep the roots and the flow that were evaluated, before events act, in `moved` and `slope`."""
    for j in range(k.root_count):
        k.moved[j] = k.root[j]
    for i in range(k.n):
        k.slope[i] = k.rate[i]
    return 0


def reread(k: IndicatorWorkspace) -> int:
    """Put the truth of conditions whose two sides are equal after events have acted into the mode: nothing else may move them then.

    Conditions whose root and its motion the events left as they were (`keep`) keep their truth: a motion from rest is too slow to be seen ahead.
    """
    span = FARTHEST * k.whole if k.flows != 0 else 0.0
    for i in range(k.n):
        k.later[i] = k.state[i] + (span * k.rate[i] if i < k.count else 0.0)
    k.roots(k.time + span, k.later, k.inputs, k.constants, k.mode, k.change)
    for i in range(k.count):
        k.later[i] = k.state[i] + span * k.slope[i]
    k.roots(k.time + span, k.later, k.inputs, k.constants, k.mode, k.again)
    for j in range(k.root_count):
        same = k.flows != 0 and k.root[j] == k.moved[j] and k.change[j] == k.again[j]
        if abs(k.root[j]) <= k.noise[j] and not same:
            k.mode[k.places[j]] = float(truth(0.0, k.strict[j]))
    return 0


def put_later(k: IndicatorWorkspace, span: float, rates: Floats) -> None:
    """Put the state after some time with these rates into `later`, with the unknowns of loops that belong to it."""
    for i in range(k.n):
        k.later[i] = k.state[i]
    for i in range(k.count):
        k.later[i] = k.state[i] + span * rates[i]
    if k.count < k.n:
        k.solve(k.time + span, k.later, k.inputs, k.constants, k.mode, k.later)


def put_slope(k: IndicatorWorkspace, span: float) -> None:
    """Put the mean of the rates here and after some time into `slope`."""
    k.derivative(k.time + span, k.later, k.inputs, k.constants, k.mode, k.slope)
    for i in range(k.count):
        k.slope[i] = 0.5 * (k.rate[i] + k.slope[i])
