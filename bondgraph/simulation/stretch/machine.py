"""A stretch stepped through in machine code, and what Python does where that stops."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...door import Program
from ..closed.singular import NEAR
from ..segments import Segment
from ..steps.compiled.advance import FINISHED, HANDOVER, MORE, STIFF
from ..steps.compiled.run import CompiledRadau, obstacle, steps
from ..steps.methods import AUTOMATIC, EXPLICIT, RADAU
from ..steps.radau import StepFailed
from ..watch.stuck import MOST_COMPILED
from .poses import beyond, chosen_anew

if TYPE_CHECKING:
    from .stepper import Stepper


def obstacle_of(program: Program) -> str | None:
    """Why machine code does not make the steps, in brackets; None if it does."""
    found = obstacle(program)
    return f" ({found})" if found else None


def _solver(stepper: Stepper, stretch: Segment, x: Any, method: int) -> CompiledRadau:
    """A solver for a stretch, of which nothing but the steps is asked yet."""
    solver = CompiledRadau(
        stepper.program, stepper.inputs, stepper.constants, stepper.tolerances, stretch, x, stepper.longest,
        stepper.constraints.always_compiled, method, stepper.whole,
    )  # fmt: skip
    solver.values["automatic"] = int(stepper.solver == AUTOMATIC and method == EXPLICIT)
    return solver


def explicit_trial(stepper: Stepper, stretch: Segment, x: Any, most: int) -> tuple[dict[str, int], bool, bool]:
    """Up to so many explicit steps, of which nothing is kept: evaluations, whether stability holds the steps, whether the end came first."""
    solver = explicit_scout(stepper, stretch, x)
    answer = solver.advance(most)
    return solver.evaluations, answer == STIFF, answer == FINISHED


def explicit_scout(stepper: Stepper, stretch: Segment, x: Any) -> CompiledRadau:
    """The explicit pair from the start of a stretch, to be asked for one step after another, of which nothing is kept."""
    solver = _solver(stepper, stretch, x, EXPLICIT)
    solver.values["limit_count"] = 0
    solver.begin()
    return solver


def in_machine_code(stepper: Stepper, stretch: Segment, x: Any, method: int, size: float) -> Any:
    """As `run` from where it begins to step, by `compiled/advance.py`. `size` of all steps, if the method wants that."""
    solver = _solver(stepper, stretch, x, method)
    solver.fixed_size = size if size < np.inf else None
    first = stepper.position
    solver.report(stepper.instants, first, stepper.result.states)
    if stepper.choice is not None:
        solver.choose(stepper.choice)
    if stepper.powers is not None:
        if stepper.result.work is None:
            stepper.result.work = np.zeros_like(stepper.powers(stretch.start, x, stretch.mode))
        solver.measure(stepper.result.work, stepper.traffic)
    solver.begin()

    leaving = stepper.leaving

    def look() -> list[int]:
        passed = stepper.instants[np.searchsorted(stepper.instants, solver.last_step[0], "right") : solver.position]
        stepper.look(solver, stretch, passed)
        return [*stepper.watch.left]

    try:
        while answer := steps(solver, look, MOST_COMPILED, np.inf if leaving is None else leaving.pause):
            if answer == MORE:
                if leaving is not None and leaving.cuts(stepper, solver, solver.steps, stretch):
                    stepper.reached = float(solver.time)
                    break
                continue
            if answer == STIFF:
                stepper.result.settled = RADAU
                stepper.name(RADAU, "native")
                solver.go_on_with(RADAU)
                continue
            if answer != HANDOVER:
                _near_singular_pose(stepper, solver, stretch)
                if stepper.result.handover is not None:
                    break
                continue
            assert stepper.choice is not None
            state = solver.state * stepper.tolerances.magnitude
            stepper.result.handover = stepper.choice.look(solver.time, state, stretch.mode)
            if stepper.result.handover is not None:
                break
    except StepFailed as failed:
        _keep(stepper, solver, stretch)
        raise stepper.failed(solver, failed.what, stretch.mode) from None
    except BaseException:
        _keep(stepper, solver, stretch)
        raise
    stepper.position, stepper.traffic = solver.position, solver.traffic
    if stepper.position > first:
        times, states = (a[first : stepper.position] for a in (stepper.instants, stepper.result.states))
        states[:] = stepper.loops.solve_all(times, states, stretch.mode)
    stepper.result.steps += solver.steps
    stepper.count(solver.evaluations)
    stepper.tell_crawling(solver, solver.steps, stretch.mode)
    return stepper.loops.solve(solver.time, solver.state * stepper.tolerances.magnitude, stretch.mode)


def _keep(stepper: Stepper, solver: CompiledRadau, stretch: Segment) -> None:
    """What is sure where machine code stands. A step that is pending has not been looked at: it does not count."""
    last = solver.ends - 1 - (1 if solver.pending else 0)
    if last < 0 or solver.ends == 0:
        return
    time, n = float(solver.end_time[last]), solver.n
    state = solver.end_state[last * n : (last + 1) * n] * stepper.tolerances.magnitude
    position = max(stepper.position, int(np.searchsorted(stepper.instants, time, "right")))
    position = min(position, solver.position)
    work = None if stepper.powers is None else np.array(solver.work)
    if position > stepper.position:
        times, states = (a[stepper.position : position] for a in (stepper.instants, stepper.result.states))
        states[:] = stepper.loops.solve_all(times, states, stretch.mode)
    stepper.result.steps += solver.steps
    stepper.count(solver.evaluations)
    stepper.keep(time, state, stretch.mode, stretch.start, work, position)


def _near_singular_pose(stepper: Stepper, solver: CompiledRadau, stretch: Segment) -> None:
    """The same where machine code stopped before a pose, or where a redundant constraint may no longer be one."""
    state = solver.state * stepper.tolerances.magnitude
    watcher = stepper.singular
    watcher.ahead, watcher.tried, watcher.comes = solver.ahead, solver.tried, bool(solver.comes)
    watcher.check_redundant(solver.time, state, stretch.mode)
    wish = solver.size
    if chosen_anew(stepper, solver.time, state, stretch.mode, wish):
        return
    crossed = watcher.crossing(solver.time, state, stretch.mode, wish, stretch.stop, stepper.tolerances.relative)
    if crossed is None:
        solver.note_tried(watcher.tried)
        return
    stepper.position, stepper.traffic = solver.position, solver.traffic
    after = beyond(stepper, crossed, state, stretch)
    solver.begin_again(crossed.start + crossed.size, after, min(wish, NEAR * 0.5 * crossed.size))
    stepper.result.work = solver.went_on(stepper.position, stepper.result.work, stepper.traffic)
