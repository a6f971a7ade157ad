"""Tolerances of a phase: those of the experiment, and the magnitudes of its states, from the phase before or from pilot runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import RunFailed, UsageError
from ...results.records import ToleranceDoubt
from ..constraints.constraints import Constraints
from ..integrators.pilot.schedule import Conditions
from ..magnitudes.nominal_magnitudes import (
    Magnitudes,
    above_rounding,
    nominal_magnitudes,
    of_what_moved,
    rounding_levels,
)
from ..magnitudes.pilot_run import PilotObservation, PilotObserver
from ..monitors.state_selection import Choice
from ..segments.timeline import Segment

if TYPE_CHECKING:
    from compiler.api import Array, Plan, Program, RunMetadata

    from ..events.events import Events

HIDDEN = 1000.0  # in units of an absolute tolerance: a threshold below that is hidden by it
LARGEST = 256  # number of states of models whose thresholds are looked for
DECADES = 10.0 ** -np.arange(20)  # parts of it, at which a threshold is looked for
OVERSHOT = 10.0  # ratio to the largest values of a run through the events: more, in a mode before one, is no magnitude


def given_tolerances(plan: Plan, program: Program, facts: RunMetadata) -> dict[int, float]:
    """Return the absolute tolerances that the experiment gives, by index of the state or unknown. Raises `UsageError`."""
    result: dict[int, float] = {}
    if not plan.tolerances:
        return result
    variables = {n: i for i, n in enumerate(program.variables.names)}
    for name, value in plan.tolerances.items():
        index = variables.get(name, facts.shown.get(name))
        if index is None:
            index, factor = facts.following.get(name, (-1, None))
            if factor is None:
                behind = f" (it follows `{program.states.names[index]}`)" if index >= 0 else ""
                raise UsageError(
                    "BR719", f"the tolerance of `{name}` cannot be held: it is no state of this run{behind}; states are {', '.join(variables)}",
                )  # fmt: skip
            value /= abs(factor)
        result[index] = min(value, result.get(index, value))
    return result


def put_thresholds(events: Events, time: float, mode: Array, magnitude: Array, tolerances: Array, rtol: float) -> None:
    """Lower absolute tolerances that hide a threshold: those of states with which a condition changes something between zero and a few of them."""
    count, size = events.count, len(magnitude)
    if not 0 < count <= LARGEST:
        return
    reach = HIDDEN * tolerances[:count]

    def signs(states: Array) -> Any:
        times = np.full(len(states), time)
        with suppress(RunFailed):  # loops may have no solution there
            states = events.loops.solve_all(times, states, mode)
        roots = events.roots(times, states, mode)
        return np.where(np.isfinite(roots), np.sign(roots), 0.0)  # zero is no threshold of what has a pole there

    box = magnitude + np.concatenate(
        [(x - magnitude[:count])[:, None] * np.eye(count, size) for x in (0, reach, -reach)]
    )
    at_zero, *beside = signs(box).reshape(3, count, -1)
    hidden = (at_zero != 0) & ((beside[0] == -at_zero) | (beside[1] == -at_zero))
    for state, number in zip(*hidden.nonzero(), strict=True):
        sign = -at_zero[state, number]
        tried = np.tile(magnitude, (len(DECADES), 1))
        tried[:, state] = (1 if beside[0][state, number] == sign else -1) * reach[state] * DECADES
        least = tried[(signs(tried)[:, number] == sign).nonzero()[0][-1]]
        if events.jumps(number, time, least, mode):
            share = min(1.0, rtol * abs(least[state]) / tolerances[state])
            tolerances[state] *= share
            tolerances[count:] *= share  # unknowns may be all that it is read through


@dataclass(frozen=True, slots=True)
class PhaseMagnitudes:
    """Magnitudes of all states and unknowns, doubts about them, and by name: those that the next phase takes over, and those of all that moves.

    Of what nothing moves the value is no more than a guess; `guessed`: their names.
    """

    values: Any
    doubts: tuple[ToleranceDoubt, ...] | None  # None: nothing was searched
    known: Mapping[str, float]
    moved: Mapping[str, float]
    guessed: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class MagnitudeSearch:
    """Search of the magnitudes of a phase.

    `state`: where pilot runs start; `known`: magnitudes by name; `peaks`: largest absolute values before this phase; `choice`: a monitor of the
    state selection; `coarse`: the largest values of a coarse run through the events, with the magnitudes up to the first, and the time at which other
    junctions go on or off, infinite if none do; `rtol`: relative tolerance.
    """

    constraints: Constraints
    mechanisms: Sequence[str]
    state: Any
    stretches: Sequence[Segment]
    known: Mapping[str, float]
    peaks: Any
    choice: Callable[[], Choice]
    coarse: Callable[[Array], tuple[Array, float]]
    rtol: float

    def magnitudes(self, events: Events | None) -> PhaseMagnitudes:
        """Return the magnitudes; `events` are measured by them."""
        if events is not None:
            return self._with_events(events)
        names = self.constraints.program.variables.names
        if all(n in self.known for n in names):
            return PhaseMagnitudes(np.array([self.known[n] for n in names]), None, self.known, self.known)
        nominal = self._nominal(PilotObservation(self.choice(), rtol=self.rtol), self.peaks)
        return PhaseMagnitudes(nominal.values, nominal.doubts, self.known, nominal.by_name(names), nominal.resting)

    def _nominal(
        self, observation: PilotObservation, largest: Array | float = 0.0, look: PilotObserver | None = None
    ) -> Magnitudes:
        return nominal_magnitudes(
            self.constraints, self.mechanisms, self.state, self.stretches, observation, largest, look
        )  # fmt: skip

    def _with_events(self, events: Events) -> PhaseMagnitudes:
        """Return magnitudes from a pilot run up to the first event, then from a coarse run through the events."""
        from ..events.indicators import HybridState

        program, known, segment = self.constraints.program, self.known, self.stretches[0]
        at = HybridState(segment.start, self.state, segment.mode)

        def conditions(mode: Array) -> Conditions:
            return Conditions(np.asarray(mode)[events.places] == 1.0, events.strict)

        names, doubts, guess = program.variables.names, None, 1.0
        guessed: Sequence[str] = ()
        if known and self.mechanisms:
            levels = rounding_levels(self.mechanisms, self.constraints, self.state, self.stretches[0])
            known = of_what_moved(known, program, above_rounding(self.rtol) * levels)
        if not all(n in known for n in names):
            first = self._nominal(PilotObservation(self.choice(), conditions, self.rtol))
            events.measure_anew(first.moved, at)
            largest, until = self.coarse(first.values)
            largest = np.maximum(largest, self.peaks)
            search, look = self, _without_overshoot(first.look, largest)
            if before := [s.up_to(s.start, min(s.stop, until)) for s in self.stretches if s.start < until < np.inf]:
                # the look went on with a program that does not hold there: behind a switch that stays closed a current grows without end
                search, look = replace(self, stretches=before), None
            nominal = search._nominal(PilotObservation(self.choice(), conditions, self.rtol), largest, look)
            doubts, guess, guessed = nominal.doubts, nominal.values, (*nominal.unknown, *nominal.resting)
            known = nominal.by_name(names) | dict(known)
        moved = np.array([known.get(n, 0.0) for n in names])
        events.measure_anew(moved, at)
        return PhaseMagnitudes(np.where(moved > 0, moved, guess), doubts, known, known, guessed)


def _without_overshoot(look: PilotObserver | None, largest: Array) -> PilotObserver | None:
    """Return a pilot run without what its last step, in a mode that no longer held, has beyond the largest values of a run through the events."""
    if look is None:
        return None
    reached = np.maximum(look.sure, largest)
    return replace(look, largest=np.where((reached > 0) & (look.largest > OVERSHOT * reached), reached, look.largest))
