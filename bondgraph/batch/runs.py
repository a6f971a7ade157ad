"""Runs of a batch: their parameters, constants and starts; and groups of them with equal segments and signals; and their trajectories."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array, IntArray, Program

from ..simulation.monitors.state_selection import Choice
from ..simulation.segments.timeline import GOLDEN, Segment, aligned, timeline
from .scope import BatchScene


@dataclass(frozen=True, slots=True, eq=False)
class Runs:
    """Runs of one program; `numbers` (runs,) among those of the batch; parameters (runs, P), constants (runs, K) and states at the start (runs, n)."""

    numbers: IntArray
    parameters: Array
    constants: Array
    state: Array

    def __len__(self) -> int:
        return len(self.numbers)

    def those(self, rows: Any) -> Runs:
        """Return some of them, by indices or a mask."""
        return Runs(self.numbers[rows], self.parameters[rows], self.constants[rows], self.state[rows])


@dataclass(frozen=True, slots=True, eq=False)
class BatchCourse:
    """Segments of some runs, notes on how they were found, and the constants (K,) of one of the runs, with which the signals of all are evaluated."""

    segments: tuple[Segment, ...]
    notes: tuple[str, ...]
    constants: Array

    @property
    def crowded(self) -> bool:
        """True if a run has notes on signals with more peaks than are resolved."""
        return any(s.resolution.notes for s in self.segments if s.resolution is not None)

    @property
    def whole(self) -> float:
        """Length of all segments, s."""
        return self.segments[-1].stop - self.segments[0].start


def grouped(scene: BatchScene, parameters: Array) -> Iterator[tuple[Runs, BatchCourse]]:
    """Yield runs with equal segments and signals, and the segments. Runs without a finite start are left out, those with other conditions, and those
    with parameters that the model does not allow.
    """
    program = scene.program
    constants = np.asarray(program.constants(parameters))
    state = np.asarray(program.start(constants))
    rows = np.flatnonzero(np.isfinite(state).all(axis=1))
    every = Runs(rows, parameters[rows], constants[rows], state[rows])
    timed = [program.instants(every.constants), program.periods(every.constants)]
    if program.recurring is not None:
        timed.append(program.recurring(every.constants))
    read = np.concatenate([*timed, every.constants[:, _constants_of_time(program)]], axis=1)
    groups: dict[bytes, list[int]] = {}
    for row, numbers in enumerate(read):
        groups.setdefault(numbers.tobytes(), []).append(row)
    for members in groups.values():
        runs = every.those(np.array(members))
        cuts = timeline(program, runs.constants[0], float(scene.instants[0]), float(scene.instants[-1]))
        course = BatchCourse(tuple(aligned(cuts.segments, scene.instants)), cuts.notes, runs.constants[0])
        first = cuts.segments[0]
        runs = runs.those(_has_conditions(program, runs, course))
        holds = program.holds(first.start, runs.state, scene.inputs, runs.constants, first.mode)
        yield runs.those((holds == 1.0).all(axis=1)), course


def _constants_of_time(program: Program) -> list[int]:
    """Return the places of the constants that decide segments and signals, beside known instants."""
    functions = program.time_functions
    places = set(program.signal_constants)
    if functions is not None:
        roots = [place for f in functions.crossings for place in (f.place, max(f.slope, 0))]
        roots += functions.narrow
        places.update(functions.constants_of(roots))
    return sorted(places)


def _has_conditions(program: Program, runs: Runs, course: BatchCourse) -> Any:
    """Return a mask of the runs whose conditions on time, which may read other constants, are those of the segments."""
    same = np.ones(len(runs), dtype=bool)
    for segment in course.segments:
        if np.size(segment.mode):
            inside = segment.start + GOLDEN * (segment.stop - segment.start)
            same &= (program.switches(inside, runs.constants) == segment.mode).all(axis=1)
    return same


@dataclass(frozen=True, slots=True, eq=False)
class BatchTrajectories:
    """Trajectories of runs: states at the reported instants (runs, points, n), and the work of the steps; those of runs that are not `sound` mean nothing."""

    states: Any
    sound: Any
    steps: Any  # (runs,)
    evaluations: Mapping[str, Any]  # by kind, (runs,)
    solvers: Sequence[str]
    choice: Choice  # with the largest values that storages have had
    absolute: Any  # tolerances of the states (runs, n); 0 where they are exact
    fixed: Any  # 1 for those that the author gave (n,)


def goes_on(scene: BatchScene, runs: Runs, x: Array, before: Segment, stretch: Segment) -> Any:
    """Return a mask of the runs in which nothing that forces a storage jumps between two segments; `x`: their states there."""
    if (before.mode == stretch.mode).all():
        return np.ones(len(runs), dtype=bool)
    old, new = (
        scene.program.forced(stretch.start, x, scene.inputs, runs.constants, mode)
        for mode in (before.mode, stretch.mode)
    )
    return (old == new).all(axis=1)
