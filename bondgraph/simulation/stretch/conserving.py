"""What a method that keeps the energy asks before it steps: that the model loses none, and the size that all its steps have."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import NotLossless, RunFailed, UsageError
from ..segments import Segment
from ..steps.radau import StepFailed
from ..trajectory import Tolerances
from .reference import interpreted

if TYPE_CHECKING:
    from ..steps.compiled.interpreted import Interpreted
    from ..steps.compiled.run import CompiledRadau
    from .stepper import Stepper

SCOUT = 1000  # steps of an adaptive method that look ahead
FIRST = 3  # of them, which begin small
SMALL = 0.05  # of the others are shorter than the steps that are taken then
SHARE = 0.6  # of such a step: then the polynomial between the ends of the steps errs no more than the tolerance either
ROUNDS = 3  # of looking ahead, where magnitudes were wrong
FAR = 10.0  # by so much
LOST = 1e-9  # of the powers between storages: what a lossless model may seem to lose by rounding


def equal_steps(stepper: Stepper, stretch: Segment, x: Any, compiled: bool) -> float:
    """The size of all steps of a stretch: as an adaptive method takes them where they are short. Raises `NotLossless`, `RunFailed`."""
    times, states = _looked_ahead(stepper, stretch, x, compiled)
    for _ in range(ROUNDS):
        if not _measured(stepper, states):
            break
        times, states = _looked_ahead(stepper, stretch, x, compiled)
    _check_lossless(stepper, stretch, times, states)
    sizes = np.diff(times)
    if times[-1] >= stretch.stop and len(sizes) > 1:
        sizes = sizes[:-1]  # the last one is cut
    usual = sizes[FIRST:] if len(sizes) > FIRST else sizes[-1:]
    span = stretch.stop - stretch.start
    return span / float(np.ceil(span / (SHARE * np.quantile(usual, SMALL))))


def _looked_ahead(stepper: Stepper, stretch: Segment, x: Any, compiled: bool) -> tuple[Any, Any]:
    """Ends of some explicit steps, and the states there."""
    magnitude = stepper.tolerances.magnitude
    times, states = [stretch.start], [x]
    try:
        if compiled:
            from .machine import explicit_scout

            solver: Interpreted | CompiledRadau = explicit_scout(stepper, stretch, x)
        else:
            solver = interpreted(stepper, stretch, x)
        while len(times) <= SCOUT and not solver.finished:
            solver.step()
            times.append(float(solver.time))
            states.append(solver.state * magnitude)
    except StepFailed as failed:
        raise stepper.failed(solver, failed.what, stretch.mode) from None
    stepper.count(solver.evaluations)
    return np.array(times), np.array(states)


def _measured(stepper: Stepper, states: Any) -> bool:
    """Whether states stay far below the magnitudes of a coarse run, which loses its way in a long one; then these are what is seen.

    What loses no energy returns to where it was, so a look at its beginning tells more.
    """
    old = stepper.tolerances
    peak = np.abs(states).max(axis=0)
    peak = np.where(old.held | (peak == 0), old.magnitude, np.minimum(peak, old.magnitude))
    if not (old.magnitude > FAR * peak).any():
        return False
    absolute = np.where(old.held, old.absolute, old.relative * peak)
    stepper.tolerances = Tolerances(old.relative, absolute, peak, old.held)
    return True


def _check_lossless(stepper: Stepper, stretch: Segment, times: Any, states: Any) -> None:
    """Whether what is stored stays the same wherever the run comes by."""
    program, fixed = stepper.program, (stepper.inputs, stepper.constants, stretch.mode)
    assert program.stored_energy is not None
    found = program.stored_energy(times, states, *fixed)
    if not np.isfinite(found).all():
        raise RunFailed(
            "the energy that the model stores cannot be computed from its laws between the start and the states of the run; "
            "give the storages by `energy = …`, or leave the solver to choose"
        )
    rates = program.derivative(times, states, *fixed)
    if rates.any() and not found[:, 1:].any():
        raise UsageError(
            "no method keeps the energy of this model: nothing in it stores any; leave the solver to choose"
        )
    flows = found[:, 1:] * rates
    lost = np.abs(flows.sum(axis=1))
    worst = int(np.argmax(lost))
    if lost[worst] > LOST * np.abs(flows).sum(axis=1).max():
        raise NotLossless(float(times[worst]), states[worst], stretch.mode)
