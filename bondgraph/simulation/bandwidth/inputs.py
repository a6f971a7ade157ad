"""Whether what drives a model has content above the bandwidth: that is followed, since a step that does not see a signal answers to another one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..segments import GOLDEN, Segment, inside

if TYPE_CHECKING:
    from ...door import Program

PLACES = 256  # of a stretch
AHEAD = 1e-3  # of a radian at the bandwidth: differences in time
SMALL = 1e-9  # of a signal: a change within that time that is rounding


def content(program: Program, inputs: Any, constants: Any, stretch: Segment, bandwidth: float) -> float:
    """A frequency in Hz: how fast the fastest of the signals of time changes, by its largest second and first derivative; 0 if it is below the bandwidth."""
    ahead = AHEAD / (2 * np.pi * bandwidth)
    first, last = inside(stretch)
    if last - first < 4 * ahead:
        return 0.0
    numbers = np.arange(PLACES)
    times = first + (last - 2 * ahead - first) * (numbers + (GOLDEN * numbers + 0.5) % 1.0) / PLACES
    values = np.array([program.signals(times + k * ahead, inputs, constants, stretch.mode) for k in range(3)])
    if not values.size or not np.isfinite(values).all():
        return 0.0
    slopes, bends = (np.abs(np.diff(values, k, axis=0)[0]).max(axis=0) for k in (1, 2))
    sure = slopes > SMALL * np.abs(values).max(axis=(0, 1))
    rates = bends[sure] / slopes[sure] / ahead
    found = float(rates.max(initial=0.0)) / (2 * np.pi)
    return found if found > bandwidth else 0.0
