"""Search of a part of a step for the first zero crossing of a condition: from polynomials through its roots, then by narrowing; see `events/locate.py`."""

from __future__ import annotations

from math import isfinite, ulp

from compiler.api import Floats

from ....numerics import indicators
from ....numerics.roots import MOST, begin_bracket, bracket_place, closes_at
from ..workspace import IntegratorWorkspace
from .event_indicators import INFINITE, IndicatorWorkspace
from .zero_crossings import contradicts, roots_at, slope_inwards, truth, turns

PLACES, GRID, LAST, DEPTH = indicators.PLACES, indicators.GRID, indicators.LAST, indicators.DEPTH
SHARES, FINER = tuple(indicators.SHARES.tolist()), tuple(indicators.FINER.tolist())
CONVERGED, SURE, LEFT, EXACT = indicators.CONVERGED, indicators.SURE, indicators.LEFT, indicators.EXACT
RESTS = 4.0  # in units of the rounding of a root: as far behind its zero rounding may leave it where a step begins
RETURNS = 1.1  # ratio of roots that get no further
WIDTH = 4.0  # units in the last place of a time: end of the narrowing
AT_END = 64.0  # widths that are one instant: what is zero for less before the end of a part may be so there alone
SEARCHED = 2  # what `dips` says of a place beside which the instant nearest to zero is searched for
CHANGES = 3  # what `touching` says of a condition that changes
LEAST = 1e-300  # least distance from a zero crossing, so that its sign is defined


def survey(k: IndicatorWorkspace, begins: int, bounded: int) -> int:
    """Examine the polynomials of a part: which conditions may have a crossing there, and where. `begins`: 1 if the part begins a step, whose mode holds
    there; `bounded`: 1 if conditions far from zero are asked for, too."""
    k.near_count = 0
    k.unsure_count = 0
    for place in range(PLACES):
        k.at_place[place] = 0
    for place in range(GRID + 1):
        k.at_grid[place] = 0
    for j in range(k.root_count):
        k.near[j] = is_near(k, j, begins)
        k.near_count += k.near[j]
        if k.near[j] != 0 or k.shown[j] != 0 or bounded != 0:
            mark_on_grid(k, j)
            mark_dips(k, j, begins)
        k.unsure[j] = 0
        if k.near[j] != 0 and (k.converged[j] == 0 or (k.dipping[j] != 0 and k.error[j] > EXACT * k.variation[j])):
            k.unsure[j] = 1
            k.unsure_count += 1
    put_suspects(k)
    keep_dips(k)
    return 0


def is_near(k: IndicatorWorkspace, j: int, begins: int) -> int:
    """Return 1 if a condition may cross zero in the part; mark the places that show it."""
    m = k.root_count
    finite = 0
    still = 0
    returns = 1
    first = k.values[j]
    k.shown[j] = 0
    behind = 0
    for place in range(PLACES):
        root = k.values[place * m + j]
        if isfinite(root):
            finite += 1
        if abs(root) < k.floor[j]:
            still += 1
        if not abs(root) <= RETURNS * abs(first):
            returns = 0
        if differs(k, j, root) != 0:
            k.at_place[place] = 1
            k.shown[j] = 1
            if place > 0:
                behind = 1
    k.variation[j] = 0.0
    k.error[j] = 0.0
    for place in range(1, PLACES):
        size = abs(k.form[place * m + j])
        k.variation[j] += size
        if place >= PLACES - LAST:
            k.error[j] += size
    k.converged[j] = 1 if finite == PLACES and k.error[j] <= CONVERGED * k.variation[j] else 0
    if begins != 0 and differs(k, j, first) != 0 and abs(first) < RESTS * k.floor[j] and returns != 0:
        return 0  # rounding left it behind its zero
    if behind != 0:
        return 1
    if still == PLACES or finite == 0:
        return 0
    around = k.variation[j] + SURE * k.error[j] if k.converged[j] != 0 else 2.0 * k.variation[j]
    return 0 if finite == PLACES and abs(k.form[j]) > around else 1


def mark_on_grid(k: IndicatorWorkspace, j: int) -> None:
    """Mark the places of the grid at which a polynomial begins to have the wrong sign, and those at which it is deepest behind its crossing."""
    k.crosses[j] = 0
    for place in range(GRID + 1):
        if differs(k, j, k.grid[place * k.root_count + j]) != 0:
            k.crosses[j] = 1
            here = depth(k, j, place)
            before = depth(k, j, place - 1)
            if here >= 0.0 and (before < 0.0 or (here >= before and here >= depth(k, j, place + 1))):
                k.at_grid[place] = 1


