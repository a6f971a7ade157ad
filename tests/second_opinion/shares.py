"""Unknowns that the equations leave open, as shares of an effort between a stuck friction and a stop that hold one flow at zero.

Where an event would act on such a share, others are looked for with which none acts: a motion goes on as long as there are any. Of the admissible ones those
are taken that stay so for longest, as the limits now move (a linear program for each set of branches of what the shares decide).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import linprog

Array = Any
OPEN = 1e-11  # relative singular value of what is open
MOST = 10  # comparisons that shares decide
CERTAIN = 1e-8  # of the largest unknown: margin without a drift
LEAST = 1e-9  # of the span: shares that are admissible for less are none
SIDES = {"less": (1.0, 0.0), "less_equal": (1.0, 0.0), "abs": (-1.0, 1.0), "min": (1.0, 0.0), "max": (0.0, 1.0), "sign": (-1.0, 1.0)}  # fmt: skip


def open_directions(jacobian: Array, states: int) -> Array:
    """Return the directions of unknowns that change neither rates nor residuals; shape (unknowns, directions)."""
    matrix = jacobian[:, states:]
    columns = np.ones(matrix.shape[1])
    for _ in range(3):
        for axis in (1, 0):
            size = np.sqrt(np.abs(matrix).max(axis=axis, initial=0.0))
            size[size == 0] = 1.0
            matrix = matrix / np.expand_dims(size, axis)
            columns /= size if axis == 0 else 1.0
    _, sizes, rows = np.linalg.svd(matrix)
    rank = int((sizes > OPEN * sizes.max(initial=0.0)).sum())
    return columns[:, None] * rows[rank:].T


def admissible(
    run: Any, x: Array, w: Array, before: tuple[float, Array, Array] | None
) -> tuple[Array, list[float]] | None:
    """Return unknowns with other shares, and the branches, with which no event acts; None if there are none. `before`: time, states and unknowns a while ago."""
    system, modes = run.system, len(run.m) - len(run.system.assembly.graph.switches)
    free = open_directions(run.linearized(run.t, x, w), len(x))
    if not free.shape[1]:
        return None
    size = max(float(np.abs(w).max(initial=0.0)), 1e-9)
    free = free * (size / np.abs(free).max(axis=0))

    def gaps(t: float, x: Array, w: Array, b: Sequence[float]) -> Array:
        return np.array(system.watch(t, x.tolist(), w.tolist(), run.m, list(b))[1])

    def slopes(b: Sequence[float]) -> Array:
        here = gaps(run.t, x, w, b)
        return np.array([gaps(run.t, x, w + d, b) - here for d in free.T]).T

    moved = np.flatnonzero(np.abs(slopes(run.b)).max(axis=1) > 1e-9 * size)
    operators = [system.operators[k] for k in moved]
    if not len(moved) or len(moved) > MOST or not set(operators) <= SIDES.keys():
        return None
    best: tuple[float, Array, list[float]] | None = None
    rest = run.end - run.t
    for signs in itertools.product((-1.0, 1.0), repeat=len(moved)):
        b = list(run.b)
        for k, operator, sign in zip(moved, operators, signs, strict=True):
            b[k] = SIDES[operator][sign > 0]
        truth, on = system.conditions(run.t, x.tolist(), w.tolist(), run.m, b)
        if any(v and not t for v, t in zip(truth, run.true, strict=True)) or list(map(float, on)) != run.m[modes:]:
            continue
        value, slope = np.array(signs) * gaps(run.t, x, w, b)[moved], np.array(signs)[:, None] * slopes(b)[moved]
        drift = None
        if before is not None and run.t - before[0] > 1e-7 * run.span:
            drift = (value - np.array(signs) * gaps(*before, b)[moved]) / (run.t - before[0])
        found = _longest(value, slope, drift, rest, size)
        if found is not None and found[0] > LEAST * run.span and (best is None or found[0] > best[0]):
            best = found[0], w + free @ found[1], b
    return None if best is None else best[1:]


def _longest(value: Array, slope: Array, drift: Array | None, rest: float, size: float) -> tuple[float, Array] | None:
    """Return the longest time, at most `rest`, for which value + slope a + drift t stays positive, and a; with a margin where that is possible. Where no
    drift is known, the margin counts as time."""
    count, directions = slope.shape
    worth = 1e-3 * rest / size
    matrix = np.vstack([
        np.hstack([-slope, np.zeros((count, 1)), np.ones((count, 1))]),
        np.hstack([-slope, np.reshape(0.0 if drift is None else -drift, (-1, 1)) * np.ones((count, 1)), np.ones((count, 1))]),
    ])  # fmt: skip
    cost = np.concatenate([np.zeros(directions), [-1.0, -worth]])
    bounds = [(-10.0, 10.0)] * directions + [(0.0, 0.0 if drift is None else rest), (0.0, size)]
    found = linprog(cost, matrix, np.concatenate([value, value]), bounds=bounds)
    if found.status != 0 or (drift is None and found.x[-1] < CERTAIN * size):
        return None
    return float(found.x[-2] + worth * found.x[-1]), found.x[:directions]
