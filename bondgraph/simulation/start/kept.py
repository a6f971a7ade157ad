"""Factorization reuse in the pilot run: factors of an earlier step, as long as they converge; those of a large model dominate the cost of a step."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from ..steps.factorise import is_large

if TYPE_CHECKING:
    from compiler.api import Program

    from ..steps.factorise import Factorised

KEPT_ITERATIONS = 8  # iterations with factors of an earlier step
FAR = 2.1  # largest ratio of step sizes; it includes the half steps that check a whole one for overshoot
SHRINKS = 0.4  # largest ratio of successive changes with which these factors are used

Share = Callable[[Any, Any, Any], float]  # size of a change of a state, with the gain from other states


def keeps_factors(program: Program) -> bool:
    """Return True if the pilot run of a program reuses factors: one with many states and no loop unknowns."""
    return not program.unknowns.names and is_large(len(program.states.names), len(program.pattern[0]))


class KeptFactors:
    """Last factors, the scale of their matrix, and the step size that they belong to."""

    def __init__(self) -> None:
        self.size = 0.0  # no factors yet
        self.count = 0  # number of factorizations
        self.factors: Factorised | None = None
        self.scale: Any = None
        self.gain: Any = None

    def keep(self, size: float, factors: Factorised, scale: Any, entries: Any) -> None:
        """Store factors as the last ones; `entries`: those of the Jacobian."""
        self.size, self.factors, self.scale, self.gain = size, factors, scale, np.abs(entries)
        self.count += 1

    def step(self, begin: Any, size: float, rates: Callable[[Any], Any], share: Share, close: float) -> Any:
        """Return the state at the end of a step, if these factors converge fast; else None. A single change, however small, does not show that.

        With factors of a step g times as long, slow components move g times too far and stiff ones as far as they should: each change is multiplied by
        2/(1 + g) (as with BDF, Petzold 1983), so that both are missed by the same fraction.
        """
        if self.factors is None or not size <= FAR * self.size <= FAR * FAR * size:
            return None
        relaxed, before, x = 2.0 / (1.0 + self.size / size), np.inf, np.array(begin)
        for turn in range(KEPT_ITERATIONS):
            slope = rates(x)
            if not np.isfinite(slope).all():
                return None
            change = self.factors.solve((slope - (x - begin) / size) / self.scale) * (relaxed * self.scale)
            norm = share(x, change, size * self.gain)
            if not np.isfinite(norm) or (turn > 0 and norm > SHRINKS * before):
                return None
            x = x + change
            if norm == 0.0 or (turn > 0 and norm <= close):
                return x
            before = norm
        return None
