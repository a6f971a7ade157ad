"""Mode iteration at an instant: conditions change until all are as just after it, with the unknowns of loops that belong to them.

If under each truth value the flow leads back to the other, no motion on either side is possible: the model slides along the condition, which is
reported, not integrated (sticking needs a law of its own; Filippov, Differential Equations with Discontinuous Righthand Sides, 1988, describes
the possible interpretations).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from compiler.api import IntArray

from ...errors import RunFailed
from ..integrators.acceptance.event_indicators import REACHES
from .indicators import EventIndicators, HybridState

VANISHES = 0.8  # ratio of differences of two laws at two reaches: a root of the twentieth order has it, a jump has 1
CLOSE = 1e-9  # relative to the magnitudes: rates and unknowns that agree so well are equal


def settled(indicators: EventIndicators, at: HybridState) -> HybridState:
    """Return the mode in which all conditions are as just after, with the matching unknowns of loops."""
    seen: dict[bytes, int] = {}
    trail: list[Any] = []
    now = indicators.solved(at)
    if not len(indicators.places) and not indicators.counted:
        return now
    while True:
        key = now.mode.tobytes()
        if key in seen:
            loop = np.array(trail[seen[key] :])[:, indicators.places]
            flipping = np.flatnonzero(np.ptp(loop, axis=0) > 0)
            between = _between(indicators, now, flipping)
            if between is None and _is_alike(indicators, now, trail[seen[key] :]):
                indicators.floor[flipping] = 4 * indicators.noise(now)[flipping]
                return now
            if between is None:
                between = _onwards(indicators, now, flipping)
            if between is None:
                raise _sliding(indicators, at.time, flipping)
            return between
        seen[key] = len(trail)
        trail.append(now.mode)
        truth = indicators.just_after(now)
        mode = now.mode.copy()
        mode[indicators.places] = truth
        indicators.count_in(HybridState(at.time, now.state, mode))
        if (mode == now.mode).all():
            return now
        now = indicators.solved(HybridState(at.time, now.state, mode))


def reread(indicators: EventIndicators, before: HybridState, at: HybridState) -> HybridState:
    """Return a hybrid state that events have set, with the truth of conditions whose two sides are equal there. `before`: the events."""
    if not len(indicators.places):
        return at
    record = indicators.record
    indicators.evaluated(before)
    record.call("keep")
    now = indicators.solved(at)
    roots, noise, _ = indicators.evaluated(now)
    if not (np.abs(roots) <= noise).any():
        return now
    record.call("reread")
    mode = np.array(record["mode"])
    record["mode"][:] = now.mode
    return HybridState(now.time, now.state, mode)


def _between(indicators: EventIndicators, at: HybridState, conditions: IntArray) -> HybridState | None:
    """Return the mode in which each of these conditions is as where its two sides are equal, if the motion stays there.

    A law that goes through zero (a valve without pressure) ends there; one that jumps (dry friction) does not.
    """
    mode = at.mode.copy()
    mode[indicators.places[conditions]] = indicators.truth(np.zeros(len(indicators.places)))[conditions]
    indicators.count_in(HybridState(at.time, at.state, mode))
    rest = indicators.solved(HybridState(at.time, at.state, mode))
    if (indicators.just_after(rest) == (mode[indicators.places] == 1.0)).all():
        return rest
    return rest if _stands(indicators, rest, conditions) else None


def _onwards(indicators: EventIndicators, at: HybridState, conditions: IntArray) -> HybridState | None:
    """Return the mode into which the motion leads from where the sides of these conditions are equal, if their laws go through zero there.

    A law may be so steep (a root) that what it is at a state that is zero but for rounding leads back from either side.
    """
    rest, ahead = at.mode.copy(), at.mode.copy()
    rest[indicators.places[conditions]] = indicators.truth(np.zeros(len(indicators.places)))[conditions]
    now = indicators.solved(HybridState(at.time, at.state, rest))
    flow = indicators.flow(now)
    if flow is None:
        return None
    ahead[indicators.places[conditions]] = indicators.just_after(now)[conditions]
    differences: list[Any] = []
    for reach in REACHES[1:]:
        state = np.array(now.state)
        state[: indicators.count] += reach * flow[1] * flow[0]
        one, other = (indicators.flow(indicators.solved(HybridState(at.time, state, mode))) for mode in (rest, ahead))
        if one is None or other is None:
            return None
        differences.append(np.abs(other[0] - one[0]))
        if not differences[-1].any():  # something else jumps there, as a count of steps
            return None
        if len(differences) > 1 and not (differences[-2] <= VANISHES * differences[-1]).all():
            return None
    noise = indicators.noise(now)
    indicators.floor[conditions] = np.maximum(4 * noise, indicators.tolerated(noise))[conditions]
    return indicators.solved(HybridState(at.time, at.state, ahead))


def _stands(indicators: EventIndicators, at: HybridState, conditions: IntArray) -> bool:
    """Return True if the rates, as they are now, leave the roots of these conditions zero but for rounding. What moves them later, such as
    a pump that is about to feed an empty tank, is an event of its own."""
    flow = indicators.flow(at)
    if flow is None:
        return False
    first, whole = flow
    state = np.array(at.state)
    state[: indicators.count] += REACHES[-1] * whole * first
    before, after = indicators.roots(at.time, at.state, at.mode), indicators.roots(at.time, state, at.mode)
    limit = indicators.noise(at)
    if not (np.maximum(np.abs(before), np.abs(after)) <= limit)[conditions].all():
        return False
    indicators.floor[conditions] = np.maximum(0.25 * limit, 2 * np.abs(before))[conditions]
    return True


def _is_alike(indicators: EventIndicators, at: HybridState, modes: Sequence[Any]) -> bool:
    """Return True if the rates and unknowns are equal under all these modes, as for a law that is continuous at its condition."""
    flow = indicators.flow(at)
    if flow is None:
        return False
    sizes = np.maximum(indicators.sizes(flow), np.abs(at.state))
    for mode in modes:
        other = indicators.solved(HybridState(at.time, at.state, mode))
        changed = indicators.flow(other)
        if changed is None:
            return False
        moved = np.concatenate([flow[1] * (changed[0] - flow[0]), (other.state - at.state)[indicators.count :]])
        if not (np.abs(moved) <= CLOSE * sizes).all():
            return False
    return True


def _sliding(indicators: EventIndicators, time: float, conditions: IntArray) -> RunFailed:
    return RunFailed(
        "BR780", f"at t = {time:.9g} s {indicators.listed_conditions(conditions)} cannot hold and cannot fail: on either side the motion leads "
        "back to the other, and the model slides along between them.",
        "Give it a law for that: a `mode` that sticks and the events that set it, a hysteresis, or a smooth law (tanh) in place of the jump",
    )  # fmt: skip
