"""Mechanisms with loop joints at the start: their rates, and the independent ones among their constraints.

The pose is known already (`poses.py`), and rates never change it. Rates without a given start value follow, by the least change; where that is
not enough (rounded digits), the given ones change within rounding. Then the rank is examined: rows that depend on others at this pose and
at neighbouring poses are redundant and inactive in the run; rows that do so only here make the start a singular pose, from which the further
motion is undetermined.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from compiler.api import Array, BoolArray

from ...errors import RunFailed
from ...quantities import listed
from ..constraints.constraints import Assembled, Constraints
from .initial_equations import fulfil

RANK = 1e-7  # relative to the largest singular value, for derivatives by differences
FULL = 1e-9  # the same, for exact derivatives
CLOSE = 1e-6  # relative change that a given start value may undergo
AT_REST = 1e-150  # relative to the size of a mechanism, 1/s: the squares of slower rates are no numbers
TRIES = 4
BESIDE = 1e-2  # radians or fractions of the size: distance of the poses at which the rank is examined again
SPEEDS = ("m/s", "1/s")
Missed = Callable[[Any], Any]  # states (n,) -> residuals of the initial equations


def rates_closed(
    constraints: Constraints, claims: Missed, at: tuple[float, Any], state: Array, masks: tuple[Any, Any],
    claimed: Sequence[tuple[str, str]],
) -> Any:  # fmt: skip
    """Return the states, shape (n,), with rates (and other states that are no pose) that keep the loops closed and satisfy the initial equations.

    `at`: time and mode; `masks`: the movable states, and the poses; `claimed`: names and units in the initial equations. Only movable states change, apart from
    rounding of the others' start values; a pose never does. Raises `RunFailed`.
    """
    movable, poses = masks
    count, program = constraints.count, constraints.program
    fixed = (constraints.inputs, constraints.constants, at[1])
    unit_of, speed = sizes(constraints, at[0], state, at[1]), np.isin(program.states.units, SPEEDS)
    size = np.array([unit_of.get(u, 0.0) for u in program.states.units])
    state = state.copy()
    state[:count][speed & (np.abs(state[:count]) < AT_REST * size)] = 0.0

    def missed(x: Array) -> Any:
        gaps = program.invariant(at[0], x, *fixed)
        return np.concatenate([claims(x), np.asarray(gaps)[constraints.gaps :]])

    units = [*(unit for _, unit in claimed), *program.invariants.units[constraints.gaps :]]
    missing = [abs(v) / unit_of[u] for v, u in zip(missed(state), units, strict=True) if u in SPEEDS]
    changes = np.where(speed, (max(missing, default=0.0) or 1.0) * size, 0.0)

    def searched(places: BoolArray) -> Any:
        closed = fulfil(lambda x: missed(np.append(x, state[count:])), state[:count], places, changes, RANK)
        return np.append(closed, state[count:])

    found = searched(movable & ~poses)
    opening = _opening(constraints, at, found, size)
    if opening is not None:
        loose = searched(~poses)
        given_size = np.where(speed, _fastest(constraints, loose, size) * size, np.abs(state[:count]))
        off = np.abs(loose - state)[:count] > CLOSE * given_size
        if off[~movable & ~poses].any() or _opening(constraints, at, loose, size) is not None:
            given = np.flatnonzero(~movable[:count] & ~poses[:count])
            rates = [constraints.program.states.names[i].rpartition(".")[0] for i in given]
            names = listed(tuple(dict.fromkeys((*rates, *(name for name, _ in claimed)))))
            raise RunFailed(
                "BR736", f"the starts of rates of {names} cannot hold together: in this pose `{opening}` would not stay closed;", "leave one of them out",
            )  # fmt: skip
        found = loose
    return found


def _opening(constraints: Constraints, at: tuple[float, Any], state: Array, size: Array) -> str | None:
    """Return the joint that opens with the rates of a state, or None; `size`: of the states."""
    rates = constraints.values(at[0], state, at[1])[constraints.gaps :]
    _, slopes = constraints.slopes(at[0], state, at[1])
    speeds = constraints.speeds
    arms = np.abs(slopes * size[speeds] / constraints.reach[speeds]).max(axis=1, initial=0.0)
    bad = np.flatnonzero(np.abs(rates) > FULL * arms * _fastest(constraints, state, size))
    if not len(bad):
        return None
    return constraints.name_of(int(np.flatnonzero(constraints.rate_rows == constraints.gaps + bad[0])[0])).rpartition(
        "."
    )[0]


def _fastest(constraints: Constraints, state: Array, size: Array) -> float:
    """Return the largest rate that enters the residuals' rates, in units of the mechanism."""
    return float(np.abs(state[constraints.speeds] / size[constraints.speeds]).max(initial=0.0))


