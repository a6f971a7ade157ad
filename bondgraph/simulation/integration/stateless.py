"""Segment of a model without states: its loops are solved at each instant."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array

from ..segments.timeline import Segment

if TYPE_CHECKING:
    from .integration_state import IntegrationState


def without_states(stepper: IntegrationState, stretch: Segment, x: Array) -> Any:
    """Solve the loops at each instant, each from the solution before it; there is nothing to integrate."""
    inner = stepper.instants[(stepper.instants > stretch.start) & (stepper.instants < stretch.stop)]
    stepper.watch.look(
        np.array([stretch.start, *inner, stretch.stop]), stretch.mode, partial(_loops_at, stepper, x, stretch)
    )
    before = stretch.start
    while before < stretch.stop:
        inside = stepper.position < len(stepper.instants) and stepper.instants[stepper.position] < stretch.stop
        now = stepper.instants[stepper.position] if inside else stretch.stop
        if now - before > stepper.longest:
            now, inside = before + stepper.longest, False
        stretch = stepper.follow(before, now, stretch, partial(_loops_exactly, stepper, x, stretch))
        if stepper.powers is not None:
            stop = now if stepper.flip is None else stepper.flip.time
            stepper.add_work(before, stop, partial(_loops_at, stepper, x, stretch), stretch)
        if stepper.history is not None:
            stop = now if stepper.flip is None else stepper.flip.time
            stepper.history.keep(before, stop, partial(_loops_at, stepper, x, stretch), stepper.inputs, stretch.mode)
        if stepper.flip is not None:
            return stepper.flip.state
        x = stepper.loops.solve(now, x, stretch.mode)
        if inside:
            stepper.result.states[stepper.position] = x
            stepper.position += 1
        stepper.keep(now, x, stretch.mode, stretch.start)
        before = now
    return x


def _loops_exactly(stepper: IntegrationState, x: Array, stretch: Segment, times: Array, _: bool) -> Any:
    return _loops_at(stepper, x, stretch, times)


def _loops_at(stepper: IntegrationState, x: Array, stretch: Segment, times: Array) -> Any:
    return stepper.loops.solve_all(times, np.tile(x, (len(times), 1)), stretch.mode)
