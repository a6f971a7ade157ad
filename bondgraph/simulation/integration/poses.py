"""Actions near a singular pose, the same for all integrators."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array

from ..segments.timeline import Segment

if TYPE_CHECKING:
    from ..constraints.crossing import Crossed
    from .integration_state import IntegrationState


def chosen_anew(stepper: IntegrationState, time: float, state: Array, mode: Array, step: float) -> bool:
    """Return True if the phase must end here because other constraints should be active from now on: the next phase selects them."""
    if stepper.choice is None or not stepper.singular.other_rows(time, state, mode, step):
        return False
    stepper.result.handover = stepper.choice.transition(time, state, mode)
    return True


def beyond(stepper: IntegrationState, crossed: Crossed, state: Array, stretch: Segment) -> Any:
    """Return the state after a crossing, and store the run's data on it. `state`: before."""
    magnitude, count = stepper.tolerances.magnitude, stepper.constraints.count

    def sample(times: Array) -> Any:
        states = crossed.at(times) * magnitude[:count]
        unknowns = np.broadcast_to(state[count:], (len(states), len(state) - count))
        return np.concatenate([states, unknowns], axis=1)

    end = crossed.start + crossed.size
    last, instants = stepper.position, stepper.instants
    while last < len(instants) and instants[last] <= end and instants[last] < stretch.stop:
        last += 1
    times = instants[stepper.position : last]
    if len(times):
        stepper.result.states[stepper.position : last] = stepper.held_all(times, sample(times), stretch.mode)
        stepper.position = last
    stepper.watch_limits(crossed.start, end, times, sample, stretch)
    if stepper.powers is not None:
        stepper.add_work(crossed.start, end, sample, stretch)
    return stepper.held(end, sample(np.array([end]))[0], stretch.mode)
