"""Pose in which mechanisms start: from the drawing along the given coordinates, on the branch of the drawing.

All given coordinates change proportionally from their drawn to their given values; the others follow by the least change, and the residuals of
loop joints stay zero (`numerics/continuation.py`). So an elbow or a rocker is on the side on which it was drawn, and a coordinate winds as often as the path
winds it. Coordinates that follow from others are compared at the end. A start that the path does not reach is an error that names the nearest
reachable value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array

from ...errors import RunFailed
from ...numerics.continuation import Followed, SolutionPath, follow, newton, split
from ...quantities import behind, listed
from ..constraints.constraints import Constraints
from .initial_equations import DIFFERENCE, differences

if TYPE_CHECKING:
    from compiler.api import IntArray, StateSpace

INDEPENDENT = 1e-6  # least part of a unit derivative that is independent of earlier start values
CLOSE = 1e-6  # relative error of a dependent coordinate, and difference of two poses that are one: start values have few digits
CLOSED = 1e-9  # relative size of a residual that counts as closed
STAYS = 1e-14  # relative change of a coordinate that starts as drawn
ASIDE, FAR, BESIDE = 1e-3, 10.0, 8  # distance from a singular drawing, in units of the variables; largest; directions
CHOICES = 6  # of the coordinates to follow

Claims = Callable[[Any], Any]  # states (…, n) -> the rows of `Program.claims`


@dataclass(frozen=True, slots=True)
class GivenCoordinates:
    """A coordinate with a start value: name and place in the text, unit, and index of its state or initial equation."""

    name: str
    line: int
    unit: str
    state: int = -1  # among the coordinates
    claim: int = -1
    value: float = 0.0
    read: int = -1  # the row of all claims that has the coordinate's value


@dataclass(frozen=True, slots=True)
class PoseProblem:
    """Residuals and given coordinates as functions of all coordinates of mechanisms; `begin`: the states with the drawn coordinates."""

    constraints: Constraints
    claims: Claims
    time: float
    mode: Any
    begin: Any  # shape (n,)
    places: Any  # indices of the coordinates among the states
    size: Any  # unit of change of each coordinate
    length: float  # length of the mechanism, m
    given: tuple[GivenCoordinates, ...]

    def state(self, z: Array) -> Any:
        """Return all states, with coordinates z."""
        state = np.array(self.begin, dtype=float)
        state[self.places] = z * self.size
        return state

    @property
    def drawn(self) -> Any:
        """Coordinates in the drawing."""
        return self.begin[self.places] / self.size

    @property
    def gaps(self) -> int:
        """Number of residuals; their rows come first."""
        return self.constraints.gaps

    def values(self, z: Array) -> Any:
        """Return residuals, then given coordinates minus their start values, in units of the mechanism."""
        state = self.state(z)
        found = [self.constraints.values(self.time, state, self.mode)[: self.gaps] / self._gap_units()]
        claims = self.claims(state) if any(g.claim >= 0 for g in self.given) else ()
        found.append(
            np.array([claims[g.claim] if g.claim >= 0 else state[self.places[g.state]] - g.value for g in self.given])
            / self.units()
        )
        return np.concatenate(found)

    def slopes(self, z: Array) -> Any:
        """Return their derivatives; those of initial equations are central differences."""
        state, count, constraints = self.state(z), len(self.places), self.constraints
        result = np.zeros((self.gaps + len(self.given), count))
        if self.gaps:
            by, _ = constraints.slopes(self.time, state, self.mode)
            columns = np.searchsorted(self.places, constraints.positions)
            scale = self.size[columns] / constraints.reach[constraints.positions]
            result[: self.gaps, columns] = by * scale / self._gap_units()[:, None]
        if any(g.claim >= 0 for g in self.given):
            claims = differences(self.claims, state, self.places, self.size).T
        for row, (item, unit) in enumerate(zip(self.given, self.units(), strict=True), self.gaps):
            if item.claim >= 0:
                result[row] = claims[item.claim] / unit
            else:
                result[row, item.state] = self.size[item.state] / unit
        return result

    def _gap_units(self) -> Any:
        return np.where(self.constraints.lengths, self.length, 1.0)

    def units(self) -> Any:
        return np.array([self.length if g.unit == "m" else 1.0 for g in self.given])

    def missed(self, z: Array) -> float:
        """Return the largest residual."""
        return float(np.abs(self.values(z)[: self.gaps]).max(initial=0.0))


def posed(problem: PoseProblem) -> tuple[Any, str | None]:
    """Return the states in the pose of the start values, shape (n,), and a note if the drawing leaves open which of two poses it is.

    Raises `RunFailed`.
    """
    alone = replace(problem, given=())
    z = problem.drawn
    if problem.missed(z) > CLOSED:
        opened = alone.values(z)
        closed = follow(alone, z, SolutionPath(lambda s: (1.0 - s) * opened, lambda _: -opened))
        if not closed.arrived or problem.missed(closed.z) > CLOSED:
            raise _open(problem, closed.z)
        z = closed.z
    elif problem.gaps:
        z = newton(alone, z, np.zeros(problem.gaps), close=0.0)[0]
    if not problem.given:
        return problem.state(z), None
    found, note = _along(problem, z)
    return problem.state(found), note


def _along(problem: PoseProblem, z: Array) -> tuple[Any, str | None]:
    """Return the pose at the end of the path along given coordinates."""
    if np.abs(problem.values(z)).max(initial=0.0) <= STAYS:
        return z, None
    beside = _beside(problem, z)
    if beside:
        return _from_singular(problem, z, beside)
    tried: list[RunFailed] = []
    for chosen in _choices(problem, z):
        found = _followed(problem, chosen, z, tried)
        if found is not None:
            return found, None
    raise tried[0]


def _from_singular(problem: PoseProblem, z: Array, beside: Sequence[Any]) -> tuple[Any, str | None]:
    """Return the pose from a drawing whose coordinates have fewer independent derivatives than neighbouring poses.

    It exists where all paths from there end in one pose, and for open chains.
    """
    several = RunFailed(
        "BR741", f"the start of {_names(problem.given)} (line {problem.given[0].line}) can be reached in several ways from the drawing, "
        "a singular pose, and nothing says in which:", "draw the mechanism a little beside it, on the side that is meant",
    )  # fmt: skip
    gaps = slice(0, problem.gaps)
    if any(_rank(problem.slopes(b)[gaps]) > _rank(problem.slopes(z)[gaps]) for b in beside):
        raise several
    tried: list[RunFailed] = []
    ends = [_followed(problem, chosen, b, tried) for b in beside for chosen in _choices(problem, b)[:1]]
    reached = [e for e in ends if e is not None]
    if not reached:
        raise tried[0]
    if all(np.abs(e - reached[0]).max() < CLOSE for e in reached):
        return reached[0], None
    if problem.gaps:
        raise several
    return reached[0], f"{several.sentence}; one of them is taken: {several.advice}"


def _followed(problem: PoseProblem, chosen: Sequence[int], z: Array, tried: list[RunFailed]) -> Any:
    """Return the pose with all start values, followed along some of them; None if it is not reached, with the reason added to `tried`."""
    along = replace(problem, given=tuple(problem.given[i] for i in chosen))
    path = _path(along, z)
    end = follow(along, z, path)
    if not end.arrived:
        tried.append(_short(along, end))
        return None
    rest = problem.values(end.z)[problem.gaps :]
    others = [i for i in range(len(problem.given)) if i not in set(chosen)]
    off = [i for i in others if abs(rest[i]) > CLOSE * max(1.0, _said(problem, i))]
    if off or problem.missed(end.z) > CLOSED:
        tried.append(_against(problem, along, off, end.z))
        return None
    return end.z


def _said(problem: PoseProblem, row: int) -> float:
    """Return the size of a start value, in units of the mechanism."""
    return abs(problem.given[row].value) / float(problem.units()[row])


def _path(problem: PoseProblem, z: Array) -> SolutionPath:
    """Return the path of all given coordinates, proportional from their values to their start values; an attitude turns about one axis."""
    begin = problem.values(z)
    begin[: problem.gaps] = 0.0
    turns = _attitudes(problem)
    ends = [np.array([problem.given[i].value for i in rows]) for rows in turns]

    def at(share: float) -> Any:
        result = (1.0 - share) * begin
        for rows, end in zip(turns, ends, strict=True):
            places = [problem.gaps + i for i in rows]
            result[places] = _turned(begin[places] + end, end, share) - end
        return result

    def slope(share: float) -> Any:
        if not turns:
            return -begin
        low, high = max(share - DIFFERENCE, 0.0), min(share + DIFFERENCE, 1.0)
        return (at(high) - at(low)) / (high - low)

    return SolutionPath(at, slope)


def _attitudes(problem: PoseProblem) -> list[list[int]]:
    """Return the given rows of each attitude, w x y z."""
    groups: dict[str, list[int]] = {}
    for row, item in enumerate(problem.given):
        head, dot, letter = item.name.rpartition(".attitude.")
        if dot and letter in "wxyz":
            groups.setdefault(head, []).append(row)
    return [rows for rows in groups.values() if len(rows) == 4]


def _turned(begin: Array, end: Array, share: float) -> Any:
    """Return the unit quaternion at a share of the rotation from one to another."""
    angle = math.acos(min(1.0, max(-1.0, float(begin @ end))))
    if math.sin(angle) < CLOSE:
        return begin + share * (end - begin)
    return (math.sin((1.0 - share) * angle) * begin + math.sin(share * angle) * end) / math.sin(angle)


# ---------------------------------------------------------------- which coordinates lead
def _choices(problem: PoseProblem, z: Array) -> list[tuple[int, ...]]:
    """Return sets of given coordinates that are independent at a pose, in the order of the text; dependent ones each come first in a further set."""
    slopes = problem.slopes(z)
    free = split(slopes[: problem.gaps])[1].T
    count = len(problem.given)
    attitudes = _attitudes(problem)
    whole = {i: set(rows) for rows in attitudes for i in rows}

    def leading(order: Sequence[int]) -> tuple[int, ...]:
        basis = np.zeros((0, free.shape[1]))
        chosen: set[int] = set()
        for i in order:
            row = slopes[problem.gaps + i] @ free
            norm: Any = np.linalg.norm(slopes[problem.gaps + i])
            for _ in range(2):
                row = row - basis.T @ (basis @ row)
            if np.linalg.norm(row) > INDEPENDENT * max(norm, 1e-300):
                basis = np.concatenate([basis, row[None] / np.linalg.norm(row)])
                chosen |= whole.get(i, {i})
        return tuple(sorted(chosen))

    first = leading(range(count))
    left = [i for i in range(count) if i not in first]
    orders = [[i, *(k for k in range(count) if k != i)] for i in left]
    return list(dict.fromkeys([first, *(leading(order) for order in orders[:CHOICES])]))


def _beside(problem: PoseProblem, z: Array) -> list[Any]:
    """Return neighbouring poses of a drawing with more independent derivatives of residuals and given coordinates; an empty list if there are none."""
    alone = replace(problem, given=())
    slopes = problem.slopes(z)
    rank = _rank(slopes)
    if rank == min(slopes.shape):
        return []
    free = split(slopes[: problem.gaps], 0, INDEPENDENT)[1].T
    ways = np.random.default_rng(0).normal(size=(BESIDE // 2, free.shape[1])) @ free.T
    found = []
    for way in (*ways, *-ways):
        aside = z + ASIDE * way / max(float(np.abs(way).max(initial=0.0)), 1e-300)
        if problem.gaps:
            aside, _ = newton(alone, aside, np.zeros(problem.gaps))
        if (
            problem.missed(aside) < CLOSED
            and np.abs(aside - z).max() < FAR * ASIDE
            and _rank(problem.slopes(aside)) > rank
        ):
            found.append(aside)
    return found


def _rank(slopes: Array) -> int:
    values = np.linalg.svd(slopes, compute_uv=False)
    return int((values > INDEPENDENT * values.max(initial=0.0)).sum())


# ---------------------------------------------------------------- words
def _names(given: Sequence[GivenCoordinates]) -> str:
    parts = (g.name.rpartition(".attitude.") for g in given)
    names = (f"{body}.attitude" if mark else name for body, mark, name in parts)
    return listed(list(dict.fromkeys(names)))


def _shown(item: GivenCoordinates, value: float) -> str:
    """Return a value with its unit as text: angles in degrees too."""
    if item.unit == "m":
        return f"{value:.9g} m"
    return f"{value:.9g} rad ({math.degrees(value):.6g} deg)" if item.unit == "1" else f"{value:.9g}{behind(item.unit)}"


def _here(problem: PoseProblem, z: Array) -> list[float]:
    """Return the values of the given coordinates."""
    state = problem.state(z)
    claims = problem.claims(state)
    return [float(claims[g.read] if g.claim >= 0 else state[problem.places[g.state]]) for g in problem.given]


def _short(problem: PoseProblem, end: Followed) -> RunFailed:
    """Return the error of a path that ends before its start values."""
    given, here = problem.given, _here(problem, end.z)
    reached = ", ".join(f"`{g.name}` = {_shown(g, v)}" for g, v in list(zip(given, here, strict=True))[:4])
    if end.fold:
        why = "there a dead centre stands between, and the mechanism turns back"
        advice = "start it before that pose, or say another coordinate that leads through it"
    else:
        why = "there a singular pose stands between, from which the mechanism may go on in several ways"
        advice = "draw it beyond that pose, on the branch that is meant"
    return RunFailed(
        "BR739", f"the start of {_names(given)} (line {given[0].line}) cannot hold: from the drawing it can be reached up to {reached}; {why}:", f"{advice}",
    )  # fmt: skip


def _against(problem: PoseProblem, along: PoseProblem, off: Sequence[int], z: Array) -> RunFailed:
    """Return the error of start values that contradict each other."""
    off = off or range(len(problem.given))  # all are as given, and loops open
    items, here = [problem.given[i] for i in off], _here(problem, z)
    there = ", ".join(f"`{problem.given[i].name}` = {_shown(problem.given[i], here[i])}" for i in off[:4])
    joint = _opened(problem, off, z)
    beginning = (
        f"the start of {_names(items)} (line {items[0].line}) cannot hold together with those of {_names(along.given)}"
    )
    if joint is not None:
        beginning = (
            f"`{joint}` cannot be closed with the starts of {_names((*along.given, *items))} (line {items[0].line})"
        )
    return RunFailed(
        "BR740", f"{beginning}: the mechanism ties them to each other, and on the branch that is drawn {there} there;",
        "leave one of them out, or draw the mechanism on the other branch",
    )  # fmt: skip


def _opened(problem: PoseProblem, off: Sequence[int], z: Array) -> str | None:
    """Return the joint that opens most where coordinates of the tree take their start values; None if all are other coordinates."""
    places = [problem.given[i].state for i in off if problem.given[i].claim < 0]
    if not places or not problem.gaps:
        return None
    beside = np.array(z)
    beside[places] = [
        problem.given[i].value / problem.size[problem.given[i].state] for i in off if problem.given[i].claim < 0
    ]
    worst = int(np.argmax(np.abs(problem.values(beside)[: problem.gaps])))
    return problem.constraints.program.invariants.names[worst].rpartition(".")[0]


def _open(problem: PoseProblem, z: Array) -> RunFailed:
    """Return the error of joints that do not close."""
    constraints = problem.constraints
    gaps = problem.values(z)[: problem.gaps]
    worst = int(np.argmax(np.abs(gaps)))
    names = constraints.program.invariants
    joint = names.names[worst].rpartition(".")[0]
    left = abs(float(gaps[worst])) * (problem.length if constraints.lengths[worst] else 1.0)
    return RunFailed(
        "BR742", f"`{joint}` cannot be closed: {left:.3g} {names.units[worst]} are left open; the parts do not reach each other there",
    )  # fmt: skip


# ---------------------------------------------------------------- from a program
def pose_problem(space: StateSpace, constraints: Constraints, claims: Claims, at: tuple[float, Any], state: Array) -> PoseProblem:  # fmt: skip
    """Return the coordinates of all mechanisms and their start values.

    `at`: time and mode; `state`: with the start values of the text.
    """
    count, claimed = constraints.count, len(space.claims)
    drawn = np.array([s.drawn is not None for s in space.states], dtype=bool)
    drawn[constraints.positions] = True
    on_pose = [i for i, c in enumerate(space.claims) if c.on_pose]
    places = np.flatnonzero(drawn)
    begin, row = np.array(state[:count], dtype=float), claims(np.zeros(len(state)))
    begin[list(space.moved)] = -row[claimed : claimed + len(space.moved)]
    names, units = constraints.program.states.names, constraints.program.states.units
    given = [
        GivenCoordinates(names[p], space.states[p].span.line, units[p], state=i, value=float(state[p]))
        for i, p in enumerate(places)
        if space.states[p].given
    ]
    full = np.concatenate([begin, state[count:]])
    first = claims(full)
    for i in on_pose:
        claim, number = space.claims[i], claimed + len(space.moved) + i
        unit = space.variables[claim.variable].unit
        value = float(first[number] - first[i])
        given.append(GivenCoordinates(claim.element, claim.span.line, unit, claim=i, value=value, read=number))
    given.sort(key=lambda g: g.line)
    size, length = _sizes(constraints, (*at, full), places, given, claims)
    return PoseProblem(constraints, claims, *at, full, places, size, length, tuple(given))


def _sizes(
    constraints: Constraints, at: tuple[float, Any, Any], places: IntArray, given: Sequence[GivenCoordinates], claims: Claims
) -> tuple[Any, float]:  # fmt: skip
    """Return the unit of change of each coordinate (a radian for an angle, the mechanism's length for a length), and that length in m.

    The length of the mechanism is its longest lever arm.
    """
    time, mode, state = at
    turns = places[[constraints.program.states.units[p] == "1" for p in places]]
    lengths = [g for g in given if g.unit == "m"]
    arms = [constraints.length(time, state, mode)] if constraints else []
    claimed = [g.claim for g in lengths if g.claim >= 0]
    if claimed and len(turns):
        arms.append(float(np.abs(differences(claims, state, turns, 1.0)[:, claimed]).max()))
    longest = float(max(arms, default=0.0))
    if not longest > 0:
        there = claims(state)
        moves = [g.value - (there[g.read] if g.claim >= 0 else g.value) for g in lengths]
        longest = float(max([0.0, *(abs(float(m)) for m in moves)]))
    length = longest or 1.0
    return np.array([length if constraints.program.states.units[p] == "m" else 1.0 for p in places]), length
