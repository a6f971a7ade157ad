"""Slow manifold: project a state onto the slow motion with the same slow coordinates, which removes its fast oscillations.

On the slow motion the fast coordinates only follow, so all their derivatives are small. The state whose fast part of x'' vanishes misses the
slow motion by a part (slow rate / fast rate)^2 of the value that the fast coordinates follow (Gear, Kaper, Kevrekidis and Zagaris, Projecting to
a slow manifold, SIAM J. Appl. Dyn. Syst. 4, 2005). A step towards a vanishing third derivative adds one order, and shows if the orders
converge. Newton steps take the fast part of the Jacobian from the split at the current state.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array

from .spectrum_split import ScaledDynamics, Split, one

ROUNDS = 3  # number of splits, each at the state that the previous one led to
ITERATIONS = 12
CLOSE = 1e-8  # relative to the removed part: the iteration ends below this change
STRAIGHT = 1e-4  # relative to the first change: a smaller second one shows equal fast motions at both ends
LOOK = 0.01  # radians of the fastest motion: time step of difference quotients


@dataclass(frozen=True, eq=False)
class SlowState:
    """Result of a projection onto the slow manifold.

    `state` (n,) over the magnitudes of the flow, the part `removed` from the earlier state, the `split` there; `rest`: remaining error of the
    orders that were used.
    """

    state: Any
    removed: Any
    split: Split
    rest: Any


def settled(flow: ScaledDynamics, first: Split, time: float, state: Array, mode: Array, bandwidth: float) -> SlowState | str:  # fmt: skip
    """Return the slow motion near a state in SI, with its unknowns; or the reason as text why there is none."""
    before = state[: flow.count] / flow.magnitude
    here, now, times, near = before, first, np.array([time]), state[None]
    rest = np.zeros(flow.count)
    for number in range(ROUNDS):
        moved, last, contraction = _iterated(flow, now, time, here, mode, state)
        if not np.isfinite(moved).all():
            return "no slow motion is found near it"
        here, rest = moved, last
        if contraction < STRAIGHT or number == ROUNDS - 1:
            break
        (again,) = flow.splits(times, flow.whole(times, one(mode), near, here[None]), one(mode), bandwidth)
        if isinstance(again, str):
            return again
        if len(again.values) != len(first.values):
            return "how much is faster than the bandwidth depends on what would be left out"
        now = again
    thrice = now.inverse @ now.inverse @ now.inverse
    here = here - thrice @ _third(flow, now, time, here, mode, state)
    last = thrice @ _third(flow, now, time, here, mode, state)
    return SlowState(here, before - here, now, np.abs(rest) + np.abs(last))


def _iterated(flow: ScaledDynamics, at: Split, time: float, here: Array, mode: Array, near: Array) -> tuple[Any, Any, float]:  # fmt: skip
    """Return the state whose fast part of x'' vanishes, the last change of the iteration, and the ratio of the second change to the first."""
    twice = at.inverse @ at.inverse
    sizes: list[float] = []
    change = np.full(len(here), np.inf)
    while len(sizes) < ITERATIONS:
        step = twice @ second(flow, at, time, here, mode, near)
        sizes.append(float(np.linalg.norm(step)))
        if not np.isfinite(sizes[-1]) or (len(sizes) > 1 and sizes[-1] > 0.5 * sizes[-2]):
            break  # rounding is reached, or there is no such state
        here, change = here - step, step
        if sizes[-1] <= CLOSE * sizes[0]:
            break
    return here, change, sizes[1] / sizes[0] if len(sizes) > 1 and sizes[0] else 0.0


def second(flow: ScaledDynamics, at: Split, time: float, here: Array, mode: Array, near: Array) -> Any:
    """Return the second time derivative at a state over the magnitudes; `near`: a state in SI with its unknowns."""
    return _next(flow, at, time, here, mode, near)[1]


def _next(
    flow: ScaledDynamics, at: Split, time: float, here: Array, mode: Array, near: Array, matrix: Array | None = None
) -> tuple[Any, Any]:
    """Return the first two time derivatives. `matrix`: the Jacobian there, if it differs from that of `at`."""
    ahead = LOOK / float(np.abs(at.values).max())
    rate, later = (flow.rate(t, mode, near, here) for t in (time, time + ahead))
    return rate, (at.matrix if matrix is None else matrix) @ rate + (later - rate) / ahead


def _third(flow: ScaledDynamics, at: Split, time: float, here: Array, mode: Array, near: Array) -> Any:
    """Return the third time derivative."""
    ahead = LOOK / float(np.abs(at.values).max())
    rate, now = _next(flow, at, time, here, mode, near)
    there = here + ahead * rate + 0.5 * ahead**2 * now
    times = np.array([time + ahead])
    (matrix,) = flow.matrices(times, one(mode), flow.whole(times, one(mode), near[None], there[None]))
    return (_next(flow, at, time + ahead, there, mode, near, matrix)[1] - now) / ahead
