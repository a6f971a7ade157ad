"""Whether a condition may flip within the last step: `events/locate.py` finds out where, on the same places of it."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

from ...events import locate
from .. import pair
from ..methods import RADAU
from .holding import put_multipliers
from .step import sign
from .stepper import Stepper
from .within import state_at

if TYPE_CHECKING:
    from ....door import Floats

PLACES, PARTS = locate.PLACES, pair.PARTS


def may_flip(s: Stepper) -> bool:
    """Whether some condition is not what the mode says at a place of the step, or near zero between some."""
    start = s.end_time[s.ends - 2]
    parts = 1 if s.method == RADAU else PARTS
    begin = start
    for k in range(parts):
        end = s.time if k + 1 == parts else start + (s.time - start) * float(k + 1) / float(parts)
        for place in range(PLACES):
            time = end if place + 1 == PLACES else begin + (end - begin) * float(place + 1) / float(PLACES)
            roots_at(s, time, s.root_seen[place * s.root_count :])
        if is_suspicious(s):
            return True
        begin = end
    return False


def is_suspicious(s: Stepper) -> bool:
    """The same of the places that have been looked at."""
    m = s.root_count
    for j in range(m):
        for place in range(PLACES):
            root = s.root_seen[place * m + j]
            if is_wrong(s, j, root):
                return True
            if place > 1 and comes_near(s.root_seen[(place - 2) * m + j], s.root_seen[(place - 1) * m + j], root):
                return True
    return False


def is_wrong(s: Stepper, j: int, root: float) -> bool:
    """Whether a condition with this root is not what the mode says."""
    if not isfinite(root) or abs(root) < s.root_floor[j]:
        return False
    holds = 1 if root < 0.0 or (root == 0.0 and s.root_strict[j] == 0) else 0
    return holds != s.root_said[j]


def comes_near(first: float, second: float, third: float) -> bool:
    """Whether the distance from zero is least at the second of three places, so that there may be a zero beside it: see `locate._closest`."""
    if sign(first) != sign(second) or sign(second) != sign(third):
        return False
    here = abs(second)
    return here <= abs(first) and here <= abs(third) and here < 0.5 * max(abs(first), abs(third))


def roots_at(s: Stepper, time: float, out: Floats) -> None:
    """The roots of all conditions at an instant of the last step."""
    full_at(s, time, s.si)
    s.roots(time, s.si, s.inputs, s.constants, s.mode, out)


def full_at(s: Stepper, time: float, out: Floats) -> None:
    """States in SI at an instant of the last step, with the multipliers that belong to them; other unknowns as the step carries them along."""
    state_at(s, time, out)
    if s.closed.multipliers > 0:
        put_multipliers(s.closed, time, out)


def roots_along(s: Stepper, count: int, times: Floats, out: Floats) -> None:
    """The same at several instants."""
    for k in range(count):
        roots_at(s, times[k], out[k * s.root_count :])


def states_along(s: Stepper, count: int, times: Floats, out: Floats) -> None:
    """The states at several instants."""
    for k in range(count):
        full_at(s, times[k], out[k * s.n :])
