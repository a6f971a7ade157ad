"""Steps along a branch of equilibria: each is corrected by Newton's method on the plane perpendicular to the tangent.

A branch must not follow families of rests: directions along which an equilibrium may lie anywhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from compiler.api import Array

from ..errors import RunFailed
from ..numerics.scales import group_numbers, largest_of_group, nonzero
from ..simulation.equilibrium.search import equilibrium
from ..simulation.equilibrium.steady import given_terms
from ..simulation.magnitudes.nominal_magnitudes import rounding_levels
from ..simulation.segments.timeline import Segment
from .eigenvalues import EPS, Eigenvalues
from .operating_point import OperatingPoint
from .sizes import natural, of_parameters, reach
from .verdict import decisive, resting_rates

ITERATIONS = 12
CLOSE = 1e-13  # relative to the magnitudes: size of the last correction
ENOUGH = 1e-9  # the same, where rounding prevents a smaller one
SHORTEST = 1e-7  # shortest step, as a fraction of the range
ASIDE = (1e-4, 1e-3, 1e-2, 1e-5)  # relative to the magnitudes: first steps onto another branch
PROBES = 6  # first steps that are tried, each a quarter of the one before
CLOSE_BY = SHORTEST * 4.0 ** np.arange(6)  # fractions of the range: steps across a bend
BENT = 1e-3  # relative to the largest slope of a row: least change of a slope at a kink
RESTING = 1e-6  # relative to the terms in a rate: a larger one is a motion; where one is left at rest, these are rounding of zero
NOISE = 1e-14  # relative to the largest term of a row: rounding
LOST = 1e-13  # relative to the terms of a rate: a state that contributes less is rounding of zero
TIED = 2.0  # relative to what it follows: a tied coordinate within it is rounding, if that is
ASTRIDE = (-0.7, 0.3)  # in magnitudes: places at which a family of rests is told from a fold
SINGULAR = 1e-11  # relative to the largest singular value


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
        levels = rounding_levels(first.made.facts.mechanisms, constraints, first.state, still)[: first.count]
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
        state = equilibrium(moved.constraints, moved.state, segment)
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
        constants = given_terms(point.constraints, point.time, point.state, point.mode)
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


def scaled_system(A: Array, b: Array, scale: Array, free: Array) -> Any:
    """Return the sizes of the rows of [A b], b scaled, the rows over them, and the conserved sums and free coordinates, all with scaled columns."""
    whole = np.concatenate([A * scale, b], axis=1)
    rows = nonzero(np.abs(whole).max(axis=1))
    u, sizes, _ = np.linalg.svd(whole / rows[:, None], full_matrices=True)
    rank = int((sizes > SINGULAR * sizes.max(initial=0.0)).sum())
    kept = np.concatenate([u[:, rank:].T / rows * scale, free / scale])
    kept = kept / nonzero(np.linalg.norm(kept, axis=1, keepdims=True))
    return rows, whole / rows[:, None], np.pad(kept, ((0, 0), (0, 1)))


def families(point: OperatingPoint, A: Array, rows: Array, scale: Array, rates: Callable[[OperatingPoint], Any]) -> Any:
    """Return the directions (k, n) of the states along which a point is one of a family of rests.

    `A`: derivatives of the free coordinates' rates by them; `rows`: the same, scaled, and the conserved sums, which tell the members of other families apart.
    """
    chosen = point.reduced.chosen
    _, sizes, right = np.linalg.svd(rows, full_matrices=True)
    rank = int((sizes > SINGULAR * sizes.max(initial=0.0)).sum())
    ways = [point.reduced.directions @ (q * scale[chosen]) for q in right[rank:]]
    terms = RESTING * (np.abs(A) @ scale[chosen])
    free = [w for w in ways if all(_rests(point, s * w, terms, rates) for s in ASTRIDE)]
    return np.array(free).reshape(-1, point.count)


def _rests(point: OperatingPoint, change: Array, allowed: Array, rates: Callable[[OperatingPoint], Any]) -> bool:
    state = np.concatenate([point.state[: point.count] + change, point.state[point.count :]])
    try:
        return bool((np.abs(rates(point.elsewhere({}, state))) <= allowed).all())
    except (RunFailed, np.linalg.LinAlgError):
        return False
