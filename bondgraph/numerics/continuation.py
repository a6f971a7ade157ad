"""Continuation: solutions of rows(z) = path(s), followed from s = 0 to s = 1 without a change of branch.

Predictor along the tangent, corrector by Newton's method with the shortest step (E. L. Allgower, K. Georg, Introduction to Numerical Continuation
Methods, 2003, chapters 2 and 8). A step is halved until the corrector is small relative to the predictor, the tangent turns little, and the
determinant of the derivatives, bordered by the free directions, keeps its sign and most of its size. Two branches that come near each other or cross
differ in that sign, so a step from one to the other is never taken; a fold or a crossing is approached and ends the path.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from compiler.api import Array, IntArray

LONGEST = 0.1  # step, in units of the variables
FIRST = 1e-3
BEND = 0.1  # largest ratio of corrector to predictor
TURN = 0.3  # largest relative change of the tangent
SHRINK = 0.5  # least ratio of the smallest singular values over a step
NEWTON, HALVING = 8, 60  # iterations; at a fold each halves the distance
CONVERGED = 1e-11  # size of the last corrector step
STALLED = 1e-12  # least step, as a fraction of the path
STEPS = 100_000
RANK = 1e-7  # relative to the largest singular value, for derivatives by differences
SINGULAR = 1e-6  # relative to the smallest singular value at the start of the path
FOLD = 30.0  # growth of the tangent that shows a fold
LAST = 1e-7  # fraction of the path: a fold this near to the end counts as reached
AT_FOLD = 1e-7  # size of the last corrector step there


class Rows(Protocol):
    """Equations of a pose: values, shape (m,), and derivatives, shape (m, n), at z, shape (n,)."""

    def values(self, z: Array) -> Array: ...

    def slopes(self, z: Array) -> Array: ...


@dataclass(frozen=True, slots=True)
class SolutionPath:
    """Values of all rows at a share of the path, and their derivatives by the share."""

    at: Callable[[float], Array]
    slope: Callable[[float], Array]


@dataclass(frozen=True, slots=True)
class Followed:
    """End of a path: z, the share reached, and, below 1, True in `fold` if the path turns back there (otherwise branches meet)."""

    z: Array
    share: float
    fold: bool = False

    @property
    def arrived(self) -> bool:
        """True if the whole path was followed."""
        return self.share == 1.0


@dataclass(frozen=True, slots=True)
class TangentFrame:
    """Derivatives at a point of the path, the independent rows among them, the free directions, and the tangent."""

    slopes: Array
    rows: IntArray
    free: Array
    tangent: Array

    def bordered(self, slopes: Array) -> tuple[float, float]:
        """Return the sign of the determinant and the smallest singular value of derivatives bordered by the free directions of this point."""
        matrix = np.concatenate([slopes[self.rows], self.free])
        values = np.linalg.svd(matrix, compute_uv=False)
        return float(np.linalg.slogdet(matrix)[0]), float(values.min(initial=np.inf))


def follow(rows: Rows, z: Array, path: SolutionPath) -> Followed:
    """Return the solution at s = 1 that continues z, which solves the rows at s = 0; or the point at which the path ends before."""
    share, size = 0.0, FIRST
    z = polished(rows, z, path.at(0.0))
    here = _frame(rows, z, path.slope(0.0))
    _, weight = here.bordered(here.slopes)
    least, pace = SINGULAR * min(weight, 1.0), float(np.abs(here.tangent).max(initial=0.0))
    for _ in range(STEPS):
        size = min(size, 1.0 - share, LONGEST / max(float(np.abs(here.tangent).max(initial=0.0)), 1e-300))
        found = _step(rows, z, path, share, size, here)
        if found is None:
            size /= 2
            if size > STALLED:
                continue
            break
        z, here, bend = found
        share = 1.0 if share + size >= 1.0 else share + size
        if share == 1.0:
            return Followed(polished(rows, z, path.at(1.0)), 1.0)
        _, weight = here.bordered(here.slopes)
        if weight < least:
            break
        size *= 2.0 if bend < BEND / 4 else 1.0
    grown = float(np.abs(here.tangent).max(initial=0.0)) > FOLD * max(pace, 1e-300)
    if 1.0 - share < LAST and grown:
        end, moves = newton(rows, z, path.at(1.0), HALVING)
        if moves[-1] < AT_FOLD:
            return Followed(end, 1.0)
    return Followed(z, share, grown)


def newton(rows: Rows, z: Array, wanted: Array, most: int = NEWTON, close: float = CONVERGED) -> tuple[Array, list[float]]:  # fmt: skip
    """Return the solution of rows(z) = wanted by minimum-norm steps, and the sizes of these; the last one exceeds `close` if it fails."""
    moves: list[float] = []
    for _ in range(most):
        step = shortest(rows.slopes(z), wanted - rows.values(z))
        move = float(np.abs(step).max(initial=0.0))
        if not np.isfinite(move) or (len(moves) > 1 and move > moves[-1]):
            break
        z, moves = z + step, [*moves, move]
        if move <= close:
            break
    return z, moves


def polished(rows: Rows, z: Array, wanted: Array) -> Array:
    """Return the solution to rounding, from a close one."""
    return newton(rows, z, wanted, close=0.0)[0]


def shortest(slopes: Array, miss: Array) -> Array:
    """Return the minimum-norm step that cancels a residual."""
    return np.asarray(np.linalg.lstsq(slopes, miss, rcond=RANK)[0])


def _step(
    rows: Rows, z: Array, path: SolutionPath, share: float, size: float, here: TangentFrame
) -> tuple[Array, TangentFrame, float] | None:
    """Return the next point of the path, its frame, and the measure of its bend; None if the step is too long."""
    ahead = 1.0 if share + size >= 1.0 else share + size
    predicted = z + size * here.tangent
    moved = float(np.abs(size * here.tangent).max(initial=0.0))
    found, moves = newton(rows, predicted, path.at(ahead))
    if not moves or moves[-1] > CONVERGED or moves[0] > max(BEND * moved, CONVERGED):
        return None
    there = _frame(rows, found, path.slope(ahead), here)
    sign, weight = here.bordered(here.slopes)
    new_sign, new_weight = here.bordered(there.slopes)
    if new_sign != sign or new_weight < SHRINK * weight:
        return None
    turned = float(np.abs(there.tangent - here.tangent).max(initial=0.0))
    if turned > TURN * float(np.abs(here.tangent).max(initial=0.0)) + CONVERGED and ahead < 1.0:
        return None
    return found, there, moves[0] / moved if moved > 0 else 0.0


def _frame(rows: Rows, z: Array, pull: Array, before: TangentFrame | None = None) -> TangentFrame:
    """Return the frame at a point of the path; `pull`: the derivatives of the rows along the path."""
    slopes = rows.slopes(z)
    independent, free = split(slopes, 0 if before is None else len(before.rows))
    return TangentFrame(slopes, independent, free, shortest(slopes, pull))


def split(slopes: Array, least: int = 0, small: float = RANK) -> tuple[IntArray, Array]:
    """Return the independent rows of a Jacobian, shape (m, n), at least `least` of them, and an orthonormal basis (rows) of its null space."""
    from scipy.linalg import qr

    if not len(slopes):
        return np.zeros(0, dtype=int), np.eye(slopes.shape[1])
    q, triangle, order = qr(slopes.T, mode="full", pivoting=True)
    pivots = np.abs(np.diag(triangle))
    rank = max(int((pivots > small * pivots[0]).sum()), least)
    return order[:rank], q[:, rank:].T
