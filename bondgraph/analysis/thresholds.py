"""Events exactly at their thresholds: a small motion about such a state makes them act, so that no linear model holds there.

A `when` whose condition is within rounding of its threshold, an ideal valve without effort and flow, friction at its limit, a junction whose `active` is
about to fail. What acts and changes nothing (a counter that nothing reads, a reset of a velocity that is held) does not count.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array, IntArray

from .singular_slopes import FAR, SIGNS, departure

if TYPE_CHECKING:
    from ..simulation.events.indicators import EventIndicators, HybridState

StateFunction = Callable[[float, Array, Array, Array, Array], Array]
SHARE = 1e-7  # relative step of inputs and parameters, for the rounding of a condition
ALIKE = 1e-8  # relative to the largest of a row: change of a slope, a rate or an output that counts as none
SET = 1e-3  # relative to a step away from the point: change of a state by an event that counts as none
CHAIN = 8  # most events that cause each other


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Events and junctions, by their text and line, that change the equations at a point; outputs that jump there by events."""

    names: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()


def thresholds(events: EventIndicators, at: HybridState, size: Array) -> Thresholds:
    """Return the events that are exactly at their thresholds at a hybrid state, and change something there. `size`: magnitudes of states and unknowns."""
    hybrid = events.hybrid
    if not any(not e.sampled for e in hybrid.events) and not hybrid.junctions:
        return Thresholds()
    return _Neighbourhood(events, at, size).thresholds()


def acting(events: EventIndicators, at: HybridState, size: Array) -> tuple[Array, tuple[str, ...]]:
    """Return the mode with the conditions that hold at a hybrid state; and the events and junctions that act there and change the equations, in words."""
    here, after = _Neighbourhood(events, at, size), events.guess(at)
    off = [set(events.actives(replace(at, mode=mode))) for mode in (at.mode, after)]
    words = [f"`active` of `{junction}`" for junction in sorted(off[0] ^ off[1])]
    rising = [i for i in here.rising(np.array(at.mode), after) if here.effect(np.array(at.mode), after, i)[0]]
    notes = [events.hybrid.events[i] for i in rising]
    return after, tuple(words + [f"`{note}` ({note.span.file_and_line})" for note in notes])


@dataclass(frozen=True, slots=True)
class _Neighbourhood:
    events: EventIndicators
    at: HybridState
    size: Array

    def thresholds(self) -> Thresholds:
        events = self.events
        names, outputs = dict[str, None](), dict[str, None]()
        for place in events.places[self._doubtful()]:
            low, high = (self._with(place, truth) for truth in (0.0, 1.0))
            off = [set(events.actives(replace(self.at, mode=mode))) for mode in (low, high)]
            names |= {f"`active` of `{junction}`": None for junction in sorted(off[0] ^ off[1])}
            for base, other in ((low, high), (high, low)):
                for i in self.rising(base, other):
                    changed, jumping = self.effect(base, other, i)
                    note = events.hybrid.events[i]
                    names |= {f"`{note}` ({note.span.file_and_line})": None} if changed else {}
                    outputs |= dict.fromkeys(jumping)
        return Thresholds(tuple(names), tuple(outputs))

    def _doubtful(self) -> IntArray:
        """Return the indices of the conditions within rounding of their thresholds."""
        from ..simulation.integrators.acceptance.event_indicators import NOISE

        events, at = self.events, self.at
        roots = events.roots(at.time, at.state, at.mode)
        noise = events.noise(at)
        parameters, inputs = events.constraints.parameters, np.asarray(events.inputs, dtype=float)
        for way in range(len(SIGNS)):
            steps = [1 + departure(np.ones(len(x)), SHARE, way) for x in (parameters, inputs)]
            constants = events.program.constants(parameters * steps[0])
            moved = events.hybrid.roots(at.time, at.state, inputs * steps[1], constants, at.mode)
            change = np.abs(moved - roots) * (NOISE / SHARE)
            noise = np.maximum(noise, np.where(np.isfinite(change), change, 0.0))
        return np.flatnonzero(np.abs(roots) <= noise)

    def _with(self, place: int, truth: float) -> Any:
        mode = np.array(self.at.mode, dtype=float)
        mode[place] = truth
        return mode

    def rising(self, base: Array, other: Array) -> list[int]:
        """Return the events, without sampled ones, that act where one mode becomes the other."""
        before, after = (self.events.triggers(replace(self.at, mode=mode)) for mode in (base, other))
        return [int(i) for i in np.flatnonzero(after & ~before) if not self.events.hybrid.events[i].sampled]

    def effect(self, base: Array, other: Array, event: int) -> tuple[bool, set[str]]:
        """Return True if an event changes states, junctions, rates or slopes at or beside the point, and the outputs that it changes."""
        from ..simulation.events.resets import reset

        jumping, count, places = set[str](), self.events.count, self.events.places
        step = np.abs(departure(self.size, FAR))[:count]
        for state in self._states():
            after, acting = replace(self.at, state=state, mode=other), [event]
            for _ in range(CHAIN):
                before, after = after, reset(self.events, after, acting)
                self._reread(before, after)
                acting = self.rising(before.mode, after.mode)
                if not acting:
                    break
            if (np.abs(after.state - state)[:count] > SET * step).any():
                return True, jumping
            changed = np.array(after.mode)
            changed[places] = base[places]
            if (changed == base).all():
                continue
            sides = [self.events.guess(replace(self.at, state=state, mode=mode)) for mode in (base, changed)]
            if self._equations_differ(state, sides):
                return True, jumping
            jumping |= self._jumping(state, sides)
        return False, jumping

    def _reread(self, before: HybridState, after: HybridState) -> None:
        """Put the truth of the conditions whose roots events have changed into the mode after them."""
        roots, old = (self.events.roots(at.time, at.state, at.mode) for at in (after, before))
        read = roots != old
        after.mode[self.events.places[read]] = self.events.truth(roots)[read]

    def _states(self) -> Iterator[Any]:
        """Yield the states at the point and beside it."""
        yield self.at.state
        for way in range(len(SIGNS)):
            for side in (1.0, -1.0):
                yield self.at.state + side * departure(self.size, FAR, way)

    def _equations_differ(self, state: Array, modes: Sequence[Array]) -> bool:
        """Return True if junctions, rates or slopes differ in two modes."""
        junctions = [self.events.actives(replace(self.at, state=state, mode=mode)) for mode in modes]
        if junctions[0] != junctions[1]:
            return True
        slopes = self._in(self.events.program.jacobian, state, modes)
        rates = self._in(self.events.program.derivative, state, modes)
        largest = np.abs(slopes).max(axis=0)
        bent = np.abs(np.subtract(*slopes)) > ALIKE * largest.max(axis=1, initial=0.0)[:, None]
        return bool(bent.any() or (np.abs(np.subtract(*rates)) > ALIKE * (largest @ self.size)).any())

    def _jumping(self, state: Array, modes: Sequence[Array]) -> set[str]:
        """Return the outputs that differ in two modes."""
        values = self._in(self.events.program.output, state, modes)
        apart = np.abs(np.subtract(*values)) > ALIKE * np.abs(values).max(axis=0)
        return {self.events.program.outputs.names[i] for i in np.flatnonzero(apart)}

    def _in(self, function: StateFunction, state: Array, modes: Sequence[Array]) -> Any:
        """Return the values of a function of the program in several modes."""
        with np.errstate(all="ignore"):
            return np.array(
                [function(self.at.time, state, self.events.inputs, self.events.constants, m) for m in modes]
            )
