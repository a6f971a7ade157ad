"""First zero crossing of a condition in a part of a step, halved until polynomials show all of it; see `events/locate.py`, which has loops and bounds too."""

from __future__ import annotations

from math import isfinite, ulp

from ..workspace import IntegratorWorkspace
from .crossing_search import FINER, SEARCHED, WIDTH, differs, narrow, survey
from .event_indicators import DEEPEST, INFINITE, IndicatorWorkspace, evaluate
from .zero_crossings import COEFFICIENTS, GRID, ON_GRID, PLACES, SHARES, full_at, roots_along, roots_at

NONE, FOUND, LEFT = 0, 1, 3  # no crossing; one; the caller has to act
SMALLEST = 2.0**-DEEPEST  # smallest part, as a fraction of the interval searched; a jump lies at one of its places
FEWEST = 1 / 64  # smallest first part, as a fraction of the interval searched
SUSPICIOUS = 4  # parts, and twice as many again and again, after which roots may be rounding of terms that cancel
MOST_PARTS = 1 << 15  # most parts of the interval searched
GOLDEN = 0.5 * (5**0.5 - 1)  # share of a bracket that a golden section keeps


def first_crossing(s: IntegratorWorkspace, k: IndicatorWorkspace, start: float, stop: float) -> int:
    """Find the first zero crossing in a part of the last step; `LEFT` where there are too many parts, or roots that may be rounding of terms that cancel."""
    for j in range(s.root_count):
        k.said[j] = s.root_said[j]
        k.floor[j] = s.root_floor[j]
    smallest = max(SMALLEST * (stop - start), 64.0 * ulp(max(abs(start), abs(stop))))
    spacing = max(k.spacing, FEWEST * (stop - start))
    k.measured = 0
    low = start
    depth = 0
    count = 0
    while low < stop:
        if depth == 0:
            k.ends[0] = stop
            if spacing < 0.5 * (stop - low):
                k.ends[0] = low + spacing
                spacing *= 2.0
            depth = 1
        high = k.ends[depth - 1]
        survey_part(s, k, low, high, 1 if low == start else 0)
        if k.near_count > 0:
            count += 1
            if count >= k.most_parts:
                return LEFT
            wide = k.unsure_count > 0 and high - low > smallest
            dips = has_dips(k)
            if (wide or dips) and k.measured == 0 and measure(s, k, high) > 0 and k.most_parts < MOST_PARTS:
                return LEFT
            if wide and is_unsure(k):
                k.ends[depth] = 0.5 * (low + high)
                depth += 1
                continue
            least = first_minimum(s, k) if dips and depth < DEEPEST else high
            if (
                least < high
            ):  # where a dip is behind, what is before it is looked at closely: two may lie between two places
                k.ends[depth] = least
                depth += 1
                continue
            roots_along(s, k.suspect_count, k.suspects, k.roots_there)
            if k.suspect_count > 0 and narrow(k, s, 0, k.suspect_count, k.suspects, k.roots_there) != 0:
                k.spacing = high - low
                return FOUND
        low = high
        depth -= 1
    k.spacing = INFINITE
    return NONE


def survey_part(s: IntegratorWorkspace, k: IndicatorWorkspace, low: float, high: float, begins: int) -> None:
    """Examine the polynomials of a part through the roots at its places."""
    m = s.root_count
    for place in range(PLACES):
        time = low + (high - low) * SHARES[place]
        if place == 0:
            time = low
        if place == PLACES - 1:
            time = high
        roots_at(s, time, k.values[place * m :])
    for j in range(m):
        for degree in range(PLACES):
            total = 0.0
            for place in range(PLACES):
                root = k.values[place * m + j]
                if isfinite(root):
                    total += COEFFICIENTS[degree * PLACES + place] * root
            k.form[degree * m + j] = total
        for place in range(GRID + 1):
            value = 0.0
            for degree in range(PLACES):
                value += ON_GRID[place * PLACES + degree] * k.form[degree * m + j]
            k.grid[place * m + j] = value
    k.low = low
    k.high = high
    survey(k, begins, 0)


def measure(s: IntegratorWorkspace, k: IndicatorWorkspace, time: float) -> int:
    """Put the rounding of the indicators at an instant of the step into `noise`, the end of the first part that needs it: smaller changes are ignored.

    Return the number of roots that may be rounding of terms that cancel.
    """
    k.measured = 1
    k.time = time
    full_at(s, time, k.state)
    return evaluate(k)


def is_unsure(k: IndicatorWorkspace) -> bool:
    """Return True if a polynomial that is more than rounding does not show all of its indicator."""
    for j in range(k.root_count):
        if k.unsure[j] != 0 and k.variation[j] > k.noise[j]:
            return True
    return False


def has_dips(k: IndicatorWorkspace) -> bool:
    """Return True if a condition may touch zero before all places that show a crossing, which takes a search for its minimum."""
    for j in range(k.root_count):
        if k.near[j] != 0:
            if k.converged[j] == 0 and k.shown[j] == 0:
                return True
            for place in range(GRID + 1):
                if k.dips[place * k.root_count + j] == SEARCHED:
                    return True
    return False


def first_minimum(s: IntegratorWorkspace, k: IndicatorWorkspace) -> float:
    """Return the first instant of a part, before all places that show a crossing, at which a condition that dips differs from the mode; else its end."""
    size = k.high - k.low
    first = k.high
    for j in range(k.root_count):
        if k.near[j] != 0 and k.variation[j] > k.noise[j]:
            if k.converged[j] == 0 and k.shown[j] == 0:
                first = min(first, bottom(s, k, j, k.low, k.high))
            for place in range(GRID + 1):
                low = k.low + size * FINER[max(place - 1, 0)]
                if k.converged[j] != 0 and k.dips[place * k.root_count + j] == SEARCHED and low < first:
                    first = min(first, bottom(s, k, j, low, k.low + size * FINER[min(place + 1, GRID)]))
    return first


def bottom(s: IntegratorWorkspace, k: IndicatorWorkspace, j: int, low: float, high: float) -> float:
    """Return an instant of a bracket at which a condition differs, by golden sections towards where its root is nearest to zero; `k.high` if there is none."""
    width = WIDTH * ulp(max(abs(low), abs(high)))
    while high - low > width:
        first = high - GOLDEN * (high - low)
        second = low + GOLDEN * (high - low)
        roots_at(s, first, k.seen)
        distance = abs(k.seen[j])
        if differs(k, j, k.seen[j]) != 0:
            return first
        roots_at(s, second, k.seen)
        if differs(k, j, k.seen[j]) != 0:
            return second
        if distance < abs(k.seen[j]):
            high = second
        else:
            low = first
    return k.high
