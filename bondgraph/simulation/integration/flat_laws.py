"""A step over an instant at which a law of a loop is flat, as z^3 at zero: no implicit step begins there, as the slope that it uses is zero."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array

from ...errors import RunFailed, StepsCollapsed
from ..constraints.crossing import Crossed
from ..segments.timeline import Segment

if TYPE_CHECKING:
    from .integration_state import IntegrationState

ALIKE = 0.1  # of the tolerance: what the step may miss
SHRINKS = 0.9  # ratio of the ways of unknowns in a step and in one a hundredth as long: as of a root of order 40
GROWS = 2.0  # times the ratio of two steps: a longer way of an unknown is a jump


def step_over(stepper: IntegrationState, told: StepsCollapsed, before: Array, stretch: Segment) -> Crossed | None:
    """Return the longest step along the rates within which these change by nothing that the tolerance sees; None if there is none.

    The unknowns of loops are searched at its end. They must come back to where they are as the step gets shorter, without a jump: else what is
    found is another solution, and the branch ends; not where loops are proved to have one only, which `before` may miss. `before`: the state.
    """
    mode, count = stretch.mode, stepper.constraints.count
    if not stepper.program.unknowns.names or stepper.history is not None or not told.ahead:
        return None

    def values(time: float, state: Array) -> tuple[Any, Any]:
        rates = stepper.program.derivative(time, state, stepper.inputs, stepper.constants, mode)[:count]
        events = stepper.events
        return rates, () if events is None else events.truth(events.roots(time, state, mode))

    start, tolerances = told.time, stepper.tolerances
    allowed = ALIKE * (tolerances.absolute + tolerances.relative * np.abs(before))
    rates, truth = values(start, before)
    end = span = 0.0
    way, after = None, before
    for time, state in told.ahead:
        if time >= stretch.stop:
            break
        try:
            after = stepper.held(time, np.concatenate([state[:count], after[count:]]), mode)
        except RunFailed:
            break
        size, last, way = time - start, way, np.abs(after - before)[count:]
        changed, others = values(time, after)
        if (size * np.abs(changed - rates) > allowed[:count]).any() or not np.array_equal(truth, others):
            break
        if stepper.unique:
            end = size
        elif last is not None:
            low, high = (np.fmax(x, allowed[count:]) for x in (SHRINKS * way, GROWS * size / span * last))
            if not ((last <= low) & (way <= high)).all():
                break
            end = size
        span = size
    if not end:
        return None
    magnitude = tolerances.magnitude[:count]
    return Crossed(start, end, before[:count] / magnitude, (rates / magnitude)[None], 0.0)
