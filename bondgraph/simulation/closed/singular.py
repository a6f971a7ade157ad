"""Singular poses: where closing joints lose rank on the way, and whether a branch goes on from there.

At each accepted step the smallest singular value of the gaps' slopes says how far the nearest loss of rank is. A real one is told from a
near miss (bars that are almost equal) by going there: at a singular point the slopes that vanish together belong to gaps that are
closed, to round-off, whatever the tolerance of the run; at a near miss a gap stays open.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import RunFailed
from ..loops.loops import LoopSolver
from .constraints import Assembled, Constraints
from .crossing import Crossed, OnConstraints, cross

LOOK = 16.0  # steps ahead, within which a singular pose is crossed in one go
NEAR = 0.3  # of the time to it: no usual step is longer
MISSES = 0.5  # of it: what a parabola leaves where a straight line would end
APART = 1e-8  # of its size: a gap of a redundant row
OPEN = 1e-10  # of its size: a gap that cannot be closed where slopes vanish
VANISHED = 1e-6  # of the largest: a singular value that is none
SEARCH = 12
DIFFERENCE = 1e-6
ASIDE = 0.1  # of the way of a crossing: how far beside it the singular point may lie
LARGEST = 400  # positions up to which singular values are computed at each step
SHOWN = 5  # names and times in a note
PLACES = 65  # of a crossing, at which it looks for the pose


@dataclass(frozen=True, slots=True)
class SingularPose:
    """A pose of loss of rank that was passed."""

    time: float
    lost: int  # constraints that say nothing there
    joints: tuple[str, ...]


class Watcher:
    """Looks at accepted steps. `constraints` in the magnitudes of the run."""

    def __init__(self, constraints: Constraints, loops: LoopSolver, passed: list[SingularPose]) -> None:
        self.constraints, self.loops, self.passed = constraints, loops, passed
        self.seen: list[
            tuple[float, float]
        ] = []  # instants of the last three steps, and smallest singular values there
        self.ahead = np.inf  # time to where it vanishes, if it goes on
        self.behind = np.inf
        self.comes = False  # whether it seems to vanish there, and not to turn before
        self.tried = np.inf  # time ahead at the last try to cross that failed

    def begin(self, time: float, state: Any, mode: Any) -> None:
        """At the start of a stretch, or after a crossing."""
        self.seen = [(time, self._least(time, state, mode))]
        self.ahead = self.behind = self.tried = np.inf
        self.comes = False

    def look(self, time: float, state: Any, mode: Any) -> None:
        """After a step."""
        self.seen = [*self.seen[-2:], (time, self._least(time, state, mode))]
        times, values = zip(*self.seen, strict=True)
        least = values[-1]
        slope = (least - values[-2]) / (time - times[-2])
        bend = 0.0
        if len(times) > 2:
            bend = 2 * (slope - (values[1] - values[0]) / (times[1] - times[0])) / (time - times[0])
            slope += 0.5 * bend * (time - times[1])
        self.ahead = least / -slope if slope < 0 else np.inf
        self.behind = least / slope if slope > 0 else np.inf
        self.comes = np.isfinite(self.ahead) and 0.5 * bend * self.ahead**2 < MISSES * least
        if not self.comes:
            self.tried = np.inf
        self._check_redundant(time, state, mode)

    def _check_redundant(self, time: float, state: Any, mode: Any) -> None:
        """What followed from other constraints at the start must go on to do so. Raises `RunFailed`."""
        constraints = self.constraints
        if not constraints.taking.all() and constraints.missed(time, state, mode) > APART:
            assert constraints.assembled is not None
            names = ", ".join(f"`{n}`" for n in constraints.assembled.redundant[:SHOWN])
            raise RunFailed(
                f"at t = {time:.9g} s {names}, which followed from the other constraints at the start, no longer "
                "do: the mechanism is drawn in a special pose; start it elsewhere, or leave a joint out"
            )

    @property
    def longest(self) -> float:
        """How long the next step may be."""
        return NEAR * min(self.ahead, self.behind)

    def _least(self, time: float, state: Any, mode: Any) -> float:
        slopes, _ = self._scaled(time, state, mode)
        if not len(slopes) or slopes.shape[1] > LARGEST:
            return np.inf
        values = np.linalg.svd(slopes, compute_uv=False)
        return float(values[-1] / values[0]) if values[0] > 0 and len(slopes) <= slopes.shape[1] else 0.0

    def _scaled(self, time: float, state: Any, mode: Any) -> tuple[Any, Any]:
        gaps, _ = self.constraints.slopes(time, state, mode)
        size = self.constraints.sizes(gaps)
        taking = self.constraints.taking
        return gaps[taking] / size[taking, None], size[taking]

    # ------------------------------------------------------------ crossing
    def crossing(
        self, time: float, state: Any, mode: Any, step: float, stop: float, tolerance: float
    ) -> Crossed | None:
        """A step over the pose ahead, if there is one within reach that can be crossed; None else."""
        size = 2 * self.ahead
        if not self.comes or not self.ahead < LOOK * step or time + size > stop or self.ahead > 0.5 * self.tried:
            return None
        self.tried = self.ahead
        constraints = self.constraints
        function = OnConstraints(constraints, self.loops, mode, state[constraints.count :])
        scaled = state[: constraints.count] / constraints.reach
        if not self._lies_ahead(function, time, scaled, state, mode):
            return None
        crossed = cross(function, time, scaled, size)
        if crossed is None or not crossed.error <= tolerance:
            return None
        pose = self._pose(crossed, state, mode)
        if pose is None:
            return None
        self.passed.append(pose)
        return crossed

    def _lies_ahead(self, function: OnConstraints, time: float, scaled: Any, state: Any, mode: Any) -> bool:
        """Whether a singular point is near where the motion would be by then: much cheaper than to go there."""
        constraints, count = self.constraints, self.constraints.count
        rates = function(time, scaled)
        share = 1e-4 * self.ahead
        bend = (function(time, scaled + share * rates) - rates) / share
        there = np.array(state)
        there[:count] = constraints.reach * (scaled + self.ahead * rates + 0.5 * self.ahead**2 * bend)
        found = self._point(time, there, mode)
        if found is None:
            return False
        positions, reach = constraints.positions, constraints.reach[constraints.positions]
        way = np.linalg.norm((there - state)[positions] / reach)
        return bool(np.linalg.norm((found[0] - there)[positions] / reach) < 0.5 * way)

    def _pose(self, crossed: Crossed, state: Any, mode: Any) -> SingularPose | None:
        """The singular pose on a crossing; None if there is none."""
        times = crossed.start + crossed.size * np.linspace(0, 1, PLACES)

        def full(time: float) -> Any:
            return np.concatenate([crossed.at(time)[0] * self.constraints.reach, state[self.constraints.count :]])

        def least(time: float) -> float:
            return self._least(time, full(time), mode)

        values = [least(t) for t in times]
        best = int(np.argmin(values))
        if best in (0, len(times) - 1):
            return None
        time = _lowest(least, times[best - 1], times[best + 1])
        found = self._point(time, full(time), mode)
        if found is None:
            return None
        point, lost, joints = found
        positions, reach = self.constraints.positions, self.constraints.reach
        way = np.linalg.norm((full(crossed.start) - full(crossed.start + crossed.size))[positions] / reach[positions])
        if np.linalg.norm((point - full(time))[positions] / reach[positions]) > ASIDE * way:
            return None
        return SingularPose(time, lost, joints)

    def _point(self, time: float, state: Any, mode: Any) -> tuple[Any, int, tuple[str, ...]] | None:
        """The singular point nearest to a state, by Gauss and Newton: gaps closed, slopes of those that are lost gone."""
        constraints = self.constraints
        positions = constraints.positions
        state = np.array(state)
        lost = 0
        for _ in range(SEARCH):
            slopes, size = self._scaled(time, state, mode)
            left, values, right = np.linalg.svd(slopes)
            if not lost:
                lost = int((values < 30 * values[-1] + VANISHED).sum())
            kept = len(values) - lost
            held, gone, still = left[:, :kept], left[:, kept:], right[kept:]
            gap = constraints.values(time, state, mode)[: constraints.gaps][constraints.taking] / size
            rest = np.concatenate([held.T @ gap, (gone.T @ slopes @ still.T).ravel()])
            if np.abs(rest).max() < 1e-13:
                break
            matrix = np.empty((len(rest), len(positions)))
            for j, place in enumerate(positions):
                moved = state.copy()
                moved[place] += DIFFERENCE * constraints.reach[place]
                bent = (self._scaled(time, moved, mode)[0] - slopes) / DIFFERENCE
                matrix[:, j] = np.concatenate([held.T @ slopes[:, j], (gone.T @ bent @ still.T).ravel()])
            step, *_ = np.linalg.lstsq(matrix, -rest, rcond=1e-6)
            state[positions] += constraints.reach[positions] * step
            if np.abs(step).max() < 1e-13:
                break
        slopes, size = self._scaled(time, state, mode)
        left, values, _ = np.linalg.svd(slopes)
        gap = constraints.values(time, state, mode)[: constraints.gaps][constraints.taking] / size
        if values[len(values) - lost] > VANISHED * values[0] or np.abs(gap).max() > OPEN:
            return None
        names = np.array(constraints.program.invariants.names[: constraints.gaps])[constraints.taking]
        share = np.abs(left[:, len(values) - lost :]).max(axis=1)
        joints = dict.fromkeys(n.rpartition(".")[0] for n in names[share > 0.1])
        return state, lost, tuple(joints)


def told_of(assembled: Assembled | None, poses: list[SingularPose]) -> tuple[str, ...]:
    """What a run says of its constraints: the redundant ones, and the singular poses that it passed."""
    told = []
    if assembled is not None and assembled.redundant:
        names = ", ".join(f"`{n}`" for n in assembled.redundant[:SHOWN]) + (
            "…" if len(assembled.redundant) > SHOWN else ""
        )
        count = len(assembled.redundant)
        told.append(
            f"{count} constraint{'s' * (count != 1)} of closing joints follow{'s' * (count == 1)} from the others and take{'s' * (count == 1)} "
            f"no part ({names}); mobility {assembled.mobility}"
        )
    if poses:
        times = ", ".join(f"{p.time:.6g} s" for p in poses[:SHOWN]) + (", …" if len(poses) > SHOWN else "")
        joints = list(dict.fromkeys(j for p in poses for j in p.joints))
        named = ", ".join(f"`{j}`" for j in joints[:SHOWN]) + ("…" if len(joints) > SHOWN else "")
        told.append(
            f"{len(poses)} singular pose{'s' * (len(poses) != 1)} passed on the branch that goes on with a continuous tangent, at t = {times}: "
            f"there {named} lose{'s' * (len(joints) == 1)} hold of up to {max(p.lost for p in poses)} motions"
        )
    return tuple(told)


def _lowest(function: Any, low: float, high: float) -> float:
    """Where a function has its least value, by golden section."""
    share = 0.5 * (5**0.5 - 1)
    a, b = high - share * (high - low), low + share * (high - low)
    fa, fb = function(a), function(b)
    for _ in range(40):
        if fa < fb:
            high, b, fb = b, a, fa
            a = high - share * (high - low)
            fa = function(a)
        else:
            low, a, fa = a, b, fb
            b = low + share * (high - low)
            fb = function(b)
    return 0.5 * (low + high)
