"""State selection: exchange of two dependent storages as state, where the first choice has become ill-conditioned.

A storage in derivative form is computed from the states: x_d = g(x). Where a modulated transformer makes the derivative of g large, an error
below the tolerance of the state is a large error of the dependent one; where the derivative grows without bound, the state loses information
that the other still has. So each accepted step examines these derivatives, in units of the largest values of both so far. Beyond `WORST` the two
are exchanged: the model is compiled with the other stroke, which is as valid as the first, and the run goes on from the same values. (Dummy
derivatives are pivoted for the same reason: Mattsson and Söderlind, SIAM J. Sci. Comput. 14, 1993, section 4.)
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from compiler.api import Array, Program

from ..segments.trajectory import PhaseTransition

WORST = 1e3  # relative change of a dependent storage per relative change of a state, each relative to its peak


class Choice:
    """Monitor of the state selection. `storages`: the elements that can be exchanged; `before`: transition at the end of the phase before.

    `constants` may have a leading axis, for runs that differ in them; these have a peak each.
    """

    def __init__(
        self, program: Program, constants: Array, inputs: Array, storages: tuple[str, ...], before: PhaseTransition | None
    ) -> None:  # fmt: skip
        self.program, self.fixed = program, (inputs, constants)
        selection: tuple[Any, ...] | None = program.kept.get("state selection")
        if selection is None or selection[0] != storages:
            rows, columns = program.sensitivity_pattern
            chosen: Any = np.array([self._element(c) in storages for c in columns], dtype=bool)
            names: Any = (*program.states.names, *program.dependents.names)
            selection = program.kept["state selection"] = storages, chosen, rows[chosen], columns[chosen], names
        _, self.chosen, self.rows, self.columns, self.names = selection
        self.peak = np.zeros((*constants.shape[:-1], len(self.names)))
        if before is not None:
            self.peak[:] = [before.peaks.get(n, 0.0) for n in self.names]

    def _element(self, state: int) -> str:
        """Return the element to which a state belongs."""
        return self.program.states.names[state].rpartition(".")[0]

    def __bool__(self) -> bool:
        """Return True if there are storages that can be exchanged."""
        return len(self.rows) > 0

    def look(self, time: float, state: Array, mode: Array) -> PhaseTransition | None:
        """Return the transition that exchanges two storages after a step that ended here; None if none is needed."""
        if not len(self.rows):
            return None
        gain = self._gain(time, state, mode)
        worst = int(np.argmax(gain))
        if not gain[worst] > WORST:
            return None
        dependent = self.program.dependents.names[self.rows[worst]].rpartition(".")[0]
        element = self._element(self.columns[worst])
        return replace(self.transition(time, state, mode), dependent=dependent, state=element)

    def transition(self, time: float, state: Array, mode: Array, **more: Any) -> PhaseTransition:
        """Return the transition of another program that goes on here, near the solutions of the loops as they are. `more`: its other fields."""
        names, solved = self.program.unknowns.names, state[len(self.program.states.names) :].tolist()
        unknowns = dict(zip(names, solved, strict=True))
        return PhaseTransition(time, *self.stored(time, state, mode), unknowns=unknowns, **more)

    def _gain(self, time: float, state: Array, mode: Array) -> Any:
        """Return the relative changes of dependent storages per relative change of a state, shape (chosen,)."""
        slopes = np.abs(self.program.sensitivities(time, state, *self.fixed, mode))[self.chosen]
        scale = self.peak[len(self.program.states.names) + self.rows]
        return slopes * self.peak[self.columns] / np.where(scale > 0, scale, np.inf)

    def contents(self, time: Array | float, state: Array, mode: Array) -> Any:
        """Return all stored quantities, states and dependent storages; raise their largest values."""
        states = state[..., : len(self.program.states.names)]
        stored = np.concatenate([states, self.program.dependent(time, state, *self.fixed, mode)], axis=-1)
        np.maximum(self.peak, np.abs(stored), out=self.peak)  # machine code writes into it, too
        return stored

    def stored(self, time: float, state: Array, mode: Array) -> tuple[dict[str, float], dict[str, float]]:
        """Return all stored quantities (states and dependent storages) and their largest values so far; by name."""
        stored = self.contents(time, state, mode)
        values, peaks = (dict(zip(self.names, x.tolist(), strict=True)) for x in (stored, self.peak))
        return values, peaks
