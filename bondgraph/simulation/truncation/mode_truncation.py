"""Mode truncation: oscillations faster than the bandwidth are removed from the state where a segment begins, and where they shorten the steps.

The integrators know nothing of that: after the removal they hold the tolerance of the whole system, which no longer oscillates.

A state is projected onto the slow motion with the same slow coordinates, which removes its fast oscillations. On the slow motion the fast coordinates
only follow, so all their derivatives are small. The state whose fast part of x'' vanishes misses the slow motion by a part (slow rate / fast rate)^2
of the value that the fast coordinates follow (Gear, Kaper, Kevrekidis and Zagaris, Projecting to a slow manifold, SIAM J. Appl. Dyn. Syst. 4, 2005).
A step towards a vanishing third derivative adds one order, and shows if the orders converge. Newton steps take the fast part of the Jacobian from the
split at the current state.
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
ROUNDS = 3  # number of splits, each at the state that the previous one led to
ITERATIONS = 12
CLOSE = 1e-8  # relative to the removed part: the iteration ends below this change
STRAIGHT = 1e-4  # relative to the first change: a smaller second one shows equal fast motions at both ends
LOOK = 0.01  # radians of the fastest motion: time step of difference quotients


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


@dataclass(frozen=True, eq=False)
class SlowState:
    """Result of a projection onto the slow manifold.

    `state` (n,) over the magnitudes of the flow, the part `removed` from the earlier state, the `split` there; `rest`: remaining error of the
    orders that were used.
    """

    state: Any
    removed: Any
    split: Split
    rest: Any


def settled(flow: ScaledDynamics, first: Split, time: float, state: Array, mode: Array, bandwidth: float) -> SlowState | str:  # fmt: skip
    """Return the slow motion near a state in SI, with its unknowns; or the reason as text why there is none."""
    before = state[: flow.count] / flow.magnitude
    here, now, times, near = before, first, np.array([time]), state[None]
    rest = np.zeros(flow.count)
    for number in range(ROUNDS):
        moved, last, contraction = _iterated(flow, now, time, here, mode, state)
        if not np.isfinite(moved).all():
            return "no slow motion is found near it"
        here, rest = moved, last
        if contraction < STRAIGHT or number == ROUNDS - 1:
            break
        (again,) = flow.splits(times, flow.whole(times, one(mode), near, here[None]), one(mode), bandwidth)
        if isinstance(again, str):
            return again
        if len(again.values) != len(first.values):
            return "how much is faster than the bandwidth depends on what would be left out"
        now = again
    thrice = now.inverse @ now.inverse @ now.inverse
    here = here - thrice @ _third(flow, now, time, here, mode, state)
    last = thrice @ _third(flow, now, time, here, mode, state)
    return SlowState(here, before - here, now, np.abs(rest) + np.abs(last))


def _iterated(flow: ScaledDynamics, at: Split, time: float, here: Array, mode: Array, near: Array) -> tuple[Any, Any, float]:  # fmt: skip
    """Return the state whose fast part of x'' vanishes, the last change of the iteration, and the ratio of the second change to the first."""
    twice = at.inverse @ at.inverse
    sizes: list[float] = []
    change = np.full(len(here), np.inf)
    while len(sizes) < ITERATIONS:
        step = twice @ second(flow, at, time, here, mode, near)
        sizes.append(float(np.linalg.norm(step)))
        if not np.isfinite(sizes[-1]) or (len(sizes) > 1 and sizes[-1] > 0.5 * sizes[-2]):
            break  # rounding is reached, or there is no such state
        here, change = here - step, step
        if sizes[-1] <= CLOSE * sizes[0]:
            break
    return here, change, sizes[1] / sizes[0] if len(sizes) > 1 and sizes[0] else 0.0


def second(flow: ScaledDynamics, at: Split, time: float, here: Array, mode: Array, near: Array) -> Any:
    """Return the second time derivative at a state over the magnitudes; `near`: a state in SI with its unknowns."""
    return _next(flow, at, time, here, mode, near)[1]


def _next(
    flow: ScaledDynamics, at: Split, time: float, here: Array, mode: Array, near: Array, matrix: Array | None = None
) -> tuple[Any, Any]:
    """Return the first two time derivatives. `matrix`: the Jacobian there, if it differs from that of `at`."""
    ahead = LOOK / float(np.abs(at.values).max())
    rate, later = (flow.rate(t, mode, near, here) for t in (time, time + ahead))
    return rate, (at.matrix if matrix is None else matrix) @ rate + (later - rate) / ahead


def _third(flow: ScaledDynamics, at: Split, time: float, here: Array, mode: Array, near: Array) -> Any:
    """Return the third time derivative."""
    ahead = LOOK / float(np.abs(at.values).max())
    rate, now = _next(flow, at, time, here, mode, near)
    there = here + ahead * rate + 0.5 * ahead**2 * now
    times = np.array([time + ahead])
    (matrix,) = flow.matrices(times, one(mode), flow.whole(times, one(mode), near[None], there[None]))
    return (_next(flow, at, time + ahead, there, mode, near, matrix)[1] - now) / ahead
