"""How large each state is going to be, so that an absolute tolerance means the same for nanometres and megapascals.

What the author says counts; else the start and a coarse linearly implicit Euler run over the whole time (L-stable, so what is
fast only follows) tell the magnitude, with what a free motion from there would reach: the speed of something that is pushed
slowly is measured by the speed at which it would swing back. States of one unit support each other: a coordinate that happens
to stay at zero must not be held to round-off.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..door import Program
from ..errors import RunFailed
from .factorise import dense, sparse
from .integrate import DENSE
from .loops import LoopSolver
from .segments import Segment

STEPS = 60  # of the coarse run
SMALLEST_ANGLE = 1e-12  # rad, and rad/s: below lies what symmetry leaves of an angle, which is rounding
LARGEST = 200  # states up to which the modes are computed
SHARE = 1e-2  # of the largest state of the same unit, at least


def nominal_magnitudes(program: Program, constants: Any, state: Any, inputs: Any, stretches: Sequence[Segment]) -> Any:
    """A positive magnitude for every state, in SI; shape (n,)."""
    given = np.asarray(program.nominal(constants), dtype=float)
    peak = np.maximum(np.abs(state), _coarse_peak(program, constants, state, inputs, stretches))
    result = np.where(given > 0, given, peak)
    units = (*program.states.units, *program.unknowns.units)
    for unit in set(units):
        same = np.array([u == unit for u in units])
        largest = result[same].max(initial=0.0)
        result[same] = np.maximum(result[same], SHARE * largest)
    bare = np.array([u in ("1", "1/s") for u in units], dtype=bool)
    result[bare] = np.maximum(result[bare], SMALLEST_ANGLE)
    result[(result == 0) | ~np.isfinite(result)] = 1.0
    return result


def _coarse_peak(program: Program, constants: Any, state: Any, inputs: Any, stretches: Sequence[Segment]) -> Any:
    """The largest magnitudes in a coarse run; the unknowns of loops are solved for before each of its steps."""
    peak, count = np.abs(state), len(program.states.names)
    if not count:
        return peak
    x = np.array(state, dtype=float)
    first = stretches[0]
    reach = None
    if not len(program.unknowns.names):
        reach = _free_motion(program.jacobian(first.start, x, inputs, constants, first.mode), x)
    whole = stretches[-1].stop - first.start
    rows, columns = program.pattern
    differential = np.arange(len(x)) < count
    large = len(x) > DENSE and len(rows) < 0.2 * len(x) ** 2
    shifted = (sparse if large else dense)(rows, columns, differential)
    for stretch in stretches:
        length = stretch.stop - stretch.start
        steps = max(2, min(STEPS, round(STEPS * length / whole)))
        h = length / steps
        for i in range(steps):
            time = stretch.start + (i + 1) * h
            try:
                x = LoopSolver(program, constants, inputs, np.where(peak > 0, peak, 1.0)).solve(time, x, stretch.mode)
            except RunFailed:
                return peak
            slope = program.derivative(time, x, inputs, constants, stretch.mode)
            entries = program.jacobian_entries(time, x, inputs, constants, stretch.mode)
            if not (np.isfinite(slope).all() and np.isfinite(entries).all()):
                return peak
            moved = np.abs(h * np.where(differential, slope, 0.0))
            scale = np.maximum(np.maximum(peak, moved), 1e-300)
            unit = np.where(differential, scale, 1.0)
            try:
                step = shifted(1 / h, entries * scale[columns] / unit[rows]).solve(slope / unit) * scale
            except (np.linalg.LinAlgError, RuntimeError, ValueError):
                return peak
            if not np.isfinite(step).all() or np.any((np.abs(step) > 1e8 * np.maximum(peak, moved) + 1e300)[:count]):
                return peak
            x = x + step
            peak = np.maximum(peak, np.abs(x))
            if reach is not None:
                peak = np.maximum(peak, reach(x))
    return peak


def _free_motion(jacobian: Any, state: Any) -> Callable[[Any], Any] | None:
    """A bound of what each state reaches in the free linear motion from a state: sum of its modes' amplitudes.

    None where the modes are too many, or too close to each other to tell their amplitudes apart.
    """
    if not 0 < len(state) <= LARGEST or not np.isfinite(jacobian).all():
        return None
    from scipy.linalg import matrix_balance

    _, (scale, _) = matrix_balance(jacobian, permute=False, separate=True)
    try:
        _, shapes = np.linalg.eig(jacobian * scale / scale[:, None])
        inverse = np.linalg.inv(shapes)
    except np.linalg.LinAlgError:
        return None
    if np.linalg.cond(shapes) > 1e6:
        return None
    amplitudes = np.abs(shapes)

    def reach(x: Any) -> Any:
        return amplitudes @ np.abs(inverse @ (x / scale)) * scale

    return reach
