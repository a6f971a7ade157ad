"""Singular poses: detection of poses at which loop joints lose rank, and a test if the motion continues beyond them.

At each accepted step the smallest singular value of the residuals' Jacobian shows how far the nearest loss of rank is. A real one is
distinguished from a near miss (bars of almost equal length) by computing the singular point: there, the residuals whose derivatives vanish
together are closed to round-off, whatever the tolerance of the run; at a near miss a residual stays open.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from compiler.api import Array

from ...errors import RunFailed
from ...quantities import listed
from ...results.records import ToleranceDoubt
from ..integrators.projection.limits import APART, FINE, LOOK, NEVER, NOISE
from ..loops.loops import LoopSolver
from ..segments.trajectory import SingularPose
from .constraints import Assembled, Constraints
from .crossing import Crossed, OnConstraints, cross

OPEN = 1e-10  # relative size from which a residual counts as open where its derivatives vanish
VANISHED = 1e-6  # relative to the largest: a smaller singular value counts as zero
MOST_ROUNDED = 1e-7  # in magnitudes: a crossing with more rounding than that is not taken
ROUNDINGS = 10.0  # tolerances of rounding that a crossing may leave: what steps leave adds up to as much
SLIGHT = 3.0  # tolerances of rounding from which a run warns
FALLS = 0.5  # fraction of the rounding of a longer crossing: a shorter one with more than that gains nothing
SEARCH = 12
DIFFERENCE = 1e-6
ORDER = 1 / 6  # exponent of the step size as a function of its error, a lower bound
BETTER = 2.0  # ratio of smallest singular values from which other active rows are worth a restart
ASIDE = 0.1  # fraction of the way of a crossing: largest distance of the singular point from it
LARGEST = 400  # most positions for which singular values are computed at each step
SHOWN = 5  # names and times in a note
PLACES, NARROWINGS = 33, 5  # sample places of a crossing, and refinements, of the search for the pose
WAYS = 4  # number of directions along which derivatives must vanish


@dataclass(frozen=True, slots=True)
class SingularPoint:
    """A singular point near the motion."""

    state: Any
    lost: int
    joints: tuple[str, ...]


def look_ahead(relative: float) -> float:
    """Number of steps ahead of a singular pose at which it is crossed: as far, in time, at tight tolerances as at others."""
    return LOOK * float(max(1.0, (FINE / relative) ** 0.25))


class SingularPoseMonitor:
    """Monitor of accepted steps for singular poses. `constraints`: in the magnitudes of the run."""

    def __init__(self, constraints: Constraints, loops: LoopSolver, passed: list[SingularPose]) -> None:
        self.constraints, self.loops, self.passed = constraints, loops, passed
        self.ahead = np.inf  # extrapolated time until the singular value vanishes
        self.comes = False  # True if it seems to vanish there, without a minimum before
        self.point: SingularPoint | None = None  # the singular point found ahead
        self.tried = np.inf  # time ahead at the last failed try to cross
        self.left = np.inf  # rounding of the last tries

    def _opens(self, time: float, state: Array, mode: Array) -> bool:
        """Return True if a residual exceeds rounding of the mechanism's size: magnitudes of coordinates that hardly move are less than that."""
        constraints = self.constraints
        slopes, _ = constraints.slopes(time, state, mode)
        sizes = constraints.sizes(slopes / constraints.reach[constraints.positions])
        return bool((np.abs(constraints.values(time, state, mode)[: constraints.gaps]) > NOISE * sizes).any())

    def check_redundant(self, time: float, state: Array, mode: Array) -> None:
        """Raise `RunFailed` if a constraint that followed from the others at the start no longer does."""
        constraints = self.constraints
        if (
            not constraints.taking_gaps.all()
            and constraints.missed(time, state, mode) > APART
            and self._opens(time, state, mode)
        ):
            assert constraints.assembled is not None
            names = ", ".join(f"`{n}`" for n in constraints.assembled.redundant[:SHOWN])
            raise RunFailed(
                "BR743", f"at t = {time:.9g} s {names}, which followed from the other constraints at the start, no longer do: the mechanism is drawn in a "
                "special pose;", "start it elsewhere, or leave a joint out",
            )  # fmt: skip

    def other_rows(self, time: float, state: Array, mode: Array, step: float) -> bool:
        """Return True if the active rows are about to become dependent where other rows, so far redundant, do not."""
        constraints = self.constraints
        if constraints.taking_gaps.all() or not self.comes or not self.ahead < LOOK * step:
            return False
        from scipy.linalg import qr

        slopes, _ = constraints.slopes(time, state, mode)
        slopes = slopes / constraints.sizes(slopes)[:, None]
        count = int(constraints.taking_gaps.sum())
        order = qr(slopes.T, mode="economic", pivoting=True)[2][:count]
        kept, best = (np.linalg.svd(slopes[rows], compute_uv=False)[-1] for rows in (constraints.taking_gaps, order))
        return bool(best > BETTER * kept)

    def _least_all(self, times: Array, states: Array, mode: Array) -> Any:
        """Return the smallest singular values at several instants, rows in units of their sizes; shape (times,)."""
        rows, columns = int(self.constraints.taking_gaps.sum()), len(self.constraints.positions)
        if not rows or rows > columns:
            return np.full(len(times), np.inf if not rows else 0.0)
        if self.constraints.compiled is not None:
            return self.constraints.compiled.least_singular_values(times, states, mode)
        if columns > LARGEST:
            return np.full(len(times), np.inf)
        slopes = (self._scaled(t, x, mode)[0] for t, x in zip(times, states, strict=True))
        return np.array([np.linalg.svd(each, compute_uv=False)[-1] for each in slopes])

    def _scaled(self, time: float, state: Array, mode: Array) -> tuple[Any, Any]:
        gaps, _ = self.constraints.slopes(time, state, mode)
        size = self.constraints.sizes(gaps)
        taking = self.constraints.taking_gaps
        return gaps[taking] / size[taking, None], size[taking]

    # ------------------------------------------------------------ crossing
    def crossing(self, time: float, state: Array, mode: Array, step: float, stop: float, tolerance: float) -> Crossed | None:  # fmt: skip
        """Return a step over the singular pose ahead, if there is one within reach that can be crossed; None otherwise."""
        size = 2 * self.ahead
        near = self.ahead < look_ahead(tolerance) * step
        if not self.comes or not near or time + size > stop or self.ahead > 0.5 * self.tried:
            return None
        self.left = self.left if self.tried < NEVER else np.inf
        self.tried = self.ahead
        constraints = self.constraints
        function = OnConstraints(constraints, self.loops, mode, state[constraints.count :])
        scaled = state[: constraints.count] / constraints.reach
        ahead = self._point_ahead(function, time, scaled, state, mode)
        if ahead is None:
            return None
        crossed = cross(function, time, scaled, size, tolerance)
        if crossed is None:
            return None
        holds = crossed.error <= tolerance * (ROUNDINGS if crossed.rounded else 1.0)
        if not holds and crossed.rounded:
            if not (FALLS * self.left < crossed.error <= MOST_ROUNDED):
                self.left = min(self.left, crossed.error)
                return None
        elif not holds:
            self.tried *= min(1.0, 2 * (tolerance / crossed.error) ** ORDER)
            return None
        pose = self._pose(crossed, ahead, state, mode)
        if pose is None:
            return None
        self.passed.append(replace(pose, rounding=crossed.error) if crossed.error > SLIGHT * tolerance else pose)
        return crossed

    def _point_ahead(
        self, function: OnConstraints, time: float, scaled: Array, state: Array, mode: Array
    ) -> SingularPoint | None:
        """Return a singular point near the extrapolated motion, which costs much less than integrating to it; None if there is none."""
        constraints, count = self.constraints, self.constraints.count
        rates = function(time, scaled)
        share = 1e-4 * self.ahead
        bend = (function(time, scaled + share * rates) - rates) / share
        there = np.array(state)
        there[:count] = constraints.reach * (scaled + self.ahead * rates + 0.5 * self.ahead**2 * bend)
        near = 0.5 * self._apart(there, state)
        if self.point is None or self._apart(self.point.state, there) > near:
            self.point = self._point(time, there, mode)
        return None if self.point is None or self._apart(self.point.state, there) > near else self.point

    def _apart(self, one: Array, other: Array) -> float:
        """Return the distance of two positions, in units of the magnitudes."""
        positions = self.constraints.positions
        return float(np.linalg.norm((one - other)[positions] / self.constraints.reach[positions]))

    def _pose(self, crossed: Crossed, ahead: SingularPoint, state: Array, mode: Array) -> SingularPose | None:
        """Return the singular pose on a crossing; None if there is none. `ahead`: the singular point that was expected."""
        low, high = crossed.start, crossed.start + crossed.size
        for narrowing in range(NARROWINGS):
            times = np.linspace(low, high, PLACES)
            values = self._least_all(times, self._on(crossed, times, state), mode)
            best = int(np.argmin(values))
            if best in (0, len(times) - 1):
                if not narrowing:
                    return None
                break
            low, high = times[best - 1], times[best + 1]
        time = float(times[best])
        start, here, end = self._on(crossed, np.array([crossed.start, time, crossed.start + crossed.size]), state)
        near = ASIDE * self._apart(start, end)
        found: SingularPoint | None = ahead
        if self._apart(ahead.state, here) > near:
            found = self._point(time, here, mode)
        if found is None or self._apart(found.state, here) > near:
            return None
        return SingularPose(time, found.lost, found.joints)

    def _on(self, crossed: Crossed, times: Array, state: Array) -> Any:
        """Return full states on a crossing; shape (times, n)."""
        count = self.constraints.count
        unknowns = np.broadcast_to(state[count:], (len(times), len(state) - count))
        return np.concatenate([crossed.at(times) * self.constraints.reach, unknowns], axis=1)

    def _point(self, time: float, state: Array, mode: Array) -> SingularPoint | None:
        """Return the singular point nearest to a state, by Gauss-Newton: residuals closed, derivatives of the lost constraints zero.

        The derivatives are examined along a few of the directions that change only the lost residuals: the derivative of the Jacobian along a direction
        is, as second derivatives are symmetric, that of the directional derivative by all positions.
        """
        from scipy.linalg import lstsq

        constraints = self.constraints
        positions = constraints.positions
        state, lost, change = np.array(state), 0, np.inf
        for count in range(SEARCH):
            slopes, size = self._scaled(time, state, mode)
            squares, basis = np.linalg.eigh(slopes @ slopes.T)
            if not lost:
                values = np.sqrt(np.maximum(squares, 0.0))
                lost = int((values < 30 * values[0] + VANISHED).sum())
            gone, held = basis[:, :lost], basis[:, lost:]
            across, _ = np.linalg.qr(slopes.T @ held)
            ways = self._still(across)
            rest = [
                held.T @ (constraints.values(time, state, mode)[: constraints.gaps][constraints.taking_gaps] / size)
            ]
            rest += [gone.T @ (slopes @ way) for way in ways]
            if np.abs(np.concatenate(rest)).max() < 1e-13:
                break
            matrix = [held.T @ slopes]
            matrix += [gone.T @ self._bent(time, state, mode, way, size) for way in ways]
            step, *_ = lstsq(np.concatenate(matrix), -np.concatenate(rest), cond=1e-6, lapack_driver="gelsy")
            state[positions] += constraints.reach[positions] * step
            change, before = float(np.abs(step).max()), change
            if change < 1e-13 or (count and change > 0.5 * before):  # no more progress; the point reached is checked
                break
        slopes, size = self._scaled(time, state, mode)
        squares, basis = np.linalg.eigh(slopes @ slopes.T)
        gone = basis[:, :lost]
        gap = constraints.values(time, state, mode)[: constraints.gaps][constraints.taking_gaps] / size
        if np.linalg.norm(gone.T @ slopes) > VANISHED * np.sqrt(squares[-1]) or np.abs(gap).max() > OPEN:
            return None
        names = np.array(constraints.program.invariants.names[: constraints.gaps])[constraints.taking_gaps]
        share = np.abs(gone).max(axis=1)
        joints = dict.fromkeys(n.rpartition(".")[0] for n in names[share > 0.1])
        return SingularPoint(state, lost, tuple(joints))

    @staticmethod
    def _still(across: Array) -> Any:
        """Return a few unit directions (rows) that all but the lost residuals allow, as mixtures of all such directions."""
        count, taken = across.shape
        many = min(count - taken, WAYS)
        ways = np.random.default_rng(1).normal(size=(many, count))
        ways -= (ways @ across) @ across.T
        return ways / np.linalg.norm(ways, axis=1, keepdims=True)

    def _bent(self, time: float, state: Array, mode: Array, way: Array, size: Array) -> Any:
        """Return the derivative of the Jacobian along a direction, by central differences; rows in units of their sizes."""
        constraints = self.constraints
        shift = np.zeros(len(state))
        shift[constraints.positions] = DIFFERENCE * constraints.reach[constraints.positions] * way
        beyond, before = (constraints.slopes(time, state + sign * shift, mode)[0] for sign in (1, -1))
        return (beyond - before)[constraints.taking_gaps] / (2 * DIFFERENCE * size[:, None])


