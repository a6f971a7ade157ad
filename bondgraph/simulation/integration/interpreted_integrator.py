"""Interpreted integrator: a segment integrated in Python, with all monitors called after each step.

It is the reference for `native_integrator.py`, and is used for models that machine code cannot run.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import AUTOMATIC

from ...errors import StepsCollapsed
from ..integrators.limits import NEAR
from ..integrators.methods import RADAU
from ..integrators.radau import StepFailed
from ..monitors.step_failure import MOST_STEPS
from ..segments.timeline import Segment
from .cut import is_sure
from .poses import beyond, chosen_anew
from .reference import interpreted

if TYPE_CHECKING:
    from ..integrators.compiled.interpreted import Interpreted
    from .integration_state import IntegrationState


def one_by_one(stepper: IntegrationState, stretch: Segment, x: Any, method: int, size: float, target: str) -> Any:
    """Integrate as `IntegrationState.run` from its first step.

    `size`: of all steps, for a method with equal steps; `target`: the name of this integrator in the result.
    """
    return InterpretedIntegrator(stepper, stretch, x, method, size, target).to_end()


class InterpretedIntegrator:
    """Interpreted integrator over one segment, with access to its last step."""

    def __init__(
        self, stepper: IntegrationState, stretch: Segment, x: Any, method: int, size: float, target: str
    ) -> None:
        self.stepper, self.stretch, self.target = stepper, stretch, target
        self.steps = 0
        self.method = method
        self.solver: Interpreted = interpreted(stepper, stretch, x, method, size)
        self.before = self.solver.state  # state at the start of the last step
        self.magnitude = stepper.tolerances.magnitude
        self.peak = np.maximum(np.abs(x) / self.magnitude, 1.0)
        if stepper.constraints:
            stepper.singular.begin(stretch.start, x, stretch.mode)

    def to_end(self) -> Any:
        """Return the state at the end of the segment, or where it is cut."""
        stepper = self.stepper
        try:
            while not self.solver.finished and self.step():
                self.steps += 1
                if not self._pass_step():
                    continue
                if stepper.flip is not None or self._is_cut():
                    break
                stepper.keep(self.solver.time, self.state, self.stretch.mode, self.stretch.start)
        finally:
            stepper.result.steps += self.steps
            stepper.count(self.solver.evaluations)
        stepper.tell_crawling(self.solver, self.steps, self.stretch.mode)
        if stepper.flip is not None:
            return stepper.flip.state
        return stepper.loops.solve(self.solver.time, self.state, self.stretch.mode)

    @property
    def state(self) -> Any:
        """State at the end of the last step, in SI."""
        return self.solver.state * self.magnitude

    def step(self) -> bool:
        """Make one accepted step; return False if no step is possible but an event lies just ahead."""
        stepper = self.stepper
        self.before = np.array(self.solver.state)
        try:
            self.solver.step()
        except StepFailed as failed:
            told = stepper.failed(self.solver, failed.what, self.stretch.mode)
            if isinstance(told, StepsCollapsed) and stepper.flips_just_ahead(told, self.stretch):
                return False
            raise told from None
        stepper.steps += 1
        stepper.result.rounded = max(stepper.result.rounded, self.solver.record.rounded)
        if self.steps >= MOST_STEPS or stepper.steps > stepper.most_steps:
            raise stepper.failed(self.solver, "steps", self.stretch.mode)
        return True

    # ------------------------------------------------------------ monitors of a step
    def _pass_step(self) -> bool:
        """Call all monitors of an accepted step (events, outputs, limits, work, delays); return False if the step must be repeated."""
        stepper, solver = self.stepper, self.solver
        before = stepper.position
        dense = partial(self._dense, self.stretch.mode)
        mark, whole = stepper.marked(), self.stretch
        self.stretch = stepper.follow_step(solver.last_step, solver.parts, self.stretch, dense)
        flip, start = stepper.flip, solver.last_step[0]
        if flip is not None and not is_sure(stepper, start, flip.time, self.stretch.mode, dense):
            stepper.go_back(mark)
            self._repeat(whole.up_to(start, whole.stop), stepper.shortened(start, flip.time - start))
            self.stretch = whole
            return False
        if self.stretch is not whole:
            solver.put_mode(self.stretch.mode)
        self._sample()
        stepper.look(solver, self.stretch, stepper.instants[before : stepper.position])
        start, stop = solver.last_step
        stop = stop if stepper.flip is None else stepper.flip.time
        if stepper.powers is not None:
            stepper.add_work(start, stop, self._along, self.stretch)
        if stepper.history is not None:
            dense = partial(self._dense, self.stretch.mode)
            stepper.history.keep(start, stop, dense, stepper.inputs, self.stretch.mode)
        stepper.grow(self.state if stepper.flip is None else stepper.flip.state)
        return True

    def _repeat(self, stretch: Segment, size: float) -> None:
        """Restart at the start of the last step, with a segment that begins there and a step no longer than `size`."""
        stepper, x, old = self.stepper, self.before * self.magnitude, self.solver
        stepper.count(old.evaluations)
        self.solver = interpreted(stepper, stretch, x, old.method)
        if stepper.constraints:
            stepper.singular.begin(stretch.start, x, stretch.mode)
        self.solver.begin_with(size)
        self._hold_to_peak()

    def _sample(self) -> None:
        """Store states at the reported instants within the last step; where an event ends it, the state after the event is stored."""
        stepper, solver = self.stepper, self.solver
        first = last = stepper.position
        end = self.stretch.stop if stepper.flip is None else stepper.flip.time
        while last < len(stepper.instants) and stepper.instants[last] <= solver.time and stepper.instants[last] < end:
            last += 1
        if last > first:
            times = stepper.instants[first:last]
            scaled = solver.settled(times)
            stepper.result.states[first:last] = stepper.held_all(times, scaled * self.magnitude, self.stretch.mode)
            stepper.position = last

    def _dense(self, mode: Any, times: Any, exactly: bool = True) -> Any:
        """Return states and unknowns within the last step, shape (times, n); unknowns are solved for if `exactly`, multipliers always."""
        stepper, states = self.stepper, self.solver.sample(times) * self.magnitude
        states = stepper.constraints.project_all(times, states, mode)
        return stepper.loops.solve_all(times, states, mode) if exactly or stepper.loops.affine else states

    def _along(self, times: Any) -> Any:
        """Return states within the last step from the collocation polynomial."""
        return self.solver.collocation(times) * self.magnitude

    # ------------------------------------------------------------ what a step makes of the next
    def _is_cut(self) -> bool:
        """Return True if the segment ends after this step: for another segment, another phase, or a signal that will jump. Else prepare the next step."""
        stepper, solver, stretch = self.stepper, self.solver, self.stretch
        if stepper.history is not None and stepper.history.next_cut(solver.time, stretch.stop) < stretch.stop:
            stepper.reached = solver.time  # a signal will jump; this was unknown when the segment began
            return True
        absolute = self._hold_to_peak()
        if stepper.choice is not None and not solver.finished:
            stepper.result.handover = stepper.choice.look(solver.time, self.state, stretch.mode)
            if stepper.result.handover is not None:
                return True
        if stepper.solver == AUTOMATIC and solver.is_stiff and not solver.finished:
            stepper.result.settled = RADAU
            stepper.name(RADAU, self.target)
            stepper.count(solver.evaluations)
            self.solver = interpreted(stepper, stretch.up_to(solver.time, stretch.stop), self.state, RADAU)
            self.solver.hold_to(absolute)
        elif stepper.constraints and not solver.finished:
            self._past_singular_pose(solver)
            if stepper.result.handover is not None:
                return True
        if stepper.leaving is not None and stepper.leaving.cuts(stepper, self.solver, self.steps, stretch):
            stepper.reached = self.solver.time
            return True
        return False

    def _hold_to_peak(self) -> Any:
        """Raise the magnitude of a state that exceeds it, and return the new tolerances; tolerances given by the author stay."""
        tolerances = self.stepper.tolerances
        self.peak = np.maximum(self.peak, np.abs(self.solver.state))
        absolute = tolerances.scaled * np.where(tolerances.held, 1.0, self.peak)
        self.solver.hold_to(absolute)
        return absolute

    def _past_singular_pose(self, solver: Interpreted) -> None:
        """Go on with a new solver beyond a singular pose that is near; ordinary steps near it are short."""
        stepper, mode, state = self.stepper, self.stretch.mode, self.state
        watcher = stepper.singular
        watcher.look(solver.time, state, mode)
        solver.record.longest = min(stepper.longest, watcher.longest)
        if chosen_anew(stepper, solver.time, state, mode, solver.wish):
            return
        crossed = watcher.crossing(
            solver.time, state, mode, solver.wish, self.stretch.stop, stepper.tolerances.relative
        )
        if crossed is None:
            return
        after = beyond(stepper, crossed, state, self.stretch)
        stepper.count(solver.evaluations)
        watcher.begin(end := crossed.start + crossed.size, after, mode)
        self.solver = interpreted(
            stepper,
            self.stretch.up_to(end, self.stretch.stop),
            after,
            solver.method,
            min(solver.wish, NEAR * 0.5 * crossed.size),
        )
