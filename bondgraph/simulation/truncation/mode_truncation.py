"""Mode truncation: oscillations faster than the bandwidth are removed from the state where a segment begins, and where they shorten the steps.

The integrators know nothing of that: after the removal they hold the tolerance of the whole system, which no longer oscillates.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array, Program

from ...errors import RunFailed
from ...results.truncation import frequency_text
from ..segments.timeline import GOLDEN, Segment, inside
from .slow_manifold import SlowState, second, settled
from .spectrum_split import ScaledDynamics, Split, one

if TYPE_CHECKING:
    from ..integration.integration_state import IntegrationState
    from ..integrators.compiled.run import CompiledMethod

SEEN = 1.0  # in units of the tolerance: a larger oscillation shortens steps
# Largest fraction of the removed part that may remain; above, the motion is driven and no free oscillation. The second holds within a segment.
LEFT, LEFT_LATER = 0.3, 0.01
AFTER = 50  # number of steps after which the step size is checked
LOUD = 0.3  # fraction of a state's magnitude: a larger oscillation falsifies magnitudes that a pilot run found
IN_A_TURN = 65  # instants per period at which requirements of the model are checked for the removed oscillation
SHORT = 0.02  # in periods of the bandwidth: steps shorter than this are short
PLACES = 128  # number of sample places per segment
AHEAD = 1e-3  # radians at the bandwidth: time step of difference quotients
SMALL = 1e-9  # relative change of a signal within that time that counts as rounding


@dataclass(frozen=True, eq=False)
class Removal:
    """Record of one removal at an instant. States in SI, with their unknowns."""

    time: float
    mode: Any
    before: Any
    after: Any
    found: SlowState
    rate: float  # modes beyond this rate are fast, 1/s


class Leaving:
    """Mode truncation of one phase (`Phase`).

    `restart` receives the state from which magnitudes are searched again, where the removed part would dominate them.
    """

    def __init__(self, bandwidth: float, span: float, restart: Callable[[Any], None]) -> None:
        self.bandwidth, self.span, self.restart = bandwidth, span, restart
        self.flow: ScaledDynamics | None = None
        self.removals: list[Removal] = []
        self.looks: list[float] = []  # instants at which the eigenvalues were examined
        self.faster = 0  # number of oscillating modes faster than the bandwidth
        self.fastest = 0.0  # rate of the fastest motion within the circle of the bandwidth, 1/s
        self.decay = 0.0  # rate of the fastest motion beyond the circle that does not oscillate, 1/s
        self.reasons: dict[str, float] = {}  # reasons why faster modes were not truncated, with the first time of each
        self.above = 0.0  # Hz: frequency of the driving signals, if above the bandwidth
        self.pause = AFTER  # number of steps of a segment after which it is examined
        self._began, self._counted = 0.0, 0

    def begin(self, stepper: IntegrationState, stretch: Segment, x: Array) -> Any:
        """Return the state without its fast oscillations. x: in SI, with its unknowns."""
        self.pause, self._began, self._counted = AFTER, stretch.start, 0
        first = self.flow is None
        if self.flow is None:
            self.flow = ScaledDynamics(stepper)
        self.above = max(
            self.above, content(stepper.program, stepper.inputs, stepper.constants, stretch, self.bandwidth)
        )
        found = self._found(stretch.start, x, stretch.mode, LEFT)
        if isinstance(found, str):
            self.reasons.setdefault(found, stretch.start)
        if not isinstance(found, SlowState):
            return x
        after = self._whole(stepper, stretch, x, found)
        if first and (found.split.envelope(found.removed) > LOUD).any():
            self.restart(after)
            stepper.look_anew()
        self.removals.append(Removal(stretch.start, stretch.mode, x, after, found, 2 * np.pi * self.bandwidth))
        if any(note.kind != "table" and not note.fixed for note in stepper.program.limits):
            _ask(stepper, self.flow.magnitude, self.removals[-1])
        return after

    def cuts(self, stepper: IntegrationState, solver: CompiledMethod, steps: int, stretch: Segment) -> bool:
        """Return True if a segment is to be cut after so many steps, because a fast oscillation there shortens them."""
        if steps < self.pause or solver.finished:
            return False
        time = float(solver.time)
        usual = (time - self._began) / (steps - self._counted)
        self._began, self._counted = time, steps
        if usual * self.bandwidth >= SHORT:
            self.pause = steps + AFTER
            return False
        self.pause = 2 * steps
        x = stepper.held(time, solver.state * stepper.tolerances.magnitude, stretch.mode)
        return isinstance(self._found(time, x, stretch.mode, LEFT_LATER), SlowState)

    def _found(self, time: float, x: Array, mode: Array, left: float) -> SlowState | str | None:
        """Return the slow motion at a state; None if nothing need be removed, or the reason as text if removal is not possible."""
        flow = self.flow
        assert flow is not None
        self.looks.append(time)
        (at,) = flow.splits(np.array([time]), x[None], one(mode), self.bandwidth)
        if isinstance(at, str) or not len(at.values):
            return self._told(at)
        change = at.inverse @ at.inverse @ second(flow, at, time, x[: flow.count] / flow.magnitude, mode, x)
        why = self._told(at)
        if why is not None or _size(flow, at.envelope(change)) <= SEEN:
            return why
        found = settled(flow, at, time, x, mode, self.bandwidth)
        if isinstance(found, str):
            return found
        ringing, rest = (_size(flow, at.envelope(change)) for change in (found.removed, found.rest))
        if ringing <= SEEN:
            return None
        return found if rest <= left * ringing else "what is fast follows its drive as much as it rings, and is kept"

    def _told(self, at: Split | str) -> str | None:
        """Return the reason why nothing may be truncated at a split, or None; count the faster modes."""
        if isinstance(at, str):
            return at
        self.faster = max(self.faster, int((at.values.imag >= 0).sum()))
        self.fastest = max(self.fastest, at.slowest)
        self.decay = float(np.abs(at.decays).max(initial=self.decay))
        if not at.grows(self.span):
            return None
        rates = np.append(at.values, at.decays)
        rate = rates[np.argmax(rates.real)]
        return f"a motion of {frequency_text(abs(rate) / (2 * np.pi))} grows, so it is followed"

    def _whole(self, stepper: IntegrationState, stretch: Segment, x: Array, found: SlowState) -> Any:
        """Return the slow state in SI, on all constraints, with its unknowns."""
        assert self.flow is not None
        states = np.concatenate([found.state * self.flow.magnitude, x[self.flow.count :]])
        return stepper.held(stretch.start, states, stretch.mode)


def _ask(stepper: IntegrationState, magnitude: Array, removal: Removal) -> None:
    """Check the requirements of the model over the first period of the removed oscillation; ignore instants at which loops have no solution."""
    at, count = removal.found.split, len(removal.found.removed)
    parts = (at.right * (at.dual @ removal.found.removed)).T * magnitude
    turn = 2 * np.pi / float(np.abs(at.values.imag).min())

    def state_at(times: Array) -> Any:
        states = np.tile(removal.after, (len(times), 1))
        states[:, :count] += (np.exp((times - removal.time)[:, None] * at.values) @ parts).real
        return stepper.held_all(times, states, removal.mode)

    with suppress(RunFailed):
        stepper.watch.look(removal.time + np.linspace(0.0, turn, IN_A_TURN), removal.mode, state_at, tables=False)


def _size(flow: ScaledDynamics, change: Array) -> float:
    """Return the norm of a change in units of the tolerance, as the integrators measure their errors."""
    return float(np.linalg.norm(change / flow.allowed) / max(1, len(change)) ** 0.5)


def content(program: Program, inputs: Array, constants: Array, stretch: Segment, bandwidth: float) -> float:
    """Return a frequency in Hz: how fast the fastest signal of time changes, from its largest second and first derivative; 0 if below the bandwidth."""
    ahead = AHEAD / (2 * np.pi * bandwidth)
    first, last = inside(stretch)
    if last - first < 4 * ahead:
        return 0.0
    numbers = np.arange(PLACES)
    times = first + (last - 2 * ahead - first) * (numbers + (GOLDEN * numbers + 0.5) % 1.0) / PLACES
    close = (times + ahead * np.arange(3.0)[:, None]).ravel()
    values = np.asarray(program.signals(close, inputs, constants, stretch.mode)).reshape(3, PLACES, -1)
    if not values.size or not np.isfinite(values).all():
        return 0.0
    slopes, bends = (np.abs(np.diff(values, k, axis=0)[0]).max(axis=0) for k in (1, 2))
    sure = slopes > SMALL * np.abs(values).max(axis=(0, 1))
    rates = bends[sure] / slopes[sure] / ahead
    found = float(rates.max(initial=0.0)) / (2 * np.pi)
    return found if found > bandwidth else 0.0
