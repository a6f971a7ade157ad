"""Trajectories of a batch, and the test at the end of a segment that another may follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array

from ..simulation.monitors.state_selection import Choice
from ..simulation.segments.timeline import Segment
from .runs import Runs
from .scope import BatchScene


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


def goes_on(scene: BatchScene, runs: Runs, x: Array, before: Segment, stretch: Segment) -> Any:
    """Return a mask of the runs in which nothing that forces a storage jumps between two segments; `x`: their states there."""
    if (before.mode == stretch.mode).all():
        return np.ones(len(runs), dtype=bool)
    old, new = (
        scene.program.forced(stretch.start, x, scene.inputs, runs.constants, mode)
        for mode in (before.mode, stretch.mode)
    )
    return (old == new).all(axis=1)
