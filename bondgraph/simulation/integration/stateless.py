"""Segment of a model without states: its loops are solved at each instant, along the branch of the solution at its start where there may be several."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array

from ...errors import StepsCollapsed
from ..monitors.extremes import PLACES, ExtremesMonitor
from ..segments.timeline import Segment
from ..segments.trajectory import Kept

if TYPE_CHECKING:
    from ..loops.continuation import Continuation
    from .integration_state import IntegrationState

PANELS = 32  # of a segment
JUMPED = 1e-2  # of an unknown: what it moves by at a jump
CHOSEN = "Newton's method went from the solution before a jump to one of several behind it"


def without_states(stepper: IntegrationState, stretch: Segment, x: Array, last: Kept | None) -> Any:
    """Solve the loops at each instant, each from the solution before it, `last` before the segment; there is nothing to integrate."""
    branch = _branch(stepper, stretch, x)
    if branch is not None:
        _tell_others(stepper, stretch, x, last)

    def states_at(times: Array, exactly: bool = True) -> Any:
        """Return the solutions in the present mode, which are exact in any case."""
        if branch is not None:
            return branch.at(times)
        return stepper.loops.solve_all(times, np.tile(x, (len(times), 1)), stretch.mode)

    def look(times: Array, panels: int) -> None:
        if stepper.extremes is not None:
            _look_between(stepper, stepper.extremes, stretch.up_to(times[0], times[-1]), states_at, panels)
        stepper.watch.look(times, stretch.mode, states_at)

    if branch is None:
        inner = stepper.instants[(stepper.instants > stretch.start) & (stepper.instants < stretch.stop)]
        look(np.array([stretch.start, *inner, stretch.stop]), PANELS)
    before = stretch.start
    while before < stretch.stop:
        inside = stepper.position < len(stepper.instants) and stepper.instants[stepper.position] < stretch.stop
        now = stepper.instants[stepper.position] if inside else stretch.stop
        most = before + stepper.longest
        if branch is not None:
            try:
                most = min(most, branch.beyond(before))
            except StepsCollapsed as told:
                if not stepper.flips_just_ahead(told, stretch) or stepper.flip is None:
                    raise
                return stepper.flip.state
        if now > most:
            now, inside = most, False
        stretch = stepper.follow(before, now, stretch, states_at)
        stop = now if stepper.flip is None else stepper.flip.time
        if branch is not None:
            look(np.array([before, stop]), 1)
        if stepper.powers is not None:
            stepper.add_work(before, stop, states_at, stretch)
        if stepper.history is not None:
            stepper.history.keep((before, stop), states_at, stepper.inputs, stretch.mode, stepper.tolerances.relative)
        if stepper.flip is not None:
            return stepper.flip.state
        x = stepper.loops.solve(now, x, stretch.mode) if branch is None else branch.at(np.array([now]))[0]
        if inside:
            stepper.result.states[stepper.position] = x
            stepper.position += 1
        stepper.keep(now, x, stretch.mode, stretch.start)
        before = now
        if stepper.history is not None and stepper.history.next_cut(now, stretch.stop) < stretch.stop:
            stepper.reached = now  # a delayed signal will jump in this segment, which was unknown when it began
            return x
    return x


def _branch(stepper: IntegrationState, stretch: Segment, x: Array) -> Continuation | None:
    """Return the branch of a solution; None where there surely is no second one: then it need not be followed. The proof is for the signs in the text."""
    loops, program = stepper.loops, stepper.program
    proved = stepper.unique and (np.sign(stepper.constraints.parameters) == np.sign(program.defaults)).all()
    if proved or loops.affine or not len(loops.magnitude) or not stretch.start < stretch.stop:
        return None
    from ..loops.continuation import Continuation

    return Continuation(loops, stretch.start, x, stretch.mode, stretch.stop, _places(stepper, stretch))


def _tell_others(stepper: IntegrationState, stretch: Segment, x: Array, last: Kept | None) -> None:
    """Note once the other solutions where a law has jumped away from a branch: Newton's method has gone to one of them."""
    if last is None:
        stays = stepper.events is None or not stepper.events.log
    else:
        stays = (np.abs(x - last.state) <= JUMPED * np.maximum(np.abs(last.state), np.abs(x))).all()
    if stays or any(CHOSEN in note for note in stepper.result.notes):
        return
    from ..initialization.consistent_start import in_words
    from ..loops.branches import other_solutions

    if others := other_solutions(stepper.loops, stretch.start, x, stretch.mode):
        one, *rest = in_words(stepper.program, np.array([x, *others]), np.arange(len(x)))
        stepper.result.notes.append(f"at t = {stretch.start:.9g} s {CHOSEN}: {one}; not {'; '.join(rest)}")


def _places(stepper: IntegrationState, stretch: Segment) -> Any:
    """Return the places of narrow signals on a segment."""
    functions = stepper.program.time_functions
    return stepper.signals(stretch).times if functions is not None and functions.narrow else np.empty(0)


def _look_between(
    stepper: IntegrationState,
    extremes: ExtremesMonitor,
    stretch: Segment,
    states_at: Callable[[Array], Any],
    panels: int,
) -> None:
    """Search the solutions of a segment for the extremes of the outputs, on panels, which the places of narrow signals divide."""
    edges = np.linspace(stretch.start, stretch.stop, panels + 1)
    edges = np.unique(np.clip(np.concatenate([edges, _places(stepper, stretch)]), *edges[[0, -1]]))
    times = np.minimum(edges[:-1, None] + np.diff(edges)[:, None] * PLACES, stretch.stop)
    states = states_at(times.reshape(-1))
    extremes.look(times, states.reshape(*times.shape, states.shape[-1]), stretch.mode)