def depth(k: IndicatorWorkspace, j: int, place: int) -> float:
    """Return how far a polynomial that is valid is behind its crossing at a place of the grid; negative before it, as at the start, where the mode holds."""
    if place < 1 or place > GRID or k.converged[j] == 0:
        return -1.0
    value = k.grid[place * k.root_count + j]
    return abs(value) if differs(k, j, value) != 0 else -1.0


def mark_dips(k: IndicatorWorkspace, j: int, begins: int) -> None:
    """Mark the places of the grid near which a polynomial may touch or cross zero; not the zero with which a step begins, as after an event."""
    m = k.root_count
    margin = SURE * k.error[j]
    k.dipping[j] = 0
    for place in range(GRID + 1):
        here = abs(k.grid[place * m + j])
        mark = 1 if here < margin else 0
        if place == 0 and begins != 0 and abs(k.values[j]) <= LEFT * k.floor[j]:
            mark = SEARCHED if k.floor[j] == 0.0 and turns_beside(k, j, place) else 0
        elif place == 0 or place == GRID:
            mark = SEARCHED if turns_beside(k, j, place) else mark
        else:
            before = abs(k.grid[(place - 1) * m + j])
            after = abs(k.grid[(place + 1) * m + j])
            beside = max(before, after)
            touches = here <= before and here <= after and here < beside and here - DEPTH * (beside - here) < margin
            mark = SEARCHED if touches else 0
        k.dips[place * m + j] = mark
        if mark != 0:
            k.dipping[j] = 1


def turns_beside(k: IndicatorWorkspace, j: int, place: int) -> bool:
    """Return True if a polynomial may touch or cross zero between an end of the part and the place beside it."""
    m = k.root_count
    beside = k.grid[(1 if place == 0 else GRID - 1) * m + j]
    inwards = slope_inwards(k.form[j:], m, 1 if place == 0 else 0)
    return turns(k.grid[place * m + j], beside, inwards, SURE * k.error[j], k.said[j])


def keep_dips(k: IndicatorWorkspace) -> None:
    """Keep the dips before the first place that shows a crossing, and count the conditions that have one or show nothing: an earlier crossing may be there."""
    m = k.root_count
    first = INFINITE
    for place in range(PLACES - 1, 0, -1):
        if k.at_place[place] != 0:
            first = SHARES[place]
    k.clear_count = 0
    for j in range(m):
        clear = k.near[j] - min(k.near[j], k.shown[j])
        for place in range(GRID + 1):
            after = min(place + 1, GRID)
            if FINER[after] >= first or (k.shown[j] != 0 and differs(k, j, k.grid[after * m + j]) != 0):
                k.dips[place * m + j] = 0
            elif k.near[j] != 0 and k.dips[place * m + j] == SEARCHED:
                clear = 1
        k.clear_count += clear


def put_suspects(k: IndicatorWorkspace) -> None:
    """Put the instants of all marked places behind the start of the part into `suspects`, sorted."""
    k.suspect_count = 0
    place = 0
    on_grid = 0
    while place < PLACES or on_grid <= GRID:
        share = INFINITE
        marked = 0
        if place < PLACES:
            share = SHARES[place]
            marked = k.at_place[place]
        if on_grid <= GRID and FINER[on_grid] <= share:
            marked = k.at_grid[on_grid] if FINER[on_grid] < share else max(marked, k.at_grid[on_grid])
            if FINER[on_grid] == share:
                place += 1
            share = FINER[on_grid]
            on_grid += 1
        else:
            place += 1
        time = k.low + (k.high - k.low) * share
        if marked != 0 and time > k.low:
            k.suspects[k.suspect_count] = time
            k.suspect_count += 1


def narrow(k: IndicatorWorkspace, s: IntegratorWorkspace, exact: int, count: int, times: Floats, roots: Floats) -> int:
    """Put the first instant of a part, to rounding, from which on a condition has changed into `found`; return 0 if none has at these instants.

    `exact`: 1 if loops are solved for the roots, by Python.
    """
    behind = k.low
    first = first_behind(k, 0, count, roots)
    while first >= 0:
        narrow_before(k, s, exact, times[first], max(behind, times[first - 1]) if first > 0 else behind)
        behind = goes_on(k, s, exact)
        if behind < 0.0:
            return 1
        first += 1
        while first < count and times[first] <= behind:
            first += 1
        first = first_behind(k, first, count, roots)
    return 0