def sizes(constraints: Constraints, time: float, state: Array, mode: Array) -> dict[str, float]:
    """Return the size of each unit of the mechanism, for rates in 1 s: its length for a length, a radian for an angle."""
    slopes, _ = constraints.slopes(time, state, mode)
    turns = np.array([constraints.program.states.units[p] == "1" for p in constraints.positions], dtype=bool)
    arms = np.abs(slopes[constraints.lengths][:, turns])
    length = float(arms.max(initial=0.0)) or 1.0
    return {"m": length, "m/s": length, "1": 1.0, "1/s": 1.0}


def measures(constraints: Constraints, time: float, state: Array, mode: Array) -> Any:
    """Return the size of each state of the mechanism, (n,): that of its unit, for a rate as far as the fastest part moves; 0 for other states."""
    units, unit_of = constraints.program.states.units, sizes(constraints, time, state, mode)
    size = np.array([unit_of.get(u, 0.0) for u in units])
    return np.where(np.isin(units, SPEEDS), _fastest(constraints, state, size) * size, size)


# ---------------------------------------------------------------- rank
def choose_rows(constraints: Constraints, time: float, state: Array, mode: Array) -> Assembled:
    """Find the independent constraints and activate only these. Raises `RunFailed` in a singular pose."""
    assembled = _choose_residuals(constraints, time, state, mode)
    if constraints.all == constraints.gaps:
        return assembled
    redundant = _choose_rates(constraints, time, state, mode)
    return Assembled(len(constraints.speeds) - len(constraints.taking_rates), (*assembled.redundant, *redundant))


def _choose_residuals(constraints: Constraints, time: float, state: Array, mode: Array) -> Assembled:
    """Find the independent constraints among those with residuals."""
    positions = len(constraints.positions)
    here, _, rank = _rank(constraints, time, state, mode)
    bound = np.array(constraints.program.parts)[: constraints.gaps] >= 0
    if rank == constraints.gaps:
        return Assembled(positions - rank, ())
    beside = _moved_aside(constraints, time, state, mode, here)
    if beside is None and rank < positions:
        joints = listed(_lost(constraints, here))
        raise RunFailed(
            "BR737", f"at t = {time:.9g} s the mechanism is drawn in a pose from which it cannot move although {joints} would let it: "
            "its bars are stretched out;", "draw it a little beside, or leave a joint out",
        )  # fmt: skip
    _, order, generic = _rank(constraints, time, state if beside is None else beside, mode)
    if generic > rank:
        raise _singular(time, _lost(constraints, here), positions - rank, positions - generic)
    taking = np.zeros(constraints.gaps, dtype=bool)
    taking[order[:generic]] = True
    taking |= ~bound
    constraints.leave_out(np.concatenate([taking, constraints.taking[constraints.gaps :]]))
    names = np.array(constraints.program.invariants.names[: constraints.gaps])
    return Assembled(positions - generic, tuple(str(n) for n in names[~taking]))


def _singular(time: float, joints: tuple[str, ...], motions: int, beside: int) -> RunFailed:
    return RunFailed(
        "BR738", f"at t = {time:.9g} s the mechanism starts in a singular pose: {listed(joints)} let it go on in several ways "
        f"there ({motions} motions instead of {beside}), and nothing says in which;", "start it a little beside",
    )  # fmt: skip


