"""Frequency content of the signals that drive a model: a signal above the bandwidth must be followed, because a step that does not see it would
answer to a different signal.
"""

from __future__ import annotations

import numpy as np

from compiler.api import Array, Program

from ..segments.timeline import GOLDEN, Segment, inside

PLACES = 128  # number of sample places per segment
AHEAD = 1e-3  # radians at the bandwidth: time step of difference quotients
SMALL = 1e-9  # relative change of a signal within that time that counts as rounding


def content(program: Program, inputs: Array, constants: Array, stretch: Segment, bandwidth: float) -> float:
    """Return a frequency in Hz: how fast the fastest signal of time changes, from its largest second and first derivative; 0 if below the bandwidth."""
    ahead = AHEAD / (2 * np.pi * bandwidth)
    first, last = inside(stretch)
    if last - first < 4 * ahead:
        return 0.0
    numbers = np.arange(PLACES)
    times = first + (last - 2 * ahead - first) * (numbers + (GOLDEN * numbers + 0.5) % 1.0) / PLACES
    close = (times + ahead * np.arange(3.0)[:, None]).ravel()
    values = np.asarray(program.signals(close, inputs, constants, stretch.mode)).reshape(3, PLACES, -1)
    if not values.size or not np.isfinite(values).all():
        return 0.0
    slopes, bends = (np.abs(np.diff(values, k, axis=0)[0]).max(axis=0) for k in (1, 2))
    sure = slopes > SMALL * np.abs(values).max(axis=(0, 1))
    rates = bends[sure] / slopes[sure] / ahead
    found = float(rates.max(initial=0.0)) / (2 * np.pi)
    return found if found > bandwidth else 0.0
