"""A branch of equilibria within a range: its steps, and the special points between them.

A fold, a branch point or an oscillation is accepted only if its test function has different signs close by on both sides, and goes to zero there instead
of passing a pole. Rates that jump with the parameter alone are told as a jump, and followed beyond it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import RunFailed
from .branch_steps import ASIDE, CLOSE, CLOSE_BY, SHORTEST, BranchFollower, BranchPlace

TURN = 0.97  # cosine of the largest turn between two tangents
LIMIT_STEPS = 30  # halvings of the step within which the model ceases to be valid, or a condition changes
JUMPS = 1e-6  # relative to the largest slope of a row: least rate that a condition brings by changing at a rest; least jump of a scaled state
ARC = 0.3  # relative to length and turn of a step: how far its chord may be from the mean of its tangents
LONGEST = 4.0  # longest step, in units of the first one
NO_FURTHER = "no further state of rest was found"
CROSSED = 0.5  # relative to a test function at the ends of a step: limit next to a zero, exceeded next to a pole
BOTH_SIDES = (0.01, 0.05, 0.2)  # fractions of a step: distances from a zero at which the signs are verified


class BranchLine:
    """One branch, as far as it goes within a range."""

    def __init__(self, follower: BranchFollower, low: float, high: float, points: int, most: int) -> None:
        self.follower, self.low, self.high, self.points, self.most = follower, low, high, points, most
        self.places: list[BranchPlace] = []
        self.sure: tuple[BranchPlace, float] | None = None  # the last point with a verdict, and its distance
        self.changed: BranchPlace | None = None  # the last place at which conditions changed
        self.ended = f"after {most} points"

    def go(self, first: BranchPlace) -> list[tuple[str, BranchPlace]]:
        """Follow the branch from a first point along its tangent; return the special points on the way."""
        follower, self.places = self.follower, [first]
        special: list[tuple[str, BranchPlace]] = []
        length = 1.0 / self.points
        while len(self.places) < self.most:
            here = self.places[-1]
            found, next_length = follower.corrected(here, length), 1.3 * length
            if found is None or found.tangent @ here.tangent < TURN:
                length *= 0.5
                if length >= SHORTEST:
                    continue
                (found, length), next_length = follower.behind_bend(here), 1.0 / self.points
            end = None if found is None else self._passed(found.value)
            change = None if found is None else self._change(here, found, length)
            if change is not None and end is not None and self._passed(change[2].value) is not None:
                change = None
            jump = self._jump(here, *((found, length) if change is None else change[:2]))
            if jump and self._passed(jump[1].value) is None:
                self.places += jump
                special.append(("jump", jump[1]))
                self.sure, length = None, 1.0 / self.points
                continue
            if found is None:
                self.ended = NO_FURTHER
                break
            if change is not None:
                before, at, after = change
                special += self._passed_between(before, at)
                ahead = self._ahead(before, after) if at > 0.0 or here is not self.changed else NO_FURTHER
                self.places[len(self.places) - (at == 0.0) :] = [before if isinstance(ahead, str) else ahead]
                if isinstance(ahead, str):
                    self.ended = ahead
                    break
                self.sure, self.changed, length = None, ahead, 1.0 / self.points
                continue
            special += self._passed_between(found, length)
            if end is not None:
                self.places.append(_ended(follower, here, length, end) or found)
                self.ended = f"`{follower.name}` leaves the range"
                break
            self.places.append(found)
            follower.see(found.point, found.A)
            self.places[-1] = follower.place(found.point, found.value, found.tangent)
            length = min(next_length, LONGEST / self.points)
        return special

    def _reason(self, place: BranchPlace) -> str | None:
        """Return why the branch ends before a place; "" where only conditions of laws are others there, None where all is as assumed."""
        try:
            left = place.point.left
        except RunFailed as outside:  # a table ends
            return f"the model does not hold beyond: {str(outside).partition(';')[0]}"
        if left:
            return f"the model does not hold beyond: {left[0].words_at_rest}"
        mode, acting = place.point.acting
        if acting:
            return f"beyond acts {' and '.join(acting[:3])}"
        return None if np.array_equal(mode, place.point.mode) else ""

    def _change(self, here: BranchPlace, found: BranchPlace, length: float) -> tuple[BranchPlace, float, BranchPlace] | None:  # fmt: skip
        """Return the last place of a step where all is as assumed, its length, and the first where it is not; None if it is so at the end of the step."""
        if self._reason(found) is None:
            return None
        low, high, before, after = 0.0, length, here, found
        for _ in range(LIMIT_STEPS):
            middle = 0.5 * (low + high)
            place = self.follower.corrected(here, middle)
            if place is None:
                break
            beyond = self._reason(place) is not None
            low, high = (low, middle) if beyond else (middle, high)
            before, after = (before, place) if beyond else (place, after)
        return before, low, after

    def _jump(self, here: BranchPlace, found: BranchPlace | None, length: float) -> list[BranchPlace]:
        """Return the places on both sides of a jump of the rates with the parameter alone, within a step whose chord is not that of an arc."""
        follower, value, state = self.follower, here.value, here.point.state
        if found is None:  # a short step that goes no further
            low, high = value, float(value + here.forward * CLOSE_BY[-1] * follower.range)
        else:
            moved = np.append((found.point.state - state)[: follower.count] / follower.scale, 0.0)
            moved[-1] = (found.value - value) / follower.range
            off = np.linalg.norm(moved - 0.5 * length * (here.tangent + found.tangent))
            if off <= JUMPS + ARC * length * np.linalg.norm(found.tangent - here.tangent):
                return []
            low, high = value, found.value

        def rates(at: float) -> Any:
            return follower.rates(here.point.elsewhere({follower.name: at}, state)) - here.b * (at - value)

        try:
            before, after = rates(low), rates(high)
            while abs(high - low) > CLOSE * abs(follower.range):
                now = rates(middle := 0.5 * (low + high))
                if np.linalg.norm(now - before) > np.linalg.norm(after - now):
                    high, after = middle, now
                else:
                    low, before = middle, now
            if (np.abs(after - before) <= JUMPS * follower.system(here.point, here.A, here.b)[0]).all():
                return []
            return [
                follower.place(follower.at_rest(p.point, at), at, p.tangent)
                for p, at in ((here, low), (found or here, high))
            ]
        except (RunFailed, np.linalg.LinAlgError):
            return []

    def _ahead(self, before: BranchPlace, after: BranchPlace) -> BranchPlace | str:
        """Return the place before a change with the conditions that hold beyond, and the tangent along which they do; or why the branch ends there."""
        reason = self._reason(after)
        if reason:
            return reason
        follower, mode = self.follower, after.point.acting[0]
        try:
            point = before.point.in_mode(mode)
            place = follower.place(point, before.value, before.tangent)
        except (RunFailed, np.linalg.LinAlgError):
            return NO_FURTHER
        if (np.abs(follower.rates(point)) > JUMPS * follower.system(point, place.A, place.b)[0]).any():
            numbers = np.flatnonzero(mode[point.conditions.places] != before.point.mode[point.conditions.places])
            return f"the rates jump with {point.conditions.listed_conditions(numbers)}"
        for length in ASIDE:
            for tangent in (place.tangent, -place.tangent):
                start = replace(place, tangent=tangent)
                moved = follower.corrected(start, length)
                if moved is not None and self._reason(moved) is None:
                    return start
        return NO_FURTHER

    def _passed_between(self, found: BranchPlace, length: float) -> list[tuple[str, BranchPlace]]:
        """Return the special points between the last point with known stability and another one."""
        base, way = self.sure if self.sure is not None else (None, 0.0)
        way += length
        here = self.places[-1]
        if here.decided:
            base, way = here, length
        if not found.decided:
            self.sure = None if base is None else (base, way)
            return [] if here.forward * found.forward >= 0 else _special(self.follower, here, found, length)
        self.sure = None
        return [] if base is None or found is here else _special(self.follower, base, found, way)

    def _passed(self, value: float) -> float | None:
        """Return the end of the range that a value exceeds; None if it is within."""
        if (value - self.high) * (self.high - self.low) >= 0:
            return self.high
        return self.low if (value - self.low) * (self.high - self.low) <= 0 else None


def _special(follower: BranchFollower, here: BranchPlace, found: BranchPlace, length: float) -> list[tuple[str, BranchPlace]]:  # fmt: skip
    """Return the special point between two points of known stability: a fold, or an eigenvalue that changes sign through zero.

    An eigenvalue that passes through infinity is no special point.
    """
    if here.forward * found.forward < 0:
        place = _at(follower, here, length, lambda p: p.forward)
        return [("fold", place)] if abs(place.forward) < min(abs(here.forward), abs(found.forward), CROSSED) else []
    if here.unstable() == found.unstable():
        return []
    if _crossing(found if found.unstable() > here.unstable() else here):
        return _verified("oscillation", follower, here, found, length, lambda p: _largest(p, here, found))
    return _verified("branch", follower, here, found, length, lambda p: _determinant(p, here))


def _verified(
    kind: str, follower: BranchFollower, here: BranchPlace, found: BranchPlace, length: float, test: Callable[[BranchPlace], float]
) -> list[tuple[str, BranchPlace]]:  # fmt: skip
    """Return the point at which a test function changes sign, if the signs differ close by on both sides and an eigenvalue is near zero there."""
    first, last = test(here), test(found)
    if not first * last < 0:
        return []
    place, at = _root(follower, here, length, test)
    for share in BOTH_SIDES:
        beside = [follower.corrected(here, min(max(at + way * share * length, 0.0), length)) for way in (-1, 1)]
        if None not in beside:
            break
    else:
        return []
    before, after = (test(p) for p in beside if p is not None)
    if not before * after < 0 or not max(abs(before), abs(after)) <= CROSSED * max(abs(first), abs(last)):
        return []
    return [(kind, replace(place, tangent=here.tangent, scale=here.scale, before=here) if kind == "branch" else place)]


def _determinant(place: BranchPlace, here: BranchPlace) -> float:
    """Return the product of the deciding eigenvalues, in units of those of an earlier point: it changes sign with one of them."""
    values, units = (p.eigenvalues.values for p in (place, here))
    if len(values) != len(units):
        return 0.0  # one eigenvalue has become neutral
    values, units = (v[np.argsort(np.abs(v))] for v in (values, units))
    return float(np.prod(values / np.abs(units)).real)


def _largest(place: BranchPlace, here: BranchPlace, found: BranchPlace) -> float:
    """Return the real part of the crossing eigenvalue: in sorted order, the one after the growing ones of the stabler side."""
    count = min(here.unstable(), found.unstable())
    values = place.eigenvalues.values
    return float(np.sort(values.real)[::-1][count]) if count < len(values) else 0.0


def _crossing(place: BranchPlace) -> bool:
    """Return True if the slowest growing eigenvalue is one of a complex pair."""
    values, bounds = place.eigenvalues.values, place.eigenvalues.bounds
    growing = values[values.real > bounds]
    least = growing[np.argmin(growing.real)] if len(growing) else 0.0
    return bool(abs(np.imag(least)) > 1e-6 * abs(least))


def _at(follower: BranchFollower, here: BranchPlace, length: float, sign: Callable[[BranchPlace], float]) -> BranchPlace:  # fmt: skip
    """Return the point of a step at which a function of it changes sign."""
    return _root(follower, here, length, sign)[0]


def _root(
    follower: BranchFollower, here: BranchPlace, length: float, sign: Callable[[BranchPlace], float]
) -> tuple[BranchPlace, float]:  # fmt: skip
    """Return the same point, and its length along the step."""
    from scipy.optimize import brentq

    made: dict[float, BranchPlace] = {0.0: here}

    def value(at: float) -> float:
        if at not in made:
            place = follower.corrected(here, at)
            if place is None:
                raise RunFailed("BR202", "the branch could not be followed to a fold that it has")
            made[at] = place
        return sign(made[at])

    if value(0.0) * value(length) > 0:
        return made[length], length
    try:
        root = float(brentq(value, 0.0, length, xtol=1e-14 * length, rtol=1e-14, maxiter=200))
    except RunFailed:  # at a branch point Newton's matrix is singular: interpolate between two close points
        return _between(made, sign)
    nearest = min(made, key=lambda at: abs(at - root))
    return made[nearest], nearest


def _between(made: Mapping[float, BranchPlace], sign: Callable[[BranchPlace], float]) -> tuple[BranchPlace, float]:
    """Return the point by linear interpolation of the sign function between the two closest points with different signs, and its length."""
    order = sorted(made)
    values = [sign(made[at]) for at in order]
    low = min(
        (i for i in range(len(order) - 1) if values[i] * values[i + 1] <= 0), key=lambda i: order[i + 1] - order[i]
    )
    share = values[low] / (values[low] - values[low + 1]) if values[low] != values[low + 1] else 0.5
    first, second = made[order[low]], made[order[low + 1]]
    at = order[low] + share * (order[low + 1] - order[low])
    return replace(first if share < 0.5 else second, value=first.value + share * (second.value - first.value)), at


def _ended(follower: BranchFollower, here: BranchPlace, length: float, end: float) -> BranchPlace | None:
    """Return the point at the end of the range."""
    try:
        return _at(follower, here, length, lambda p: p.value - end)
    except RunFailed:
        return None
