"""Mechanisms with closing joints at the start: put together, and which of their constraints are independent.

What is drawn closes by construction; where starts move it, the states of which nothing was said follow, as little as it takes, and
where that is not enough (digits that were rounded) those of which something was said give way by what rounding allows. Then the
rank is looked at: rows that hang on others at this pose and at poses beside it are redundant and take no part in the run; rows that
do so only here make the start a singular pose, from which nothing says how the mechanism goes on.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ...errors import RunFailed
from ..closed.constraints import Assembled, Constraints

ITERATIONS = 50
RANK = 1e-7  # of the largest singular value, where slopes are differences
FULL = 1e-9  # the same, where they are exact
DIFFERENCE = 1e-6
CLOSE = 1e-6  # relative: by how much a start that was given may be off
TRIES = 4
BESIDE = 1e-2  # radians or shares of the size: where the rank is looked at again
Missed = Callable[[Any], Any]  # states (…, n) -> by how much the author's claims are missed


def assemble(constraints: Constraints, claims: Missed, time: float, mode: Any, state: Any, movable: Any) -> Any:
    """The state, shape (n,), nearest to the given one that keeps all invariants and claims; only what is `movable` (a mask over the
    states) moves, if that is enough. Raises `RunFailed`."""
    found = _solved(constraints, claims, time, mode, state, movable)
    if constraints.missed(time, found, mode) > FULL:
        loose = _solved(constraints, claims, time, mode, state, np.ones(constraints.count, dtype=bool))
        given, count = ~movable, constraints.count
        size = np.maximum(np.abs(state[:count]), sizes(constraints, time, state, mode))
        off = np.abs(loose - state)[:count][given] > CLOSE * size[given]
        if off.any() or constraints.missed(time, loose, mode) > FULL:
            raise RunFailed(_contradiction(constraints, time, mode, found, given))
        found = loose
    return constraints.project(time, found, mode)


def _contradiction(constraints: Constraints, time: float, mode: Any, state: Any, given: Any) -> str:
    gaps = constraints.values(time, state, mode)[: constraints.gaps]
    slopes, _ = constraints.slopes(time, state, mode)
    worst = int(np.argmax(np.abs(gaps) / constraints.sizes(slopes)))
    names = constraints.program.invariants
    states = [n for n, g in zip(constraints.program.states.names, given, strict=False) if g]
    joint = names.names[worst].rpartition(".")[0]
    starts = f" with the starts of {', '.join(f'`{n}`' for n in states[:6])}" if states else ""
    return (
        f"`{joint}` cannot be closed{starts}: {abs(gaps[worst]):.3g} {names.units[worst]} are left open; "
        "the parts do not reach each other there, or starts contradict each other"
    )


def sizes(constraints: Constraints, time: float, state: Any, mode: Any) -> Any:
    """What a change of each state is measured by: a length by that of the mechanism, an angle by a radian."""
    units = constraints.program.states.units
    slopes, _ = constraints.slopes(time, state, mode)
    turns = np.array([units[p] == "1" for p in constraints.positions], dtype=bool)
    arms = np.abs(slopes[constraints.lengths][:, turns])
    length = float(arms.max(initial=0.0)) or 1.0
    return np.array([length if u in ("m", "m/s") else 1.0 for u in units])


def _solved(constraints: Constraints, claims: Missed, time: float, mode: Any, state: Any, movable: Any) -> Any:
    program = constraints.program
    size = sizes(constraints, time, state, mode)
    fixed = (constraints.inputs, constraints.constants, mode)

    def missed(x: Any) -> Any:
        return np.concatenate([claims(x), program.invariant(time, x, *fixed)], axis=-1)

    speeds = np.zeros(len(movable), dtype=bool)
    speeds[constraints.speeds] = True
    _, by_speeds = _slopes(missed, state, np.flatnonzero(speeds), size)
    still = ~(np.abs(by_speeds).max(axis=1, initial=0.0) > 0)
    # Positions first: where both are sought together, a speed that is asked for could turn a joint over to another pose.
    state = _search(missed, state, np.flatnonzero(movable & ~speeds), still, size)
    for places in (np.flatnonzero(movable & speeds), np.flatnonzero(movable)):
        state = _search(missed, state, places, np.ones(len(still), dtype=bool), size)
    return state


def _slopes(missed: Missed, state: Any, places: Any, size: Any) -> tuple[Any, Any]:
    """The places' size of a change, and central differences by these; shape (rows, places)."""
    shifts = np.zeros((len(places), len(state)))
    shifts[np.arange(len(places)), places] = DIFFERENCE * size[places]
    return size[places], ((missed(state + shifts) - missed(state - shifts)) / (2 * DIFFERENCE)).T


