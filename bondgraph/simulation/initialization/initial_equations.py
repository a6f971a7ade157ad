"""Initial equations: least change of the states without start value that satisfies them.

Gauss-Newton with the pseudo-inverse; where its step brings no progress (a mechanism that is stretched out, a nonlinear law), it is damped
(Levenberg-Marquardt) until it does, so that angles do not drift by whole turns.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from compiler.api import Array, BoolArray, IntArray

from ...errors import RunFailed

ITERATIONS = 100
DIFFERENCE = 1e-6  # step of differences, in units of the mechanism
PRECISION = 1e-13  # size of the last step, relative to the states
NOISE = 1e-9  # error of central differences where a derivative is zero, relative to the equation's value
LEAST = 1e-3  # relative to the size of a state: size of one that is smaller; and share of a residual that a state of this size moves
# Most powers of ten that are tried, factor where nothing is seen to move, and end.
DECADES, BLIND, FARTHEST = 80, 1e12, 1e40
SINGULAR = 1e-12  # relative to the largest singular value
STRONGEST = 1e8  # damping beyond which nothing moves any more
Missed = Callable[[Any], Any]  # states -> residuals of the initial equations


def fulfil(missed: Missed, x: Array, movable: BoolArray, known: Array | float = 0.0, rank: float = SINGULAR) -> Any:
    """Return the states, shape (n,), with the movable ones (a mask) changed so that the initial equations hold, or nearly hold.

    `known`: sizes of their changes, (n,), 0 where they are not known; `rank`: relative singular value that counts as zero.
    """
    x, value, damping = np.array(x), missed(x), 0.0
    known = np.broadcast_to(known, x.shape)
    sizes, least = np.array(known), np.array(known)
    unknown = movable & ~(known > 0)
    sizes[unknown] = _sizes(missed, x, unknown, value)
    least[unknown] = LEAST * sizes[unknown]
    first, least = sizes[movable], least[movable]
    for _ in range(ITERATIONS if value.any() else 0):
        size = np.maximum(np.abs(x[movable]), least)
        slopes = _noiseless(slopes_of(missed, x, movable, size) * first, size / first, value)
        bound = np.abs(slopes).max(axis=1, initial=0.0)
        told = bound > 0  # the equations that depend on movable states
        if not told.any():
            return x
        scaled, miss = slopes[told] / bound[told, None], value[told] / bound[told]
        while True:
            step = damped_step(scaled, miss, damping, rank)
            trial = x.copy()
            trial[movable] += first * step
            new = missed(trial)
            if np.linalg.norm(new[told] / bound[told]) < np.linalg.norm(miss):
                break
            if (np.abs(first * step) <= PRECISION * np.abs(x[movable])).all() or damping > STRONGEST:
                return x
            damping = 10 * damping or 1e-3
        x, value, damping = trial, new, damping / 10 if damping > 1e-6 else 0.0
    return x


def differences(function: Missed, state: Array, places: IntArray, size: Array | float) -> Any:
    """Return central differences by the entries of a state at some places, in units of `size` (places,); shape (places, values).

    The function takes several states at once.
    """
    shifts = np.zeros((len(places), len(state)))
    shifts[np.arange(len(places)), places] = DIFFERENCE * size
    return (function(state + shifts) - function(state - shifts)) / (2 * DIFFERENCE)


def _sizes(missed: Missed, x: Array, movable: BoolArray, value: Array) -> Any:
    """Return a size of each movable state: one, or the power of ten with which it moves some residual by its own order; shape (movable,)."""
    result, missing = np.ones(int(movable.sum())), value != 0
    for k, i in enumerate(np.flatnonzero(movable)):
        size, shift = 1.0, np.zeros(len(x))
        for _ in range(DECADES):
            shift[i] = size
            try:
                moved = np.abs((missed(x + shift) - value)[missing] / value[missing]).max(initial=0.0)
            except RunFailed:  # a loop has no solution so far away
                moved = np.inf
            if LEAST <= moved <= 1 / LEAST:
                result[k] = size
            if LEAST <= moved <= 1 / LEAST or size > FARTHEST:
                break
            size *= 0.1 if not moved < LEAST else 10.0 if moved else BLIND
    return result


def slopes_of(function: Missed, x: Array, movable: BoolArray, size: Array) -> Any:
    """Return central differences by the movable states, whose sizes are given; used at the start only, where an iteration over them converges to round-off."""
    columns = []
    for i, own in zip(np.flatnonzero(movable), size, strict=True):
        step = DIFFERENCE * own
        shift = np.zeros(len(x))
        shift[i] = step
        columns.append((function(x + shift) - function(x - shift)) / (2 * step))
    return np.stack(columns, axis=1) if columns else np.zeros((len(function(x)), 0))


def _noiseless(slopes: Array, size: Array, value: Array) -> Any:
    """Return derivatives with those below rounding set to zero: otherwise an equation would seem to depend on unrelated states."""
    reach = np.abs(slopes) * size
    return np.where(reach > NOISE * np.abs(value)[:, None], slopes, 0.0)


def damped_step(slopes: Array, miss: Array, damping: float, rank: float) -> Any:
    """Return the minimum-norm step that cancels the residual, or a shorter one if damped; `rank`: relative singular value that counts as zero."""
    if damping:
        count = slopes.shape[1]
        slopes = np.vstack([slopes, np.sqrt(damping) * np.eye(count)])
        miss = np.concatenate([miss, np.zeros(count)])
    step, *_ = np.linalg.lstsq(slopes, -miss, rcond=rank)
    return step
