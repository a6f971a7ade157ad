"""Integration of segments by the loop of `compiled/advance.py`, and the work of Python where it stops: after each step, where there is no machine code."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import AUTOMATIC, Array

from ...errors import StepsCollapsed
from ..integrators.compiled.run import CompiledMethod, obstacle, steps
from ..integrators.methods import CHOSEN, EXPLICIT, EXPONENTIAL, METHODS, PARTS, RADAU
from ..integrators.outcomes import FINISHED, FLIP, HANDOVER, MORE, STIFF
from ..integrators.projection.limits import NEAR
from ..integrators.radau import StepFailed
from ..monitors.extremes import PLACES
from ..monitors.step_failure import MOST_COMPILED, MOST_STEPS
from ..monitors.step_size_diagnosis import MANY
from ..segments.timeline import Segment
from .cut import is_sure
from .poses import beyond, chosen_anew

MOST_OVER = 1000  # most steps of a run over instants at which a law of a loop is flat
LARGEST_SPARE = 64  # most states of a workspace that is left to the next run

if TYPE_CHECKING:
    from ..constraints.crossing import Crossed
    from ..segments.trajectory import Tolerances
    from .integration_state import IntegrationState
    from .passed_events import PassedEvents


def target_of(stepper: IntegrationState) -> str:
    """Return the name in the result of the code that makes the steps."""
    if stepper.program.native is None:
        return "numpy" if stepper.history is None else "numpy (delays)"
    found = obstacle(stepper.program)
    return f"numpy ({found})" if found else "native"


def explicit_trial(
    stepper: IntegrationState, stretch: Segment, x: Array, most: int
) -> tuple[dict[str, int], bool, bool]:
    """Make up to `most` explicit steps without keeping them; return evaluations, True if stability limits the steps, True if the end was reached."""
    solver = explicit_scout(stepper, stretch, x)
    answer = solver.advance(most)
    return solver.evaluations, answer == STIFF, answer == FINISHED


def explicit_scout(stepper: IntegrationState, stretch: Segment, x: Array) -> CompiledMethod:
    """Return DOP853 from the start of a segment, for single steps that are not kept."""
    solver = _solver(stepper, stretch, x, EXPLICIT)
    solver.values["limit_count"] = solver.values["root_count"] = 0
    solver.begin()
    return solver


def _solver(stepper: IntegrationState, stretch: Segment, x: Array, method: int) -> CompiledMethod:
    """Return a solver for a segment with steps only: no events, limits or outputs attached yet."""
    native = not obstacle(stepper.program)
    solver = CompiledMethod(
        stepper.context, stretch, x, stepper.longest, stepper.constraints.always_compiled(native), stepper.signals(stretch), method
    )  # fmt: skip
    solver.values["automatic"] = _automatic(stepper, method)
    return solver


def is_repeatable(stepper: IntegrationState) -> bool:
    """Return True if another run with the same values and options may begin with the workspace of this one as it began; a large one is not kept."""
    program, monitors = stepper.program, (stepper.powers, stepper.extremes, stepper.leaving, stepper.history)
    plain = program.hybrid is None and not stepper.constraints and all(monitor is None for monitor in monitors)
    return plain and not obstacle(program) and len(program.variables.names) <= LARGEST_SPARE


@dataclass(slots=True)
class Beginning:
    """Beginning of the steps of a segment: True if another run may begin so, the method with evaluations of the trial steps that chose it, True if it is
    also that of all further segments, and the workspace, if a run has begun so."""

    repeatable: bool
    method: int
    evaluations: Mapping[str, int]
    settled: bool
    workspace: CompiledMethod | None = None


def _automatic(stepper: IntegrationState, method: int) -> int:
    """Return 1 if another method may take over, else 0."""
    return int(stepper.solver == AUTOMATIC and method in (EXPLICIT, EXPONENTIAL))


class NativeIntegrator:
    """Integrator of steps over successive segments; the data set up for the first segment serves all."""

    def __init__(
        self, stepper: IntegrationState, stretch: Segment, x: Array, begins: Beginning, size: float | None = None
    ) -> None:
        """`size`: of all steps, for a method with equal steps."""
        self.stepper, self.stretch, self.first = stepper, stretch, stepper.position
        self.tolerances: Tolerances = stepper.tolerances
        self.steps_over = 0  # steps over instants at which a law of a loop is flat
        self.noted = False  # True while the checkpoint before the last step is stored
        self.passed = 0  # number of steps after which Python has acted
        self.events: PassedEvents | None = None
        self.begins, method = begins, begins.method
        begun: CompiledMethod | None = self.tolerances.kept.get("workspace") if METHODS[method].exact else None
        if begins.workspace is not None:
            solver = self.solver = begins.workspace
            solver.begin_once_more(stretch.mode)
        elif begun is not None:
            solver = self.solver = begun
        else:
            solver = self.solver = _solver(stepper, stretch, x, method)
            solver.fixed_size = size
        solver.report(stepper.instants, stepper.position, stepper.result.states)
        if stepper.choice is not None:
            solver.choose(stepper.choice)
        if begins.workspace is not None:
            return
        if stepper.powers is not None:
            if stepper.result.work is None:
                stepper.result.work = np.zeros_like(stepper.powers(stretch.start, x, stretch.mode))
            solver.measure(stepper.result.work, stepper.traffic)
        if stepper.extremes is not None:
            solver.keep_places(PLACES)
        solver.doubt(stepper.floor)
        if begun is not None:
            solver.record.rounded, solver.left[:], solver.missed[:] = 0.0, 0, 0.0
            solver.begin_at(stretch, x, stepper.signals(stretch), method, _automatic(stepper, method))
        else:
            solver.begin()
        if solver.native and METHODS[method].exact:
            self.tolerances.kept["workspace"] = solver
        if begins.repeatable and size is None:
            solver.save()
            begins.workspace = solver
        if solver.native and method in CHOSEN and stepper.events is not None:
            from .passed_events import PassedEvents, is_passable

            if is_passable(stepper):
                self.events = PassedEvents(stepper, solver)
                self.events.begin(stretch.mode, method)

    def begin_at(self, stretch: Segment, x: Array, method: int) -> None:
        """Go on with another segment."""
        stepper, solver = self.stepper, self.solver
        self.stretch, self.first, self.noted, self.passed = stretch, stepper.position, False, 0
        solver.doubt(stepper.floor)
        stepper.result.work = solver.went_on(stepper.position, stepper.result.work, stepper.traffic)
        automatic = _automatic(stepper, method)
        solver.begin_at(stretch, x, stepper.signals(stretch), method, automatic)
        if self.events is not None:
            self.events.begin(stretch.mode, method)

    def to_end(self) -> Any:
        """Return the state at the end of the segment, or where it is cut."""
        stepper, solver = self.stepper, self.solver
        answer = MORE
        try:
            while answer != FINISHED:
                answer = self._steps()
                if answer != FLIP and not solver.native and self._is_cut_by_delay():
                    break
                if answer != FINISHED and self._is_cut(answer):
                    break
        except BaseException:
            if solver.native and not self.noted:
                self._note()
            stepper.result.steps += solver.steps
            stepper.count(solver.evaluations)
            raise
        record = solver.record
        self._look_at_places()
        stepper.position, stepper.traffic = record.position, record.traffic
        self._put_unknowns(self.first, stepper.position)
        stepper.steps += record.steps
        stepper.result.steps += record.steps
        stepper.count(solver.evaluations)
        stepper.result.rounded = max(stepper.result.rounded, record.rounded)
        if np.count_nonzero(solver.missed):
            stepper.result.missed = np.maximum(stepper.result.missed, solver.missed)
        stepper.tell_crawling(solver, record.steps, self.stretch)
        if stepper.events is not None:
            stepper.grow(solver.greatest * self.tolerances.magnitude)
        if stepper.flip is not None:
            stepper.grow(stepper.flip.state)
            return stepper.flip.state
        if not stepper.program.unknowns.names:
            return self._state
        return stepper.loops.solve(record.time, self._state, self.stretch.mode)

    @property
    def _state(self) -> Any:
        """State at the end of the last step, in SI."""
        return self.solver.state * self.tolerances.magnitude

    def _steps(self) -> int:
        """Step until the loop returns control; `FINISHED` at the end of the segment. Raises `RunFailed`."""
        stepper, native = self.stepper, self.solver.native
        pause = np.inf if stepper.leaving is None or not native else stepper.leaving.pause
        most = MOST_COMPILED if native else MOST_STEPS
        if stepper.most_steps < MOST_STEPS:
            most = stepper.most_steps - stepper.steps
        passed, events = self.events, stepper.events
        soon = most if events is None or not len(events.sampled) else min(most, self.solver.steps + MANY)
        if passed is not None:
            passed.hand_over()
        try:
            return steps(self.solver, self._look, soon, pause, passed)
        except StepFailed as failed:
            if failed.what == "steps" and soon < most:
                stepper.check_runaway(self.solver.time, self._state)
                return MORE
            told = stepper.failed(self.solver, failed.what, self.stretch.mode)
            if isinstance(told, StepsCollapsed) and stepper.flips_just_ahead(told, self.stretch):
                return FINISHED
            if isinstance(told, StepsCollapsed) and self._steps_over(told):
                return MORE
            raise told from None
        finally:
            if passed is not None:
                self.stretch = passed.take_over()
                self.noted = False

    def _steps_over(self, told: StepsCollapsed) -> bool:
        """Go on behind an instant at which a law of a loop is flat; False if nothing leads on."""
        from .flat_laws import step_over

        state = self._state
        step = step_over(self.stepper, told, state, self.stretch) if self.steps_over < MOST_OVER else None
        if step is None:
            return False
        self.steps_over += 1
        self._note()
        self._go_beyond(step, state, step.size)
        return True

    def _go_beyond(self, step: Crossed, state: Array, size: float) -> None:
        """Go on behind a step made by other means, with a first step no longer than `size`. `state`: before it."""
        stepper, solver = self.stepper, self.solver
        stepper.position, stepper.traffic = solver.position, solver.traffic
        solver.begin_again(step.start + step.size, beyond(stepper, step, state, self.stretch), size)
        stepper.result.work = solver.went_on(stepper.position, stepper.result.work, stepper.traffic)

    def _look(self) -> list[int]:
        """Check the limits of the model in the last step; return those that are violated."""
        stepper, solver = self.stepper, self.solver
        if solver.record.kept + solver.record.place_count > solver.record.kept_room:
            self._look_at_places()
        passed = stepper.instants[np.searchsorted(stepper.instants, solver.last_step[0], "right") : solver.position]
        stepper.look(solver, self.stretch, passed)
        return [*stepper.watch.left]

    def _look_at_places(self) -> None:
        """Search the outputs for their extremes in the steps whose states are stored."""
        stepper = self.stepper
        if stepper.extremes is not None:
            stepper.look_at_places(stepper.extremes, *self.solver.kept_steps(), self.stretch.mode)

    def _is_cut_by_delay(self) -> bool:
        """Complete a step of Python: store delayed signals and a checkpoint. Return True if a delayed signal will jump in this segment."""
        stepper, solver, history = self.stepper, self.solver, self.stepper.history
        if solver.steps == self.passed:
            return False
        self.passed = solver.steps
        (start, stop), flip = solver.last_step, stepper.flip
        if history is not None:
            stop = stop if flip is None else flip.time
            relative = stepper.tolerances.relative
            history.keep(
                (start, stop), lambda times: self._states_at(times, True), stepper.inputs, self.stretch.mode, relative
            )
        if flip is not None:
            return False
        self._note()
        self.first = stepper.position = solver.position
        if history is None or not history.next_cut(solver.time, self.stretch.stop) < self.stretch.stop:
            return False
        stepper.reached = solver.time  # this was unknown when the segment began
        return True

    def _is_cut(self, answer: int) -> bool:
        """Return True if the segment ends at the instant at which the loop returned control."""
        stepper, solver, stretch = self.stepper, self.solver, self.stretch
        if answer == MORE:
            if stepper.leaving is None or not stepper.leaving.cuts(stepper, solver, solver.steps, stretch):
                return False
            stepper.reached = float(solver.time)
            return True
        if answer == FLIP:
            self._follow()
        elif answer == STIFF:
            stepper.result.settled = RADAU
            self.tolerances.kept.pop("workspace", None)  # it is no longer as one of its method begins
            stepper.name(RADAU, target_of(stepper))
            solver.go_on_with(RADAU)
        elif answer == HANDOVER:
            assert stepper.choice is not None
            stepper.result.handover = stepper.choice.look(solver.time, self._state, stretch.mode)
        else:
            self._near_singular_pose()
        return stepper.result.handover is not None

    def _follow(self) -> None:
        """Locate a zero crossing in the last step; its monitors then get the shortened step, or another mode."""
        stepper, solver = self.stepper, self.solver
        self._note()
        self.noted = True
        parts = PARTS[solver.record.method]
        mark, before, start = stepper.marked(), self.stretch, solver.last_step[0]
        self._look_at_places()  # in the mode so far
        self.stretch = stepper.follow_step(solver.last_step, parts, self.stretch, self._states_at, solver)
        flip = stepper.flip
        exact = METHODS[solver.record.method].exact
        if (
            flip is not None
            and not exact
            and not is_sure(stepper, start, flip.time, self.stretch.mode, self._states_at)
        ):
            stepper.go_back(mark)
            self.stretch = before
            solver.put_mode(before.mode)
            solver.repeat(stepper.shortened(start, flip.time - start))
        else:
            solver.put_mode(self.stretch.mode)
            solver.doubt(stepper.floor)
            if exact and self.stretch is not before:
                solver.record.last_size = 0.0  # the matrix is another
        if stepper.flip is not None:
            solver.end_at(stepper.flip.time)
        else:
            self.noted = False

    def _states_at(self, times: Array, exactly: bool) -> Any:
        """Return states in the last step, with the unknowns solved for if `exactly`."""
        stepper, mode = self.stepper, self.stretch.mode
        states = self.solver.states(times, mode)
        return stepper.held_all(times, states, mode) if exactly else states

    def _note(self) -> None:
        """Store a checkpoint at the current instant. A pending step has not been checked, so it does not count."""
        stepper, solver = self.stepper, self.solver
        record = solver.record
        last = record.ends - 1 - (1 if record.pending else 0)
        if last < 0 or record.ends == 0:
            return
        time, n = float(solver.end_time[last]), record.n
        state = solver.end_state[last * n : (last + 1) * n] * self.tolerances.magnitude
        position = max(stepper.position, int(np.searchsorted(stepper.instants, time, "right")))
        position = min(position, record.position)
        work = None if stepper.powers is None else np.array(solver.work)
        self._put_unknowns(stepper.position, position)
        stepper.keep(time, state, self.stretch.mode, self.stretch.start, work, position)

    def _put_unknowns(self, first: int, last: int) -> None:
        """Compute the unknowns of loops at these instants."""
        stepper = self.stepper
        if last > first and stepper.program.unknowns.names:
            times, states = (a[first:last] for a in (stepper.instants, stepper.result.states))
            states[:] = stepper.loops.solve_all(times, states, self.stretch.mode)

    def _near_singular_pose(self) -> None:
        """Go on where machine code stopped before a singular pose, or where a redundant constraint may become independent."""
        stepper, solver, stretch = self.stepper, self.solver, self.stretch
        state, watcher = self._state, stepper.singular
        watcher.ahead, watcher.tried, watcher.comes = solver.ahead, solver.tried, bool(solver.comes)
        watcher.check_redundant(solver.time, state, stretch.mode)
        wish = solver.size
        if chosen_anew(stepper, solver.time, state, stretch.mode, wish):
            return
        crossed = watcher.crossing(solver.time, state, stretch.mode, wish, stretch.stop, self.tolerances.relative)
        if crossed is None:
            solver.record.tried = watcher.tried
            return
        self._go_beyond(crossed, state, min(wish, NEAR * 0.5 * crossed.size))