def _search(missed: Missed, state: Any, places: Any, rows: Any, size: Any) -> Any:
    """Gauss and Newton, damped where a step brings nothing nearer (Levenberg and Marquardt)."""
    state, value, damping = np.array(state), missed(state)[rows], 0.0
    for _ in range(ITERATIONS if len(places) else 0):
        reach, slopes = _slopes(missed, state, places, size)
        slopes = slopes[rows]
        bound = np.abs(slopes).max(axis=1, initial=0.0)
        told = bound > 0
        if not told.any():
            break
        scaled, miss = slopes[told] / bound[told, None], value[told] / bound[told]
        if np.abs(miss).max() < 1e-15:
            break
        step = _step(scaled, miss, damping)
        trial = state.copy()
        trial[places] += reach * step
        new = missed(trial)[rows]
        if np.linalg.norm(new[told] / bound[told]) < np.linalg.norm(miss):
            state, value = trial, new
            damping = damping / 10 if damping > 1e-6 else 0.0
        elif np.abs(step).max() < 1e-13 or damping > 1e8:
            break
        else:
            damping = 10 * damping or 1e-3
    return state


def _step(slopes: Any, miss: Any, damping: float) -> Any:
    if damping:
        count = slopes.shape[1]
        slopes = np.vstack([slopes, np.sqrt(damping) * np.eye(count)])
        miss = np.concatenate([miss, np.zeros(count)])
    step, *_ = np.linalg.lstsq(slopes, -miss, rcond=RANK)
    return step


# ---------------------------------------------------------------- rank
def choose_rows(constraints: Constraints, time: float, state: Any, mode: Any) -> Assembled:
    """Find the independent constraints and let only these take part. Raises `RunFailed` in a singular pose."""
    positions = len(constraints.positions)
    here, _, rank = _rank(constraints, time, state, mode)
    bound = np.array(constraints.program.parts) >= 0
    if rank == constraints.gaps:
        return Assembled(positions - rank, ())
    beside = _moved_aside(constraints, time, state, mode, here)
    if beside is None and rank < positions:
        raise RunFailed(
            f"at t = {time:.9g} s the mechanism is drawn in a pose from which it cannot move although {_told(_lost(constraints, here))} "
            "would let it: its bars are stretched out; draw it a little beside, or leave a joint out"
        )
    _, order, generic = _rank(constraints, time, state if beside is None else beside, mode)
    if generic > rank:
        raise RunFailed(
            f"at t = {time:.9g} s the mechanism starts in a singular pose: {_told(_lost(constraints, here))} let it go on in several ways "
            f"there ({positions - rank} motions instead of {positions - generic}), and nothing says in which; start it a little beside"
        )
    taking = np.zeros(constraints.gaps, dtype=bool)
    taking[order[:generic]] = True
    taking |= ~bound
    constraints.leave_out(taking)
    names = np.array(constraints.program.invariants.names[: constraints.gaps])
    return Assembled(positions - generic, tuple(str(n) for n in names[~taking]))


def _told(names: tuple[str, ...]) -> str:
    return ", ".join(f"`{n}`" for n in names[:6]) + ("…" if len(names) > 6 else "")


def _rank(constraints: Constraints, time: float, state: Any, mode: Any) -> tuple[Any, Any, int]:
    """Scaled slopes, the rows in the order in which they bring something new, and the rank."""
    from scipy.linalg import qr

    slopes, _ = constraints.slopes(time, state, mode)
    slopes = slopes / constraints.sizes(slopes)[:, None]
    _, triangle, order = qr(slopes.T, mode="economic", pivoting=True)
    left = np.abs(np.diag(triangle))
    return slopes, order, int((left > FULL * left[0]).sum()) if len(left) and left[0] > 0 else 0


def _moved_aside(constraints: Constraints, time: float, state: Any, mode: Any, slopes: Any) -> Any:
    """A pose beside this one, along a motion that its constraints allow; None if they allow none after all.

    First it is held by constraints that are independent here, as what follows from others hinders beside the pose; then by all.
    """
    from scipy.linalg import qr

    _, values, right = np.linalg.svd(slopes)
    rank = int((values > FULL * values[0]).sum())
    independent = np.zeros(constraints.gaps, dtype=bool)
    independent[qr(slopes.T, mode="economic", pivoting=True)[2][:rank]] = True
    free, positions = right[rank:], constraints.positions
    reach = constraints.reach[positions]
    ways = [free.T @ np.random.default_rng(seed).normal(size=len(free)) for seed in range(TRIES if len(free) else 0)]
    for way, taking in ((way, taking) for way in ways for taking in (independent, constraints.taking)):
        aside = np.array(state)
        aside[positions] += BESIDE * reach * way / np.linalg.norm(way)
        aside = constraints.project_by(taking, time, aside, mode)
        moved = np.linalg.norm((aside - state)[positions] / reach)
        if moved > 0.1 * BESIDE and constraints.missed(time, aside, mode) < FULL:
            return aside
    return None


def _lost(constraints: Constraints, slopes: Any) -> tuple[str, ...]:
    """The joints whose rows hang together."""
    left, values, _ = np.linalg.svd(slopes)
    rank = int((values > FULL * values[0]).sum())
    share = np.abs(left[:, rank:]).max(axis=1)
    names = constraints.program.invariants.names
    return tuple(dict.fromkeys(names[i].rpartition(".")[0] for i in np.flatnonzero(share > 0.1)))
