"""Magnitudes of a batch, as `simulation/magnitudes/nominal_magnitudes.py` finds them for one run."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..simulation.magnitudes.nominal_magnitudes import raised
from ..simulation.magnitudes.pilot_run import smallest_angles
from .pilot import largest_values
from .runs import BatchCourse, Runs
from .scope import BatchScene


def batch_magnitudes(scene: BatchScene, runs: Runs, course: BatchCourse) -> tuple[Any, Any]:
    """Return the magnitudes of the states, shape (runs, n), and a mask of the runs for which they are certain."""
    program, mechanisms = scene.program, scene.compiled_scene.facts.mechanisms
    largest, sound = largest_values(scene, runs, course)
    nominal, peak = program.nominal(runs.constants), np.maximum(np.abs(runs.state), largest)
    result = raised(program, mechanisms, np.where(nominal > 0, nominal, peak), smallest_angles(program, mechanisms))
    return result, sound & ((result > 0) & np.isfinite(result)).all(axis=1)
