"""Integrator over smooth segments: it chooses the method of each, and lets it run from one state to the next."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array

from ...errors import UsageError
from ..integrators.methods import METHODS
from ..segments.timeline import Segment, with_time_of
from .integration_state import IntegrationState
from .stateless import without_states

if TYPE_CHECKING:
    from ..segments.trajectory import Trajectory
    from .native_integrator import Beginning, NativeIntegrator


class SegmentIntegrator(IntegrationState):
    """Integrator over successive smooth segments, with the requested results."""

    machine: NativeIntegrator | None = None  # the integrator of steps, from the first segment on
    begins: Beginning | None = None  # of the steps of an earlier run with the same values, or of this one for the next
    target = ""  # name in the result of the code that makes the steps
    has_conditions = False  # True if conditions on states are located

    def let_go(self) -> None:
        """Release the integrator of steps, which refers to this object, so that memory is freed at once, without the garbage collector."""
        if self.machine is not None and self.machine.begins.workspace is not None:
            self.begins, tolerances = self.machine.begins, self.tolerances
            self._tolerances = lambda: tolerances  # without the phase, which refers to this object
        self.machine = None

    def through(self, state: Array, stretches: Sequence[Segment]) -> Trajectory:
        """Integrate over the segments, to the end or to a transition. Raises `RunFailed`."""
        x = np.array(state, dtype=float)
        for number, stretch in enumerate(stretches):
            if number:
                before, after = stretches[number - 1].mode, stretch.mode
                if self.mode is not None:
                    before, after = self.mode, with_time_of(self.program, after, self.mode)
                self.check_forced(stretch.start, before, after, x)
            x = self.run_to_end(stretch, x, not number)
            if self.result.handover is not None or self.result.stopped is not None:
                break
        return self.done(*self.finish(stretches[-1], x))

    def finish(self, last: Segment, x: Array) -> tuple[Any, Any]:
        """Return the state and the mode at the very end."""
        return x, last.mode

    def run_to_end(self, stretch: Segment, x: Array, first: bool) -> Any:
        """Integrate one segment; it is cut where a delayed signal jumps, and where fast modes are removed. `first`: its mode is that of the start."""
        start = stretch.start
        while True:
            stop = stretch.stop if self.history is None else self.history.next_cut(start, stretch.stop)
            x = self.run(stretch.up_to(start, stop), x)
            start = self.reached
            if start >= stretch.stop or self.result.handover is not None:
                return x

    def run(self, stretch: Segment, x: Array) -> Any:
        """Integrate one segment from state x, or up to the first event in it; return the state at its end."""
        self.reached = stretch.stop
        if self.history is not None:
            self.history.window = stretch.start, stretch.stop
        x = self.held(stretch.start, x, stretch.mode)
        first, last = self.position, self.result.kept
        if not self.linear:
            x = self._without_ringing(stretch, x)
        self._put_start(stretch, x, first)
        if not len(self.program.states.names):
            return without_states(self, stretch, x, last)
        if self.program.limits:
            self.watch.look(np.array([stretch.start]), stretch.mode, lambda times: x[None].repeat(len(times), axis=0))
        if self.linear:
            from .exact import exactly

            end = exactly(self, stretch, x)
            if end is not None:
                return end
        if self.solver == "exponential" and not self.has_conditions:
            from .exact import check_driven

            check_driven(self, stretch, x)
            raise UsageError(
                "BR715", "the matrix exponential takes linear models of up to a few hundred states, without noise and delays, whose inputs "
                "a few thousand polynomials can follow;", "leave the solver to choose",
            )  # fmt: skip
        if self.linear:  # the exact solution was not possible
            x = self._without_ringing(stretch, x)
            self._put_start(stretch, x, first)
        return self._by_steps(stretch, x)

    def _put_start(self, stretch: Segment, x: Array, first: int) -> None:
        """Store the initial state of a segment at all reported instants, from the index `first` on, that are no later."""
        self.position = first
        while self.position < len(self.instants) and self.instants[self.position] <= stretch.start:
            self.result.states[self.position] = x
            self.position += 1
        self.keep(stretch.start, x, stretch.mode, stretch.start)

    def _without_ringing(self, stretch: Segment, x: Array) -> Any:
        """Return the state without the modes faster than the bandwidth, if there is one."""
        if self.leaving is None or not len(self.program.states.names):
            return x
        return self.leaving.begin(self, stretch, x)

    def _by_steps(self, stretch: Segment, x: Array) -> Any:
        """Integrate one segment by a method that chooses its steps."""
        from .native_integrator import Beginning, NativeIntegrator, is_repeatable, target_of

        machine, begins = self.machine, self.begins
        target = self.target = self.target or target_of(self)
        if begins is None or machine is not None:
            from .method import method_of

            repeatable = machine is None and is_repeatable(self)
            begins = Beginning(repeatable, *method_of(self, stretch, x, target == "native"))
            if self.begins is None:  # else an earlier run has come through here
                self.check_rates(stretch.start, x, stretch.mode)
        method = begins.method
        self.count(begins.evaluations)
        if begins.settled:
            self.result.settled = method
        self.name(method, target)
        if METHODS[method].conserving:
            from .conserving import equal_steps

            machine = NativeIntegrator(self, stretch, x, begins, equal_steps(self, stretch, x))
        elif machine is None or machine.tolerances is not self.tolerances:
            machine = NativeIntegrator(self, stretch, x, begins)
        else:
            machine.begin_at(stretch, x, method)
        self.machine = machine
        return machine.to_end()
