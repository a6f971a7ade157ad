"""Families of rests: directions along which an equilibrium may lie anywhere. A branch of equilibria must not follow them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from compiler.api import Array

from ..errors import RunFailed
from ..numerics.scales import nonzero
from .operating_point import OperatingPoint

ASTRIDE = (-0.7, 0.3)  # in magnitudes: places at which a family of rests is told from a fold
SINGULAR = 1e-11  # relative to the largest singular value
RESTING = 1e-6  # relative to the terms in a rate: a larger one is a motion


def scaled_system(A: Array, b: Array, scale: Array, free: Array) -> Any:
    """Return the sizes of the rows of [A b], b scaled, the rows over them, and the conserved sums and free coordinates, all with scaled columns."""
    whole = np.concatenate([A * scale, b], axis=1)
    rows = nonzero(np.abs(whole).max(axis=1))
    u, sizes, _ = np.linalg.svd(whole / rows[:, None], full_matrices=True)
    rank = int((sizes > SINGULAR * sizes.max(initial=0.0)).sum())
    kept = np.concatenate([u[:, rank:].T / rows * scale, free / scale])
    kept = kept / nonzero(np.linalg.norm(kept, axis=1, keepdims=True))
    return rows, whole / rows[:, None], np.pad(kept, ((0, 0), (0, 1)))


def families(point: OperatingPoint, A: Array, rows: Array, scale: Array, rates: Callable[[OperatingPoint], Any]) -> Any:
    """Return the directions (k, n) of the states along which a point is one of a family of rests.

    `A`: derivatives of the free coordinates' rates by them; `rows`: the same, scaled, and the conserved sums, which tell the members of other families apart.
    """
    chosen = point.reduced.chosen
    _, sizes, right = np.linalg.svd(rows, full_matrices=True)
    rank = int((sizes > SINGULAR * sizes.max(initial=0.0)).sum())
    ways = [point.reduced.directions @ (q * scale[chosen]) for q in right[rank:]]
    terms = RESTING * (np.abs(A) @ scale[chosen])
    free = [w for w in ways if all(_rests(point, s * w, terms, rates) for s in ASTRIDE)]
    return np.array(free).reshape(-1, point.count)


def _rests(point: OperatingPoint, change: Array, allowed: Array, rates: Callable[[OperatingPoint], Any]) -> bool:
    state = np.concatenate([point.state[: point.count] + change, point.state[point.count :]])
    try:
        return bool((np.abs(rates(point.elsewhere({}, state))) <= allowed).all())
    except (RunFailed, np.linalg.LinAlgError):
        return False