def doubts_of(poses: list[SingularPose]) -> tuple[ToleranceDoubt, ...]:
    """Return a warning where rounding at singular poses is more than the tolerance covers."""
    worst = max((pose for pose in poses if pose.rounding), key=lambda pose: pose.rounding, default=None)
    if worst is None:
        return ()
    text = (
        f"rounding keeps the tolerance from being held at a singular pose, t = {worst.time:.6g} s: differences of {worst.rounding:.1g} of the magnitudes "
        f"are left there, so rtol = {worst.rounding:.1g} is the tightest that means what it says"
    )
    return (ToleranceDoubt(worst.time, "", "tolerance at a singular pose", text, (), ""),)


def told_of(assembled: Assembled | None, poses: list[SingularPose]) -> tuple[str, ...]:
    """Return notes of a run on its constraints: the redundant ones, and the singular poses that it passed."""
    notes = []
    if assembled is not None and assembled.redundant:
        names = listed(assembled.redundant, SHOWN)
        count = len(assembled.redundant)
        notes.append(
            f"{count} constraint{'s' * (count != 1)} of closing joints follow{'s' * (count == 1)} from the others and take{'s' * (count == 1)} "
            f"no part ({names}); mobility {assembled.mobility}. Nothing determines which force would act along {'it' if count == 1 else 'each'}: a `reaction` "
            "reads 0 there, and the whole force at the joints that hold the same"
        )
    if poses:
        times = ", ".join(f"{p.time:.6g} s" for p in poses[:SHOWN]) + (", …" if len(poses) > SHOWN else "")
        joints = list(dict.fromkeys(j for p in poses for j in p.joints))
        named = listed(joints, SHOWN)
        notes.append(
            f"{len(poses)} singular pose{'s' * (len(poses) != 1)} passed on the branch that goes on with a continuous tangent, at t = {times}: "
            f"there {named} lose{'s' * (len(joints) == 1)} hold of up to {max(p.lost for p in poses)} motions"
        )
    return tuple(notes)
