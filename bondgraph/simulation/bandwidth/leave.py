"""What rings faster than the bandwidth is taken out of the state: where a stretch begins, and where steps get short because of it.

The steps themselves know nothing of that: after the removal they hold the tolerance of the whole system, which does not ring.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import RunFailed
from ...left_out import told_hertz
from ..segments import Segment
from .inputs import content
from .settle import Settled, second, settled
from .split import Flow, Split, one

if TYPE_CHECKING:
    from ..stretch.stepper import Solver, Stepper

SEEN = 1.0  # of the tolerance: a ringing above that shortens steps
# Of what would be removed, so much may be left, or it is no ringing but driven; the latter where nothing begins anew.
LEFT, LEFT_LATER = 0.3, 0.01
AFTER = 50  # steps, after which it is looked whether they are short
LOUD = 0.3  # of a state's magnitude: a ringing that a look ahead should not have seen
IN_A_TURN = 65  # instants at which what is required is asked of what was removed
SHORT = 0.02  # of a period of the bandwidth


@dataclass(frozen=True, eq=False)
class Removal:
    """What was removed at an instant. States in SI, with their unknowns."""

    time: float
    mode: Any
    before: Any
    after: Any
    found: Settled
    rate: float  # beyond which a mode is fast, 1/s


class Leaving:
    """What is left out of one leg. `restart` is told the state from which magnitudes are looked for, where what was left out would count."""

    def __init__(self, bandwidth: float, span: float, restart: Callable[[Any], None]) -> None:
        self.bandwidth, self.span, self.restart = bandwidth, span, restart
        self.flow: Flow | None = None
        self.removals: list[Removal] = []
        self.looks: list[float] = []  # when it was looked what is faster
        self.faster = 0  # modes that ring faster
        self.fastest = 0.0  # the rate of the fastest motion within the circle, 1/s
        self.decay = 0.0  # that of what is beyond it and does not ring
        self.reasons: dict[str, float] = {}  # why what is faster was not left out, and when first
        self.above = 0.0  # Hz: how fast what drives the model changes, if that is faster
        self.pause = AFTER  # steps of a piece, after which it is looked at
        self._began, self._counted = 0.0, 0

    def begin(self, stepper: Stepper, stretch: Segment, x: Any) -> Any:
        """The state without what rings in it. x: in SI, with its unknowns."""
        self.pause, self._began, self._counted = AFTER, stretch.start, 0
        first = self.flow is None
        if self.flow is None:
            self.flow = Flow(stepper)
        self.above = max(
            self.above, content(stepper.program, stepper.inputs, stepper.constants, stretch, self.bandwidth)
        )
        found = self._found(stretch.start, x, stretch.mode, LEFT)
        if isinstance(found, str):
            self.reasons.setdefault(found, stretch.start)
        if not isinstance(found, Settled):
            return x
        after = self._whole(stepper, stretch, x, found)
        if first and (found.split.envelope(found.removed) > LOUD).any():
            self.restart(after)
            stepper.look_anew()
        self.removals.append(Removal(stretch.start, stretch.mode, x, after, found, 2 * np.pi * self.bandwidth))
        if any(note.kind != "table" for note in stepper.program.limits):
            _ask(stepper, self.flow.magnitude, self.removals[-1])
        return after

    def cuts(self, stepper: Stepper, solver: Solver, steps: int, stretch: Segment) -> bool:
        """Whether a stretch is to be cut after so many steps, since something rings there that shortens them."""
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
        return isinstance(self._found(time, x, stretch.mode, LEFT_LATER), Settled)

    def _found(self, time: float, x: Any, mode: Any, left: float) -> Settled | str | None:
        """The slow motion there; None if nothing need be left out, a reason if it cannot."""
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
        """Why nothing may be left out there; counts what is faster."""
        if isinstance(at, str):
            return at
        self.faster = max(self.faster, int((at.values.imag >= 0).sum()))
        self.fastest = max(self.fastest, at.slowest)
        self.decay = float(np.abs(at.decays).max(initial=self.decay))
        if not at.grows(self.span):
            return None
        rates = np.append(at.values, at.decays)
        rate = rates[np.argmax(rates.real)]
        return f"a motion of {told_hertz(abs(rate) / (2 * np.pi))} grows, so it is followed"

    def _whole(self, stepper: Stepper, stretch: Segment, x: Any, found: Settled) -> Any:
        """The slow state in SI, on all constraints, with its unknowns."""
        assert self.flow is not None
        states = np.concatenate([found.state * self.flow.magnitude, x[self.flow.count :]])
        return stepper.held(stretch.start, states, stretch.mode)


def _ask(stepper: Stepper, magnitude: Any, removal: Removal) -> None:
    """Ask the first turn of what was removed for what the model requires; nothing comes of it where loops have no solution."""
    at, count = removal.found.split, len(removal.found.removed)
    parts = (at.right * (at.dual @ removal.found.removed)).T * magnitude
    turn = 2 * np.pi / float(np.abs(at.values.imag).min())

    def state_at(times: Any) -> Any:
        states = np.tile(removal.after, (len(times), 1))
        states[:, :count] += (np.exp((times - removal.time)[:, None] * at.values) @ parts).real
        return stepper.held_all(times, states, removal.mode)

    with suppress(RunFailed):
        stepper.watch.look(removal.time + np.linspace(0.0, turn, IN_A_TURN), removal.mode, state_at, tables=False)


def _size(flow: Flow, change: Any) -> float:
    """The norm of a change in units of the tolerance, as steps measure their errors."""
    return float(np.linalg.norm(change / flow.allowed) / max(1, len(change)) ** 0.5)
