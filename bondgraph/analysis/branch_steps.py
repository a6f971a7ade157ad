"""Steps along a branch of equilibria, and the special points between them.

Each step is corrected by Newton's method on the plane perpendicular to the tangent. A fold, a branch point or an oscillation is accepted only if its
test function has different signs close by on both sides, and goes to zero there instead of passing a pole.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from compiler.api import Array

from ..errors import RunFailed
from ..numerics.scales import group_numbers, largest_of_group
from ..simulation.equilibrium.search import equilibrium
from ..simulation.equilibrium.steady import given_terms
from ..simulation.magnitudes.nominal_magnitudes import rounding_levels
from ..simulation.segments.timeline import Segment
from .eigenvalues import EPS, Eigenvalues
from .families import families, scaled_system
from .operating_point import OperatingPoint
from .sizes import natural, of_parameters, reach
from .verdict import decisive, resting_rates

ITERATIONS = 12
CLOSE = 1e-13  # relative to the magnitudes: size of the last correction
ENOUGH = 1e-9  # the same, where rounding prevents a smaller one
TURN = 0.97  # cosine of the largest turn between two tangents
SHORTEST = 1e-7  # shortest step, as a fraction of the range
ASIDE = (1e-4, 1e-3, 1e-2, 1e-5)  # relative to the magnitudes: first steps onto another branch
PROBES = 6  # first steps that are tried, each a quarter of the one before
LIMIT_STEPS = 30  # halvings of the step within which the model ceases to be valid, or a condition changes
CLOSE_BY = SHORTEST * 4.0 ** np.arange(6)  # fractions of the range: steps across a bend
BENT = 1e-3  # relative to the largest slope of a row: least change of a slope at a kink
JUMPS = 1e-6  # the same: least rate that a condition brings by changing at a rest, and least jump of a state
ARC = 0.3  # relative to length and turn of a step: how far its chord may be from the mean of its tangents
LONGEST = 4.0  # longest step, in units of the first one
RESTING = 1e-6  # relative to the terms in a rate: where a larger rate is left at rest, these are rounding of zero
NOISE = 1e-14  # relative to the largest term of a row: rounding
NO_FURTHER = "no further state of rest was found"
LOST = 1e-13  # relative to the terms of a rate: a state that contributes less is rounding of zero
TIED = 2.0  # relative to what it follows: a tied coordinate within it is rounding, if that is
CROSSED = 0.5  # relative to a test function at the ends of a step: limit next to a zero, exceeded next to a pole
BOTH_SIDES = (0.01, 0.05, 0.2)  # fractions of a step: distances from a zero at which the signs are verified


@dataclass(frozen=True, eq=False)
class BranchPlace:
    """A point of the branch: A and b are the derivatives of the rates by free coordinates and by the parameter."""

    point: OperatingPoint
    value: float
    A: Any
    b: Any
    tangent: Any  # for all states and the parameter, in scaled coordinates, of length 1
    eigenvalues: Eigenvalues  # eigenvalues that decide on stability
    scale: Any  # scales of the states used for the tangent
    before: BranchPlace | None = None  # for a branch point: the ordinary point before it

    @property
    def forward(self) -> float:
        return float(self.tangent[-1])

    def unstable(self) -> int:
        """Return the number of growing eigenvalues."""
        return self.eigenvalues.growing

    @property
    def decided(self) -> bool:
        """True if it is known for each eigenvalue if it grows."""
        return not self.eigenvalues.undecided


class BranchFollower:
    """Corrector with the scales of the states, which grow with the values encountered; makes points of the branch."""

    def __init__(self, first: OperatingPoint, name: str, low: float, high: float, points: int) -> None:
        self.name, self.range, self.count = name, high - low, first.count
        self.units = group_numbers(first.program.states.units)
        self.steady, self.neutral = first.steady, 0
        self.seen, self.unseen = np.zeros(first.count), np.ones(first.count)
        constraints, still = first.constraints, Segment(first.time, first.time, first.mode)
        levels = rounding_levels(first.program, first.made.facts.mechanisms, constraints, first.state, still)[
            : first.count
        ]
        lengths, units = of_parameters(first.program, constraints.parameters)[: first.count], first.program.states.units
        self.least = np.where([u in ("1", "m") for u in units], levels, 0.0)
        self.least = np.maximum(self.least, np.where([u == "1" for u in units], 0.0, EPS * lengths))
        self.see(first, self.slopes(first)[0])
        self._begin(first, low, 1.0 / points)
        self.see(first, self.slopes(first)[0])
        self.free, (A, b) = np.zeros((0, first.count)), self.slopes(first)
        self.free = families(first, A, np.concatenate(self.system(first, A, b)[1:])[:, :-1], self.scale, self.rates)

    def _begin(self, first: OperatingPoint, low: float, share: float) -> None:
        """Set the first magnitudes: how far the states would come over the range, by the rest at a share of it; of others, by what moves them."""
        there = first
        for _ in range(PROBES):
            try:
                there = self.at_rest(first, low + share * self.range)
                A, _ = self.slopes(there)
            except (RunFailed, np.linalg.LinAlgError):
                share *= 0.25
                continue
            before, after = first.state[: self.count], there.state[: self.count]
            moving = (self.seen > 0) | (self._values(there, A, np.abs(after)) > 0)
            self.seen = np.maximum(self.seen, np.where(moving, np.abs(after - before) / share, 0.0))
            break
        values = np.zeros(there.all)
        values[: self.count] = largest_of_group(self.seen, self.units)
        values = np.where(values > 0, values, of_parameters(first.program, first.constraints.parameters))
        units = group_numbers(first.program.variables.units)
        moved = reach(there.slopes_here, values, self.count, units)[: self.count]
        self.unseen = np.where(
            moved > 0, moved, natural(first.program, first.constraints.parameters, first.program.states.units)
        )

    def at_rest(self, point: OperatingPoint, value: float) -> OperatingPoint:
        """Return the rest that is found from a point at another value of the parameter."""
        moved = point.elsewhere({self.name: value}, point.state)
        segment = Segment(point.time, point.time, moved.mode)
        state = equilibrium(moved.program, moved.constraints, moved.inputs, moved.state, segment)
        return point.elsewhere({self.name: value}, state)

    def see(self, point: OperatingPoint, A: Array) -> None:
        """Raise the magnitudes of the states: those of one unit share the largest; an estimate for units without any value."""
        self.seen = np.maximum(self.seen, self._values(point, A, np.abs(point.state[: self.count])))
        largest = largest_of_group(self.seen, self.units)
        self.scale = np.where(largest > 0, largest, self.unseen)

    def _values(self, point: OperatingPoint, A: Array, size: Array) -> Any:
        """Return sizes of states with 0 for those without a magnitude of their own that are rounding of zero.

        At rest a rate is small relative to its terms. Where it is not, these terms are rounding, as a momentum of 1e-18 N*s of a mass at rest; so are states
        that make no difference to any rate.
        """
        size, chosen = np.where(size > self.least, size, 0.0), point.reduced.chosen
        if not ((size > 0) & (self.seen == 0))[chosen].any():
            return size
        constants = given_terms(
            point.program, point.constraints.parameters, point.time, point.state, point.inputs, point.mode
        )
        rates, directions = np.abs(self.rates(point)), np.abs(point.reduced.directions)
        for _ in chosen:
            effects = np.abs(A) * size[chosen]
            terms = np.maximum(effects.sum(axis=1), constants[chosen])[:, None]
            read = effects > LOST * terms
            nothing = ~read.any(axis=0) | (read & (rates[:, None] > RESTING * terms)).any(axis=0)
            nothing &= (self.seen[chosen] == 0) & (size[chosen] > 0)
            if not nothing.any():
                break
            follows = (self.seen == 0) & (size <= TIED * (directions[:, nothing] @ size[chosen[nothing]]))
            size[chosen[nothing]] = size[follows] = 0.0
        return size

    def slopes(self, point: OperatingPoint) -> tuple[Any, Any]:
        space = point.compilation.state_space
        A, b = point.of_states([space.states[i].rate for i in point.reduced.chosen])
        turning = [n in self.steady for n in np.take(point.program.states.names, point.reduced.chosen)]
        return np.where(np.array(turning)[:, None], 0.0, A), np.where(turning, 0.0, b[:, 0])

    def rates(self, point: OperatingPoint) -> Any:
        """Return the rates of the free coordinates, zero for angles that rotate steadily at the first point."""
        return resting_rates(point, self.steady)

    def system(self, point: OperatingPoint, A: Array, b: Array) -> Any:
        """Return the scaled rows of [A b], then the conserved sums and the free coordinates; columns are scaled coordinates and the parameter."""
        chosen = point.reduced.chosen
        return scaled_system(A, b[:, None] * self.range, self.scale[chosen], self.free[:, chosen])

    def lifted(self, point: OperatingPoint, q: Array) -> Any:
        """Return a direction of all states and the parameter, scaled, from one of the free coordinates and the parameter."""
        reduced = point.reduced
        states = reduced.directions @ (q[:-1] * self.scale[reduced.chosen])
        return np.concatenate([(states + reduced.following[:, 0] * q[-1] * self.range) / self.scale, q[-1:]])

    def place(self, point: OperatingPoint, value: float, along: Array) -> BranchPlace:
        """Return the point with the tangent in the direction of `along`."""
        A, b = self.slopes(point)
        _, whole, kept = self.system(point, A, b)
        _, _, right = np.linalg.svd(np.concatenate([whole, kept]), full_matrices=True)
        tangent = self.lifted(point, right[-1])
        tangent = tangent / np.linalg.norm(tangent)
        if tangent @ along < 0:
            tangent = -tangent
        found, self.neutral = decisive(point, A, self.neutral)
        return BranchPlace(point, value, A, b, tangent, found, self.scale)

    def behind_bend(self, here: BranchPlace) -> tuple[BranchPlace | None, float]:
        """Return the nearest place close by that has other slopes, as a law bends between, and the length of the step; None if there is none."""
        for length in CLOSE_BY.tolist():
            place = self.corrected(here, length)
            if place is None:
                continue
            slopes, others = (
                np.concatenate([p.A * p.scale[p.point.reduced.chosen], p.b[:, None] * self.range], axis=1)
                for p in (here, place)
            )
            if (np.abs(others - slopes).max(axis=1) > BENT * np.abs(slopes).max(axis=1)).any():
                return place, length
        return None, 0.0

    def corrected(self, start: BranchPlace, length: float) -> BranchPlace | None:
        """Return the point of the branch at a length along the tangent; None if it is not found."""
        origin = np.concatenate([start.point.state[: self.count] / self.scale, [start.value / self.range]])
        guess = origin + length * start.tangent
        before = math.inf
        for _ in range(ITERATIONS):
            full = np.concatenate([guess[:-1] * self.scale, start.point.state[self.count :]])
            value = float(guess[-1] * self.range)
            try:
                point = start.point.elsewhere({self.name: value}, full)
                A, b = self.slopes(point)
            except (RunFailed, np.linalg.LinAlgError):  # beyond what joints reach, a mechanism has no values
                return None
            here = np.concatenate([point.state[: self.count] / self.scale, guess[-1:]])
            rows, whole, kept = self.system(point, A, b)
            lift = np.concatenate(
                [point.reduced.directions * self.scale[point.reduced.chosen], point.reduced.following * self.range],
                axis=1,
            )
            lift = np.concatenate([lift / self.scale[:, None], np.eye(1, lift.shape[1], lift.shape[1] - 1)])
            matrix = np.concatenate([whole, kept, (start.tangent @ lift)[None]])
            moved = here - origin
            rates = self.rates(point)  # near a branch point their rounding would be amplified
            rates = np.where(np.abs(rates) < NOISE * rows, 0.0, rates)
            free = np.append(moved[:-1][point.reduced.chosen], moved[-1])
            right = np.concatenate([rates / rows, kept @ free, [start.tangent @ moved - length]])
            right[len(rates) :][np.abs(right[len(rates) :]) < NOISE] = 0.0
            step = -np.linalg.lstsq(matrix, right, rcond=1e-14)[0]
            norm = float(np.abs(step).max(initial=0.0))
            if not math.isfinite(norm):
                return None
            guess = here + lift @ step
            if norm < CLOSE or (norm < ENOUGH and norm >= 0.5 * before):
                value = float(guess[-1] * self.range)
                full = np.concatenate([guess[:-1] * self.scale, point.state[self.count :]])
                try:
                    point = point.elsewhere({self.name: value}, full)
                except (RunFailed, np.linalg.LinAlgError):
                    return None
                return self.place(point, value, start.tangent)
            before = norm
        return None

    def beside(self, place: BranchPlace, sign: float) -> BranchPlace | None:
        """Return the first point of the branch that crosses at a branch point; None if it is not found.

        Two directions preserve the equilibrium there to first order, one is that of this branch. A step along the other one is corrected on the
        perpendicular plane (Keller's parallel search).
        """
        reduced, before = place.point.reduced, place.before or place
        rows, _, kept = self.system(before.point, before.A, before.b)  # at the point itself a row may be pure rounding
        whole = np.concatenate([place.A * self.scale[reduced.chosen], place.b[:, None] * self.range], axis=1)
        _, _, right = np.linalg.svd(np.concatenate([whole / rows[:, None], kept]), full_matrices=True)
        own = np.concatenate([place.tangent[:-1] * place.scale / self.scale, place.tangent[-1:]])
        own = own / np.linalg.norm(own)
        ways = []
        for q in right[-2:]:
            way = self.lifted(place.point, q)
            ways.append(way - (way @ own) * own)
        aside = max(ways, key=lambda way: float(np.linalg.norm(way)))
        aside = sign * aside / np.linalg.norm(aside)
        for length in ASIDE:
            moved = self.corrected(replace(place, tangent=aside), length)
            if moved is not None:
                return moved
        return None


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
        left = place.point.left
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
            return [follower.place(follower.at_rest(p.point, at), at, p.tangent) for p, at in ((here, low), (found or here, high))]
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
