"""Which of two storages that depend on each other is the state, chosen anew where the first choice has become a bad one.

A storage in derivative form is computed from the states: x_d = g(x). Where a modulated transformer makes the slope of g large, what is
below the tolerance of the state is a large error of the dependent one; where the slope grows without bound the state forgets what the
other still knows. So each accepted step looks at these slopes, in units of what both have been at most; beyond `WORST` the two change places: the
model is compiled with the other stroke, which is as legal as the first, and the run goes on from the same values. (Dummy derivatives
are pivoted for the same reason: Mattsson and Söderlind, SIAM J. Sci. Comput. 14, 1993, section 4.)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ...door import Program

if TYPE_CHECKING:
    from ...ended import Past

WORST = 1e3  # change of a dependent storage, as a share of its peak, for that of a state as a share of its own


@dataclass(frozen=True, slots=True)
class Handover:
    """Where a run stops so that another program can go on: the instant, all that is stored, and why.

    Either two storages change places, or other junctions are off, or the run ended there and is to go on.
    """

    time: float
    stored: Mapping[str, float]  # by name: states and dependent storages
    peaks: Mapping[str, float]  # the largest that they have been
    dependent: str = ""  # the element that was in derivative form
    state: str = ""  # the element that was a state
    off: tuple[str, ...] | None = None  # the junctions that are off from now on; None: as before
    modes: Mapping[str, float] = field(default_factory=dict)  # by name: what only events change
    on: Mapping[tuple[str, int], bool] = field(default_factory=dict)  # which events' conditions hold
    past: Past | None = None  # of delayed signals
    magnitudes: Mapping[str, float] = field(default_factory=dict)  # of states and unknowns
    unknowns: Mapping[str, float] = field(default_factory=dict)  # of loops


class Choice:
    """Looks at accepted steps. `storages`: the elements that can change places; `before`: where the last leg stopped."""

    def __init__(
        self, program: Program, constants: Any, inputs: Any, storages: frozenset[str], before: Handover | None
    ) -> None:  # fmt: skip
        self.program, self.fixed = program, (inputs, constants)
        rows, columns = program.sensitivity_pattern
        self.chosen = np.array([self._element(c) in storages for c in columns], dtype=bool)
        self.rows, self.columns = rows[self.chosen], columns[self.chosen]
        self.names = (*program.states.names, *program.dependents.names)
        self.peak = np.zeros(len(self.names))
        if before is not None:
            self.peak[:] = [before.peaks.get(n, 0.0) for n in self.names]

    def _element(self, state: int) -> str:
        """The one that a state belongs to."""
        return self.program.states.names[state].rpartition(".")[0]

    def __bool__(self) -> bool:
        """Whether there is anything to look at."""
        return len(self.rows) > 0

    def look(self, time: float, state: Any, mode: Any) -> Handover | None:
        """Who should change places after a step that ended here."""
        if not len(self.rows):
            return None
        count = len(self.program.states.names)
        values, peaks = self.stored(time, state, mode)
        slopes = np.abs(self.program.sensitivities(time, state, *self.fixed, mode))[self.chosen]
        scale = self.peak[count + self.rows]
        gain = slopes * self.peak[self.columns] / np.where(scale > 0, scale, np.inf)
        worst = int(np.argmax(gain))
        if not gain[worst] > WORST:
            return None
        dependent = self.program.dependents.names[self.rows[worst]].rpartition(".")[0]
        return Handover(time, values, peaks, dependent, self._element(self.columns[worst]))

    def stored(self, time: float, state: Any, mode: Any) -> tuple[dict[str, float], dict[str, float]]:
        """All that is stored, states and dependent storages, and the largest that they have been; by name."""
        count = len(self.program.states.names)
        stored = np.concatenate([state[:count], self.program.dependent(time, state, *self.fixed, mode)])
        self.peak = np.maximum(self.peak, np.abs(stored))
        values, peaks = (dict(zip(self.names, x.tolist(), strict=True)) for x in (stored, self.peak))
        return values, peaks
