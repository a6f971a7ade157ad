"""Linear runs of a batch by the matrix exponential, segment by segment, as `integration/exact.py` makes one."""

from __future__ import annotations

from typing import Any

import numpy as np

from compiler.api import SOLVERS

from ..simulation.integrators.exponential import intervals, linear_form, march
from .runs import BatchCourse, Runs
from .scope import BatchScene
from .trajectories import BatchTrajectories, goes_on


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
        states, sound, np.full(count, steps), evaluations, solvers, scene.state_selection(runs.constants)
    )
