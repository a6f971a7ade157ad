"""Slopes at singular points: those around the point where the compiler's rules give another there, or none; kinks, whose sides differ, are found.

The rules of `compiler/algebra/derivative.py` take the slope of a root at zero as 0, and that of `max(x, 0)` at x = 0 as that of one side, so that steps
of an integrator go on. In a product or a sum, such as `max(x, 0) + min(x, 0)`, the result can be a slope that holds on no side.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from compiler.api import Array, BoolArray, IntArray, Tape

# Distances from the point, in sizes of the states: differences over the least have five digits, and a power law of the farthest differs.
FAR, NEAR, CLOSEST = 1e-6, 1e-10, 1e-11
GROWTH = 1.5  # of a slope from the farther to the nearer distance: a power law of exponent 0.95 grows by 1.6
ROUNDING = 1e-8  # of the largest slope: smaller ones may grow by rounding
SAME = 1e-4  # relative difference of slopes that are one
BENT = 1e-8  # relative difference of slopes beside a kink that are told as one
EXACT = 1e-13  # of the largest slope of a row: less is the rounding of terms that cancel
SIGNS = ((1.0, -1.0, -1.0), (1.0, 1.0, -1.0), (1.0, -1.0, 1.0))  # of the coordinates, along each direction
JUMPING = 0.5  # of the spread of values at the farther distance: at the nearer one a continuous law has far less
Beside = Callable[[float, float, int], Any]  # side (1 or -1), distance in sizes, direction -> numbers there


@dataclass(frozen=True, slots=True)
class Slopes:
    """Nonzero derivatives of some variables: their tape, and their places."""

    tape: Tape
    rows: Any
    columns: Any
    guarded: bool  # one of them has conditions of its own, as at a root of zero and at a kink


def departure(size: Array, distance: float, way: int = 0) -> Array:
    """Return a displacement of all coordinates together, (n,), in one of some fixed directions, so that no difference of two of them stays zero."""
    return np.asarray(distance * size * _direction(len(size), way))


@lru_cache(maxsize=256)
def _direction(count: int, way: int) -> Array:
    return np.asarray(np.random.default_rng(way).uniform(0.5, 1.0, count) * np.resize(SIGNS[way], count))


def jumps(beside: Beside, here: Array) -> IntArray:
    """Return the indices of values (k,) that are not continuous at a point, where they are `here`."""
    with np.errstate(all="ignore"):
        spreads = (np.ptp([here, beside(1.0, d, 0), beside(-1.0, d, 0)], axis=0) for d in (CLOSEST, NEAR, FAR))
        closest, near, far = spreads
        return np.flatnonzero((closest > JUMPING * near) & (near > JUMPING * far) & (near > ROUNDING * np.abs(here)))


def slopes_from_beside(beside: Beside, here: Array, ways: Sequence[int] = (0,)) -> tuple[Array, IntArray, IntArray]:
    """Return the slopes with those corrected that differ from all sides where all sides agree, and flat indices of infinite ones and of kinks.

    `here`: slopes at the point. At a kink, where sides differ, they stay. A slope without a value on one side (a root of a negative number) counts on
    the other.
    """
    smooth, infinite, bent = zip(*(_along(beside, here, way) for way in ways), strict=True)
    kinks = np.any(bent, axis=0) | (np.ptp(smooth, axis=0) > _apart(smooth[0], smooth[-1]))
    return smooth[0], np.flatnonzero(np.any(infinite, axis=0)), np.flatnonzero(kinks)


def _apart(one: Array, other: Array) -> Any:
    """Return how far slopes on two sides of a kink are apart at least: more than rounding, and not negligible."""
    size = np.maximum(np.abs(one), np.abs(other))
    return BENT * size + EXACT * np.nanmax(size, axis=-1, initial=0.0, keepdims=True)


def _along(beside: Beside, here: Array, way: int) -> tuple[Array, BoolArray, BoolArray]:
    """Return the same along one direction, and masks of infinite slopes and of kinks."""
    with np.errstate(all="ignore"):
        near = [np.asarray(beside(side, NEAR, way), dtype=float) for side in (1.0, -1.0)]
        if all((other == here).all() for other in near):
            return here, np.zeros(here.shape, dtype=bool), np.zeros(here.shape, dtype=bool)
        far = [np.asarray(beside(side, FAR, way), dtype=float) for side in (1.0, -1.0)]
        least = ROUNDING * np.nanmax(np.abs(here), initial=0.0)
        size = np.maximum(GROWTH * np.abs(here), least)
        grows = [
            np.isfinite(n) & (np.abs(n) > np.maximum(GROWTH * np.abs(f), size)) for n, f in zip(near, far, strict=True)
        ]
        one, other = near
        scale = SAME * np.maximum(np.abs(one), np.abs(other))
        sides = (np.abs(one - far[0]) <= scale) & (np.abs(other - far[1]) <= scale)
        apart = one - other  # at a kink the same from farther away
        kinks = (
            sides & (np.abs(apart - (far[0] - far[1])) < JUMPING * np.abs(apart)) & (np.abs(apart) > _apart(one, other))
        )
        if kinks.any():
            closest = np.subtract(beside(1.0, CLOSEST, way), beside(-1.0, CLOSEST, way))
            kinks &= np.abs(apart - closest) < JUMPING * np.abs(apart)
        corrected = sides & (np.abs(apart) <= scale) & (np.abs(one - here) > scale)
        return np.where(corrected, (one + other) / 2, here), grows[0] | grows[1], kinks
