"""Equilibrium of a model: the states at which all rates vanish, for the inputs and the time of the start.

Pseudo-transient continuation (Kelley and Keyes, SIAM J. Numer. Anal. 35, 1998): implicit Euler steps that grow as the rates fall, so that the
search first follows the motion and then becomes Newton's method. A coordinate without restoring force (the position of a free body) stays
unchanged: the last steps are of least length.
A state that no rate, condition or loop reads is no part of the balance: it stays unchanged. If its own rate does not vanish and it is an angle,
the model rotates steadily (a running motor). Any other state that does not come to rest is an error with its name.
"""

from __future__ import annotations

from copy import copy
from typing import Any

import numpy as np

from compiler.api import Array

from ...errors import RunFailed
from ...numerics.scales import nonzero
from ..constraints.constraints import Constraints
from ..integrators.linear_algebra.factorise import is_large
from ..segments.timeline import Segment
from .dense import CLOSE, ROUNDING, EquilibriumSearch

STEPS = 400
GROWTH = 2.0
LARGEST = 500  # most states: the null spaces are those of a dense matrix
MOVED = 1e-9  # relative to the largest part of a direction, in magnitudes: smaller ones are rounding
KEPT = 1e-6  # of the product of a direction and a conserved sum, in magnitudes: less is rounding


def equilibrium(constraints: Constraints, state: Array, first: Segment, sums: Array | None = None) -> Any:
    """Return the equilibrium that is reached from a state, with the unknowns of loops; `sums`: factors (k, n) of the states in sums that every motion keeps.
    Raises `RunFailed` if there is none."""
    if not constraints.count:
        return state
    search = search_at(constraints, first)
    search.sums = search.sums if sums is None else sums
    return found_by(search, np.array(state))


@np.errstate(all="ignore")  # a trial may lead to where a law has no value
def found_by(search: EquilibriumSearch, state: Array) -> Any:
    """Return the equilibrium that a given search reaches from a state. Raises `RunFailed`.

    Steps keep no momentum that depends on the pose, as of a cart with a pendulum on a free rail. So where a mechanism that starts without motion
    would go on for ever, a search with a drag on its speeds follows: its rests without motion are the same.
    """
    again, rest, failed = copy(search), None, None
    try:
        rest = _found(search, state)
    except RunFailed as error:
        failed = error
    still = search.speeds.any() and not np.array(state)[: search.count][~search.positions].any()
    if still and (rest is None or drifts(search, rest)):
        rest = _slowed(again, state, rest)
    if rest is None and failed is not None:
        raise failed
    return rest


def _slowed(search: EquilibriumSearch, state: Array, otherwise: Any) -> Any:
    """Return the rest that is reached with a drag on all speeds, with free coordinates as at the start; `otherwise` if there is none."""
    try:
        search.drag = search.speeds * search.fastest(search.at(np.array(state))[2])
        slowed = _found(search, state)
        search.drag = np.zeros(search.count)
        x, slope, jacobian = search.at(slowed)
        if search.close(x, slope, jacobian):
            rest = search.rested(search.polished(x, slope, jacobian))
            return otherwise if drifts(search, rest) else held_at_start(search, state, rest)
    except (RunFailed, np.linalg.LinAlgError):
        pass
    return otherwise


def _found(search: EquilibriumSearch, state: Array) -> Any:
    """Return the equilibrium that a search reaches from a state. Raises `RunFailed`."""
    count = search.count
    x, slope, jacobian = search.at(np.array(state))
    if not np.isfinite(slope).all():
        raise search.not_finite(slope, x)
    if not np.isfinite(abs(jacobian).max()):
        raise RunFailed(
            "BR753", f"at t = {search.time:.9g} s the rates have slopes that are not finite: no equilibrium is found"
        )
    if not slope.any():
        return search.rested(x)
    search.begin(slope, jacobian)
    if search.close(x, slope, jacobian):
        return search.rested(search.polished(x, slope, jacobian))
    if (moving := search.steady_motion(x, slope, jacobian)) is not None:
        raise moving
    size = search.first(slope, jacobian)
    for _ in range(STEPS):
        found = search.step(x, slope, jacobian, size)
        if found is None:
            size *= 0.25
            continue
        trial, new_slope, new_jacobian = found
        if not np.abs(trial[:count]).max() < search.farthest:
            break
        before, after = search.distance(slope, jacobian), search.distance(new_slope, new_jacobian)
        gain = before / max(after, 1e-300) if np.isfinite(before) and np.isfinite(after) else 1.0
        size *= GROWTH * min(max(gain, 0.5), 100.0)
        x, slope, jacobian = trial, new_slope, new_jacobian
        if after <= CLOSE and search.close(x, slope, jacobian):
            return held_at_start(search, state, search.rested(search.polished(x, slope, jacobian)))
    first_state, first_slope, _ = search.at(np.array(state))
    if search.cancels(first_state, first_slope) or search.steps_by_rounding(first_state):
        return first_state
    rest = _of_linear(search, state)
    if rest is not None:
        return rest
    raise search.no_rest(slope)


