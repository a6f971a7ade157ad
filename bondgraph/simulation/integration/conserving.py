"""Preparation of an energy-conserving method: check that the model is lossless, and choose the equal size of all its steps."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array

from ...errors import NotLossless, RunFailed, UsageError
from ..integrators.radau import StepFailed
from ..segments.timeline import Segment
from ..segments.trajectory import Tolerances
from .native_integrator import explicit_scout

if TYPE_CHECKING:
    from .integration_state import IntegrationState

SCOUT = 1000  # steps of an adaptive pilot run
FIRST = 3  # number of its first steps, which are small and not counted
SMALL = 0.05  # quantile of its step sizes from which the size is taken
SHARE = 0.6  # fraction of such a step: then the dense output is within the tolerance too
ROUNDS = 3  # most pilot runs, where magnitudes were wrong
FAR = 10.0  # factor by which magnitudes count as wrong
LOST = 1e-9  # relative to the powers between storages: loss of a lossless model by rounding


def equal_steps(stepper: IntegrationState, stretch: Segment, x: Array) -> float:
    """Return the size of all steps of a segment: that of the short steps of an adaptive method. Raises `NotLossless`, `RunFailed`."""
    times, states = _looked_ahead(stepper, stretch, x)
    for _ in range(ROUNDS):
        if not _measured(stepper, states):
            break
        times, states = _looked_ahead(stepper, stretch, x)
    _check_lossless(stepper, stretch, times, states)
    sizes = np.diff(times)
    if times[-1] >= stretch.stop and len(sizes) > 1:
        sizes = sizes[:-1]  # the last step is cut short
    usual = sizes[FIRST:] if len(sizes) > FIRST else sizes[-1:]
    span = stretch.stop - stretch.start
    return span / float(np.ceil(span / (SHARE * np.quantile(usual, SMALL))))


def _looked_ahead(stepper: IntegrationState, stretch: Segment, x: Array) -> tuple[Any, Any]:
    """Return the ends of some explicit steps of a pilot run, and the states there."""
    magnitude = stepper.tolerances.magnitude
    times, states = [stretch.start], [x]
    try:
        solver = explicit_scout(stepper, stretch, x)
        while len(times) <= SCOUT and not solver.finished:
            solver.step()
            times.append(float(solver.time))
            states.append(solver.state * magnitude)
    except StepFailed as failed:
        raise stepper.failed(solver, failed.what, stretch.mode) from None
    stepper.count(solver.evaluations)
    return np.array(times), np.array(states)


def _measured(stepper: IntegrationState, states: Array) -> bool:
    """Return True, and reduce the magnitudes, if states stay far below those of the coarse run, which is inaccurate in a long run.

    A lossless motion returns to where it was, so its beginning gives better magnitudes.
    """
    old = stepper.tolerances
    peak = np.abs(states).max(axis=0)
    peak = np.where(old.held | (peak == 0), old.magnitude, np.minimum(peak, old.magnitude))
    if not (old.magnitude > FAR * peak).any():
        return False
    absolute = np.where(old.held, old.absolute, old.relative * peak)
    stepper.tolerances = Tolerances(old.relative, absolute, peak, old.held, old.guessed)
    return True


def _check_lossless(stepper: IntegrationState, stretch: Segment, times: Array, states: Array) -> None:
    """Raise `NotLossless` if the stored energy changes at a state of the run; also `RunFailed` or `UsageError` if there is none to conserve."""
    program, fixed = stepper.program, (stepper.inputs, stepper.constants, stretch.mode)
    assert program.stored_energy is not None
    found = program.stored_energy(times, states, *fixed)
    if not np.isfinite(found).all():
        raise RunFailed(
            "BR716", "the energy that the model stores cannot be computed from its laws between the start and the states of the run;",
            "give the storages by `energy = …`, or leave the solver to choose",
        )  # fmt: skip
    rates = program.derivative(times, states, *fixed)
    if rates.any() and not found[:, 1:].any():
        raise UsageError(
            "BR717", "no method keeps the energy of this model: nothing in it stores any;", "leave the solver to choose"
        )
    flows = found[:, 1:] * rates
    lost = np.abs(flows.sum(axis=1))
    worst = int(np.argmax(lost))
    if lost[worst] > LOST * np.abs(flows).sum(axis=1).max():
        failed = NotLossless("BR720", f"at t = {times[worst]:.9g} s the model gains or loses energy")
        raise failed.at(float(times[worst]), states[worst], stretch.mode)
