"""Switching of ideal valves just after an instant: the companion network decides which conduct, the program's own conditions may refute it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from compiler.api import Array

from ..segments.timeline import discrete_variables
from .complementarity import Companion, Instant
from .indicators import EventIndicators, HybridState

UPHELD = 1e4  # in units of rounding: largest violation of a valve's sign


class ValveSwitching:
    """Ideal valves of a program and their companion; rows of `events` are valves, columns conducting and blocking."""

    def __init__(self, indicators: EventIndicators, companion: Companion, keys: Sequence[tuple[str, int]]) -> None:
        """`keys`: owner and place of each event."""
        self.companion = companion
        valves, hybrid = companion.valves, indicators.hybrid
        self.modes = np.array([hybrid.modes.names.index(v.mode) for v in valves], dtype=int)
        self.conducts = np.array([v.conducting for v in valves])
        self.events = np.array([[keys.index(k) for k in v.events] for v in valves], dtype=int).reshape(-1, 2)
        chosen = [keys[i] for i in self.events.ravel()]
        own = [(c.owner, c.span.start) for c in hybrid.conditions]
        self.conditions = np.array([k for k, key in enumerate(own) if key in chosen], dtype=int)

    def after(
        self, indicators: EventIndicators, at: HybridState, before: HybridState, contradicted: bool
    ) -> tuple[HybridState, list[int]]:
        """Return the hybrid state with all valves as they are just after, and the events of those that switch: then another program goes on.

        `before`: the state before the instant; `contradicted`: True if the switching condition of one of them holds.

        If other junctions have switched since, this program cannot contradict the set: the next one can.
        """
        companion, off = self.companion, indicators.actives(at)
        instant = self._instant(indicators, at, off)
        said = at.mode[self.modes] == self.conducts
        found = companion.conducting(instant, said)
        if (found == said).all():
            if off != indicators.actives(before) or not contradicted:
                return at, []
            other = companion.another(instant, said)
            if other is None and self._upheld(indicators, at):
                companion.against = at.time, frozenset()
                return at, []
            found = companion.again(instant, said) if other is None else other
        companion.switched(at.time)
        mode = at.mode.copy()
        mode[self.modes] = np.where(found, self.conducts, 1.0 - self.conducts)
        return HybridState(at.time, at.state, mode), self.switched(at.mode, mode)

    def switched(self, before: Array, after: Array) -> list[int]:
        """Return the events of the valves that conduct in one of two modes only, as they act to reach the second."""
        was, conducts = (np.asarray(mode)[self.modes] == self.conducts for mode in (before, after))
        return [int(self.events[k, 0 if conducts[k] else 1]) for k in (conducts != was).nonzero()[0]]

    def _instant(self, indicators: EventIndicators, at: HybridState, off: Sequence[str]) -> Instant:
        """Return all stored quantities and discrete variables, by name. `off`: the junctions that are off."""
        program = indicators.program
        fixed = (indicators.inputs, indicators.constants, at.mode)
        stored = self.companion.stored
        stored.update(zip(program.states.names, at.state.tolist(), strict=False))
        if program.dependents.names:
            stored.update(
                zip(program.dependents.names, program.dependent(at.time, at.state, *fixed).tolist(), strict=True)
            )
        others = tuple([name for name in off if name not in self.companion.junctions])
        return Instant(at.time, stored, discrete_variables(indicators.hybrid, at.mode), others)

    def _upheld(self, indicators: EventIndicators, at: HybridState) -> bool:
        """Return True if no valve has a positive effort while it blocks, or a negative flow while it conducts, beyond rounding.

        Violations below rounding are ignored, and not taken for a zero crossing later.
        """
        places = self.conditions
        roots = indicators.roots(at.time, at.state, at.mode)
        against = np.zeros(len(roots), dtype=bool)
        against[places] = indicators.truth(roots)[places]
        limit = UPHELD * np.maximum(
            indicators.noise(at), indicators.rounding_of_terms(np.array([at.time]), at.state[None, :], at.mode)[0]
        )
        if (np.abs(roots[against]) > limit[against]).any():
            return False
        at.mode[indicators.places[against]] = 0.0
        indicators.floor[against] = np.maximum(indicators.floor[against], 2 * np.abs(roots[against]))
        return True
