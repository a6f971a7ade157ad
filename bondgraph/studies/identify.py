"""Identifiability: uncertainty of fitted parameters, undetermined directions, and small sets of parameters that would fit the data alone.

It is based on the derivatives J of the residuals by relative changes of the parameters: J'J is Fisher's information, its eigenvectors are the
directions, 1/sqrt(eigenvalue) is the standard deviation along them (Cramer and Rao).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array

from ..errors import RunFailed

if TYPE_CHECKING:
    from .fit_problem import Problem


CONFIDENCE = 0.95
OPEN = 1e-9  # relative to the largest singular value: directions below are undetermined
TOUCHED = 1e-6  # component of an undetermined direction from which on a parameter is affected
UNLIKELY = 1e-3  # probability of the scatter below which the sigmas are too small
LARGEST_SET = 3  # most parameters of a set
MOST_TRIPLES = 40  # most parameters of which sets of three are examined
TRIED = 4  # sets of each size that are fitted
PLAUSIBLE = 0.02  # weight: a parameter change by half costs as much as a relative residual of 1 %
FEW_STEPS = 30
Solve = Callable[["Problem", Sequence[int], int], "SearchEnd"]


@dataclass(frozen=True, eq=False)
class SearchEnd:
    """End of a search: coordinates (k,), residuals (n,) over sigma, their derivatives (n, k), True if converged, mask of parameters at bounds."""

    coordinates: Array
    residuals: Array
    slopes: Array
    ended: bool
    held: Any
    open: bool = False  # True if other values fit the data equally well

    @property
    def squares(self) -> float:
        """Sum of the squared residuals."""
        return float(self.residuals @ self.residuals)

    @property
    def count(self) -> int:
        """Number of data."""
        return len(self.residuals)


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Standard errors and interval ends (k,) in SI, infinite where a parameter is undetermined; correlations (k, k)."""

    errors: Array
    low: Array
    high: Array
    correlations: Array
    scatter: float  # sum of squares over degrees of freedom; NaN without any
    notes: tuple[str, ...]

    def of(self, i: int) -> tuple[float, float, float]:
        """Return standard error, low and high end of one parameter."""
        return float(self.errors[i]), float(self.low[i]), float(self.high[i])


@dataclass(frozen=True)
class Direction:
    """A unit vector of relative changes, and its standard deviation; `open` if the data do not determine it."""

    deviation: float
    weights: dict[str, float]  # the largest first
    open: bool


@dataclass(frozen=True)
class Explanation:
    """A small set of parameters fitted alone: relative changes, and the remaining root mean square of relative differences."""

    values: dict[str, float]
    changes: dict[str, float]
    squares: float
    left: float


def uncertainty(problem: Problem, found: SearchEnd) -> Uncertainty:
    """Return the uncertainty from the covariance at the end of a search."""
    from scipy import stats

    _, sizes, right = _decomposed(found.slopes)
    sure = sizes > OPEN * sizes.max(initial=0.0)
    rank = int(sure.sum())
    freedom, k = found.count - rank, len(sizes)
    scatter = found.squares / freedom if freedom > 0 else math.nan
    factor, quantile, notes = 1.0, float(stats.norm.ppf((1 + CONFIDENCE) / 2)), []
    if not problem.weighted or (freedom > 0 and stats.chi2.sf(found.squares, freedom) < UNLIKELY):
        factor = scatter if freedom > 0 else math.inf
        quantile = float(stats.t.ppf((1 + CONFIDENCE) / 2, freedom)) if freedom > 0 else math.inf
        if freedom <= 0:
            notes.append("as many parameters as data, and no sigmas: nothing says how sure the values are")
        elif problem.weighted:
            notes.append(
                f"the data lie {math.sqrt(scatter):.3g} times as far from the model as their sigmas say: intervals are widened by that; "
                "something is missing in the model, or the sigmas are too small"
            )
    scaled = right[sure] / sizes[sure, None]
    covariance = scaled.T @ scaled
    errors = np.sqrt(np.diag(covariance) * factor)
    touched = (np.abs(right[~sure]) > TOUCHED).any(axis=0) if rank < k else np.zeros(k, dtype=bool)
    errors = np.where(touched, np.inf, errors)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        ends = [problem.values(found.coordinates + sign * quantile * errors) for sign in (-1, 1)]
        spread = np.sqrt(np.diag(covariance))
        correlations = covariance / np.outer(spread, spread)
        in_si = errors * problem.stretch(found.coordinates)
    return Uncertainty(in_si, ends[0], ends[1], correlations, scatter, tuple(notes))


