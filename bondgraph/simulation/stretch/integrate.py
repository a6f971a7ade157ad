"""A run over smooth segments: the integrator stops and restarts where the right-hand side jumps or has a kink."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Program

from ..closed.constraints import Constraints
from ..segments.timeline import Segment
from ..segments.trajectory import Tolerances, Trajectory
from ..steps.methods import AUTOMATIC
from ..watch.choice import Choice
from ..watch.validity import Watch
from .segment_integrator import SegmentIntegrator
from .stepper import ModeTruncation, Powers

if TYPE_CHECKING:
    from ..events.events import Events
    from ..events.history import History


def integrate(
    program: Program,
    constants: Any,
    inputs: Any,
    state: Any,
    stretches: Sequence[Segment],
    instants: Any,
    tolerances: Callable[[], Tolerances],
    powers: Powers | None,
    watch: Watch,
    choice: Choice | None,
    linear: bool,
    constraints: Constraints,
    events: Events | None = None,
    off: tuple[str, ...] = (),
    history: History | None = None,
    into: Trajectory | None = None,
    solver: str = AUTOMATIC,
    leaving: ModeTruncation | None = None,
) -> Trajectory:
    """Integrate over the segments, into a trajectory that keeps the part before an exception. Raises `RunFailed` with time and variable.

    `watch` checks each accepted step. `linear`: the rates are affine in the states; then the tolerances, which need a pilot run, may never be
    evaluated. `solver`: one of `methods.SOLVERS`. `powers` are integrated along the solution, outside the error control. `leaving`: modal truncation
    at a bandwidth.
    """
    exact = solver in (AUTOMATIC, "exponential")
    fixed = (program, constants, inputs, instants, tolerances, powers, watch, constraints, into)
    if events is not None:
        from .event_integrator import EventIntegrator

        return EventIntegrator.through(events, off, fixed, state, stretches, choice, linear and exact, history, solver)
    stepper = SegmentIntegrator(*fixed)
    stepper.choice, stepper.solver, stepper.leaving = choice, solver, leaving
    stepper.linear = linear and exact and not constraints and history is None
    stepper.remember(history)
    x = np.array(state, dtype=float)
    for number, stretch in enumerate(stretches):
        if number:
            stepper.check_forced(stretch.start, stretches[number - 1].mode, stretch.mode, x)
        x = stepper.run_to_end(stretch, x)
        if stepper.result.handover is not None:
            break
    return stepper.done(x, stretches[-1].mode)
