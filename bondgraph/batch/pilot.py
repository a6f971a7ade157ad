"""Pilot runs of a batch and their magnitudes: the steps of `magnitudes/pilot_run.py` for all runs, in the cases in which none of them fails."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ..errors import RunFailed
from ..simulation.constraints.constraints import Constraints
from ..simulation.integrators.compiled.pilot_run import SMALL, pilot_forms
from ..simulation.integrators.compiled.record_layout import RecordBatch
from ..simulation.integrators.compiled.run import Ordered
from ..simulation.integrators.compiled.selection_record import selection_batch
from ..simulation.integrators.linear_algebra.sparse import FINE, SINGULAR
from ..simulation.integrators.pilot.schedule import CAREFUL, MOST_STEPS, NOTES
from ..simulation.magnitudes.free_response import FreeResponse, free_responses, slopes_of
from ..simulation.magnitudes.nominal_magnitudes import RESTING, nominal_magnitudes, raised
from ..simulation.magnitudes.pilot_run import (
    COARSE,
    SMALLEST_STEP,
    STEPS,
    STIFFER,
    PilotObservation,
    PilotObserver,
    before_explosion,
    goes_astray,
    smallest_angles,
    trusted,
)
from ..simulation.segments.timeline import Segment, always, follower, signals_on
from .runs import BatchCourse, Runs
from .scope import BatchScene


@dataclass(frozen=True, slots=True, eq=False)
class FreeReach:
    """Free motions of runs from their starts: for each run the data of the pilot run, and the magnitudes of the beginning (runs, n)."""

    moves: Any  # (runs,): True if its reach counts
    amplitudes: Any  # (runs, n n)
    inverse: Any  # (runs, n n), complex
    scale: Any  # (runs, n)
    beginning: Any

    def those(self, rows: Any) -> FreeReach:
        """Return those of some of the runs."""
        return FreeReach(*(x[rows] for x in (self.moves, self.amplitudes, self.inverse, self.scale, self.beginning)))


def free_reach(scene: BatchScene, runs: Runs, first: Segment, length: float) -> FreeReach:
    """Return the reach of the free motions of runs, as `PilotRun._reach` does for one."""
    program, (count, n) = scene.program, runs.state.shape
    at = scene.inputs, runs.constants, first.mode
    jacobians = slopes_of(
        program, first.start, runs.state, *at, smallest_angles(program, scene.compiled_scene.facts.mechanisms)
    )
    rates = program.derivative(first.start, runs.state, *at)
    size = np.abs(runs.state)
    reach = FreeReach(
        np.zeros(count, dtype=bool), np.zeros((count, n * n)), np.zeros((count, n * n), dtype=complex), np.ones((count, n)), size.copy(),
    )  # fmt: skip
    for rows, motion in free_responses(jacobians, True, length):
        state = runs.state[rows]
        away = motion.rest(rates[rows], length)
        whole = np.abs(state + away) + motion(away)
        goes = ~_stiffens(scene, runs.those(rows), motion, first)
        reach.moves[rows] = goes
        reach.amplitudes[rows] = motion.amplitudes.reshape(len(rows), -1)
        reach.inverse[rows] = motion.inverse.reshape(len(rows), -1)
        reach.scale[rows] = motion.scale
        returns = (np.isfinite(away).all(axis=1) & goes)[:, None]
        reach.beginning[rows] = np.where(returns, np.maximum(size[rows], whole), size[rows])
    return reach


def _stiffens(scene: BatchScene, runs: Runs, motion: FreeResponse, first: Segment) -> Any:
    """Return a mask of the runs whose rates grow so much along their free motion that they never get there."""
    far = motion(runs.state)
    there = np.stack([runs.state + far, runs.state - far], axis=1)
    jacobians = scene.program.jacobian(first.start, there, scene.inputs, runs.constants[:, None], first.mode)
    return (motion.fastest > 0) & ~motion.is_slower_than(STIFFER * motion.fastest, jacobians)


def largest_values(scene: BatchScene, runs: Runs, course: BatchCourse) -> tuple[Any, Any]:
    """Return the largest values of the states in pilot runs that are trusted, shape (runs, n), and a mask of the runs for which they are certain."""
    program, first = scene.program, course.segments[0]
    reach = free_reach(scene, runs, first, course.whole)
    largest, sound = _observed(scene, runs, course, reach)
    driven = len(program.signals(first.start, scene.inputs, runs.constants[0], first.mode)) > 0
    if driven or len(course.segments) > 1:
        return largest, sound
    astray = sound & goes_astray(program, largest, reach.beginning)
    if scene.state_selection(runs.constants):  # parts of a run go on with the largest values of those before
        return largest, sound & ~astray
    rows = np.flatnonzero(astray)
    some, reach, looks = runs.those(rows), reach.those(rows), {first.stop: largest[rows]}

    def look_along(place: int, way: Sequence[Segment]) -> PilotObserver:
        stop = way[-1].stop
        if stop not in looks:
            looks[stop], certain = _observed(scene, some, replace(course, segments=tuple(way)), reach)
            sound[rows] &= certain
        values = looks[stop][place]
        return PilotObserver(values, reach.beginning[place], None, values)

    for place, row in enumerate(rows.tolist()):
        largest[row] = trusted(partial(look_along, place), program, course.segments, False).largest
    return largest, sound


def _observed(scene: BatchScene, runs: Runs, course: BatchCourse, reach: FreeReach) -> tuple[Any, Any]:
    """Return the largest values in pilot runs over these segments, and a mask of the runs for which they are certain."""
    first, stretches = course.segments[0], course.segments
    loop, steps = _records(scene, runs, reach, first)
    sound, taken = np.ones(len(runs), dtype=bool), np.zeros(len(runs), dtype=int)
    stopped = ~sound  # runs that gave up
    choice = scene.state_selection(runs.constants)
    if choice:
        loop.put({"selection": selection_batch(choice, choice.peak)})
    for stretch in stretches:
        length = stretch.stop - stretch.start
        usual = length / max(2, min(STEPS, round(STEPS * length / course.whole)))
        smallest, follows = SMALLEST_STEP * course.whole, _follows(scene, stretch, course)
        size = usual
        while size > smallest and not follows(stretch.start, stretch.start + size):
            size *= 0.25
        steps["mode"][:] = stretch.mode
        sizes = {"size": size, "usual": usual, "smallest": smallest}
        loop.put({"time": stretch.start, "stop": stretch.stop, "taken": taken, **sizes})
        stopped |= _advance(loop, "coarse", sound)
        times, taken = loop["time"], loop["taken"].copy()
        sound &= (taken < MOST_STEPS) & (taken + 1 != CAREFUL)
        ends = {
            time: stretch.stop - time <= smallest or follows(time, stretch.stop) for time in set(times[sound].tolist())
        }
        sound[sound] = [ends[time] for time in times[sound].tolist()]
        loop.put({"size": stretch.stop - times})
        _advance(loop, "pilot_step", sound)
        taken = loop["taken"].copy()
    largest, reached = steps["largest"].copy(), loop["time"] - first.start
    until = loop["until"].reshape(len(runs), NOTES, -1)
    largest[stopped] = before_explosion(*(a[stopped] for a in (largest, loop["far"], until, loop["noted"], reached)))
    return largest, sound | stopped


def _advance(loop: RecordBatch, source: str, sound: Any) -> Any:
    """Call a function for the runs that are sound; those with another answer than `FINE` are not any more. Return a mask of those without a short
    enough step."""
    rows, failed = np.flatnonzero(sound), np.zeros(len(sound), dtype=bool)
    answers = loop.call(source, rows)
    sound[rows], failed[rows] = answers == FINE, answers == SINGULAR
    return failed


def _follows(scene: BatchScene, stretch: Segment, course: BatchCourse) -> Any:
    """Return the test that a step resolves the signals of time, the same for all runs."""
    if not 1 < len(course.segments) <= STEPS:
        return always
    at = scene.program, scene.inputs, course.constants
    return follower(*at, stretch, signals_on(*at, stretch, course.whole), COARSE)


def _records(scene: BatchScene, runs: Runs, reach: FreeReach, first: Segment) -> tuple[RecordBatch, RecordBatch]:
    """Return the records of the loops over steps, and of the steps."""
    program, (count, n) = scene.program, runs.state.shape
    rows, columns = program.pattern
    of_step, of_loop = pilot_forms(program, runs.constants[0])
    steps = RecordBatch(of_step, count, {
        "inputs": scene.inputs, "constants": runs.constants, "rows": rows, "columns": columns,
        "pattern": Ordered(program, SMALL).values, "smallest": smallest_angles(program, scene.compiled_scene.facts.mechanisms),
    })  # fmt: skip
    steps["largest"][:] = np.abs(runs.state)
    loop = RecordBatch(of_loop, count, {
        "euler": steps, "reaching": reach.moves, "amplitudes": reach.amplitudes, "inverse_re": reach.inverse.real,
        "inverse_im": reach.inverse.imag, "unit": reach.scale, "state": runs.state.copy(), "far": np.zeros((count, NOTES)),
        "until": np.zeros((count, NOTES * n)), "begun": first.start, "noted": 0,
    })  # fmt: skip
    return loop, steps


def batch_magnitudes(scene: BatchScene, runs: Runs, course: BatchCourse) -> tuple[Any, Any]:
    """Return the magnitudes of the states, shape (runs, n), and a mask of the runs for which they are certain."""
    program, mechanisms = scene.program, scene.compiled_scene.facts.mechanisms
    largest, sound = largest_values(scene, runs, course)
    nominal, peak = program.nominal(runs.constants), np.maximum(np.abs(runs.state), largest)
    levels = smallest_angles(program, mechanisms)
    result = raised(program, mechanisms, np.where(nominal > 0, nominal, peak), levels)
    sound &= ((result > RESTING * levels) & np.isfinite(result)).all(axis=1)
    for row in np.flatnonzero(~sound).tolist():
        values = _alone(scene, runs, course, row)
        if values is not None:
            result[row], sound[row] = values, True
    return result, sound


def _alone(scene: BatchScene, runs: Runs, course: BatchCourse, row: int) -> Any:
    """Return the magnitudes of one run, whose pilot run needs Python; None if they are doubtful."""
    program, choice = scene.program, scene.state_selection(runs.constants[row])
    constraints = Constraints(program, runs.parameters[row], scene.inputs, np.ones(runs.state.shape[1]))
    mechanisms = scene.compiled_scene.facts.mechanisms
    try:
        magnitudes = nominal_magnitudes(
            constraints, mechanisms, runs.state[row], list(course.segments), PilotObservation(choice, rtol=scene.options.rtol)
        )  # fmt: skip
    except RunFailed:
        return None
    return None if magnitudes.doubts else magnitudes.values
