"""What a relative tolerance asks of a step: of the estimate of its error, and of the iteration that solves it."""

from __future__ import annotations

from math import pow, sqrt

import numpy as np

INFINITE = float("inf")
EPSILON = float(np.finfo(float).eps)
ASIDE = 1e-9  # of itself is a state moved to see how rates round: what they bend within that is less than rounding
STAGNANT, MOST_STAGNANT = 10.0, 0.3  # times what rounds, and of the tolerance: changes up to both are rounding
AMPLIFIED = 1e6  # times its own rounding is the most that others may leave of a state
FIRST = 1e-2  # of what other iterations may leave: one that begins without a guess tells too little of how it converges
LOOSE = 1e-6  # a relative tolerance above which the estimate is held to less than it


def allowed_estimate(relative: float) -> float:
    """How many times a tolerance the estimate may be.

    Steps go as the fourth root of the estimate and the error as their fifth power: for an error that follows the tolerance, tolerance^(4/5) is asked of
    the estimate where that is less (Hairer and Wanner, section IV.8, take the power 2/3 throughout)."""
    return 1.0 if relative <= LOOSE else float((relative / LOOSE) ** -0.2)


def newton_tolerance(relative: float, share: float = 1.0) -> float:
    """What an iteration may leave, in parts of a tolerance; or a share of that."""
    return float(max(10 * EPSILON / relative, share * min(0.03, relative**0.5)))


def creeping_tolerance(relative: float) -> float:
    """The same of a single number of the stages: more, as one alone shows what rounding leaves."""
    return max(newton_tolerance(relative), float(100 * EPSILON / relative))


def stagnation_tolerance(relative: float) -> float:
    """The largest change, in parts of a tolerance, of an iteration that gets no better for which rounding is looked at as its reason."""
    return float(min(MOST_STAGNANT, AMPLIFIED * EPSILON / relative))


def first_length(slope: float, curvature: float, order: float) -> float:
    """How long a step may be whose error goes as its power 1/`order`, from the norms of the first two derivatives in units of the tolerance: where each
    further derivative is as many times the one before, d1 (d2/d1)^(1/order - 1) h^(1/order) is a hundredth of it. Nothing in it is absolute in time."""
    if curvature == 0.0:
        return INFINITE
    by_curve = sqrt(0.01 / curvature)
    return by_curve if slope == 0.0 else max(by_curve, pow(0.01 / slope, order) * pow(slope / curvature, 1.0 - order))
