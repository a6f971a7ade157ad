"""What a relative tolerance asks of a step: of the estimate of its error, and of the iteration that solves it."""

from __future__ import annotations

import numpy as np

EPSILON = float(np.finfo(float).eps)
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
