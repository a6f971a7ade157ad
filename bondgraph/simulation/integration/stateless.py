"""Segment of a model without states: its loops are solved at each instant."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array

from ..monitors.extremes import PLACES, ExtremesMonitor
from ..segments.timeline import Segment

if TYPE_CHECKING:
    from .integration_state import IntegrationState

PANELS = 32  # of a segment


def without_states(stepper: IntegrationState, stretch: Segment, x: Array) -> Any:
    """Solve the loops at each instant, each from the solution before it; there is nothing to integrate."""

    def states_at(times: Array, exactly: bool = True) -> Any:
        """Return the solutions in the present mode, which are exact in any case."""
        return stepper.loops.solve_all(times, np.tile(x, (len(times), 1)), stretch.mode)

    if stepper.extremes is not None:
        _look_between(stepper, stepper.extremes, stretch, states_at)
    inner = stepper.instants[(stepper.instants > stretch.start) & (stepper.instants < stretch.stop)]
    stepper.watch.look(np.array([stretch.start, *inner, stretch.stop]), stretch.mode, states_at)
    before = stretch.start
    while before < stretch.stop:
        inside = stepper.position < len(stepper.instants) and stepper.instants[stepper.position] < stretch.stop
        now = stepper.instants[stepper.position] if inside else stretch.stop
        if now - before > stepper.longest:
            now, inside = before + stepper.longest, False
        stretch = stepper.follow(before, now, stretch, states_at)
        stop = now if stepper.flip is None else stepper.flip.time
        if stepper.powers is not None:
            stepper.add_work(before, stop, states_at, stretch)
        if stepper.history is not None:
            stepper.history.keep((before, stop), states_at, stepper.inputs, stretch.mode, stepper.tolerances.relative)
        if stepper.flip is not None:
            return stepper.flip.state
        x = stepper.loops.solve(now, x, stretch.mode)
        if inside:
            stepper.result.states[stepper.position] = x
            stepper.position += 1
        stepper.keep(now, x, stretch.mode, stretch.start)
        before = now
        if stepper.history is not None and stepper.history.next_cut(now, stretch.stop) < stretch.stop:
            stepper.reached = now  # a delayed signal will jump in this segment, which was unknown when it began
            return x
    return x


def _look_between(
    stepper: IntegrationState, extremes: ExtremesMonitor, stretch: Segment, states_at: Callable[[Array], Any]
) -> None:
    """Search the solutions of a segment for the extremes of the outputs, on panels, which the places of narrow signals divide."""
    edges, functions = np.linspace(stretch.start, stretch.stop, PANELS + 1), stepper.program.time_functions
    if functions is not None and functions.narrow:
        edges = np.unique(np.clip(np.concatenate([edges, stepper.signals(stretch).times]), *edges[[0, -1]]))
    times = np.minimum(edges[:-1, None] + np.diff(edges)[:, None] * PLACES, stretch.stop)
    states = states_at(times.reshape(-1))
    extremes.look(times, states.reshape(*times.shape, states.shape[-1]), stretch.mode)
