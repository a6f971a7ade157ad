"""Slopes at singular points: those around the point where the compiler's rules give another there, or none.

The rules of `compiler/algebra/derivative.py` take the slope of a root at zero as 0, and that of `max(x, 0)` at x = 0 as that of one side, so that steps
of an integrator go on. In a product or a sum, such as `max(x, 0) + min(x, 0)`, the result can be a slope that holds on no side.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from compiler.api import Array, IntArray

FAR, NEAR = 1e-6, 1e-10  # distances from the point, in magnitudes
GROWTH = 1.5  # of a slope from the farther to the nearer distance: a power law of exponent 0.95 grows by 1.6
ROUNDING = 1e-8  # of the largest slope: smaller ones may grow by rounding
SAME = 1e-4  # relative difference of slopes that are one


def departure(size: Array, distance: float) -> Array:
    """Return a displacement of all coordinates together, (n,), in a fixed direction, so that no difference of two of them stays zero."""
    return np.asarray(distance * size * _direction(len(size)))


@lru_cache(maxsize=256)
def _direction(count: int) -> Array:
    return np.asarray(np.random.default_rng(0).uniform(0.5, 1.0, count) * np.resize([1.0, -1.0, -1.0], count))


def slopes_from_beside(beside: Callable[[float, float], Any], here: Array) -> tuple[Array, IntArray]:
    """Return the slopes with those corrected that differ from both sides where both sides agree, and flat indices of infinite ones.

    `beside(side, distance)`: the slopes at a distance (in magnitudes) to one side (1 or -1); `here`: those at the point. Where the sides differ, the
    law has a kink, and the slope of the point stays. A slope without a value on one side (a root of a negative number) counts on the other.
    """
    with np.errstate(all="ignore"):
        near = [np.asarray(beside(side, NEAR), dtype=float) for side in (1.0, -1.0)]
        if all((other == here).all() for other in near):
            return here, np.array([], dtype=int)
        far = [np.asarray(beside(side, FAR), dtype=float) for side in (1.0, -1.0)]
        least = ROUNDING * np.nanmax(np.abs(here), initial=0.0)
        grows = [
            np.isfinite(n)
            & (np.abs(n) > least)
            & (np.abs(n) > GROWTH * np.abs(f))
            & (np.abs(n) > GROWTH * np.abs(here))
            for n, f in zip(near, far, strict=True)
        ]
        one, other = near
        scale = SAME * np.maximum(np.abs(one), np.abs(other))
        settled = (np.abs(one - other) <= scale) & (np.abs(one - far[0]) <= scale) & (np.abs(other - far[1]) <= scale)
        corrected = settled & (np.abs(one - here) > scale)
        return np.where(corrected, (one + other) / 2, here), np.flatnonzero(grows[0] | grows[1])