def _of_linear(search: EquilibriumSearch, state: Array) -> Any:
    """Return the rest of a linear model that runs away from it, to which one step of Newton's method leads; None for other models."""
    if search.program.hybrid is not None:
        return None
    search.largest = search.begun[0]
    x, slope, jacobian = search.at(np.array(state))
    change = search.correction(slope, jacobian)
    if not np.isfinite(change).all():
        return None
    x, slope, jacobian = search.at(np.concatenate([x[: search.count] + change, x[search.count :]]))
    there = (np.abs(slope) <= ROUNDING * (np.abs(jacobian) @ search.largest + search.loop_terms)).all()
    return search.rested(x) if there else None


def search_at(constraints: Constraints, first: Segment) -> EquilibriumSearch:
    """Return a dense search at the begin of a segment, or a sparse one for a large model. Directions left by loop joints are dense in any case."""
    rows, _ = constraints.program.pattern
    if not constraints and is_large(constraints.count, len(rows)):
        from .sparse import SparseSearch

        return SparseSearch(constraints, first)
    return EquilibriumSearch(constraints, first)


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
            size = np.maximum(np.abs(start[: search.count]), search.scale(np.zeros(search.count)))[places]
            sums = np.abs(search.sums @ (nearer - rest)[: search.count]).max(initial=0.0)
            if (np.abs(nearer - start)[places] <= KEPT * size).all() and sums <= KEPT * size.max():
                return nearer
    except (RunFailed, np.linalg.LinAlgError):
        pass
    return rest


def free_coordinates(search: EquilibriumSearch, rest: Array) -> Any:
    """Return a mask (n,) of the states that move along a family of rests which no conserved sum tells apart: null vectors v and w of the derivatives
    with w'v = 0."""
    return _moving_along(search, rest, True)


def drifts(search: EquilibriumSearch, rest: Array) -> bool:
    """Return True if something moves at a rest, along a motion that nothing drives, slows or stops."""
    if search.count > LARGEST:
        return False
    speeds = search.speeds & (np.abs(rest[: search.count]) > MOVED * search.scale(np.zeros(search.count)))
    return bool(speeds.any() and (_moving_along(search, rest, False) & speeds).any())


def undetermined(search: EquilibriumSearch, rest: Array, sums: Array) -> Any:
    """Return a mask (n,) of the states that move along a family of rests which these sums (k, n), kept by every motion, do not tell apart."""
    return _moving_along(search, rest, sums)


def _moving_along(search: EquilibriumSearch, rest: Array, apart: bool | Array) -> Any:
    """Return a mask (n,) of the states that move along a family of rests: of those that conserved sums do not tell apart, the left null vectors (True) or
    the rows of a matrix (k, n)."""
    jacobian = search.derivatives_with_terms(rest)
    if jacobian is None:
        return np.zeros(search.count, dtype=bool)
    size = search.moved(search.scale(np.zeros(search.count)), jacobian)
    basis = np.eye(search.count) if search.basis is None else search.basis
    lengths = 1.0 / np.abs(basis / size[:, None]).max(axis=0)  # of one magnitude each
    inner, terms = basis.T @ jacobian @ basis, np.abs(basis).T @ search.terms @ np.abs(basis)
    left, right = search.null_spaces(inner * lengths, terms * lengths)
    ways = np.eye(right.shape[1])
    if apart is not False:
        # of magnitudes, like the directions
        sums = left * lengths[:, None] if apart is True else (apart @ basis * lengths).T
        tied = (sums / nonzero(np.abs(sums).max(axis=0, initial=0.0))).T @ (
            right / np.abs(right).max(axis=0, initial=0.0)
        )
        _, sizes, turned = np.linalg.svd(tied)
        ways = turned[int((sizes > KEPT).sum()) :].T
    moves = basis @ (lengths[:, None] * right @ ways)
    sizes = np.abs(moves / size[:, None])
    return (sizes > MOVED * sizes.max(axis=0, initial=0.0)).any(axis=1)
