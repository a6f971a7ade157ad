"""Factors of an earlier step of the coarse run, as long as they serve: those of a large model cost more than all else in a step."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from ..steps.factorise import is_large

if TYPE_CHECKING:
    from ...door import Program
    from ..steps.radau import Factorised

KEPT_ITERATIONS = 8  # with factors of an earlier step
FAR = 2.1  # times as long or short may that step have been: the half steps that look whether a whole one overshoots are among them
SHRINKS = 0.4  # by how much one change is smaller than the one before, if these factors serve

Share = Callable[
    [Any, Any, Any], float
]  # of a state that changes, how large the change is, with what it gains from others


def keeps_factors(program: Program) -> bool:
    """Whether the coarse run of a program keeps factors: one with many states and nothing else."""
    return not program.unknowns.names and is_large(len(program.states.names), len(program.pattern[0]))


class KeptFactors:
    """The last factors, the scale that their matrix has, and the step for which they stand."""

    def __init__(self) -> None:
        self.size = 0.0  # none
        self.count = 0  # how often there were new ones
        self.factors: Factorised | None = None
        self.scale: Any = None
        self.gain: Any = None

    def keep(self, size: float, factors: Factorised, scale: Any, entries: Any) -> None:
        """These are the last ones; `entries` are those of the Jacobian."""
        self.size, self.factors, self.scale, self.gain = size, factors, scale, np.abs(entries)
        self.count += 1

    def step(self, begin: Any, size: float, rates: Callable[[Any], Any], share: Share, close: float) -> Any:
        """The state at the end of a step, if these factors still bring it fast to where it should be; else None. One change alone,
        however small, does not tell that.

        Factors of a step g times as long bring what does not move by itself g times as far, what is fast as far as it should be:
        between the two each change is taken 2/(1 + g) times (as with BDF, Petzold 1983), so that both are missed by the same share.
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
