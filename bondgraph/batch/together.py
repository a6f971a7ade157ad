"""Runs of one scene together: the parameters of each, in stages over all of them, to a result of each; bit by bit that of a run alone.

A run for which anything else than steps is needed has no result here: it is to be made alone.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from compiler.api import SOLVERS, Array, uncollected

from ..compiled_model import CompiledModel
from ..compiled_scene import chosen_target
from ..numerics.threads import OneThread
from ..results.checkpoint import Checkpoint
from ..results.later import later
from ..results.records import LimitLeft
from ..results.result import Result
from ..simulation.integrators.exponential import RunsPart, intervals, linear_form, march
from ..simulation.magnitudes.pilot_run import smallest_angles
from ..simulation.phases.cancellation import (
    EXACT,
    Places,
    doubts_on_outputs,
    largest_outputs,
    places_of_terms,
    rows_of_terms,
    terms_of_outputs,
)
from ..simulation.run_options import RunRequest
from ..simulation.segments.timeline import mode_after
from ..simulation.settings import Settings, SettledPoints, settle_all
from .pilot import batch_magnitudes
from .runs import BatchCourse, BatchTrajectories, Runs, goes_on, grouped
from .scope import BatchScene, batch_scene
from .steps import BatchIntegrator

FEWEST = 3  # runs of a group; fewer take longer together than alone
MOST_NUMBERS = 8_000_000  # in states and outputs of runs that are stepped at once


def simulate_together(model: CompiledModel, request: RunRequest, points: Sequence[Settings]) -> list[Result | None]:
    """Return the results of the requested run with further settings, those of each point; None for a run that is to be made alone."""
    results: list[Result | None] = [None] * len(points)
    settled = _settled(model, request, points)
    scene = None if settled is None else batch_scene(model, settled.scene, request.options)
    if settled is None or scene is None:
        return results
    program, rows = scene.program, settled.rows
    parameters = np.tile(np.array(program.defaults, dtype=float), (len(rows), 1))
    for place, name in enumerate(program.parameters.names):
        if name in settled.values:
            parameters[:, place] = settled.values[name]
    with np.errstate(all="ignore"), OneThread(len(program.states.names)), uncollected():
        for runs, course in grouped(scene, parameters):
            for part in _parts(scene, runs):
                for number, result in _results(scene, part, course):
                    results[rows[number]] = result
    return results


def _parts(scene: BatchScene, runs: Runs) -> Iterator[Runs]:
    """Yield so many runs at once as memory is meant for; none of so few that they are faster alone."""
    most = max(1, MOST_NUMBERS // scene.numbers)
    for first in range(0, len(runs), most):
        part = runs.those(slice(first, first + most))
        if len(part) >= FEWEST:
            yield part


def is_together(model: CompiledModel, request: RunRequest, point: Settings) -> bool:
    """Return True if runs at points like this one may be stepped together."""
    settled, wanted = _settled(model, request, [point]), request.options
    return settled is not None and len(settled.rows) > 0 and batch_scene(model, settled.scene, wanted) is not None


def _settled(model: CompiledModel, request: RunRequest, points: Sequence[Settings]) -> SettledPoints | None:
    settings, target = [{**request.settings, **point} for point in points], chosen_target(request.options.target)
    return settle_all(model, request.experiment, settings, request.outputs, target)


def _results(scene: BatchScene, runs: Runs, course: BatchCourse) -> Iterator[tuple[int, Result]]:
    """Yield the results of runs with equal segments, by their numbers; none of those that need more than steps."""
    began = clock.perf_counter()
    magnitude = None
    if scene.linear:
        try:
            trajectories = exact_trajectories(scene, runs, course)
        except RunsPart as part:
            for some in (part.those, ~part.those):
                if np.count_nonzero(some) >= FEWEST:
                    yield from _results(scene, runs.those(some), course)
            return
    else:
        magnitude, sound = batch_magnitudes(scene, runs, course)
        runs, magnitude = runs.those(sound), magnitude[sound]
        trajectories = BatchIntegrator(scene, runs, course, magnitude).through() if len(runs) else None
    if trajectories is None or course.crowded:
        return
    values = _outputs(scene, runs, course, trajectories)
    sound = trajectories.sound & np.isfinite(values.reshape(len(values), -1).sum(axis=1))
    final, last = trajectories.states[:, -1], course.segments[-1]
    stored = trajectories.choice.contents(float(scene.instants[-1]), final, last.mode)
    sizes = np.empty((len(runs), 0)) if magnitude is None else magnitude
    at_rows = rows_of_terms(scene.instants, trajectories.states, course.segments)
    places = places_of_terms(scene.instants, trajectories.states, at_rows)
    time = (clock.perf_counter() - began) / len(runs)
    for row in np.flatnonzero(sound).tolist():
        at = None if places is None else (places[0], places[1][row], places[2])
        ended = runs.parameters[row], stored[row], trajectories.choice.peak[row], sizes[row]
        both = (
            partial(
                _warnings, scene, runs.constants[row], at, values[row], trajectories.absolute[row], trajectories.fixed
            ),
            partial(_checkpoint, scene, *ended),
        )
        yield int(runs.numbers[row]), _result(scene, course, trajectories, row, values[row], both, time)


def _outputs(scene: BatchScene, runs: Runs, course: BatchCourse, trajectories: BatchTrajectories) -> Any:
    """Return the outputs, shape (runs, points, outputs)."""
    program, instants, states = scene.program, scene.instants, trajectories.states
    values = np.empty((*states.shape[:2], len(program.outputs.names)))
    for segment in course.segments:
        part = slice(*instants.searchsorted((segment.start, segment.stop)).tolist())
        if part.start < part.stop:
            for row, outputs in enumerate(_outputs_of(scene, runs, instants[part], states[:, part], segment.mode)):
                values[row, part] = outputs
    last = course.segments[-1]
    modes = mode_after(program, runs.constants, last.stop, last)
    values[:, -1] = program.output(instants[-1], states[:, -1], scene.inputs, runs.constants, modes)
    return values


def _outputs_of(scene: BatchScene, runs: Runs, times: Array, states: Array, mode: Array) -> Iterator[Any]:
    """Yield the outputs of each run at instants (k,) and states (runs, k, n): constants are not copied for each instant."""
    for x, constants in zip(states, runs.constants, strict=True):
        yield scene.program.output(times, x, scene.inputs, constants, mode)


def _warnings(
    scene: BatchScene, constants: Array, places: Places | None, values: Array, absolute: Array, fixed: Any
) -> tuple[LimitLeft, ...]:
    """Return the warnings of a run on outputs whose terms cancel."""

    def output(times: Array, states: Array, mode: Array) -> Any:
        return scene.program.output(times, states, scene.inputs, constants, mode)

    accuracy, begin = EXACT if scene.linear else max(scene.options.rtol, EXACT), scene.options.plan.start
    largest = largest_outputs(values)
    fixed = fixed | (
        smallest_angles(scene.program, scene.compiled_scene.facts.mechanisms, ("1", "1/s", "m", "m/s")) > 0
    )
    terms = terms_of_outputs(scene.program, output, places, absolute, scene.options.rtol, fixed)
    return doubts_on_outputs(scene.program.outputs.names, largest, [terms], accuracy, begin)


def _checkpoint(scene: BatchScene, parameters: Array, stored: Array, peaks: Array, magnitude: Array) -> Checkpoint:
    """Return the checkpoint at the end; `magnitude`: of each state, or nothing where none was searched."""
    program, end = scene.program, float(scene.instants[-1])
    names = (*program.states.names, *program.dependents.names)
    return Checkpoint(
        scene.compiled_scene.facts.identity, dict(zip(program.parameters.names, parameters.tolist(), strict=True)), end, end,
        dict(zip(names, stored.tolist(), strict=True)), dict(zip(names, peaks.tolist(), strict=True)), {},
        dict(zip(program.variables.names, magnitude.tolist(), strict=False)), {}, (), (), scene.compiled_scene.scene.preferences, None,
    )  # fmt: skip


def _result(
    scene: BatchScene, course: BatchCourse, trajectories: BatchTrajectories, row: int, values: Array, both: Sequence[Callable[[], Any]], time: float
) -> Result:  # fmt: skip
    """Return the result of a run; `both`: functions that find its warnings and its checkpoint."""
    compiled_scene, plan = scene.compiled_scene, scene.options.plan
    counts = ((kind, int(count[row])) for kind, count in trajectories.evaluations.items())
    return Result(
        scene.program.name, plan.experiment, scene.instants.copy(), compiled_scene.columns, values, plan.report, trajectories.solvers[row],
        int(trajectories.steps[row]), {kind: count for kind, count in counts if count}, scene.options.rtol, time, None, later(both[0]),
        compiled_scene.certificate, course.notes, (), "", later(both[1]),
    )  # fmt: skip


def exact_trajectories(scene: BatchScene, runs: Runs, course: BatchCourse) -> BatchTrajectories | None:
    """Return the trajectories of linear runs with equal segments; None if they cannot be found this way. Raises `RunsPart`."""
    instants, x, count = scene.instants, runs.state, len(runs)
    states = np.empty((count, len(instants), x.shape[1]))
    sound, shared = np.ones(count, dtype=bool), dict[tuple[bytes, bytes], tuple[Any, Any, Any]]()
    position = steps = exponentials = 0
    before = None
    for stretch in course.segments:
        if before is not None:
            sound &= goes_on(scene, runs, x, before, stretch)
        passed = max(position, int(np.searchsorted(instants, stretch.start, "right")))
        states[:, position:passed] = x[:, None]
        form = linear_form(scene.program, scene.inputs, runs.constants, stretch, scene.whole)
        if form is None:
            return None
        form.share(shared)
        exponentials -= len(form.known)
        cut = intervals(form, instants[passed:], np.inf)
        way = None if cut is None else march(form, cut, x)
        if cut is None or way is None:
            return None
        ends = way[1:][cut.reported][:-1]
        position = passed + len(ends)
        states[:, passed:position] = ends.swapaxes(0, 1)
        steps += len(cut.starts)
        exponentials += len(form.known)
        x, before = way[-1], stretch
    states[:, position:] = x[:, None]
    evaluations, solvers = {"exponential": np.full(count, exponentials)}, [SOLVERS["exponential"].name] * count
    return BatchTrajectories(
        states,
        sound,
        np.full(count, steps),
        evaluations,
        solvers,
        scene.state_selection(runs.constants),
        np.zeros(x.shape),
        np.zeros(x.shape[1], dtype=bool),
    )