def _decomposed(slopes: Array) -> tuple[Array, Array, Array]:
    """Return singular values and right vectors, all k of them, the strongest first."""
    u, sizes, right = np.linalg.svd(slopes, full_matrices=True)
    k = slopes.shape[1]
    return u, np.concatenate([sizes, np.zeros(k - len(sizes))]), right


def directions(problem: Problem, found: SearchEnd) -> tuple[Direction, ...]:
    """Return the directions, the weakest first."""
    _, sizes, right = _decomposed(found.slopes)
    freedom = found.count - int((sizes > OPEN * sizes.max(initial=0.0)).sum())
    noise = 1.0 if problem.weighted else math.sqrt(found.squares / freedom) if freedom > 0 else math.nan
    told = []
    for size, way in zip(sizes[::-1], right[::-1], strict=True):
        is_open = not size > OPEN * sizes[0]
        order = [i for i in np.argsort(-np.abs(way), kind="stable") if abs(way[i]) > TOUCHED]
        sign = math.copysign(1.0, way[order[0]])
        weights = {problem.names[i]: float(sign * way[i]) for i in order}
        told.append(Direction(math.inf if is_open else float(noise / size), weights, is_open))
    return tuple(told)


def explanations(problem: Problem, solve: Solve) -> tuple[Explanation, ...]:
    """Return the differences without any change, then the best sets of one, two and three parameters, selected by derivatives at the start and fitted.

    Sets are ranked by the remaining relative differences, and by the size of the changes (`PLAUSIBLE`): of two sets with equal fit, the one with smaller
    changes is more likely.
    """
    start = problem.coordinates(problem.start)
    weights = _relative(problem)
    residuals, slopes = problem.residuals(start) * weights, problem.slopes(start) * weights[:, None]
    told = [Explanation({}, {}, float(problem.residuals(start) @ problem.residuals(start)), _mean(residuals))]
    for size in range(1, min(LARGEST_SET, len(residuals), len(start)) + 1):
        if size == LARGEST_SET and len(start) > MOST_TRIPLES:
            break
        ranked = sorted(combinations(range(len(start)), size), key=lambda s: _promise(residuals, slopes, s))
        made = [_explanation(problem, solve, chosen, weights) for chosen in ranked[:TRIED]]
        told += sorted((e for e in made if e is not None), key=lambda e: _cost(e.left, list(e.changes.values())))
    return tuple(told)


def _relative(problem: Problem) -> Array:
    """Return factors from residuals over sigma to differences relative to the measured values (or to the largest of its kind, where that is zero)."""
    parts = []
    for one in problem.series:
        size = np.abs(one.measured)
        parts.append(one.sigma / np.where(size > 0, size, size.max() or 1.0))
    return np.concatenate(parts)


def _mean(residuals: Array) -> float:
    return float(np.sqrt(np.mean(residuals**2)))


def _cost(left: float, changes: Sequence[float]) -> float:
    return math.hypot(left, PLAUSIBLE * float(np.linalg.norm(changes)))


def _promise(residuals: Array, slopes: Array, chosen: Sequence[int]) -> float:
    """Return the cost for a linear model."""
    columns = slopes[:, list(chosen)]
    pull = PLAUSIBLE * math.sqrt(len(residuals)) * np.eye(len(chosen))
    wanted = np.concatenate([-residuals, np.zeros(len(chosen))])
    step, *_ = np.linalg.lstsq(np.concatenate([columns, pull]), wanted, rcond=None)
    return _cost(_mean(residuals + columns @ step), step)


def _explanation(problem: Problem, solve: Solve, chosen: Sequence[int], weights: Array) -> Explanation | None:
    try:
        found = solve(problem, chosen, FEW_STEPS)
    except (RunFailed, ValueError, np.linalg.LinAlgError):
        return None
    values = problem.values(found.coordinates)
    changes = {
        problem.names[i]: float(values[i] / problem.start[i] - 1) if problem.start[i] else math.inf for i in chosen
    }
    told = {problem.names[i]: float(values[i]) for i in chosen}
    return Explanation(told, changes, found.squares, _mean(found.residuals * weights))
