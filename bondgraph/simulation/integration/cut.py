"""Step cut by an event: a test that the remaining part is as accurate as a separate step would be.

The error was estimated for the whole step, from stages that may all lie far from the event: they do not show a law that changes strongly just
before it (friction before a stop). So the rates are evaluated at the event and half-way to it: where they differ from the derivative of the dense
output, the remaining part is integrated again.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from compiler.api import Array

from ..integrators import cuts
from ..integrators.cuts import ALLOWED, HALVES, NEAR, SHORTEST

if TYPE_CHECKING:
    from ..events.locate import StateAt
    from .integration_state import IntegrationState

BACK, SLOPE = np.array(cuts.BACK), np.array(cuts.SLOPE)


def is_sure(stepper: IntegrationState, start: float, stop: float, mode: Array, states_at: StateAt) -> bool:
    """Return True if the dense output of a step satisfies the equations from its start up to the event that cuts it."""
    size, count = stop - start, len(stepper.program.states.names)
    if size < SHORTEST * np.spacing(max(abs(start), abs(stop))):
        return True
    times = start + size * np.array(HALVES)
    states, fixed = states_at(times, True), (stepper.inputs, stepper.constants, mode)
    rates = np.array([stepper.program.derivative(t, x, *fixed)[:count] for t, x in zip(times, states, strict=True)])
    stepper.count({"derivative": len(times)})
    beside = states_at((times[:, None] + NEAR * size * BACK).ravel(), False)[:, :count]
    moved = np.einsum("k,pkn->pn", SLOPE / NEAR, beside.reshape(len(times), len(BACK), count))
    tolerances = stepper.tolerances
    allowed = tolerances.absolute[:count] + tolerances.relative * np.abs(states[:, :count])
    off = np.abs(size * rates - moved) / allowed
    # NaN counts as sure: the law of this side has ended, which no shorter step would change
    return not bool((off > ALLOWED).any())
