"""Detection of possible zero crossings in the last step; `events/locate.py` locates them, with the same polynomials (`numerics/indicators.py`)."""

from __future__ import annotations

from math import isfinite

from compiler.api import Floats

from ....numerics import indicators
from ..dense_output.dense_output import state_at
from ..methods import PARTS
from ..projection.projection import put_multipliers
from ..workspace import IntegratorWorkspace

PLACES, GRID, LAST, DEPTH = indicators.PLACES, indicators.GRID, indicators.LAST, indicators.DEPTH
SHARES = tuple(indicators.SHARES.tolist())
COEFFICIENTS, ON_GRID = (tuple(a.ravel().tolist()) for a in (indicators.COEFFICIENTS, indicators.ON_GRID))
CONVERGED, SURE, LEFT = indicators.CONVERGED, indicators.SURE, indicators.LEFT
FIRST = float(indicators.FINER[1])  # the place of the grid beside the start of a part
FREE = 8.0  # in units of its rounding level: a root that has left zero so far
INFINITE = float("inf")


def may_flip(s: IntegratorWorkspace) -> bool:
    """Return True if a condition differs from the mode at a place of the step, or may have differed between places."""
    if s.root_narrow > 0:
        return True
    start = s.end_time[s.ends - 2]
    parts = PARTS[s.method]
    begin = start
    roots_at(s, start, s.root_seen)
    for k in range(parts):
        end = s.time if k + 1 == parts else start + (s.time - start) * float(k + 1) / float(parts)
        for place in range(1, PLACES):
            time = end if place + 1 == PLACES else begin + (end - begin) * SHARES[place]
            roots_at(s, time, s.root_seen[place * s.root_count :])
        for j in range(s.root_count):
            if not is_clear(s, j, k):
                return True
            s.root_seen[j] = s.root_seen[(PLACES - 1) * s.root_count + j]
        begin = end
    free_roots(s)
    return False


def free_roots(s: IntegratorWorkspace) -> None:
    """Let the rounding level of a root end where the root is far from it at the end of a step: on a plateau at zero, as of `max(x, 0)`, it counts again."""
    for j in range(s.root_count):
        if FREE * s.root_floor[j] < abs(s.root_seen[j]) < INFINITE:
            s.root_floor[j] = 0.0


def is_clear(s: IntegratorWorkspace, j: int, part: int) -> bool:
    """Return True if a condition agrees with the mode throughout a part of the step, from its values there: see `Interpolants.far` and `dips`."""
    unknown = 0
    still = 0
    for place in range(PLACES):
        root = s.root_seen[place * s.root_count + j]
        if place > 0 and is_wrong(s, j, root):
            return False
        if not isfinite(root):
            unknown += 1
        elif abs(root) < s.root_floor[j]:
            still += 1
    if still == PLACES or unknown == PLACES:
        return True
    if unknown > 0:
        return False
    variation = 0.0
    error = 0.0
    for k in range(PLACES):
        total = 0.0
        for place in range(PLACES):
            total += COEFFICIENTS[k * PLACES + place] * s.root_seen[place * s.root_count + j]
        s.root_form[k] = total
        if k > 0:
            variation += abs(total)
        if k >= PLACES - LAST:
            error += abs(total)
    middle = abs(s.root_form[0])
    if error > CONVERGED * variation:
        return middle > 2.0 * variation
    if middle > variation + SURE * error:
        return True
    return keeps_away(s, j, part, SURE * error)


def keeps_away(s: IntegratorWorkspace, j: int, part: int, margin: float) -> bool:
    """Return True if a polynomial has the sign of the mode on a finer grid, and stays away from zero by the margin; a step may begin near zero."""
    before = 0.0
    here = 0.0
    value = 0.0
    for place in range(GRID + 1):
        beside = value
        value = 0.0
        for k in range(PLACES):
            value += ON_GRID[place * PLACES + k] * s.root_form[k]
        if place > 0 and abs(value) > margin and is_wrong(s, j, value):
            return False
        if abs(value) < margin and (
            place == GRID or (place == 0 and (part > 0 or abs(value) > LEFT * s.root_floor[j]))
        ):
            return False
        if place == 1 and (part > 0 or s.root_floor[j] == 0.0 or abs(beside) > LEFT * s.root_floor[j]):
            if turns(beside, value, slope_inwards(s.root_form, 1, 1), margin, s.root_said[j]):
                return False
        if place == GRID and turns(value, beside, slope_inwards(s.root_form, 1, 0), margin, s.root_said[j]):
            return False
        after = abs(value)
        if place > 1 and here <= before and here <= after and here < max(before, after):
            if here - DEPTH * (max(before, after) - here) < margin:
                return False
        before = here
        here = after
    return True


def slope_inwards(form: Floats, stride: int, at_start: int) -> float:
    """Return the slope over the part of a polynomial at one of its ends, towards the other one, from its Chebyshev coefficients, which are `stride` apart."""
    total = 0.0
    for degree in range(1, PLACES):
        slope = 2.0 * degree * degree * form[degree * stride]
        total += slope if at_start != 0 and degree % 2 == 1 else -slope
    return total


def turns(end: float, beside: float, inwards: float, margin: float, said: int) -> bool:
    """Return True if a polynomial may come within a margin of zero between an end, with its slope inwards, and the place beside it, farther from zero.

    What is `said` of the condition tells from which side: at zero a step may begin without an event, as at the step of an importer.
    """
    before = -end if said != 0 else end
    falls = inwards if said != 0 else -inwards
    return falls > 0.0 and abs(end) <= abs(beside) and before - 0.5 * falls * FIRST < margin


def is_wrong(s: IntegratorWorkspace, j: int, root: float) -> bool:
    """Return True if a condition with this root differs from the mode."""
    return contradicts(root, s.root_floor[j], s.root_strict[j], s.root_said[j]) != 0


def contradicts(root: float, floor: float, strict: int, said: int) -> int:
    """Return 1 if a condition with this root differs, beyond rounding, from what is said of it."""
    return 1 if isfinite(root) and abs(root) >= floor and truth(root, strict) != said else 0


def truth(root: float, strict: int) -> int:
    """Return 1 if a condition with this root holds."""
    return 1 if root < 0.0 or (root == 0.0 and strict == 0) else 0


def roots_at(s: IntegratorWorkspace, time: float, out: Floats) -> None:
    """Compute the roots of all conditions at an instant of the last step."""
    full_at(s, time, s.si)
    s.roots(time, s.si, s.inputs, s.constants, s.mode, out)


def full_at(s: IntegratorWorkspace, time: float, out: Floats) -> None:
    """Compute the state in SI at an instant of the last step, with the multipliers that belong to it; other unknowns as interpolated."""
    state_at(s, time, out)
    if s.closed.multipliers > 0:
        put_multipliers(s.closed, time, out)


def roots_along(s: IntegratorWorkspace, count: int, times: Floats, out: Floats) -> None:
    """Compute the roots at several instants."""
    for k in range(count):
        roots_at(s, times[k], out[k * s.root_count :])


def states_along(s: IntegratorWorkspace, count: int, times: Floats, out: Floats) -> None:
    """Compute the states at several instants."""
    for k in range(count):
        full_at(s, times[k], out[k * s.n :])