def _choose_rates(constraints: Constraints, time: float, state: Array, mode: Array) -> tuple[str, ...]:
    """Activate only the independent constraints on rates alone, and return the names of the others."""
    order, rank = _rank_of_rates(constraints, time, state, mode)
    if rank == len(order):
        return ()
    aside, still = np.array(state), np.ones(constraints.count, dtype=bool)
    still[constraints.speeds] = False
    aside[: constraints.count] += (
        BESIDE * still * constraints.reach * np.random.default_rng(0).uniform(-1, 1, constraints.count)
    )
    order, generic = _rank_of_rates(constraints, time, constraints.project(time, aside, mode), mode)
    names = [constraints.name_of(i) for i in range(constraints.gaps, constraints.all)]
    if generic > rank:
        left = len(constraints.speeds) - len(constraints.taking_rates) + len(order)
        raise _singular(time, tuple(dict.fromkeys(n.rpartition(".")[0] for n in names)), left - rank, left - generic)
    taking = constraints.taking.copy()
    taking[constraints.gaps + order[generic:]] = False
    constraints.leave_out(taking)
    return tuple(names[i] for i in order[generic:])


def _rank_of_rates(constraints: Constraints, time: float, state: Array, mode: Array) -> tuple[Any, int]:
    """Return the constraints on rates alone in the order of a pivoted factorisation, and how many are independent of each other and of the rest."""
    from scipy.linalg import qr

    _, slopes = constraints.slopes(time, state, mode)
    slopes = slopes / np.maximum(np.linalg.norm(slopes, axis=1, keepdims=True), np.finfo(float).tiny)
    places = constraints.rate_rows - constraints.gaps
    others = slopes[places[: constraints.gaps][constraints.taking_gaps & (places[: constraints.gaps] >= 0)]]
    own = slopes[places[constraints.gaps :]]
    basis = qr(others.T, mode="economic")[0] if len(others) else np.zeros((slopes.shape[1], 0))
    _, triangle, order = qr((own - own @ basis @ basis.T).T, mode="economic", pivoting=True)
    return order, int((np.abs(np.diag(triangle)) > FULL).sum())


def _rank(constraints: Constraints, time: float, state: Array, mode: Array) -> tuple[Any, Any, int]:
    """Return the scaled Jacobian, the rows in the order of a pivoted factorisation, and the rank."""
    from scipy.linalg import qr

    slopes, _ = constraints.slopes(time, state, mode)
    if not len(slopes):
        return slopes, np.zeros(0, dtype=int), 0
    slopes = slopes / constraints.sizes(slopes)[:, None]
    _, triangle, order = qr(slopes.T, mode="economic", pivoting=True)
    left = np.abs(np.diag(triangle))
    return slopes, order, int((left > FULL * left[0]).sum()) if len(left) and left[0] > 0 else 0


def _moved_aside(constraints: Constraints, time: float, state: Array, mode: Array, slopes: Array) -> Any:
    """Return a neighbouring pose along a motion that the constraints allow; None if they allow none.

    First it is projected on the constraints that are independent here, because redundant ones hinder beside the pose; then on all.
    """
    from scipy.linalg import qr

    _, values, right = np.linalg.svd(slopes)
    rank = int((values > FULL * values[0]).sum())
    independent = np.zeros(constraints.all, dtype=bool)
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


def _lost(constraints: Constraints, slopes: Array) -> tuple[str, ...]:
    """Return the joints whose rows are dependent."""
    left, values, _ = np.linalg.svd(slopes)
    rank = int((values > FULL * values[0]).sum())
    share = np.abs(left[:, rank:]).max(axis=1)
    names = constraints.program.invariants.names
    return tuple(dict.fromkeys(names[i].rpartition(".")[0] for i in np.flatnonzero(share > 0.1)))
