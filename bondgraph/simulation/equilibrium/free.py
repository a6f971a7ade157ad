"""Coordinates along which a rest may lie anywhere, as nothing restores, damps or conserves them: a flywheel without drag stops at any angle.

Where such a search ends is a matter of its steps, so these coordinates go back to their start, if the model rests there, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array

from ...errors import RunFailed

if TYPE_CHECKING:
    from .dense import EquilibriumSearch

LARGEST = 500  # most states: the null spaces are those of a dense matrix
MOVED = 1e-9  # relative to the largest part of a direction, in magnitudes: smaller ones are rounding
KEPT = 1e-6  # of the product of a direction and a conserved sum, in magnitudes: less is rounding


def held_at_start(search: EquilibriumSearch, start: Array, rest: Array) -> Any:
    """Return the rest with its free coordinates as at the start, or the same rest if that is none."""
    if search.count > LARGEST:
        return rest
    moved = free_coordinates(search, rest) & (start[: search.count] != rest[: search.count])
    if not moved.any():
        return rest
    places = np.flatnonzero(moved)
    back = np.array(rest)
    back[places] = start[places]
    try:
        x, slope, jacobian = search.at(back)
        if np.isfinite(slope).all() and search.close(x, slope, jacobian):
            nearer = search.rested(search.polished(x, slope, jacobian))
            if np.allclose(nearer[places], start[places], rtol=KEPT, atol=0.0):
                return nearer
    except (RunFailed, np.linalg.LinAlgError):
        pass
    return rest


def free_coordinates(search: EquilibriumSearch, rest: Array) -> Any:
    """Return a mask (n,) of the states that move along a family of rests which no conserved sum tells apart: null vectors v and w of the derivatives
    with w'v = 0."""
    jacobian = search.derivatives_with_terms(rest)
    if jacobian is None:
        return np.zeros(search.count, dtype=bool)
    size = search.moved(search.scale(np.zeros(search.count)), jacobian)
    basis = np.eye(search.count) if search.basis is None else search.basis
    lengths = 1.0 / np.abs(basis / size[:, None]).max(axis=0)  # of one magnitude each
    inner, terms = basis.T @ jacobian @ basis, np.abs(basis).T @ search.terms @ np.abs(basis)
    left, right = search.null_spaces(inner * lengths, terms * lengths)
    sums = left * lengths[:, None]  # of magnitudes, like the directions
    tied = (sums / np.abs(sums).max(axis=0, initial=0.0)).T @ (right / np.abs(right).max(axis=0, initial=0.0))
    tied[np.abs(tied) < KEPT] = 0.0
    _, sizes, ways = np.linalg.svd(tied)
    moves = basis @ (lengths[:, None] * right @ ways[int((sizes > 0).sum()) :].T)
    sizes = np.abs(moves / size[:, None])
    return (sizes > MOVED * sizes.max(axis=0, initial=0.0)).any(axis=1)
