"""A branch of states of rest against a parameter, round its folds: pull-in, snap-through, buckling.

Pseudo-arclength continuation (Keller, in: Applications of Bifurcation Theory, 1977): steps along the branch instead of along the parameter, in
scaled coordinates, each corrected by Newton's method with exact slopes on the plane across its tangent. Folds are where the tangent
has no part along the parameter; there, and where an eigenvalue crosses the imaginary axis, the step is found by bracketing.
What every motion keeps (a charge that has no way out) is kept along the branch. At a branch point another one crosses: it is told, and followed on request.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import RunFailed, UsageError
from .operating_point import OperatingPoint
from .spectrum import spectrum
from .told import named, with_units

if TYPE_CHECKING:
    from numpy.typing import NDArray

SCHEMA = "bondgraph-branch/1"
ITERATIONS = 12
CLOSE = 1e-13  # of the magnitudes: a last correction
ENOUGH = 1e-9  # the same, where rounding lets it come no closer
SINGULAR = 1e-11
TURN = 0.97  # cosine of the largest turn between two tangents
SHORTEST = 1e-7  # of the range
ASIDE = (1e-4, 1e-3, 1e-2, 1e-5)  # of the magnitudes: first steps onto another branch
LONGEST = 4.0  # first steps
# By unit, else in SI: what symmetry and rest leave of an angle, a place, a speed, a momentum is rounding, and no magnitude.
NOTHING = {"1": 1e-9, "1/s": 1e-9, "m": 1e-12, "m/s": 1e-12}
LEAST = 1e-25
NOISE = 1e-14  # of the largest term of a row: what rounding leaves
ROUNDING = 1e-9  # of the fastest eigenvalue: what is no growth


@dataclass(frozen=True, eq=False)
class Special:
    """Where a branch turns or loses stability. `kind`: "fold"; "branch" (a real eigenvalue crosses zero: another branch passes);
    "oscillation" (a pair crosses the imaginary axis). States and outputs by name, in SI."""

    kind: str
    value: float
    states: Mapping[str, float]
    outputs: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Branch:
    """States of rest along a branch: `values` (n,) of the parameter, `states` and `outputs` name -> (n,), `stable` (n,), all in SI."""

    model: str
    experiment: str | None
    parameter: str
    values: NDArray[np.float64]
    states: Mapping[str, NDArray[np.float64]]
    outputs: Mapping[str, NDArray[np.float64]]
    stable: NDArray[np.bool_]
    special: tuple[Special, ...]
    units: Mapping[str, str]
    ended: str  # why the branch ends
    others: tuple[Branch, ...] = ()  # those that pass through its branch points, if they were asked for

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """The parameter, an output or a state along the branch. Raises KeyError."""
        if name == self.parameter:
            return self.values
        return self.outputs[name] if name in self.outputs else self.states[name]

    @property
    def folds(self) -> tuple[Special, ...]:
        """Those of the special points that are folds."""
        return tuple(s for s in self.special if s.kind == "fold")

    def to_json(self) -> dict[str, Any]:
        """By the schema `bondgraph-branch/1`: {schema, model, experiment, parameter: {name, unit, values}, outputs, states: {name: {unit,
        values}}, stable, special: [{kind, value, outputs, states}], ended}; `others` are those that cross, as such objects, if they were
        followed."""
        told: dict[str, Any] = {
            "schema": SCHEMA,
            "model": self.model,
            "experiment": self.experiment,
            "ended": self.ended,
        }
        told["parameter"] = {
            "name": self.parameter,
            "unit": self.units.get(self.parameter, "1"),
            "values": self.values.tolist(),
        }
        for word in ("outputs", "states"):
            some: Mapping[str, Any] = getattr(self, word)
            told[word] = {n: {"unit": self.units.get(n, "1"), "values": v.tolist()} for n, v in some.items()}
        special = [
            {
                "kind": s.kind,
                "value": s.value,
                "outputs": with_units(s.outputs, self.units),
                "states": with_units(s.states, self.units),
            }
            for s in self.special
        ]
        told |= {"stable": self.stable.tolist(), "special": special}
        return {**told, "others": [b.to_json() for b in self.others]} if self.others else told

    def plot(self, path: str | os.PathLike[str], names: Sequence[str] = ()) -> None:
        """Outputs (or `names`) over the parameter, into a .png, .svg or .pdf file. Raises as `Result.plot`."""
        from ..views.phase import plot_branch

        plot_branch(self, path, names)

    def summary(self) -> str:
        """A table for terminals."""
        from ..views.analyses import branch_text

        return branch_text(self)


@dataclass(frozen=True, eq=False)
class _Place:
    """A point of the branch: A and b are the slopes of the rates by free coordinates and the parameter."""

    point: OperatingPoint
    value: float
    A: Any
    b: Any
    tangent: Any  # of all states and the parameter, in scaled coordinates, of length 1
    eigenvalues: Any
    scale: Any  # of the states, with which the tangent was scaled
    before: _Place | None = None  # of a branch point the point before it, which is a plain one

    @property
    def forward(self) -> float:
        return float(self.tangent[-1])

    def unstable(self) -> int:
        """How many eigenvalues grow."""
        least = ROUNDING * float(np.abs(self.eigenvalues).max(initial=0.0))
        return int((self.eigenvalues.real > least).sum())


class _Follower:
    """Holds the scales, which grow with what is seen, and makes points."""

    def __init__(self, first: OperatingPoint, name: str, low: float, high: float) -> None:
        self.name, self.range, self.count = name, high - low, first.count
        self.units = first.program.states.units
        self.seen = np.zeros(first.count)
        self.see(first.state)

    def see(self, state: Any) -> None:
        """Magnitudes of the states: those of one unit share the largest; 1 for what was never seen."""
        size = np.abs(state[: self.count])
        least = np.array([NOTHING.get(unit, LEAST) for unit in self.units])
        self.seen = np.maximum(self.seen, np.where(size > least, size, 0.0))
        self.scale = np.array(
            [max(x for x, u in zip(self.seen, self.units, strict=True) if u == unit) or 1.0 for unit in self.units]
        )

    def slopes(self, point: OperatingPoint) -> tuple[Any, Any]:
        space = point.compilation.state_space
        A, b = point.of_states([space.states[i].rate for i in point.reduced.chosen])
        return A, b[:, 0]

    def system(self, point: OperatingPoint, A: Any, b: Any) -> Any:
        """Scaled rows of [A b], then what every motion keeps; columns are scaled coordinates and the parameter."""
        whole = np.concatenate([A * self.scale[point.reduced.chosen], b[:, None] * self.range], axis=1)
        rows = np.abs(whole).max(axis=1)
        rows = np.where(rows > 0, rows, 1.0)
        u, sizes, _ = np.linalg.svd(whole / rows[:, None], full_matrices=True)
        rank = int((sizes > SINGULAR * sizes.max(initial=0.0)).sum())
        kept = u[:, rank:].T / rows * self.scale[point.reduced.chosen]
        norm = np.linalg.norm(kept, axis=1, keepdims=True)
        kept = np.concatenate([kept / np.where(norm > 0, norm, 1.0), np.zeros((len(kept), 1))], axis=1)
        return rows, whole / rows[:, None], kept

    def place(self, point: OperatingPoint, value: float, along: Any) -> _Place:
        """With the tangent that goes on like `along`."""
        A, b = self.slopes(point)
        _, whole, kept = self.system(point, A, b)
        _, _, right = np.linalg.svd(np.concatenate([whole, kept]), full_matrices=True)
        q = right[-1]
        reduced = point.reduced
        states = (
            reduced.directions @ (q[:-1] * self.scale[reduced.chosen]) + reduced.following[:, 0] * q[-1] * self.range
        )
        tangent = np.concatenate([states / self.scale, q[-1:]])
        tangent = tangent / np.linalg.norm(tangent)
        if tangent @ along < 0:
            tangent = -tangent
        return _Place(point, value, A, b, tangent, spectrum(A).values, self.scale)

    def corrected(self, start: _Place, length: float) -> _Place | None:
        """The point of the branch at a length along the tangent; None if it is not found."""
        origin = np.concatenate([start.point.state[: self.count] / self.scale, [start.value / self.range]])
        guess = origin + length * start.tangent
        before = math.inf
        for _ in range(ITERATIONS):
            full = np.concatenate([guess[:-1] * self.scale, start.point.state[self.count :]])
            value = float(guess[-1] * self.range)
            try:
                point = start.point.elsewhere({self.name: value}, full)
                A, b = self.slopes(point)
            except RunFailed:
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
            right = np.concatenate(
                [
                    point.rates[point.reduced.chosen] / rows,
                    kept @ _chosen(moved, point),
                    [start.tangent @ moved - length],
                ]
            )
            right[np.abs(right) < NOISE] = 0.0  # near a branch point rounding would be made large
            step = -np.linalg.lstsq(matrix, right, rcond=1e-14)[0]
            norm = float(np.abs(step).max(initial=0.0))
            if not math.isfinite(norm):
                return None
            guess = here + lift @ step
            if norm < CLOSE or (norm < ENOUGH and norm >= 0.5 * before):
                value = float(guess[-1] * self.range)
                full = np.concatenate([guess[:-1] * self.scale, point.state[self.count :]])
                return self.place(point.elsewhere({self.name: value}, full), value, start.tangent)
            before = norm
        return None

    def beside(self, place: _Place, sign: float) -> _Place | None:
        """The first point of the branch that crosses at a branch point: two directions keep rest there to first order, one is
        the branch's own; along the other one steps aside, and corrects on the plane across (Keller's parallel search)."""
        reduced, before = place.point.reduced, place.before or place
        rows, _, kept = self.system(
            before.point, before.A, before.b
        )  # at the point itself a row may be nothing but rounding
        whole = np.concatenate([place.A * self.scale[reduced.chosen], place.b[:, None] * self.range], axis=1)
        _, _, right = np.linalg.svd(np.concatenate([whole / rows[:, None], kept]), full_matrices=True)
        own = np.concatenate([place.tangent[:-1] * place.scale / self.scale, place.tangent[-1:]])
        own = own / np.linalg.norm(own)
        ways = []
        for q in right[-2:]:
            states = reduced.directions @ (q[:-1] * self.scale[reduced.chosen])
            way = np.concatenate([(states + reduced.following[:, 0] * q[-1] * self.range) / self.scale, q[-1:]])
            ways.append(way - (way @ own) * own)
        aside = max(ways, key=lambda way: float(np.linalg.norm(way)))
        aside = sign * aside / np.linalg.norm(aside)
        for length in ASIDE:
            moved = self.corrected(replace(place, tangent=aside), length)
            if moved is not None:
                return moved
        return None


def _chosen(moved: Any, point: OperatingPoint) -> Any:
    return np.concatenate([moved[:-1][point.reduced.chosen], moved[-1:]])


def follow(
    first: OperatingPoint, name: str, low: float, high: float, points: int, most: int, branches: bool = False
) -> Branch:
    """From a state of rest at `low` towards `high` in steps of about 1/`points` of the range, until the parameter leaves it.

    `branches`: also those that pass through its branch points, either way.
    """
    if not points >= 2 or low == high:
        raise UsageError("a branch goes from one value to another, in 2 steps or more")
    follower = _Follower(first, name, low, high)
    towards = np.zeros(first.count + 1)
    towards[-1] = 1.0
    line = _Line(follower, low, high, points, most)
    special = line.go(follower.place(first, low, towards))
    found = _told(first, name, line.places, special, line.ended)
    if not branches:
        return found
    others = []
    for kind, place in special:
        for sign in (1.0, -1.0) if kind == "branch" else ():
            begun = follower.beside(place, sign)
            if begun is not None:
                other = _Line(follower, low, high, points, most)
                turns = other.go(begun)
                others.append(_told(first, name, [place, *other.places], turns, other.ended))
    return replace(found, others=tuple(others))


class _Line:
    """One branch, as far as it goes within a range."""

    def __init__(self, follower: _Follower, low: float, high: float, points: int, most: int) -> None:
        self.follower, self.low, self.high, self.points, self.most = follower, low, high, points, most
        self.places: list[_Place] = []
        self.ended = f"after {most} points"

    def go(self, first: _Place) -> list[tuple[str, _Place]]:
        """From a first point along its tangent; what is special on the way."""
        follower, self.places = self.follower, [first]
        special: list[tuple[str, _Place]] = []
        length = 1.0 / self.points
        while len(self.places) < self.most:
            here = self.places[-1]
            found = follower.corrected(here, length)
            if found is None or found.tangent @ here.tangent < TURN:
                length *= 0.5
                if length < SHORTEST:
                    self.ended = "no further state of rest was found"
                    break
                continue
            end = self._passed(found.value)
            special += _special(follower, here, found, length)
            if end is not None:
                self.places.append(_ended(follower, here, length, end) or found)
                self.ended = f"`{follower.name}` leaves the range"
                break
            self.places.append(found)
            follower.see(found.point.state)
            self.places[-1] = follower.place(found.point, found.value, found.tangent)
            length = min(1.3 * length, LONGEST / self.points)
        return special

    def _passed(self, value: float) -> float | None:
        """The end of the range that a value lies beyond."""
        if (value - self.high) * (self.high - self.low) >= 0:
            return self.high
        return self.low if (value - self.low) * (self.high - self.low) <= 0 else None


def _switches(point: OperatingPoint) -> bool:
    """Whether conditions on states are no longer what they were at the first point."""
    program = point.program
    if program.hybrid is None:
        return False
    mode = program.mode_at(point.time, point.state, point.inputs, point.constants)
    places = [c.position for c in program.hybrid.conditions]
    return bool((np.asarray(mode)[places] != np.asarray(point.mode)[places]).any())


def _bracketed(function: Callable[[float], float], length: float) -> float:
    from scipy.optimize import brentq

    return float(brentq(function, 0.0, length, xtol=1e-14 * length, rtol=1e-14, maxiter=200))


def _special(follower: _Follower, here: _Place, found: _Place, length: float) -> list[tuple[str, _Place]]:
    """What lies between two points."""
    if here.forward * found.forward < 0:
        return [("fold", _at(follower, here, length, lambda p: p.forward))]
    if here.unstable() == found.unstable():
        return []
    pair = _crossing(found if found.unstable() > here.unstable() else here)
    if pair:
        return [("oscillation", _at(follower, here, length, lambda p: _largest(p, here, found)))]
    _, _, kept = follower.system(here.point, here.A, here.b)
    place = _at(follower, here, length, lambda p: _determinant(p, here, len(kept)))
    return [
        ("branch", replace(place, tangent=here.tangent, scale=here.scale, before=here))
    ]  # there itself a tangent is of either


def _determinant(place: _Place, here: _Place, zeros: int) -> float:
    """The product of eigenvalues without those that are always zero, in units of an earlier one: it changes sign where one of them does."""
    values, units = (np.linalg.eigvals(p.A) for p in (place, here))
    values, units = (v[np.argsort(np.abs(v))][zeros:] for v in (values, units))
    return float(np.prod(values / np.abs(units)).real)


def _largest(place: _Place, here: _Place, found: _Place) -> float:
    """The real part of the eigenvalue that crosses: of those sorted, the one after the growing ones of the stabler side."""
    count = min(here.unstable(), found.unstable())
    return float(np.sort(place.eigenvalues.real)[::-1][count])


def _crossing(place: _Place) -> bool:
    """Whether the slowest growing eigenvalue is one of a pair."""
    growing = place.eigenvalues[place.eigenvalues.real > 0]
    least = growing[np.argmin(growing.real)] if len(growing) else 0.0
    return bool(abs(np.imag(least)) > 1e-6 * abs(least))


def _at(follower: _Follower, here: _Place, length: float, sign: Callable[[_Place], float]) -> _Place:
    made: dict[float, _Place] = {0.0: here}

    def value(at: float) -> float:
        if at not in made:
            place = follower.corrected(here, at)
            if place is None:
                raise RunFailed("the branch could not be followed to a fold that it has")
            made[at] = place
        return sign(made[at])

    if value(0.0) * value(length) > 0:
        return made[length]
    try:
        root = _bracketed(value, length)
    except RunFailed:  # at a branch point itself Newton's matrix is singular: between two points close to it
        return _between(made, sign)
    return made[min(made, key=lambda at: abs(at - root))]


def _between(made: Mapping[float, _Place], sign: Callable[[_Place], float]) -> _Place:
    """Where a straight line between the two closest points of unlike sign passes zero."""
    order = sorted(made)
    values = [sign(made[at]) for at in order]
    low = min(
        (i for i in range(len(order) - 1) if values[i] * values[i + 1] <= 0), key=lambda i: order[i + 1] - order[i]
    )
    share = values[low] / (values[low] - values[low + 1]) if values[low] != values[low + 1] else 0.5
    first, second = made[order[low]], made[order[low + 1]]
    return replace(first if share < 0.5 else second, value=first.value + share * (second.value - first.value))


def _ended(follower: _Follower, here: _Place, length: float, end: float) -> _Place | None:
    """The point at the end of the range."""
    try:
        return _at(follower, here, length, lambda p: p.value - end)
    except RunFailed:
        return None


def _told(
    first: OperatingPoint, name: str, places: Sequence[_Place], special: Sequence[tuple[str, _Place]], ended: str
) -> Branch:
    from .equilibrium import units_of

    program, n = first.program, first.count
    states = np.array([p.point.state[:n] for p in places]).T
    outputs = np.array([p.point.outputs for p in places]).T.reshape(len(program.outputs.names), len(places))

    def told(kind: str, place: _Place) -> Special:
        point = place.point
        return Special(
            kind, place.value, named(program.states.names, point.state[:n]), named(program.outputs.names, point.outputs)
        )  # fmt: skip

    return Branch(
        program.name, first.made.plan.experiment, name, np.array([p.value for p in places]),
        dict(zip(program.states.names, states, strict=True)), dict(zip(program.outputs.names, outputs, strict=True)),
        np.array([p.unstable() == 0 for p in places]), tuple(told(kind, place) for kind, place in special), units_of(first), ended,
    )  # fmt: skip
