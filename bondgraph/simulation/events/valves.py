"""Switching of ideal valves just after an instant: the companion network decides which conduct, the program's own conditions may refute it."""

from __future__ import annotations

from collections.abc import Sequence, Set

import numpy as np

from compiler.api import Array, BoolArray

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
        self.gated = np.array([k for k, v in enumerate(valves) if v.gate is not None], dtype=int)
        self.gates = np.array([keys.index(v.gate) for v in valves if v.gate is not None], dtype=int)
        self.own = np.array([*self.events.ravel(), *self.gates], dtype=int)
        chosen = [keys[i] for i in self.events.ravel()]
        own = [(c.owner, c.span.start) for c in hybrid.conditions]
        self.conditions = [(k, key) for k, key in enumerate(own) if key in chosen]

    def begin(self, indicators: EventIndicators, time: float) -> None:
        """Store which valves conduct before a run begins, as written: a gate does not stop these."""
        written = indicators.hybrid.start(indicators.constants)[self.modes] == self.conducts
        self.companion.before = time, written & [not v.fitted for v in self.companion.valves]
        self.companion.shut = None

    def after(
        self, indicators: EventIndicators, at: HybridState, before: HybridState, holds: BoolArray
    ) -> tuple[HybridState, list[int]]:
        """Return the hybrid state with all valves as they are just after, and the events of those that switch: then another program goes on.

        `before`: the state before the instant; `holds`: the truth of the conditions of all events.

        If other junctions have switched since, this program cannot contradict the set: the next one can.
        """
        companion, off = self.companion, indicators.actives(at)
        said = at.mode[self.modes] == self.conducts
        if companion.before[0] != at.time:
            companion.before, companion.shut = (at.time, before.mode[self.modes] == self.conducts), None
        closed = ~holds[self.gates] & ~companion.before[1][self.gated]
        if companion.shut is not None:  # what the valve lets flow may have closed a gate that reads it
            closed = np.where(said[self.gated], companion.shut, closed)
        companion.shut, shut = closed, self.gated[closed]
        instant = self._instant(indicators, at, off, tuple([companion.valves[k].junction for k in shut]))
        contradicted = bool(np.delete(holds[self.events[:, 0]], shut).any() or holds[self.events[:, 1]].any())
        found = companion.conducting(instant, said)
        if (found == said).all():
            if off != indicators.actives(before) or not contradicted:
                return at, []
            other = companion.another(instant, said)
            if other is None and self._upheld(indicators, at, {companion.valves[k].events[0] for k in shut}):
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

    def _instant(
        self, indicators: EventIndicators, at: HybridState, off: Sequence[str], shut: tuple[str, ...]
    ) -> Instant:
        """Return all stored quantities and discrete variables, by name. `off`: the junctions that are off; `shut`: valves that cannot begin to conduct."""
        program = indicators.program
        fixed = (indicators.inputs, indicators.constants, at.mode)
        stored = self.companion.stored
        stored.update(zip(program.states.names, at.state.tolist(), strict=False))
        if program.dependents.names:
            stored.update(
                zip(program.dependents.names, program.dependent(at.time, at.state, *fixed).tolist(), strict=True)
            )
        others = tuple([name for name in off if name not in self.companion.junctions])
        return Instant(at.time, stored, discrete_variables(indicators.hybrid, at.mode), others, closed=shut)

    def _upheld(self, indicators: EventIndicators, at: HybridState, idle: Set[tuple[str, int]]) -> bool:
        """Return True if no valve has a positive effort while it blocks, or a negative flow while it conducts, beyond rounding. `idle`: events that cannot act.

        Violations below rounding are ignored, and not taken for a zero crossing later.
        """
        places = np.array([k for k, key in self.conditions if key not in idle], dtype=int)
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
