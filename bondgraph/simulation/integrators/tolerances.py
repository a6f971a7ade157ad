"""Limits that a relative tolerance sets for a step: on the estimate of its error, and on the iteration that solves it."""

from __future__ import annotations

from math import pow, sqrt

import numpy as np

INFINITE = float("inf")
EPSILON = float(np.finfo(float).eps)
ASIDE = 1e-9  # relative change of a state that shows the rounding of rates: their curvature within it is less
STAGNANT, MOST_STAGNANT = 10.0, 0.3  # in units of rounding, and of the tolerance: changes below both are rounding
AMPLIFIED = 1e6  # in units of its own rounding: largest error of a state by rounding of others
FIRST = 1e-2  # factor on the limit of an iteration that begins without a guess, whose convergence is less known
FINEST = 5e-12  # relative tolerance below which an estimate may be nothing but rounding
RINGING = 100.0  # ratio to the rounding of one step: undamped modes ring with what earlier steps have rounded
LOOSE = 1e-6  # relative tolerance above which the estimate must be smaller than the tolerance


def allowed_estimate(relative: float) -> float:
    """Return the largest error estimate, in units of the tolerance.

    Step sizes are proportional to the fourth root of the estimate and the error to their fifth power: for an error proportional to the tolerance, the
    estimate must be tolerance^(4/5) where that is less (Hairer and Wanner, section IV.8, use the power 2/3 throughout).
    """
    return 1.0 if relative <= LOOSE else pow(relative / LOOSE, -0.2)


def newton_tolerance(relative: float, share: float) -> float:
    """Return the remaining error of an iteration, in units of a tolerance; `share`: factor on it."""
    return max(10.0 * EPSILON / relative, share * min(0.03, sqrt(relative)))


def creeping_tolerance(relative: float) -> float:
    """Return the same for a single component of the stages: larger, because one component alone shows rounding."""
    return max(newton_tolerance(relative, 1.0), 100.0 * EPSILON / relative)


def stagnation_tolerance(relative: float) -> float:
    """Return the largest change, in units of a tolerance, of a stagnating iteration for which rounding is considered as the reason."""
    amplified = AMPLIFIED * EPSILON / relative
    return amplified if relative < FINEST else min(MOST_STAGNANT, amplified)


def first_length(slope: float, curvature: float, order: float) -> float:
    """Return the size of a step whose error is proportional to its power 1/`order`, from the norms of two derivatives in units of the tolerance.

    If each further derivative is the same multiple of the one before, d1 (d2/d1)^(1/order - 1) h^(1/order) is a hundredth of it. The result scales with
    the unit of time.
    """
    if curvature == 0.0:
        return INFINITE
    by_curve = sqrt(0.01 / curvature)
    return by_curve if slope == 0.0 else max(by_curve, pow(0.01 / slope, order) * pow(slope / curvature, 1.0 - order))