def goes_on(k: IndicatorWorkspace, s: IntegratorWorkspace, exact: int) -> float:
    """Return -1 if a condition is behind its crossing from the found instant on; else an instant at which all that is zero there alone has gone back.

    `touching` is `CHANGES` for what has changed, at that instant or so soon behind it that it is the same one, and 2 for what only touches zero, which takes no
    time. What is zero at the end of a part is left to the next one.
    """
    distance(k, s, exact, k.found)
    span = WIDTH * ulp(max(abs(k.low), abs(k.high)))
    waiting = 0
    changed = 0
    for j in range(k.root_count):
        k.touching[j] = 0
        if k.behind[j] != 0:
            k.touching[j] = 1 if k.seen[j] == 0.0 else CHANGES
            waiting += 1 if k.seen[j] == 0.0 else 0
            changed += 0 if k.seen[j] == 0.0 else 1
    if waiting + changed == 0:  # a loop that is solved for once more has another rounding
        for j in range(k.root_count):
            k.touching[j] = CHANGES if k.flipping[j] != 0 else 0
        return -1.0
    soon = min(k.found + AT_END * span, k.high)
    lasts = 1 if soon < k.high else 0
    time = k.found
    while waiting > 0 and time < k.high:
        time = min(time + span, k.high)
        span *= 8.0
        distance(k, s, exact, time)
        for j in range(k.root_count):
            if k.touching[j] == 1 and (k.seen[j] != 0.0 or (time == k.high and lasts != 0)):
                k.touching[j] = CHANGES if k.behind[j] != 0 else 2
                changed += k.behind[j]
                waiting -= 1
    for j in range(k.root_count):
        if k.touching[j] == 1:
            k.touching[j] = 2
    if changed == 0:
        return time
    distance(k, s, exact, soon)
    for j in range(k.root_count):
        if k.touching[j] == 0 and k.behind[j] != 0 and k.seen[j] != 0.0:
            k.touching[j] = CHANGES
    return -1.0


def narrow_before(k: IndicatorWorkspace, s: IntegratorWorkspace, exact: int, high: float, right: float) -> None:
    """Put the first instant at which a condition is behind its crossing into `found`: up to `high` one is, with the roots there in `seen`.

    The crossing is behind the last place of the grid before, unless rounding has hidden it from the search: then it is behind `right`.
    """
    low = right
    for place in range(GRID + 1):
        time = k.low + (k.high - k.low) * FINER[place]
        if time >= high:
            break
        low = max(time, right)
    for j in range(k.root_count):
        k.scale[j] = abs(k.seen[j]) if k.seen[j] != 0.0 and isfinite(k.seen[j]) else 1.0
        k.flipping[j] = differs(k, j, k.seen[j])
    k.found = high
    width = 0.5 * WIDTH * ulp(max(abs(low), abs(high)))
    if high - low <= 2.0 * width:
        return
    at_low = distance(k, s, exact, low)
    if at_low > 0.0 and low > right:
        high = low
        low = right
        at_high = at_low
        at_low = distance(k, s, exact, low)
    else:
        at_high = distance(k, s, exact, high)
    if at_high < 0.0:  # a loop that is solved for once more has another rounding
        k.found = high
        return
    begin_bracket(k.bracket, low, -abs(at_low), high, at_high)
    for _ in range(MOST):
        place_at = bracket_place(k.bracket)
        if closes_at(k.bracket, place_at, distance(k, s, exact, place_at), width):
            break
    k.found = k.bracket.a if k.bracket.at_a > 0.0 else k.bracket.b


def first_behind(k: IndicatorWorkspace, first: int, count: int, roots: Floats) -> int:
    """Return the first of several instants, from one on, at which a condition differs from the mode, with the roots there in `seen`; -1 if none is."""
    for place in range(first, count):
        wrong = 0
        for j in range(k.root_count):
            k.seen[j] = roots[place * k.root_count + j]
            wrong += differs(k, j, k.seen[j])
        if wrong > 0:
            return place
    return -1


def distance(k: IndicatorWorkspace, s: IntegratorWorkspace, exact: int, time: float) -> float:
    """Return the largest distance of a condition behind its zero crossing at an instant of a step; negative before all crossings."""
    if exact != 0:
        k.exactly(time, k.seen)
    else:
        roots_at(s, time, k.seen)
    wrong = 0
    for j in range(k.root_count):
        k.behind[j] = differs(k, j, k.seen[j])
        wrong += k.behind[j]
    largest = -INFINITE
    for j in range(k.root_count):
        if wrong > 0:
            k.flipping[j] = k.behind[j]
        if k.flipping[j] != 0:
            size = abs(k.seen[j])
            far = ((size if truth(k.seen[j], k.strict[j]) != k.said[j] else -size) - k.floor[j]) / k.scale[j]
            largest = far if far > largest or far != far else largest
    return max(largest, LEAST) if wrong > 0 else min(largest, -LEAST)


def differs(k: IndicatorWorkspace, j: int, root: float) -> int:
    """Return 1 if a condition with this root differs from the mode beyond rounding."""
    return contradicts(root, k.floor[j], k.strict[j], k.said[j])
