"""Rounding of derivatives in which terms cancel: how far an entry is from a second evaluation, with all values moved in their last places."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array

from ..numerics.scales import equilibrated

if TYPE_CHECKING:
    from .operating_point import OperatingPoint

EPS = float(np.finfo(float).eps)
SEED = 20
EVALUATIONS = 4
CANCELLED = 2.0  # in units of that rounding: smaller entries are nothing else
SUSPECT = 1e-9  # of the largest of its row and its column: only smaller entries may be rounding
LARGEST = 300  # most states of a model that is evaluated again


def rounding_of(point: OperatingPoint, variables: Sequence[int]) -> tuple[Any, Any]:
    """Return the rounding of the derivatives of variables by the free coordinates (v, r) and by the point's `by` (v, k)."""
    reduced, n, size, count = point.reduced, point.count, point.all, len(variables)
    residuals = [u.residual for u in point.compilation.state_space.unknowns]
    slopes = point.slopes_of((*variables, *residuals))
    places, shape = (slopes.rows, slopes.columns), (count + len(residuals), size + len(point.by))
    random, base = np.random.default_rng(SEED), np.zeros(shape)
    np.add.at(base, places, np.asarray(slopes.tape.values(point.lookup), dtype=float))
    rates = {s.rate: i for i, s in enumerate(point.compilation.state_space.states)}
    for row, variable in enumerate(variables):
        if variable in rates:  # by another order of operations
            base[row, :size] = point.slopes_here[rates[variable]]
    base[count:, :size] = point.slopes_here[n:]
    largest = np.zeros((count, len(reduced.chosen) + len(point.by)))
    for _ in range(EVALUATIONS):
        change = -base
        values = slopes.tape.values(
            lambda leaf: point.lookup(leaf) * (1 + EPS * random.integers(-2, 3) * (leaf.role != "mode"))
        )
        np.add.at(change, places, np.asarray(values, dtype=float))
        moved = np.concatenate(reduced.through(change[:count]), axis=1)
        if residuals:
            loops = np.concatenate(reduced.through(change[count:]), axis=1)
            moved = moved - base[:count, n:size] @ np.linalg.lstsq(base[count:, n:size], loops, rcond=None)[0]
        largest = np.fmax(largest, np.abs(moved))
    return largest[:, : len(reduced.chosen)], largest[:, len(reduced.chosen) :]


def without_rounding(
    point: OperatingPoint, variables: Sequence[int], by_states: Array, moved: Array
) -> tuple[Any, Any]:
    """Return derivatives (v, r) and (v, k) with those that are rounding of terms that cancel as zeros."""
    whole = np.nan_to_num(np.concatenate([by_states, moved], axis=1))
    scaled = np.abs(equilibrated(whole)[0])
    if point.count > LARGEST or not ((scaled > 0) & (scaled < SUSPECT)).any():
        return by_states, moved
    of_states, of_moved = rounding_of(point, variables)
    return (
        np.where(np.abs(by_states) <= CANCELLED * of_states, 0.0, by_states),
        np.where(np.abs(moved) <= CANCELLED * of_moved, 0.0, moved),
    )
