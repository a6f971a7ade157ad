"""A step that an event cuts: whether what is left of it is as accurate as a step of its own would be.

The error was estimated for the whole step, from stages of which none need lie near the event: a law that moves strongly just before it (friction before
a stop) is then seen by none. So the rates are asked at the event and half-way to it: where they are not the slopes of the dense output, what is left
is stepped anew.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ..events.locate import StateAt
    from .stepper import Stepper

NEAR = 1e-3  # of what is left: how far apart the states are that tell a slope
PLACES = (0.5, 1.0)  # of what is left, at which rates are asked
BACK = np.array([0.0, -1.0, -2.0, -3.0, -4.0])
SLOPE = np.array([25.0, -48.0, 36.0, -16.0, 3.0]) / 12  # of order 4
ALLOWED = 1.0  # tolerances by which the states may be off if the slopes err as much all the way
SHORTEST = 2.0**14  # units in the last place of a time: what is shorter tells no slope


def is_sure(stepper: Stepper, start: float, stop: float, mode: Any, states_at: StateAt) -> bool:
    """Whether the dense output of a step obeys the equations from its start up to where an event cuts it."""
    size, count = stop - start, len(stepper.program.states.names)
    if size < SHORTEST * np.spacing(max(abs(start), abs(stop))):
        return True
    times = start + size * np.array(PLACES)
    states, fixed = states_at(times, True), (stepper.inputs, stepper.constants, mode)
    rates = np.array([stepper.program.derivative(t, x, *fixed)[:count] for t, x in zip(times, states, strict=True)])
    stepper.count({"derivative": len(times)})
    beside = states_at((times[:, None] + NEAR * size * BACK).ravel(), False)[:, :count]
    moved = np.einsum("k,pkn->pn", SLOPE / NEAR, beside.reshape(len(times), len(BACK), count))
    tolerances = stepper.tolerances
    allowed = tolerances.absolute[:count] + tolerances.relative * np.abs(states[:, :count])
    off = np.abs(size * rates - moved) / allowed
    return not bool(
        (off > ALLOWED).any()
    )  # no number: the law of this side has ended, which no shorter step would change
