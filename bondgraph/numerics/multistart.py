"""Multistart: guesses for Newton's method, for loops whose solutions may lie anywhere.

Guesses lie in steps over several decades around the known values and in units of the magnitudes, for all unknowns of a loop together, for each
alone, and for some mixtures that are the same in every run.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from compiler.api import Array

ENTRIES = 500_000  # most entries of all matrices of one search
# Factors on the known values, and on the magnitudes, (factors, 1), with either sign
AROUND, UNITS = (
    np.outer(factors, (1.0, -1.0)).reshape(-1, 1)
    for factors in (10.0 ** (np.arange(-18, 19) / 6), 10.0 ** np.arange(-6, 4))
)
MIXTURES = 48
FAR = 200  # number of guesses over many decades


def guesses(known: Array, magnitude: Array) -> Array:
    """Return guesses around known values, and over decades of the magnitudes; shape (guesses, unknowns)."""
    count = len(known)
    size = np.where(known != 0, np.abs(known), magnitude)
    signed = np.where(known != 0, known, magnitude)
    parts = [AROUND * signed, UNITS * magnitude]
    if count > 1:
        shares = np.append(AROUND[::12] * (1.0, -1.0), 0.0)
        alone = np.where(np.eye(count)[:, None] > 0, shares[:, None] * size, known)
        parts += [size * _mixtures(count), alone.reshape(-1, count)]
    return np.concatenate(parts)[: max(8, ENTRIES // count**2)]


@lru_cache
def _mixtures(count: int) -> Any:
    """Return factors of the sizes of some unknowns, the same in every run."""
    random = np.random.default_rng(0)
    return np.array([random.choice((-1, 1), count) * 10 ** random.uniform(-2, 2, count) for _ in range(MIXTURES)])


def far_guesses(magnitude: Array) -> Array:
    """Return mixtures over many decades, in which the steepest law dominates; shape (guesses, unknowns)."""
    random = np.random.default_rng(1)
    count = len(magnitude)
    shape = (min(FAR, max(8, ENTRIES // count**2)), count)
    return random.choice((-1, 1), shape) * 10 ** random.uniform(-3, 6, shape) * magnitude
