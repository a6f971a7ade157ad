"""A state without what rings in it: the slow motion that has the same slow coordinates.

On a slow motion the fast coordinates only follow, so that all their derivatives are small. The state whose fast part of x'' vanishes misses the slow
motion by a part (slow rate / fast rate)^2 of what the fast coordinates follow (Gear, Kaper, Kevrekidis and Zagaris, Projecting to a slow manifold,
SIAM J. Appl. Dyn. Syst. 4, 2005). Newton steps take the fast part of the Jacobian from the split where the run stands.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .split import Flow, Split

ROUNDS = 3  # of splits, each at the state that the one before led to
ITERATIONS = 12
CLOSE = 1e-10  # of what is removed: where iterations end
LOOK = 0.01  # of a radian of the fastest motion: differences in time


@dataclass(frozen=True, eq=False)
class Settled:
    """`state` (n,) over the magnitudes of the flow, what was `removed` from the one before, the `split` there; `rest`: what the next order would remove."""

    state: Any
    removed: Any
    split: Split
    rest: Any


def settled(flow: Flow, first: Split, time: float, state: Any, mode: Any, bandwidth: float) -> Settled | str:
    """The slow motion near a state in SI, with its unknowns; or why there is none."""
    before = state[: flow.count] / flow.magnitude
    here, now = before, first
    rest = np.zeros(flow.count)
    for number in range(ROUNDS):
        moved, last = _iterated(flow, now, time, here, mode, state)
        if not np.isfinite(moved).all():
            return "no slow motion is found near it"
        change, here = float(np.linalg.norm(moved - here)), moved
        rest = np.abs(last)
        if change <= CLOSE**0.5 * float(np.linalg.norm(before - here)) or number == ROUNDS - 1:
            break
        again = flow.split(time, flow.whole(np.array([time]), here[None], mode, state[None])[0], mode, bandwidth)
        if isinstance(again, str):
            return again
        if len(again.values) != len(first.values):
            return "how much is faster than the bandwidth depends on what would be left out"
        now = again
    third = now.inverse @ now.inverse @ now.inverse @ _third(flow, now, time, here, mode, state)
    return Settled(here, before - here, now, rest + np.abs(third))


def _iterated(flow: Flow, at: Split, time: float, here: Any, mode: Any, near: Any) -> tuple[Any, Any]:
    """The state whose fast part of x'' vanishes, and the last change on the way there."""
    twice = at.inverse @ at.inverse
    last = np.inf
    first = change = None
    for _ in range(ITERATIONS):
        step = twice @ _second(flow, at, time, here, mode, near)
        size = float(np.linalg.norm(step))
        if size > 0.5 * last or not np.isfinite(size):
            break  # rounding, or there is none
        here, last, change = here - step, size, step
        first = size if first is None else first
        if size <= CLOSE * first:
            break
    return here, (np.full(len(here), np.inf) if change is None else change)


def _second(flow: Flow, at: Split, time: float, here: Any, mode: Any, near: Any) -> Any:
    """x'' there."""
    ahead = LOOK / float(np.abs(at.values).max())
    rates = flow.rates(np.array([time, time + ahead]), np.stack([here, here]), mode, np.stack([near, near]))
    return at.matrix @ rates[0] + (rates[1] - rates[0]) / ahead


def _third(flow: Flow, at: Split, time: float, here: Any, mode: Any, near: Any) -> Any:
    """x''' there."""
    ahead = LOOK / float(np.abs(at.values).max())
    (rate,) = flow.rates(np.array([time]), here[None], mode, near[None])
    now = _second(flow, at, time, here, mode, near)
    then = _second(flow, at, time + ahead, here + ahead * rate + 0.5 * ahead**2 * now, mode, near)
    return (then - now) / ahead
